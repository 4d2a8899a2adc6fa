"""A command may be held between its samples or pass smoothly through them: half a sample ahead and late are one."""

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis import pipeline
from dtbacklash.diagnosis.engine.fit import FittedModel
from dtbacklash.diagnosis.records import SMOOTH, Record, held_equivalent
from dtbacklash.physics.simulate import simulate

pytestmark = pytest.mark.check

STEP_S = 1e-3
FRICTION, DELAY = ("disk", "coulomb_friction"), ("amplifier", "delay")


@pytest.fixture(scope="module")
def held():
    """A pendulum with friction, its command held: sines from 1 to 15 Hz."""
    rig = nominal_rig("pendulum").with_effect(*FRICTION, {"torque": 0.05})
    rng, t = np.random.default_rng(5), STEP_S * np.arange(6001)
    u = np.sum([np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (1.0, 2.3, 4.1, 7.7, 11.3, 15.1)], axis=0)
    noises = {"theta": 2e-5, "omega": 1e-3}
    shown = simulate(rig, u[:-1], STEP_S).sensors
    y = {c: shown[c] + noise * rng.standard_normal(len(t)) for c, noise in noises.items()}
    return Record(STEP_S, u, y, np.ones(len(t), bool), np.zeros(len(t), bool))


def smoothed(record):
    return Record(STEP_S, held_equivalent(record.u), record.y, record.train, record.held, at_once=record.u)


def course(record, name):
    found = pipeline._Course(nominal_rig("pendulum"), [record], lambda text, share: None, pipeline.FULL, {}, True)
    found.every, found.course = [1], name
    return found


def with_names(at, record, *keys):
    """A search that has found these names."""
    search, rig = at._start([record]), nominal_rig("pendulum")
    for key in keys:
        rig = rig.with_effect(*key, {"torque": 0.05} if key == FRICTION else {"time": 0.5 * STEP_S})
    model = search.fitted(rig, search.nothing, keys, (1.0, 0.1, 1.0), 5)
    assert isinstance(model, FittedModel)
    search.now = model
    return search


def test_a_smooth_command_and_half_a_sample_of_delay_are_a_held_command(held):
    at = course(smoothed(held), SMOOTH)
    search = with_names(at, smoothed(held), FRICTION, DELAY)
    time = search.now.rig.effects[DELAY[0]][DELAY[1]]["time"]
    assert time == pytest.approx(0.5 * STEP_S, rel=0.05)
    better = at._at_course("", [held], search)
    assert better.keys == (FRICTION,)
    again = at._start([held], better)
    assert again.now.keys == (FRICTION,)


def test_a_held_command_stays_held(held):
    at = course(held, "")
    assert at._at_course(SMOOTH, [smoothed(held)], with_names(at, held, FRICTION)) is None


def test_names_that_earn_nothing_here_are_not_taken_up(held):
    at = course(held, "")
    model = with_names(at, held, FRICTION).now
    idle = at._start([held]).fitted(model.rig.with_effect(*DELAY, {"time": 1e-5}), model, (FRICTION, DELAY))
    assert at._start([held], idle).now.keys == (FRICTION,)
    assert at._start([held]).now.keys == ()
