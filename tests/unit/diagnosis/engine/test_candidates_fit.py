"""Columns rank what is missing first, and exact fits find its values, on recordings with one known effect."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from nominal import nominal_rig
from scipy.optimize import lsq_linear

from dtbacklash.diagnosis.engine.candidates import CandidateSensitivities
from dtbacklash.diagnosis.engine.columns import ColumnMaker
from dtbacklash.diagnosis.engine.efforts import SMALL
from dtbacklash.diagnosis.engine.fit import FitProblem, FittedModel
from dtbacklash.diagnosis.engine.least_squares import secant, step_in_box
from dtbacklash.diagnosis.engine.motion import Motion, motion_of
from dtbacklash.diagnosis.engine.parameters import Key, apply, standing, taken_out
from dtbacklash.diagnosis.engine.predictor import Predictor
from dtbacklash.diagnosis.engine.resampling import readings
from dtbacklash.diagnosis.engine.rig_simulator import Simulated
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.physics.effects.table import VALUES, weights
from dtbacklash.physics.rig import Rig

from .conftest import STEP_S, command, recorded, segments_of, with_sensors


@dataclass(frozen=True)
class Case:
    """A rig with one effect that the nominal one lacks, and the size of its command."""

    rig: str
    key: Key
    values: dict[str, float]
    rms: float


CASES = {
    "coulomb": Case("pendulum", ("disk", "coulomb_friction"), {"torque": 0.02}, 0.4),
    "gravity": Case("pendulum", ("disk", "gravity"), {"torque": 0.05, "phase": 0.6}, 0.4),
    "cogging": Case("pendulum", ("disk", "cogging"), {"torque": 0.03, "periods": 7.0, "phase": 0.3}, 0.6),
    "viscous": Case("two_mass_stage", ("carriage", "viscous_friction"), {"coefficient": 12.0}, 1.0),
    "cubic": Case("oscillator", ("spring", "cubic_stiffness"), {"k3": 2e6}, 1.5),
    "a cubic of stiff springs": Case("lead_screw", ("link_1", "cubic_stiffness"), {"k3": 1e10}, 3.0),
    "constant": Case("two_mass_stage", ("table", "constant_force"), {"force": 0.7}, 1.0),
}


@cache
def looked_at(name: str) -> tuple[Rig, Segments, FittedModel, Motion]:
    """The nominal rig recalibrated on a recording of another, at sizes by likelihood."""
    case = CASES[name]
    rig = nominal_rig(case.rig)
    u = command(8.0, case.rms)
    segments = segments_of(rig, u, recorded(rig.with_effect(*case.key, case.values), u))
    return rig, segments, *recalibrated(rig, segments)


def recalibrated(rig: Rig, segments: Segments) -> tuple[FittedModel, Motion]:
    sizes, _ = segments.tuned(rig)
    motion = motion_of(segments, rig, segments.gains(rig, sizes))
    model = FitProblem(segments, rig, (), motion).homotopy_fit(sizes, None, (1.0,))
    assert model is not None
    return model, motion


each = pytest.mark.parametrize("name", list(CASES))


@each
def test_what_is_missing_is_ranked_first(name):
    _, segments, model, _ = looked_at(name)
    columns = CandidateSensitivities(segments, model, segments.scaled(model.noise_levels, 0.1))
    assert columns.ranked[0].keys == (CASES[name].key,)
    assert columns.ranked[0].gain > 1000.0
    gains = [p.gain for p in columns.ranked]
    assert gains == sorted(gains, reverse=True)
    names = [p.keys for p in columns.ranked]
    assert len(names) == len(set(names))


@each
def test_exact_fits_find_the_values(name):
    rig, segments, model, motion = looked_at(name)
    case = CASES[name]
    best = next(
        p
        for p in CandidateSensitivities(segments, model, segments.scaled(model.noise_levels, 0.1)).ranked
        if p.keys == (case.key,)
    )
    found = FitProblem(segments, best.put(rig), (case.key,), motion).homotopy_fit(model.noise_levels)
    values = found.rig.effect(*case.key)
    for parameter, value in case.values.items():
        near = {"abs": 0.02} if parameter == "phase" else {"rel": 0.01}
        assert values[parameter] == pytest.approx(value, **near), parameter
    assert not found.at_end
    assert found.keys == (case.key,)
    assert found.counts == len([f for f in found.free if not f.prior])
    assert found.score == pytest.approx(found.loss + found.counts * np.log(segments.count))
    assert found.score < model.score - 250.0
    # hardly anything is left unknown
    assert segments.most_unknown(found.noise_levels) < 0.05 * segments.most_unknown(model.noise_levels)
    # nominal parameters, which were right, stay within a tenth of a tolerance or so
    assert np.abs([standing(f, found.rig) for f in found.free if f.prior]).max() < 0.3


@each
def test_a_gain_that_columns_promise_is_one_that_comes(name):
    """At the same sizes: the fall of the sum of squares of an exact fit, less what its parameters cost."""
    rig, segments, model, motion = looked_at(name)
    case = CASES[name]
    (best,) = (p for p in CandidateSensitivities(segments, model, model.noise_levels).ranked if p.keys == (case.key,))
    problem = FitProblem(segments, best.put(rig), (case.key,), motion)
    nothing = FitProblem(segments, model.rig, (), motion)
    rows = nothing.residuals(nothing.start(), segments.gains(model.rig, model.noise_levels))
    _, squares = problem.gauss_newton(model.noise_levels, problem.start(), 6)
    fall = float(rows @ rows) - squares - np.log(segments.count) * best.parts[0][0].counts
    assert best.gain == pytest.approx(fall, rel=0.25)


def test_a_jacobian_is_how_rows_change():
    rig, segments, model, motion = looked_at("cubic")
    key = CASES["cubic"].key
    problem = FitProblem(segments, rig.with_effect(*key, {"k3": 1.5e6}), (key,), motion)
    x, gains = problem.start(), segments.gains(rig, model.noise_levels)
    rows = problem.residuals(x, gains)
    J = problem.jacobian(x, gains, rows)
    assert J.shape == (len(rows), len(problem.free))
    assert problem.innovation_rows + problem.priors == len(rows)
    for j, f in enumerate(problem.free):
        z = np.zeros(len(x))
        z[j] = 0.5 * f.step
        both = (problem.residuals(x + z, gains) - problem.residuals(x - z, gains)) / f.step
        assert np.linalg.norm(J[:, j] - both) < 0.1 * np.linalg.norm(both)
    # known columns are used again
    near = problem.jacobian(x, gains, rows, {problem.free[0].title: np.ones(problem.innovation_rows)})
    assert np.array_equal(near[: problem.innovation_rows, 0], np.ones(problem.innovation_rows))
    assert near[problem.innovation_rows, 0] == problem.stiff
    assert not near[: problem.innovation_rows, 1].any()


def test_a_step_ends_at_the_box_where_the_rest_is_least():
    """Against SciPy's bounded least squares, of a problem whose free step would leave the box."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        J, r = rng.standard_normal((30, 4)), 3.0 * rng.standard_normal(30)
        J[:, 1] = J[:, 0] + 0.2 * J[:, 1]
        step = step_in_box(J.T @ J, J.T @ r)
        assert np.abs(step).max() <= 1.0
        least = lsq_linear(J, -r, (-1.0, 1.0))
        assert step == pytest.approx(least.x, abs=1e-3)


def test_a_jacobian_by_secants_knows_what_a_step_did():
    """And what it knew across that step stays, in the units in which each parameter does the same."""
    rng = np.random.default_rng(4)
    J, step, change = rng.standard_normal((30, 3)), np.array([0.3, -0.2, 0.1]), rng.standard_normal(30)
    after = J + secant(J.T @ J, change - J @ step, step)
    assert after @ step == pytest.approx(change)
    across = np.array([1.0, 1.0, -1.0])
    across -= (across @ (np.diag(J.T @ J) * step)) / (step @ (np.diag(J.T @ J) * step)) * step
    assert after @ across == pytest.approx(J @ across)


def test_a_wrong_parameter_is_no_missing_law():
    """What the nominal parameters can do is projected out of every column."""
    rig = nominal_rig("oscillator")
    stiffer = rig.with_parameters({"k": 1.05 * rig.config.parameters["k"].value})
    u = command(8.0, 1.0)
    segments = segments_of(rig, u, recorded(stiffer, u))
    model, _ = recalibrated(rig, segments)
    assert model.rig.config.parameters["k"].value == pytest.approx(1.05 * 1900.0, rel=0.005)
    best = CandidateSensitivities(segments, model, model.noise_levels).ranked[0]
    assert best.gain < 0.02 * segments.count


def test_pairs_promise_what_no_single_does():
    rig = nominal_rig("pendulum")
    keys = (("disk", "coulomb_friction"), ("disk", "viscous_friction"))
    true = rig.with_effect(*keys[0], {"torque": 0.02}).with_effect(*keys[1], {"coefficient": 0.01})
    u = command(8.0, 0.6)
    segments = segments_of(rig, u, recorded(true, u))
    model, motion = recalibrated(rig, segments)
    columns = CandidateSensitivities(segments, model, segments.scaled(model.noise_levels, 0.1))
    pairs = columns.pairs(columns.ranked[:5])
    assert pairs[0].keys == keys
    assert pairs[0].gain > columns.ranked[0].gain + 100.0
    found = FitProblem(segments, pairs[0].put(rig), keys, motion).homotopy_fit(model.noise_levels)
    assert found.rig.effect(*keys[0])["torque"] == pytest.approx(0.02, rel=0.01)
    assert found.rig.effect(*keys[1])["coefficient"] == pytest.approx(0.01, rel=0.01)


class Kept(CandidateSensitivities):
    """Columns that keep what was projected."""

    def _set_base(self, base, jacobian, data):
        self.base, self.J = base, jacobian
        super()._set_base(base, jacobian, data)

    def _project(self, columns):
        self.T = np.hstack([columns, np.zeros((len(columns), len(self.base) - columns.shape[1]))])
        super()._project(columns.copy())

    def left(self, base: np.ndarray, *columns: np.ndarray) -> float:
        """What is left of a sum of squares beside nominal parameters and columns, by least squares."""
        made = np.column_stack([self.J, *columns])
        made = made / np.linalg.norm(made, axis=0)
        left = base - made @ np.linalg.lstsq(made, base, rcond=1e-13)[0]
        return float(left @ left)


def test_what_columns_promise_is_by_least_squares():
    """Singles, and others beside a hypothesis that falls with its size or counts as it is, all columns written out."""
    _, segments, model, _ = looked_at("coulomb")
    columns = Kept(segments, model, segments.scaled(model.noise_levels, 0.1))
    slices, log_n = dict(columns.hypotheses), columns.log_n
    nothing = columns.left(columns.base)

    def one(h, base: np.ndarray, *beside: np.ndarray) -> float:
        """What is left with a hypothesis."""
        made = columns.T[slices[h]]
        return columns.left(base + made[0], *beside) if h.as_it_is else columns.left(base, *beside, *made)

    for p in columns.ranked:
        ((h, size),) = p.parts
        assert p.gain == pytest.approx(nothing - one(h, columns.base) - log_n * h.counts, rel=1e-4, abs=0.1)
        assert (size is None) is h.as_it_is
    firsts = [next(p.parts[0][0] for p in columns.ranked if p.parts[0][0].as_it_is is kind) for kind in (False, True)]
    for first in firsts:
        made = columns.T[slices[first]]
        base, beside = (columns.base + made[0], ()) if first.as_it_is else (columns.base, tuple(made))
        before = columns.left(base, *beside)
        others = columns._ranked((first, slices[first]))
        assert len(others) >= 5
        assert first.key not in {p.parts[0][0].key for p in others}
        for p in others[:8]:
            h = p.parts[0][0]
            fall = before - one(h, base, *beside)
            assert p.gain == pytest.approx(fall - log_n * h.counts, rel=1e-3, abs=0.2)
            # what is left beside the first is not what is there without it
        alone = {p.keys: p.gain for p in columns.ranked}
        assert max(abs(alone.get(p.keys, 0.0) - p.gain) for p in others) > 100.0


DRAG = 0.02


@cache
def dragged() -> tuple[Rig, Segments, FittedModel, Motion]:
    """A disk under a drag that grows with the root of its speed, integrated here: no law of the catalogue."""
    rig, u, steps = nominal_rig("pendulum"), command(8.0, 0.5), 40
    at, speed, h = 0.0, 0.0, STEP_S / steps
    y = np.zeros((len(u), 2))
    for k in range(len(u)):
        y[k] = at, speed
        for _ in range(steps):
            half = speed + 0.5 * h * (0.3 * u[k] - DRAG * np.sign(speed) * np.sqrt(abs(speed))) / 0.02
            at, speed = at + h * half, speed + h * (0.3 * u[k] - DRAG * np.sign(half) * np.sqrt(abs(half))) / 0.02
    y += 1e-3 * y.std(axis=0) * np.random.default_rng(2).normal(size=y.shape)
    segments = segments_of(rig, u, {"theta": y[:, 0], "omega": y[:, 1]})
    return rig, segments, *recalibrated(rig, segments)


def test_a_table_gains_more_than_any_name_where_no_name_is_right():
    _rig, segments, model, motion = dragged()
    key = ("disk", "speed_table")
    for share, more in ((1.0, 1.01), (0.1, 1.03)):
        sizes = segments.scaled(model.noise_levels, share)
        names, tables = (
            CandidateSensitivities(segments, model, sizes, tables=tables).ranked for tables in (False, True)
        )
        assert tables[0].keys == (key,)
        assert tables[0].gain > more * names[0].gain
    smooth = {key: tables[0].smooth}
    found = FitProblem(segments, tables[0].put(model.rig), (key,), motion, smooth=smooth).homotopy_fit(
        model.noise_levels
    )
    named = FitProblem(segments, names[0].put(model.rig), names[0].keys, motion).homotopy_fit(model.noise_levels)
    assert found.score < named.score - 1000.0
    assert named.score < model.score - 1000.0
    # it is held back in how it bends: it has less freedom than values
    assert 3.0 < found.counts < len(VALUES)
    values = found.rig.effect(*key)
    knots, efforts = np.array([values[f"x{k + 1}"] for k in range(16)]), np.array([values[n] for n in VALUES])
    speeds = np.quantile(motion.speed["disk"], [0.05, 0.2, 0.35, 0.65, 0.8, 0.95])
    made = weights(speeds, knots) @ efforts
    assert made == pytest.approx(-DRAG * np.sign(speeds) * np.sqrt(np.abs(speeds)), rel=0.06)


def test_a_table_of_values_is_found_by_the_linear_plant_as_by_the_simulation():
    """The column of each value of a table, which the linear plant answers, against a difference of two passes."""
    _rig, segments, model, _ = dragged()
    columns = CandidateSensitivities(segments, model, model.noise_levels, tables=True)
    gains = segments.gains(model.rig, model.noise_levels)
    h, _ = next(pair for pair in columns.hypotheses if pair[0].effect.name == "speed_table")
    before = segments.residuals(model.rig, gains)
    made = ColumnMaker(segments, model.rig, gains, columns.motion, before).columns(h)
    # around rest a knot acts for less than a sample, and less exactly
    for j, near in ((2, 0.05), (7, 0.35), (12, 0.05)):
        size = 1e-4 * np.eye(len(VALUES))[j]
        after = segments.residuals(h.put(model.rig, size), gains)
        difference = (after - before) / 1e-4
        assert np.linalg.norm(made[j] - difference) < near * np.linalg.norm(difference)


def test_a_model_that_comes_to_nothing_is_at_its_end():
    """A law that is not there."""
    rig, u = nominal_rig("pendulum"), command(8.0, 0.4)
    segments = segments_of(rig, u, recorded(rig, u))
    model, motion = recalibrated(rig, segments)
    key = ("disk", "viscous_friction")
    found = FitProblem(segments, rig.with_effect(*key, {"coefficient": 1e-4}), (key,), motion).homotopy_fit(
        model.noise_levels
    )
    assert found.at_end or found.rig.effect(*key)["coefficient"] < 1e-4
    assert found.score > model.score


def test_a_rig_that_cannot_be_has_no_rows():
    rig, segments, model, motion = looked_at("gravity")
    key = CASES["gravity"].key
    problem = FitProblem(segments, rig.with_effect(*key, {"torque": 0.05}), (key,), motion)
    x = problem.start()
    x[0] = np.nan
    with np.errstate(all="ignore"):
        assert problem.residuals(x, segments.gains(rig, model.noise_levels)) is None
    assert taken_out(problem.base, key).effect(*key) is None


def test_a_parameter_that_has_left_its_tolerance_begins_where_it_was_given_too():
    rig, segments, model, motion = looked_at("gravity")
    key = CASES["gravity"].key
    free = FitProblem(segments, rig, (), motion).free
    away = apply(rig, free, np.array([3.0 * (j == 0) for j in range(len(free))]))
    problem = FitProblem(segments, away.with_effect(*key, dict(CASES["gravity"].values)), (key,), motion)
    few = [problem.gauss_newton(model.noise_levels, x, 1)[1] for x in (problem.start(), np.zeros(len(problem.free)))]
    assert problem.start()[0] == pytest.approx(3.0)
    assert problem.solved(model.noise_levels, 1)[1] == min(few)
    assert few[1] < few[0]


def test_a_rig_that_cannot_be_compiled_is_passed_over():
    """No force acts on a mass that a rigid screw carries; that is refused when the rig is compiled."""
    rig = nominal_rig("lead_screw")
    u = command(3.0, 1.0)
    segments = segments_of(rig, u, recorded(rig, u))
    sizes = (segments.predictors[0].first_noise_levels(),)
    proposed = rig.with_effect("mass_1", "ground_friction", {"force": 1.0})
    problem = FitProblem(segments, proposed, (), motion_of(segments, rig, segments.gains(rig, sizes)))
    assert problem.better_start(sizes) == pytest.approx(problem.start())
    assert problem.gauss_newton(sizes, problem.start(), 2)[1] == np.inf
    assert problem.homotopy_fit(sizes) is None


def test_two_laws_over_a_position_that_begins_anywhere_have_phases_in_each_recording():
    """Zeros half a turn apart: with one phase for both, weight and a cogging of odd periods would add up to nothing."""
    nominal, found = nominal_rig("pendulum"), []
    nominal = with_sensors(nominal, theta={"of": "disk", "quantity": "position"})
    weight, cogging, zeros = ("disk", "gravity"), ("disk", "cogging"), (0.0, -np.pi)
    for k, zero in enumerate(zeros):
        rig = nominal.with_effect(*weight, {"torque": 0.03, "phase": 0.6 + zero})
        rig = rig.with_effect(*cogging, {"torque": 0.03, "periods": 7.0, "phase": 0.3 + zero})
        u = command(8.0, 0.6, 1 + k)
        y = recorded(rig, u, seed=k)
        found.append(Predictor(nominal, Simulated(readings(u, y, tuple(y), STEP_S, 1, False, None, k))))
    segments = Segments(nominal, tuple(found))
    assert segments.anywhere == (0, 1)
    model, _ = recalibrated(nominal, segments)
    columns = CandidateSensitivities(segments, model, segments.scaled(model.noise_levels, 0.1))
    pair = columns.pairs(columns.ranked[:3])[0]
    assert pair.keys == (cogging, weight)
    rig = pair.put(nominal)
    for k, zero in enumerate(zeros):
        there = rig.of(k)
        for key, phase in ((weight, 0.6 + zero), (cogging, 0.3 + zero)):
            values = there.effects[key[0]][key[1]]
            assert values["torque"] == pytest.approx(0.03, rel=0.3)
            assert abs(np.angle(np.exp(1j * (values["phase"] - phase)))) < 0.4


def test_a_later_signal_is_not_looked_at_where_a_less_late_one_explains_more():
    """Of delays and filters that are not there the least ones are looked at, of all else everything."""
    _, segments, model, _ = looked_at("coulomb")
    few, every = (CandidateSensitivities(segments, model, model.noise_levels, every=every) for every in (False, True))
    amounts = [
        {h.key: [o.values[o.effect.size.name] for o, _ in c.hypotheses if o.key == h.key] for h, _ in c.hypotheses}
        for c in (few, every)
    ]
    assert len(few.hypotheses) < len(every.hypotheses)
    assert amounts[0].keys() == amounts[1].keys()
    filters = {"delay", "low_pass", "second_order_low_pass", "moving_average"}
    assert {key[1] for key, own in amounts[0].items() if own != amounts[1][key]} <= filters
    assert all(set(own) <= set(amounts[1][key]) for key, own in amounts[0].items())
    late = ("sensor_theta", "delay")
    assert len(amounts[0][late]) < len(amounts[1][late])
    assert min(amounts[0][late]) == min(amounts[1][late])
    ranked = [{p.keys: p.gain for p in c.ranked if p.gain > 0.0} for c in (few, every)]
    assert ranked[0] == pytest.approx(ranked[1])


def test_coarse_steps_do_for_what_a_law_adds():
    """Columns of laws beside friction have nearly the direction that fine steps give."""
    rig, segments, _, _ = looked_at("coulomb")
    fine = segments.fine
    rig = rig.with_effect("disk", "coulomb_friction", CASES["coulomb"].values)
    sizes, _ = fine.tuned(rig)
    motion = motion_of(fine, rig, fine.gains(rig, sizes))
    model = FitProblem(fine, rig, (("disk", "coulomb_friction"),), motion).homotopy_fit(sizes, None, (1.0,))
    assert fine.coarse is not fine
    assert segments.coarse is segments
    columns = CandidateSensitivities(fine, model, model.noise_levels)
    gains, simulated = fine.gains(model.rig, model.noise_levels), 0
    e0 = fine.residuals(model.rig, gains)
    for h, at in columns.hypotheses:
        if h.key != ("sensor_theta", "delay") and h.effect.name != "load_friction":
            continue
        values = dict(h.values)
        values[h.effect.size.name] *= 1.0 if h.as_it_is else SMALL
        per = 1.0 if h.as_it_is else values[h.effect.size.name]
        column = (fine.residuals(model.rig.with_effect(*h.key, values), gains) - e0) / per
        made = columns._T[at][0] * columns.scale[at][0]
        cosine = made @ column / (np.linalg.norm(made) * np.linalg.norm(column))
        assert cosine > 0.9, (h.key, h.values)
        simulated += 1
    assert simulated > 3


def test_a_law_over_the_command_needs_no_pass():
    """The column of a dead zone as it is follows from the command; a simulated one is nearly the same."""
    _, segments, model, _ = looked_at("gravity")
    columns = CandidateSensitivities(segments, model, model.noise_levels)
    gains = segments.gains(model.rig, model.noise_levels)
    e0 = segments.residuals(model.rig, gains)
    (h, at) = next((h, at) for h, at in columns.hypotheses if h.key == ("amplifier", "dead_zone") and h.as_it_is)
    column = segments.residuals(model.rig.with_effect(*h.key, h.values), gains) - e0
    made = columns._T[at][0] * columns.scale[at][0]
    assert np.linalg.norm(made - column) < 0.1 * np.linalg.norm(column)
