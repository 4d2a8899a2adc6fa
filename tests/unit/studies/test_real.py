"""The tables of the real recordings: made of the committed data, in units that one can read, and never by hand."""

from pathlib import Path

import pytest

from dtbacklash.errors import UserError
from dtbacklash.files import read_json
from dtbacklash.recording import load_mapping
from studies import real

DOCS = Path(__file__).resolve().parents[3] / "docs"
CARRIAGE = {
    "verdict": "missing_physics",
    "findings": [{
        "location": "carriage", "effect": "viscous_friction", "confidence": "sure", "sentence": "", "also_fits": [],
        "parameters": {"coefficient": {"value": 196.5, "unit": "N s/m", "ci95": [187.0, 206.0]}},
    }],
    "recalibrated": {"M": {"nominal": 95.0, "value": 96.0, "unit": "kg", "ci95": [95.5, 96.5]}},
    "located": None,
    "fit": {"channels": ["qm"], "noise_floor": 3e-5,
            "train": {"nominal": 0.02, "recalibrated": 0.016, "extended": 3e-4},
            "held_out": {"nominal": 0.0217, "recalibrated": 0.0166, "extended": 3.14e-4}},
    "free_running": {"train": {"nominal": None, "recalibrated": 40.0, "extended": 0.01},
                     "held_out": {"nominal": None, "recalibrated": 50.0, "extended": 0.05}},
}  # fmt: skip


def made(case):
    return real.summary(CARRIAGE, {"qm": (0.1, "m")}, 0.3) | {"samples": 24841, "seconds": 222.2}


@pytest.fixture
def docs(tmp_path):
    (tmp_path / real.PAGE).write_text(f"before\n{real.BEGIN}\n{real.END}\nafter\n", encoding="utf-8")
    return tmp_path


def test_errors_are_in_units_and_values_beside_what_is_known(docs):
    for _ in range(2):
        real.make(real.CASES[:1], docs, made)
    text = (docs / real.PAGE).read_text(encoding="utf-8")
    assert text.startswith("before\n")
    assert text.endswith("\nafter\n")
    for said in (
        "dtb diagnose recording=emps out=emps\n",
        "| EMPS | `missing_physics` | viscous_friction at `carriage` |  | 24841 | 222 s |",
        "| EMPS | 2.17 % | 1.66 % | 0.0314 % | 0.003 % |",
        # 0.05 of 0.1 m on the held-out 30 %; of all of it the root of 0.7 * 1 mm^2 + 0.3 * 25 mm^2
        "| EMPS | ran away | 5 m | 5 mm | 2.86 mm |",
        "| EMPS | viscous_friction at `carriage`: coefficient | 196 ± 10 N s/m | 203.5 N s/m (pub) |",
        "| EMPS | `M`, nominal 95 kg |",
    ):
        assert said in text, said


def test_a_finding_that_is_not_sure_is_marked_and_what_is_left_has_a_place(docs):
    partial = [{**finding, "confidence": "partial"} for finding in CARRIAGE["findings"]]
    rest = {"location": "motor", "state": "speed"}
    changed = {"verdict": "unexplained", "findings": partial, "located": rest}
    real.make(real.CASES[:1], docs, lambda case: made(case) | changed)
    text = (docs / real.PAGE).read_text(encoding="utf-8")
    assert "| EMPS | `unexplained` | viscous_friction at `carriage` (partial) | at `motor`, over speed |" in text


def test_a_page_that_is_edited_meanwhile_keeps_the_edit(docs):
    def edited(case):
        page = docs / real.PAGE
        page.write_text(page.read_text(encoding="utf-8") + "edited\n", encoding="utf-8")
        return made(case)

    real.make(real.CASES[:1], docs, edited)
    assert (docs / real.PAGE).read_text(encoding="utf-8").endswith(f"{real.END}\nafter\nedited\n")


def test_errors_of_several_channels_are_relative(docs):
    two = made(None) | {"sizes": {"theta": [20.0, "rad"], "omega": [3.0, "rad/s"]}}
    real.make(real.CASES[:1], docs, lambda case: two)
    assert "| EMPS | ran away | 50 times | 5 % | 2.86 % |" in (docs / real.PAGE).read_text(encoding="utf-8")


def test_what_is_made_anew_leaves_the_others(docs):
    real.make(real.CASES[:2], docs, made)
    before = {path: path.read_bytes() for path in docs.rglob("*.*")}
    real.make(real.CASES[1:2], docs, made)
    assert {path: path.read_bytes() for path in docs.rglob("*.*")} == before


def test_a_page_without_a_place_for_the_tables_is_refused_before_the_work(tmp_path):
    (tmp_path / real.PAGE).write_text("nothing", encoding="utf-8")
    with pytest.raises(UserError, match=r"needs a real-recordings\.md with the lines"):
        real.make(real.CASES[:1], tmp_path, lambda case: pytest.fail("worked"))
    assert not (tmp_path / real.DATA).exists()


def test_a_diagnosis_that_is_not_there_is_refused():
    with pytest.raises(SystemExit, match="no diagnosis 'nope'; choose of emps, emps_half, silverbox"):
        real.main(["docs", "nope"])


@pytest.mark.parametrize("case", real.CASES, ids=lambda c: c.name)
def test_every_case_names_a_recording_and_places_that_there_are(case):
    from dtbacklash import load_rig
    from dtbacklash.physics.catalogue import find

    name, _, part = case.recording.partition(":")
    mapping = load_mapping(name)
    assert not part or part in mapping.parts
    judged = case.validation.partition(":")
    assert not case.validation or judged[2] in mapping.parts or case.validation in mapping.files
    rig = load_rig(mapping.rig)
    for key in case.known:
        location, effect, parameter = key.split(".")
        known = {p.name for p in find(rig.kind_at(location), effect, key).parameters}
        assert parameter in known


def test_the_committed_tables_are_made_of_the_committed_data():
    text = (DOCS / real.PAGE).read_text(encoding="utf-8")
    assert real.BEGIN + text.split(real.BEGIN)[1].split(real.END)[0] + real.END == real.block(DOCS)
    assert all(read_json(path).get("verdict") for path in (DOCS / real.DATA).glob("*.json"))
