"""Several recordings in one diagnosis, from the command line: the example of the docs, and mistakes."""

import json
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from told import refusal

from dtbacklash import cli

DOCS = Path(__file__).parents[2] / "docs" / "usage.md"
K3 = 3e7
#: of a channel, as a share of its standard deviation
NOISE = 2e-3


def commands() -> list[list[str]]:
    """The words of the example in the docs."""
    section = DOCS.read_text(encoding="utf-8").partition("## Several recordings")[2]
    block = section.partition("```sh\n")[2].partition("```")[0]
    return [shlex.split(line) for line in block.splitlines()]


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """The two recordings of the docs with noise; the second has another channel."""
    monkeypatch.chdir(tmp_path)
    *runs, diagnose = commands()
    for number, (_, *words) in enumerate(runs):
        assert cli.main([*words, f"out=run_{number}"]) == 0
    rng = np.random.default_rng(3)
    for name, more in (("fast.csv", []), ("slow.csv", ["v"])):
        frame = pd.read_csv(name)
        noisy = {c: frame[c] + rng.normal(0.0, NOISE * frame[c].std(), len(frame)) for c in ("x", *more)}
        frame.assign(**noisy)[["t", "u", *noisy]].to_csv(name, index=False)
    return diagnose[1:]


@pytest.mark.check
def test_the_example_of_the_docs_finds_the_spring(recorded, tmp_path, capsys):
    assert cli.main([*recorded, "out=found"]) == 0
    shown = capsys.readouterr().out
    found = json.loads((tmp_path / "found" / "diagnosis.json").read_text(encoding="utf-8"))
    (finding,) = found["findings"]
    assert (finding["location"], finding["effect"]) == ("spring", "cubic_stiffness")
    low, high = finding["parameters"]["k3"]["ci95"]
    assert low < K3 < high
    assert high - low < 0.02 * K3
    fast, slow = found["recordings"]
    assert [r["name"] for r in (fast, slow)] == ["fast.csv", "slow.csv"]
    assert [r["sample_time_s"] for r in (fast, slow)] == pytest.approx([1e-3, 2e-3])
    for one in (fast, slow):
        assert one["judged"] == pytest.approx(0.2 * one["samples"], rel=0.01)
        assert one["held_out"]["extended"] == pytest.approx(NOISE, rel=0.3)
        assert one["held_out"]["nominal"] > 3.0 * NOISE
        assert one["name"] in shown
    notes = " ".join(found["notes"])
    assert "v is in slow.csv only." in notes
    page = (tmp_path / "found" / "report.html").read_text(encoding="utf-8")
    assert "Recordings fast.csv, slow.csv, compared" in page
    assert '<h2 id="recording">The recording</h2>' in page


@pytest.mark.nightly
def test_one_of_them_judges_alone(recorded, tmp_path):
    assert cli.main([*recorded, "validation=slow.csv", "out=found"]) == 0
    found = json.loads((tmp_path / "found" / "diagnosis.json").read_text(encoding="utf-8"))
    assert [f["effect"] for f in found["findings"]] == ["cubic_stiffness"]
    fast, slow = found["recordings"]
    assert fast["judged"] == 0
    assert fast["held_out"] is None
    assert slow["held_out"]["extended"] == pytest.approx(NOISE, rel=0.3)
    assert "slow.csv judges alone." in found["notes"]


@pytest.mark.check
def test_what_is_its_own_and_what_is_given_is_said_on_the_command_line(recorded, tmp_path):
    given = "given={slow: {spring.stiffness: 1900 N/m}}"
    assert cli.main([*recorded, "own=[mass.mass]", given, "search=none", "hold_out=turns", "out=found"]) == 0
    found = json.loads((tmp_path / "found" / "diagnosis.json").read_text(encoding="utf-8"))
    assert {"m in fast.csv", "m in slow.csv", "k"} <= found["calibration"]["parameters"].keys()
    assert "m" not in found["calibration"]["parameters"]
    assert any("Each recording is left out in turn" in note for note in found["notes"])
    assert [one["judged"] for one in found["recordings"]] == [one["samples"] for one in found["recordings"]]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["recording=[a.csv,z.csv]"], "recording=z.csv: no such file"),
        (["recording=z*.csv"], "recording=z*.csv: no file has such a name"),
        (["recording=[a.csv,b.csv]"], "recording=b.csv: "),
        (["recording=[a.csv,a.csv]"], "recording=a.csv (2): is equal to a.csv (1), sample by sample: give each once"),
        (["recording=[a.csv,c.csv]", "validation=3"], "validation=3: is none of the recordings; choose one of 1"),
        (["recording=[a.csv,c.csv]", "validation=z.csv"], "validation=z.csv: no such file"),
        (["recording=[a.csv,c.csv]", "recording.path=b.csv"], "recording.path=b.csv: is the file of one recording"),
        (["recording=[a.csv,c.csv]", "own=[mass.weight]"], "own=mass.weight: is no parameter or effect of this rig"),
        (["recording=[a.csv,c.csv]", "own={d: [m]}"], "own=d: is none of the recordings; choose one of 1 (a.csv)"),
        (["recording=[a.csv,c.csv]", "given={c: {m: 3 mm}}"], "given.c.m=3 mm: must be in kg, as m is"),
        (["recording=[a.csv,more/a.csv]", "own={a: [m]}"], "own=a: is none of the recordings; choose one of 1 ("),
        (["recording=[a.csv,c.csv]", "hold_out=d"], "hold_out=d: is none of the recordings; choose one of 1 (a.csv)"),
        (["recording=[a.csv,c.csv]", "own=5"], "own=5: must be a list, as [carriage.mass]"),
        (["recording=[a.csv,c.csv]", "own=[[m]]"], "own=['m']: is no parameter or effect of this rig"),
        (["recording=[a.csv,c.csv]", "given=[m]"], "given=['m']: must be a mapping"),
        (["recording=a.csv", "hold_out=turns"], "hold_out=turns: leaves out one of several: give several"),
        (
            ["recording=a.csv", "compare=change"],
            "compare=change: is of two recordings",
        ),
        (["recording=[a.csv,c.csv]", "compare=change", "hold_out=c"], "compare=change: needs both recordings"),
    ],
)
def test_mistakes_end_in_one_line(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rng, t = np.random.default_rng(0), 1e-3 * np.arange(1000)
    (tmp_path / "more").mkdir()
    for name, channel in (("a.csv", "x"), ("b.csv", "w"), ("c.csv", "x"), ("more/a.csv", "x")):
        moves = 1e-3 * np.cumsum(rng.normal(size=1000))
        pd.DataFrame({"t": t, "u": rng.normal(size=1000), channel: moves}).to_csv(name, index=False)
    line = refusal(capsys, "diagnose", *words, "rig=oscillator", "recording.trust_units=true", "out=found")
    assert line.startswith(said)
    assert not (tmp_path / "found").exists()


@pytest.mark.nightly
def test_three_files_lead_to_a_controller_that_uses_the_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    section = DOCS.read_text(encoding="utf-8").partition("### From three files to a controller")[2]
    *runs, diagnose, nominal, found = [
        shlex.split(line, comments=True)[1:]
        for line in section.partition("```sh\n")[2].partition("```")[0].splitlines()
    ]
    for number, words in enumerate(runs):
        assert cli.main([*words, f"out=run_{number}"]) == 0
    assert cli.main(diagnose) == 0
    said = json.loads((tmp_path / "found" / "diagnosis.json").read_text(encoding="utf-8"))
    (friction,) = [f for f in said["findings"] if f["confidence"] == "sure"]
    assert (friction["location"], friction["effect"]) == ("motor_bearing", "coulomb_friction")
    assert friction["parameters"]["torque"]["value"] == pytest.approx(0.02, rel=0.05)
    assert len(friction["evidence"]["size"]["recordings"]) == 3
    assert min(friction["evidence"]["size"]["recordings"]) > 1.0
    overshoots = []
    for words, folder in ((nominal, "nominal"), (found, "told")):
        assert cli.main([*words, f"out={folder}"]) == 0
        summary = json.loads((tmp_path / folder / "summary.json").read_text(encoding="utf-8"))
        overshoots.append(summary["overshoot_pct_max"])
    assert overshoots[1] < 0.5 * overshoots[0]
