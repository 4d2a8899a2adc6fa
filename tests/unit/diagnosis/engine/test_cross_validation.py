"""A recording that is left out: the others alone fit the rig, and it judges whether a name predicts it."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis.engine.cross_validation import left_out, predicted
from dtbacklash.diagnosis.engine.fit import FitProblem
from dtbacklash.diagnosis.engine.motion import motion_of
from dtbacklash.diagnosis.engine.predictor import Predictor
from dtbacklash.diagnosis.engine.resampling import readings
from dtbacklash.diagnosis.engine.rig_simulator import Simulated
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.diagnosis.parallel import on_cores

from .conftest import STEP_S, command, recorded

DAMPED = ("mass", "viscous_friction")


def segments_of(masses: dict[int, float], coefficients: dict[int, float]) -> Segments:
    """Recordings by their numbers, of oscillators with these masses and dampings."""
    nominal, found = nominal_rig("oscillator"), []
    for k, mass in masses.items():
        rig = nominal.with_parameters({"m": mass})
        if coefficients[k]:
            rig = rig.with_effect(*DAMPED, {"coefficient": coefficients[k]})
        u = command(5.0, 1.0, k)
        y = recorded(rig, u, seed=k)
        found.append(Predictor(nominal, Simulated(readings(u, y, tuple(y), STEP_S, 1, False, None, k))))
    return Segments(nominal, tuple(found))


def fitted(segments: Segments, keys=()):
    rig = segments.nominal
    for key in keys:
        rig = rig.with_effect(*key, {"coefficient": 1.0})
    sizes, _ = segments.tuned(rig)
    motion = motion_of(segments, rig, segments.gains(rig, sizes))
    return motion, FitProblem(segments, rig, keys, motion, 1.0).homotopy_fit(sizes, None, (1.0, 0.1, 1.0), 6)


def test_recordings_share_one_compiled_rig_and_threads_give_the_same_rows():
    segments = segments_of({0: 1.2, 1: 1.2}, {0: 0.0, 1: 0.0})
    own = segments.nominal.owning({(1, "m"): 1.3})
    one, other = (p.simulated.linear(segments.nominal) for p in segments.predictors)
    alone, heavier = (p.simulated.linear(own) for p in segments.predictors)
    assert one is other
    assert heavier.inertia[0] == pytest.approx(1.3 / segments.nominal.config.parameters["m"].value * alone.inertia[0])
    sizes, value = segments.tuned(own)
    rows = segments.residuals(own, segments.gains(own, sizes))
    with on_cores(2):
        again, same = segments.tuned(own)
        assert same == value
        assert np.array_equal(segments.residuals(own, segments.gains(own, again)), rows)


def stiffness(rig) -> float:
    """By mass: masses, springs and gains that all grow alike do not show."""
    return rig.config.parameters["k"].value / rig.config.parameters["m"].value


def test_the_rig_of_the_others_is_what_a_fit_to_them_gives():
    masses, none = {0: 1.2, 1: 1.2, 2: 1.21}, dict.fromkeys(range(3), 0.0)
    segments, (motion, alike) = segments_of(masses, none), fitted(segments_of(dict.fromkeys(masses, 1.2), none))
    whole = FitProblem(segments, alike.rig, (), motion, 1.0)
    model = whole.model(whole.gauss_newton(alike.noise_levels, whole.start(), 6)[0], alike.noise_levels, 0.0)
    rigs = left_out(segments, motion, model)
    for k in masses:
        others = replace(segments, predictors=tuple(p for p in segments.predictors if p.readings.recording != k))
        sizes = tuple(
            s for p, s in zip(segments.predictors, model.noise_levels, strict=True) if p.readings.recording != k
        )
        problem = FitProblem(others, model.rig, (), motion, 1.0)
        alone = problem.rig(problem.gauss_newton(sizes, problem.start(), 6)[0])
        stiffer = [stiffness(rig) / stiffness(model.rig) - 1.0 for rig in (rigs[k], alone)]
        assert stiffer[0] == pytest.approx(stiffer[1], rel=0.05)
        assert abs(stiffer[0]) > 1e-3


def test_a_name_predicts_the_recordings_that_have_it_and_no_other():
    segments = segments_of(dict.fromkeys(range(3), 1.2), {0: 2.0, 1: 2.0, 2: 0.0})
    motion, model = fitted(segments, (DAMPED,))
    _, less = fitted(segments)
    (ratios,) = predicted(segments, motion, left_out(segments, motion, model), model, {DAMPED: less}).values()
    # two of three are damped: with one of them left out, the others say half of it; with the third, all of it
    assert ratios[0] > 1.0
    assert ratios[1] > 1.0
    assert ratios[2] < 0.9


def test_what_a_recording_alone_has_stays_with_it():
    segments = segments_of(dict.fromkeys(range(3), 1.2), {0: 0.0, 1: 0.0, 2: 2.0})
    title = ".".join((*DAMPED, "coefficient"))
    rig = segments.nominal.with_effect(*DAMPED, {"coefficient": 1.0}).owning({(k, title): 1.0 for k in range(3)})
    sizes, _ = segments.tuned(rig)
    motion = motion_of(segments, rig, segments.gains(rig, sizes))
    model = FitProblem(segments, rig, (DAMPED,), motion, 1.0).homotopy_fit(sizes, None, (1.0, 0.1, 1.0), 6)
    own = [left_out(segments, motion, model)[2].own[k][title] for k in range(3)]
    assert own == pytest.approx([model.rig.own[k][title] for k in range(3)], abs=0.02)
    assert own[2] == pytest.approx(2.0, rel=0.05)
    assert np.abs(own[:2]).max() < 0.1


def test_a_column_of_one_recording_runs_it_alone(monkeypatch):
    masses = dict.fromkeys(range(3), 1.2)
    segments = segments_of(masses, dict.fromkeys(masses, 0.0))
    rig = segments.nominal.owning({(1, "m"): 1.2})
    sizes = tuple(p.first_noise_levels() for p in segments.predictors)
    problem = FitProblem(segments, rig, (), motion_of(segments, rig, segments.gains(rig, sizes)), 1.0)
    x, gains = problem.start(), segments.gains(rig, sizes)
    rows = problem.residuals(x, gains)
    ran = []
    run = Predictor.run
    monkeypatch.setattr(Predictor, "run", lambda p, *how: ran.append(p.readings.recording) or run(p, *how))
    j = next(j for j, f in enumerate(problem.free) if f.recording == 1 and f.name == "m")
    column = problem.sensitivity(j, x, gains, rows)
    assert ran == [1]
    step = np.eye(len(x))[j] * problem.free[j].step
    whole = (problem.residuals(x + step, gains) - rows) / problem.free[j].step
    assert column == pytest.approx(whole)
    assert np.any(column)
