"""The whole diagnosis on simulated recordings; other integrators and real recordings have tests of their own."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis import Record, diagnose, diagnose_records, pipeline
from dtbacklash.diagnosis.predictions import Predictions
from dtbacklash.physics.simulate import simulate
from dtbacklash.recording.model import Recording

from .conftest import command, recorded

KEYS = {"verdict", "summary", "findings", "recalibrated", "fit", "candidates", "next_experiment"}


@pytest.mark.check
def test_nothing_missing_is_consistent(rig):
    document = diagnose_records(rig, [recorded(rig)]).to_json()
    assert document["verdict"] == "consistent"
    assert not document["findings"]
    assert set(document) >= KEYS


@pytest.mark.check
def test_a_wrong_parameter_is_not_physics(rig):
    document = diagnose_records(rig, [recorded(rig.with_parameters({"k": 1.08e4}))]).to_json()
    assert document["verdict"] == "parameters"
    assert not document["findings"]
    low, high = document["recalibrated"]["k"]["ci95"]
    assert low < 1.08e4 < high


@pytest.mark.check
def test_a_parameter_is_recalibrated_at_the_full_rate():
    """Means of samples stand for a command that bends between them: off by millionths, more than this noise allows."""
    rig, t = nominal_rig("oscillator"), np.arange(16_000) * 1e-3
    u = 2.0 * np.sin(2.0 * np.pi * (1.0 + 0.3 * t) * t)
    y = simulate(rig.with_parameters({"m": 1.2647}), u, 1e-3).sensors
    noisy = {"x": y["x"] + 4e-7 * np.random.default_rng(3).standard_normal(len(y["x"]))}
    train = np.arange(len(noisy["x"])) < 0.8 * len(noisy["x"])
    found = diagnose_records(rig, [Record(1e-3, np.append(u, u[-1]), noisy, train, ~train)], depth="none")
    assert found.work is not None
    assert found.work.every > 1
    low, high = found.recalibrated["m"].ci95
    assert low < 1.2647 < high
    assert high - low < 2e-5


@pytest.mark.check
def test_a_parameter_that_a_missing_friction_hides_is_recalibrated_all_the_same():
    """Without the friction no stiffness explains the recording: what had to move shows beside the name."""
    rig, u = nominal_rig("oscillator"), command(8.0, 1)[::5]
    truth = rig.with_parameters({"k": 2033.0}).with_effect("mass", "ground_friction", {"force": 6.0})
    noisy = 1.0 + 1e-3 * np.random.default_rng(2).standard_normal(len(u))
    y = {c: v * noisy for c, v in simulate(truth, u[:-1], 5e-3).sensors.items()}
    train = np.arange(len(u)) < 0.8 * len(u)
    found = diagnose_records(rig, [Record(5e-3, u, y, train, ~train)], depth="quick")
    # of a mass on a spring to the ground both rub alike
    (friction,) = found.findings
    assert (friction.location, friction.effect) in {("mass", "ground_friction"), ("spring", "dry_friction")}
    low, high = found.recalibrated["k"].ci95
    assert low < 2033.0 < high
    assert "Recalibrated beside that: k = 2.03e+03 N/m." in found.summary


@pytest.mark.parametrize(
    ("place", "effect", "values"),
    [
        ("motor_bearing", "coulomb_friction", {"torque": 0.02}),
        ("gear", "backlash", {"half_gap": 0.35}),
        ("link_1", "cubic_stiffness", {"k3": 1e10}),
    ],
)
@pytest.mark.nightly
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


@pytest.mark.check
def test_no_name_is_sure_where_the_extended_rig_does_not_stay_finite(rig, monkeypatch):
    truth = rig.with_effect("motor_bearing", "coulomb_friction", {"torque": 0.02})
    monkeypatch.setattr(Predictions, "errors", lambda self, rig, others=None: None)
    found = diagnose_records(rig, [recorded(truth, seconds=4.0)])
    assert found.verdict == "unexplained"
    assert [(f.effect, f.confidence) for f in found.findings] == [("coulomb_friction", "partial")]
    assert "does not follow the recording: its simulation does not stay finite." in found.summary


@pytest.mark.check
def test_the_progress_is_told(rig):
    told: list[float] = []
    diagnose_records(rig, [recorded(rig, seconds=4.0)], lambda _, share: told.append(share))
    assert told
    assert np.all(np.diff(told) >= 0)


@pytest.mark.check
def test_what_is_known_when_it_is_stopped_may_be_kept(rig):
    """Ctrl-C while the second effect is looked for; a second Ctrl-C, or one before the first fit, leaves nothing."""
    truth = rig.with_effect("motor_bearing", "coulomb_friction", {"torque": 0.02})
    records = [recorded(truth, seconds=4.0)]

    def stopped_at(*stages):
        waiting = list(stages)

        def tell(text, share):
            if waiting and waiting[0] in text.partition(", ")[2]:
                del waiting[0]
                raise KeyboardInterrupt

        return tell

    found = diagnose_records(rig, records, stopped_at("round 2"), keep=True)
    document = found.to_json()
    assert document["stopped_early"] == "round 2: ranking what may be missing"
    assert [(f["location"], f["effect"], f["confidence"]) for f in document["findings"]] == [
        ("motor_bearing", "coulomb_friction", "partial")
    ]
    assert document["summary"].startswith(
        "Stopped early (round 2: ranking what may be missing): what was found until then"
    )
    assert "Known then: Coulomb friction at the motor bearing (torque " in document["summary"]
    assert "stopped_early" not in replace(found, stopped="").to_json()
    for keep, stages in ((False, ["round"]), (True, ["recalibrating"]), (True, ["round", "judging what is known"])):
        with pytest.raises(KeyboardInterrupt) as ended:
            diagnose_records(rig, records, stopped_at(*stages), keep=keep)
        assert str(ended.value) == (": nothing was known yet" if stages == ["recalibrating"] else "")


@pytest.mark.check
def test_what_cannot_be_judged_where_it_was_stopped_ends_it_in_a_line(rig, monkeypatch):
    def interrupted(search):
        search.now = replace(search.now, noise_levels=search.now.noise_levels[:0])  # as between two changes of a search
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline.StepwiseSelection, "run", interrupted)
    with pytest.raises(KeyboardInterrupt, match="nothing was known yet"):
        diagnose_records(rig, [recorded(rig, seconds=4.0)], keep=True)


def test_a_recording_s_units_notes_and_name_stand_in_the_result(rig):
    record = recorded(rig, seconds=4.0)
    recording = Recording(
        "bench", None, record.sample_time_s, np.arange(record.samples) * record.sample_time_s,
        {"u": record.u, **record.y}, {}, ["a gap was filled"], assumed_units={"q3": "m (assumed)"},
    )  # fmt: skip
    found = diagnose(recording, rig, depth="none")
    assert found.source == "bench"
    assert found.units == {"q3": "m (assumed)"}
    assert found.notes == (
        "a gap was filled", "The recording is bench, 0 to 4 s (4001 samples): 80 % of it are fitted to, and the last "
        "20 % judge.",
    )  # fmt: skip
    assert found.to_json()["units"] == {"q3": "m (assumed)"}


@pytest.mark.parametrize("step_s", [1e-3, 2e-2])
@pytest.mark.nightly
def test_gravity_is_found_however_slowly_the_disk_is_sampled(step_s):
    """The regression over wave numbers works on means of samples: with too many in one its pull is not stable."""
    disk = nominal_rig("pendulum")
    rng, n = np.random.default_rng(5), round(12.0 / step_s)
    u = np.repeat(rng.normal(0.0, 0.6, n // round(0.2 / step_s) + 1), round(0.2 / step_s))[: n + 1]
    heavy = disk.with_effect("disk", "gravity", {"torque": 0.15, "phase": 0.4})
    theta = simulate(heavy, u[:-1], step_s).sensors["theta"] + rng.normal(0.0, 1e-4, len(u))
    train = np.arange(len(u)) < 0.6 * len(u)
    found = diagnose_records(disk, [Record(step_s, u, {"theta": theta}, train, ~train)])
    assert (found.verdict, [f.effect for f in found.findings]) == ("missing_physics", ["gravity"])
    assert found.findings[0].parameters["torque"].value == pytest.approx(0.15, rel=0.02)
