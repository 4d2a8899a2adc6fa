"""``dtb run experiment=close_the_loop``: from a recording to a controller that works again, as a person would do it."""

import json

import pandas as pd
import pytest

from dtbacklash import cli

pytestmark = pytest.mark.check

MACHINE = ("rig.parameters.k.value=8000", "rig.effects.motor_bearing.coulomb_friction.torque=0.03")
LOOP = ("duration_s=62", "profile=constant", "profile.start_deg=40", "controller.gap_hat_deg=40")


def test_what_is_found_makes_the_loop_as_good_as_the_truth(tmp_path, monkeypatch, capsys):
    """From a recording of 12 s, so that the test is quick; the study takes it whole."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("dtbacklash.closed_loop_check.RECORDED_S", 12.0)
    assert cli.main(["run", "experiment=close_the_loop", *MACHINE, *LOOP, "out=closed"]) == 0
    folder = tmp_path / "closed"
    files = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}
    assert {
        "close_the_loop.csv", "summary.json", "report.html", "recording.parquet", "figures/close_the_loop.png",
        "found/rig.yaml", "found/diagnosis.json", "found/report.html",
    } <= files  # fmt: skip
    rows = pd.read_csv(folder / "close_the_loop.csv").set_index("belief")
    assert rows.loc["both", "overshoot_pct"] < max(1.3 * rows.loc["truth", "overshoot_pct"], 1.0)
    assert rows.loc["both", "overshoot_pct"] < 0.5 * rows.loc["nominal", "overshoot_pct"]
    # from command, angle and output alone, dry friction of the motor is a dead zone of the amplifier
    diagnosis = json.loads((folder / "found" / "diagnosis.json").read_text(encoding="utf-8"))
    told = [(f["effect"], *(a["effect"] for a in f["also_fits"])) for f in diagnosis["findings"]]
    assert any("coulomb_friction" in names for names in told)
    assert list(pd.read_parquet(folder / "recording.parquet").columns) == ["t", "r", "u", "theta_m", "q3"]
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert summary["overshoot_pct_max"] == rows.loc["both", "overshoot_pct"]
    assert "both" in capsys.readouterr().out
    words = ("model=closed/found/rig.yaml", "sensors=encoder", "figures=false", "out=run")
    assert cli.main(["run", *MACHINE, *LOOP, *words]) == 0
    alone = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    assert alone["overshoot_pct_max"] == rows.loc["both", "overshoot_pct"]


def test_a_loop_without_a_twin_is_refused(process, tmp_path):
    done = process("run", "experiment=close_the_loop", "controller=nimc_fixed", "out=closed")
    assert done.returncode == 2
    assert done.stderr.startswith("dtb: error: controller=nimc_fixed: closing the loop needs one that the twin")
    assert not (tmp_path / "closed").exists()
