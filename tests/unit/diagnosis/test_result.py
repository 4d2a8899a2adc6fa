"""The typed result: exactly the keys and forms of diagnosis.json, and nothing that JSON does not know."""

import json
import math
from dataclasses import replace

import diagnosed
import numpy as np
import pytest

from dtbacklash.diagnosis.explain.save import save
from dtbacklash.diagnosis.explain.sentences import summary
from dtbacklash.diagnosis.findings import Alternative, Evidence, Ground, Instead
from dtbacklash.diagnosis.plot_data import Explained, FreeRunning, Left, ModelErrors
from dtbacklash.diagnosis.result import UNEXPLAINED, Candidate, Located

KEYS = [
    "verdict", "summary", "findings", "recalibrated", "fit", "free_running", "candidates", "located", "checks",
    "limits", "units", "next_experiment", "notes", "explained", "calibration", "settings",
]  # fmt: skip


@pytest.mark.parametrize("name", diagnosed.EACH)
def test_the_document_has_its_keys_and_survives_json(name):
    document = diagnosed.EACH[name]().to_json()
    assert list(document) == KEYS
    assert json.loads(json.dumps(document, allow_nan=False)) == document


def test_findings_and_parameters_are_what_they_always_were():
    instead = Instead("gear", "backlash", 0.1, "rad", 2.5)
    made = diagnosed.missing()
    made = replace(made, findings=(replace(made.findings[0], instead=instead),))
    (row,) = made.to_json()["findings"]
    assert row == {
        "location": "motor_bearing",
        "effect": "coulomb_friction",
        "parameters": {"torque": {"value": 0.02, "unit": "N m", "ci95": [0.0195, 0.0205]}},
        "also_fits": [{"location": "amplifier", "effect": "dead_zone"}],
        "when": "84 % of the mismatch lies within 50 ms of a velocity reversal",
        "instead": {"location": "gear", "effect": "backlash", "value": 0.1, "unit": "rad", "times_the_error": 2.5},
        "sentence": "Dry (Coulomb) friction of 0.02 N m acts at the motor bearing.",
        "confidence": "partial",
        "evidence": None,
    }
    assert made.to_json()["recalibrated"]["k"] == {
        "nominal": 10000.0, "value": 9020.0, "unit": "N/m", "ci95": [9001.0, 9039.0],
    }  # fmt: skip
    row = made.to_json()["checks"][0]
    assert list(row) == ["check", "statistic", "operator", "threshold", "pass", "comment", "source"]
    assert row["pass"] is True
    assert Located("motor", "motor", 0.5).to_json() == {"block": "motor", "location": "motor", "share": 0.5}
    left = diagnosed.unexplained().to_json()["located"]
    assert list(left) == ["block", "location", "share", "state", "state_unit", "effort_unit", "explained", "recovered"]
    assert len(left["recovered"][0]) == 3


def test_what_a_name_rests_on_and_what_is_left_stand_in_the_document():
    made = diagnosed.missing()
    grounds = Evidence(
        Ground(False, 1.1, 2.0, 0.5, Alternative("gear", "backlash")), Ground(True, share=0.97), Ground(True)
    )
    unknown = {"mass_3": {"before": 0.4, "after": 0.01, "force": 2.0, "unit": "N"}}
    much = Explained(
        None, 0.97, {"q3": Left(1e-6, "m", 0.01, 2.0)}, True, unknown=unknown, causes={"gear.backlash": 0.97}
    )
    document = replace(made, findings=(replace(made.findings[0], evidence=grounds),), explained=much).to_json()
    none = {"stands": True, "ratio": None, "t": None, "agree": None}
    rival = {"location": "gear", "effect": "backlash"}
    assert document["findings"][0]["evidence"] == {
        "where": {"stands": False, "ratio": 1.1, "t": 2.0, "agree": 0.5, "against": rival},
        "law": {**none, "share": 0.97},
        "size": none,
    }
    assert document["explained"] == {
        "free_running": None, "compared": 0.97, "enough": True,
        "left": {"q3": {"rms": 1e-6, "unit": "m", "of_motion": 0.01, "floors": 2.0}},
        "unknown": unknown, "causes": {"gear.backlash": 0.97},
    }  # fmt: skip


MOVED = "k = 9.02e+03 N/m"


@pytest.mark.parametrize(
    ("verdict", "looked", "enough", "said"),
    [
        ("parameters", True, None, f"No physics is missing: recalibrated parameters explain the recording ({MOVED})."),
        ("parameters", True, True, f"With recalibrated parameters ({MOVED}) what is left is what was called enough."),
        ("parameters", False, None, f"With recalibrated parameters ({MOVED}) what is left is the sensors' noise."),
        ("consistent", False, True, "The recording agrees with the rig: what is left is what was called enough."),
        ("unexplained", False, None, ""),
    ],
)  # fmt: skip
def test_no_physics_is_said_to_be_absent_that_was_not_looked_for_or_did_not_matter(verdict, looked, enough, said):
    moved = {"k": diagnosed.parameters().recalibrated["k"]}
    where = diagnosed.unexplained().located
    assert summary(verdict, (), moved, where, looked, enough) == said


@pytest.mark.parametrize("open_one", ["where", "law", "size", ""])
def test_a_name_is_sure_where_place_law_and_size_stand(open_one):
    assert Evidence(*(Ground(part != open_one) for part in ("where", "law", "size"))).sure == (not open_one)


def test_where_nothing_explains_what_is_left_no_place_is_said():
    there = diagnosed.unexplained().located
    nowhere = replace(there, shown=False)
    said, silent = (summary(UNEXPLAINED, (), {}, where) for where in (there, nowhere))
    nothing = "but nothing in the catalogue was found that explains it"
    assert said == f"The mismatch is real and lies at or near motor bearing, {nothing}."
    assert silent == f"The mismatch is real, {nothing}, and nothing shows where it lies."


def test_numbers_that_json_has_not_become_null(tmp_path):
    made = diagnosed.missing()
    odd = replace(made.findings[0].parameters["torque"], ci95=(np.float64(0.01), math.inf))
    finding = replace(made.findings[0], parameters={"torque": odd})
    free = FreeRunning(ModelErrors(None, math.nan, 0.1), ModelErrors(1.0, None, np.float64(0.2)))
    made = replace(
        made, findings=(finding,), free_running=free, candidates=(Candidate("gear", "backlash", math.nan, None, ""),)
    )
    save(made, tmp_path)
    document = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    assert document["findings"][0]["parameters"]["torque"]["ci95"] == [0.01, None]
    assert document["free_running"] == {
        "train": {"nominal": None, "recalibrated": None, "extended": 0.1},
        "held_out": {"nominal": 1.0, "recalibrated": None, "extended": 0.2},
        "window_s": None,
    }
    assert document["candidates"][0]["score"] is None
