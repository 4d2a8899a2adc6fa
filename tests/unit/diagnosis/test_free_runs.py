"""A free run is a simulation by the command alone: what `dtb run` shows of the same rig, with filters or without."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis.engine.resampling import OPENING
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.diagnosis.predictions import Predictions, segments_of
from dtbacklash.diagnosis.records import Record
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

STEP_S = 2e-3
#: every rig of the package: size of its command
RIGS = {
    "lead_screw": 3.0, "two_mass_stage": 1.0, "rotary_drive": 1.0, "belt_stage": 2.0, "pendulum": 0.4, "disk": 0.5,
    "oscillator": 1.0, "silverbox": 0.1, "servo_arm": 0.3, "emps": 1.0, "anticogging": 1.0, "brfd": 5e-3,
}  # fmt: skip


def command(seconds: float, rms: float) -> np.ndarray:
    """(N,) tones, 0.5 to 6 Hz, from 0 on, V."""
    t = STEP_S * np.arange(round(seconds / STEP_S) + 1)
    u = sum(np.sin(2.0 * np.pi * f * t) for f in (0.5, 1.3, 2.9, 6.1))
    return rms * u / u.std()


def record_of(true: Rig, u: np.ndarray, seconds_before: float = 0.0) -> Record:
    """What a rig shows of a command; seconds_before : so much of the beginning is not recorded."""
    shown, first = simulate(true, u[:-1], STEP_S).sensors, round(seconds_before / STEP_S)
    y = {c: v[first:] for c, v in shown.items() if true.sensors[c].quantity != "acceleration"}
    train = np.arange(len(u) - first) < 0.7 * (len(u) - first)
    return Record(STEP_S, u[first:], y, train, ~train)


def seen(rig: Rig, record: Record, every: int = 1, forces: float = 1.0) -> Predictions:
    """forces : unknown ones, of what a search begins with."""
    segments: Segments = segments_of(rig, [record], [every])
    return Predictions(
        segments,
        [record],
        [every],
        rig,
        segments.scaled(tuple(p.first_noise_levels() for p in segments.predictors), forces),
    )


def with_filters(rig: Rig) -> Rig:
    for c, sensor in rig.sensors.items():
        if sensor.quantity in ("position", "velocity", "current"):
            rig = rig.with_effect(f"sensor_{c}", "low_pass", {"cutoff": 40.0})
    return rig


@pytest.mark.parametrize("filtered", [False, True], ids=["plain", "filtered"])
@pytest.mark.parametrize("name", RIGS)
def test_it_is_what_a_simulation_shows(name, filtered):
    rig = nominal_rig(name)
    given = [(p, one.value) for p, one in rig.config.parameters.items() if one.tolerance]
    true = rig.with_parameters({p: (1.05, 0.95)[k % 2] * value for k, (p, value) in enumerate(given)})
    if filtered:
        rig, true = with_filters(rig), with_filters(true)
    u = command(4.0, RIGS[name])
    record = record_of(true, u)
    alone = simulate(rig, u[:-1], STEP_S).sensors
    found = seen(rig, record)
    assert found.window_s is None
    (errors,) = found.free(rig)
    size, known = found.spread(), dict(zip(found.channels, errors.T, strict=True))
    assert any(np.std(record.y[c] - alone[c]) > 0.01 * size[c] for c in known), "the two machines are alike"
    for c, own in known.items():
        # the last command, which a positioner goes on from, is none of the simulation's
        assert np.abs(own - (record.y[c] - alone[c]))[:-3].max() < 1e-3 * size[c]


def test_no_gain_has_a_part_in_it():
    rig = with_filters(nominal_rig("pendulum"))
    record = record_of(rig.with_effect("disk", "coulomb_friction", {"torque": 0.01}), command(3.0, 0.4))
    one, other = (seen(rig, record, forces=forces) for forces in (1.0, 1e-3))
    assert not np.array_equal(one.errors(rig)[0], other.errors(rig)[0])
    assert np.array_equal(one.free(rig)[0], other.free(rig)[0])


def test_at_the_rate_of_the_motion_it_is_the_mean():
    rig, every = nominal_rig("pendulum"), 5
    u = command(20.0, 0.4)
    record = record_of(rig.with_effect("disk", "gravity", {"torque": 0.02, "phase": 0.0}), u)
    (errors,) = seen(rig, record, every).free(rig)
    alone = simulate(rig, u[:-1], STEP_S).sensors["theta"]
    n = len(errors)
    means = (record.y["theta"] - alone)[: n * every].reshape(n, every).mean(axis=1)
    column = list(record.y).index("theta")
    assert np.abs(errors[:, column] - means).max() < 0.01 * np.abs(means).max()


def test_a_recording_that_begins_in_motion_begins_with_a_state_that_its_readings_make_known():
    rig = nominal_rig("pendulum")
    record = record_of(rig, command(6.0, 0.4), seconds_before=1.1)
    assert np.abs(record.y["omega"][0]) > 0.5 * np.std(record.y["omega"])
    position = replace(record, y={"theta": record.y["theta"]})
    found = seen(rig, position)
    (errors,) = found.free(rig)
    assert found.window_s is None
    assert np.isnan(errors[:OPENING]).all()
    assert np.isfinite(errors[OPENING:]).all()
    assert np.abs(errors[OPENING:]).max() < 1e-3 * np.std(record.y["theta"])


def test_a_machine_that_drifts_away_is_compared_over_windows():
    """A constant torque that the rig lacks turns it away; a spring holds the other one."""
    rig, u = nominal_rig("pendulum"), command(30.0, 0.4)
    record = record_of(rig.with_effect("disk", "constant_load", {"torque": 5e-3}), u)
    found = seen(rig, record)
    (errors,) = found.free(rig)
    window = found.window_s
    assert 0.0 < window < 0.6 * STEP_S * len(u)
    theta = errors[:, list(record.y).index("theta")]
    begun = np.flatnonzero(np.isnan(theta[1:]) & np.isfinite(theta[:-1])) + 1
    assert np.allclose(np.diff(begun), window / STEP_S, atol=1.0)
    assert np.isnan(theta).mean() < 0.3
    assert np.sqrt(np.nanmean(theta**2)) < found.spread()["theta"]
    # the error within a window is that of the torque, and of nothing that came before
    ends = theta[begun - 1]
    assert np.abs(ends / ends.mean() - 1.0).max() < 0.2
    held = nominal_rig("oscillator")
    record = record_of(held.with_effect("mass", "constant_force", {"force": 50.0}), command(30.0, 1.0))
    assert seen(held, record).window_s is None


def test_a_rig_that_errs_by_more_than_the_motion_does_not_follow_it():
    """An outlier of the command where it judges; where a machine rests noise is no motion."""
    rig, u = nominal_rig("pendulum"), command(5.0, 0.4)
    record = record_of(rig, u)
    assert seen(rig, record).follows(rig)
    far = u.copy()
    far[2200] = -1e5
    found = seen(rig, replace(record, u=far))
    assert not found.follows(rig)
    assert found.furthest_off(rig)[1:] == ("omega", pytest.approx(2201 * STEP_S))
    noise = 1e-3 * np.random.default_rng(1).standard_normal((len(record.y), len(u)))
    rests = replace(record, u=0.0 * u, y=dict(zip(record.y, noise, strict=True)))
    assert seen(rig, rests).follows(rig)
