"""A command is read as smooth only where that needs no more effects than reading it as held."""

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnose import pipeline
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import Key, nominal_free
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.search.course import Course
from dtbacklash.diagnose.search.model import Log, Model, Named
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

from .conftest import STEP_S, Record, command

FRICTION: Key = ("mass", "viscous_friction")
LATE: Key = ("sensor_x", "delay")


@pytest.fixture(scope="module")
def oscillator() -> Rig:
    return nominal_rig("oscillator")


@pytest.fixture(scope="module")
def readings(oscillator) -> list[Evidence]:
    """A held command and viscous friction; the second reading is the smooth one."""
    u = command(6.0, 7)
    shown = simulate(oscillator.with_effect(*FRICTION, {"coefficient": 3.0}), u[:-1], STEP_S).sensors["x"]
    mask = np.arange(len(u)) < 0.7 * len(u)
    seen = {"x": shown + np.random.default_rng(7).normal(0.0, 1e-7, len(u))}
    held = Record(STEP_S, u, seen, mask, ~mask)
    smooth = Record(STEP_S, pipeline.held_equivalent(u), seen, mask, ~mask)
    return [Evidence.gather(oscillator, [record]) for record in (held, smooth)]


def searching(found: dict[int, Rig], order: dict[int, list[Key]], seen: list[Evidence]):
    """A search that finds the rigs that it is told to."""

    def search(evidence: Evidence, course, depth) -> tuple[Model, Log]:
        seen.append(evidence)
        known = fit(evidence, evidence.nominal, nominal_free(evidence.nominal))
        fitted: Fit = fit(evidence, found[id(evidence)], [])
        return Model(evidence, known, fitted, tuple(map(Named, order[id(evidence)]))), Log()

    return search


def test_a_delay_of_half_a_sample_that_undoes_the_smooth_reading_is_no_finding(oscillator, readings, monkeypatch):
    held, smooth = readings
    true = oscillator.with_effect(*FRICTION, {"coefficient": 3.0})
    late, seen = true.with_effect(*LATE, {"time": 0.5 * STEP_S}), []
    found = {id(held): true, id(smooth): late}
    order = {id(held): [FRICTION], id(smooth): [FRICTION, LATE]}
    monkeypatch.setattr(pipeline, "search", searching(found, order, seen))
    chosen, _, is_smooth = pipeline._searched(readings, Course())
    assert (chosen.keys, is_smooth) == ((FRICTION,), False)
    assert len(seen) == 2
    assert held.rms(chosen.fitted.residuals) < 1.1


def test_a_smooth_reading_that_the_held_one_does_not_come_near_is_not_searched_twice(oscillator, readings, monkeypatch):
    """Here the first of the two is wrong by a delay that no law without one makes up for."""
    held, smooth = readings
    true, seen = oscillator.with_effect(*FRICTION, {"coefficient": 3.0}), []
    monkeypatch.setattr(pipeline, "search", searching({id(held): true}, {id(held): [FRICTION]}, seen))
    chosen, _, is_smooth = pipeline._searched([smooth, held], Course())
    assert (chosen.keys, is_smooth) == ((FRICTION,), True)
    assert seen == [held]
