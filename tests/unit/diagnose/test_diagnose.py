"""The whole diagnosis on simulated recordings; other integrators and real recordings have tests of their own."""

from dataclasses import replace

import numpy as np
import pytest

from dtbacklash.diagnose import diagnose, diagnose_records
from dtbacklash.diagnose.evidence import Evidence
from dtbacklash.diagnose.free import nominal_free
from dtbacklash.diagnose.refit import fit
from dtbacklash.diagnose.settings import settings
from dtbacklash.errors import UserError
from dtbacklash.recording.model import Recording

from .conftest import recorded

KEYS = {"verdict", "summary", "findings", "recalibrated", "fit", "candidates", "next_experiment"}


def test_nothing_missing_is_consistent(rig):
    document = diagnose_records(rig, [recorded(rig)]).to_json()
    assert document["verdict"] == "consistent"
    assert not document["findings"]
    assert set(document) >= KEYS


def test_a_wrong_parameter_is_not_physics(rig):
    document = diagnose_records(rig, [recorded(rig.with_parameters({"k": 1.08e4}))]).to_json()
    assert document["verdict"] == "parameters"
    assert not document["findings"]
    low, high = document["recalibrated"]["k"]["ci95"]
    assert low < 1.08e4 < high


@pytest.mark.parametrize(
    ("place", "effect", "values"),
    [
        ("motor_bearing", "coulomb_friction", {"torque": 0.02}),
        ("gear", "backlash", {"half_gap": 0.35}),
        ("link_1", "cubic_stiffness", {"k3": 1e10}),
    ],
)
def test_one_effect_is_named(rig, place, effect, values):
    truth = rig.with_parameters({"m": 5.3, "R": 12.2}).with_effect(place, effect, values)
    found = diagnose_records(rig, [recorded(truth)])
    document = found.to_json()
    assert document["verdict"] == "missing_physics"
    assert [(f["location"], f["effect"]) for f in document["findings"]] == [(place, effect)]
    name, value = next(iter(values.items()))
    found_value = document["findings"][0]["parameters"][name]
    # masses, springs and forces that all grow alike cannot be seen: the size is known as well as the mass is
    assert found_value["value"] == pytest.approx(value, rel=0.1)
    low, high = found_value["ci95"]
    assert low <= value <= high
    assert high - low < 0.4 * value
    held = document["fit"]["held_out"]
    assert held["extended"] < 1.2 * document["fit"]["noise_floor"] < held["nominal"]
    assert found.extended.effect(place, effect) is not None


def test_parameters_stay_within_their_tolerances(rig):
    evidence = Evidence.gather(rig, [recorded(rig.with_parameters({"J": 1.6e-5}))])
    fitted = fit(evidence, rig, nominal_free(rig))
    for name, p in rig.config.parameters.items():
        away = abs(fitted.rig.config.parameters[name].value / p.value - 1.0)
        assert away <= settings().tolerances_max * p.tolerance + 1e-9


def test_the_progress_is_told(rig):
    told: list[float] = []
    diagnose_records(rig, [recorded(rig, seconds=4.0)], lambda _, share: told.append(share))
    assert told
    assert np.all(np.diff(told) >= 0)


def test_a_recording_without_a_command_is_refused(rig):
    record = recorded(rig, seconds=4.0)
    silent = replace(record, u=np.zeros(record.samples))
    with pytest.raises(UserError, match="it is 0 in all that is fitted"):
        diagnose_records(rig, [silent])


def test_a_recording_s_units_notes_and_name_stand_in_the_result(rig):
    record = recorded(rig, seconds=4.0)
    recording = Recording(
        "bench", None, record.sample_time_s, np.arange(record.samples) * record.sample_time_s,
        {"u": record.u, **record.y}, {}, ["a gap was filled"], assumed_units={"q3": "m (assumed)"},
    )  # fmt: skip
    found = diagnose(recording, rig)
    assert found.source == "bench"
    assert found.units == {"q3": "m (assumed)"}
    assert found.notes == (
        "a gap was filled", "Fitted to the beginning of bench, 0 to 4 s (4001 samples); of its last 40 % the "
        "first part chooses the structure, and the last 15 % judge it.",
    )  # fmt: skip
    assert found.to_json()["units"] == {"q3": "m (assumed)"}
