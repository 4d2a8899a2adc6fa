"""The twin's error, its derivatives, profile and simulation by the core do what plain Python does, to the last bit."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import twin as oracle

from dtbacklash.config.compose import compose
from dtbacklash.control.chain import StructureParameters
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.kernel.plant import new_state
from dtbacklash.physics.rig import build_rig
from dtbacklash.twin.gap import guard, observer, simulated
from dtbacklash.twin.gap.observer import Path, TwinModel, twin_model

STEP_S = 1e-3
EFFECTS = ["mass_3.ground_friction.force=0.2", "screw.pitch_error.amplitude=5e-5", "link_1.cubic_stiffness.k3=1e9"]


def same_bits(ours, theirs) -> bool:
    """Whether numbers are the same, to the last bit and the sign of zero; all that is not a number is one."""
    ours, theirs = (np.atleast_1d(np.asarray(one, dtype=np.float64)) for one in (ours, theirs))
    bits = [np.where(np.isnan(one), np.nan, one).view(np.int64) for one in (ours, theirs)]
    return ours.shape == theirs.shape and np.array_equal(*bits)


@cache
def model_of(masses: int) -> TwinModel:
    structure = StructureParameters((3.0,) * masses, (1e4,) * masses, (30.0,) * masses, 4e-4)
    return twin_model(structure, 40.0, STEP_S, 0)


def angle(samples: int, rng: np.random.Generator) -> np.ndarray:
    """(samples,) smooth motion that rests at times, with noise, rad."""
    moved = np.cumsum(rng.standard_normal(samples) * (rng.random(samples) < 0.7))
    return 0.3 * moved + 1e-4 * rng.standard_normal(samples)


@st.composite
def buffers(draw):
    """theta_m, eps_q, half_gap, theta_d0, growth, path, settle."""
    rng, samples = np.random.default_rng(draw(st.integers(0, 10**6))), draw(st.integers(1, 100))
    settle, masses = draw(st.integers(0, samples - 1)), draw(st.sampled_from([1, 2, 3, 4, 5]))
    theta_m, eps_q = angle(samples, rng), 1e-4 * rng.standard_normal(samples)
    half_gap = draw(st.sampled_from([0.0, -0.0, 0.05, 0.7, -0.7, 30.0]) | st.floats(-3.0, 3.0))
    start = theta_m[0] + draw(st.sampled_from([0.0, 5.0, -50.0]) | st.floats(-1.0, 1.0))
    growth = draw(st.sampled_from([0.0, 1e-3, -1e-2, 0.1]))
    return theta_m, eps_q, half_gap, start, growth, model_of(masses).from_theta_d, settle


@settings(max_examples=100)
@given(buffers())
def test_the_play_and_its_derivatives(case):
    theta_m, _, half_gap, start, growth, _, _ = case
    assert same_bits(observer.play(theta_m, half_gap, start, growth), oracle.play(theta_m, half_gap, start, growth))
    ours, theirs = np.empty((2, 4, len(theta_m)))
    observer.play_sensitivities(theta_m, half_gap, start, growth, ours)
    oracle.play_sensitivities(theta_m, half_gap, start, growth, theirs)
    assert same_bits(ours, theirs)


@settings(max_examples=100)
@given(buffers())
def test_the_error_its_cost_and_its_derivatives(case):
    theta_m, eps_q, half_gap, start, _, path, settle = case
    assert same_bits(observer.filtered(theta_m, path), oracle.filtered(theta_m, path))
    assert same_bits(observer.cost(*case), oracle.cost(*case))
    assert same_bits(observer.sensitivities(*case), oracle.sensitivities(*case))
    fixed = theta_m, eps_q, half_gap, start, path, settle
    assert same_bits(observer.cost_and_gradient(*fixed), oracle.cost_and_gradient(*fixed))
    by_start = observer.sensitivities(theta_m, eps_q, half_gap, start, 0.0, path, settle)[[0, 2]]
    assert same_bits(by_start, oracle.start_sensitivity(*fixed))


@settings(max_examples=60)
@given(buffers())
def test_the_profile(case):
    theta_m, eps_q, half_gap, _, _, path, settle = case
    gaps = np.abs(half_gap) * np.linspace(0.0, 2.0, 7)
    assert same_bits(
        guard._profile(theta_m, eps_q, gaps, path, settle), oracle._profile(theta_m, eps_q, gaps, path, settle)
    )


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite(bad):
    rng = np.random.default_rng(1)
    path, gaps = model_of(2).from_theta_d, np.array([0.0, 0.5])
    for k in (0, 20):
        theta_m, eps_q = angle(60, rng), rng.standard_normal(60)
        theta_m[k] = bad
        case = theta_m, eps_q, 0.5, 0.1, 1e-3, path, 5
        assert same_bits(observer.play(theta_m, *case[2:5]), oracle.play(theta_m, *case[2:5]))
        assert same_bits(observer.cost(*case), oracle.cost(*case))
        assert same_bits(observer.sensitivities(*case), oracle.sensitivities(*case))
        profiles = [one._profile(theta_m, eps_q, gaps, path, 5) for one in (guard, oracle)]
        assert same_bits(*profiles)


def test_where_nothing_counts():
    rng, path = np.random.default_rng(2), model_of(2).from_theta_d
    case = angle(30, rng), rng.standard_normal(30), 0.5, 0.1, 0.0, path, 30
    assert same_bits(observer.cost(*case), oracle.cost(*case))
    assert observer.sensitivities(*case).shape == (4, 0)


def test_arrays_of_any_layout_are_taken():
    rng, path = np.random.default_rng(3), model_of(2).from_theta_d
    theta_m, eps_q = angle(200, rng)[::2], rng.standard_normal((100, 2))[:, 0]
    turned = Path(np.asfortranarray(path.phi), *path[1:])
    case = theta_m.copy(), eps_q.copy(), 0.5, 0.1, 0.0, path, 10
    assert same_bits(observer.cost(theta_m, eps_q, *case[2:5], turned, 10), oracle.cost(*case))
    assert same_bits(observer.filtered(theta_m, turned), oracle.filtered(case[0], path))
    assert same_bits(observer.play(theta_m, 0.5, 0.1, 0.0), oracle.play(case[0], 0.5, 0.1, 0.0))


def test_arrays_that_do_not_fit_are_refused():
    path = model_of(2).from_theta_d
    with pytest.raises(ValueError, match=r"shape \(9,\)"):
        observer.cost(np.zeros(10), np.zeros(9), 0.5, 0.1, 0.0, path, 0)
    with pytest.raises(ValueError, match=r"shape \(3, 10\)"):
        observer.play_sensitivities(np.zeros(10), 0.5, 0.1, 0.0, np.zeros((3, 10)))
    for samples, settle in ((10, -1), (0, 0)):
        with pytest.raises(ValueError, match=f"{samples} samples that count from {settle}"):
            guard._profile(np.zeros(samples), np.zeros(samples), np.array([0.5]), path, settle)


def test_threads_do_not_disturb_each_other():
    rng, path = np.random.default_rng(4), model_of(3).from_theta_d
    case = angle(4000, rng), 1e-4 * rng.standard_normal(4000)
    gaps = np.linspace(0.0, 1.0, 40).reshape(40, 1)
    one_by_one = [guard._profile(*case, gap, path, 400).tolist() for gap in gaps]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda gap: guard._profile(*case, gap, path, 400).tolist(), gaps)) == one_by_one


@pytest.mark.parametrize("effects", [[], *([one] for one in EFFECTS), EFFECTS])
def test_the_simulation_behind_the_play(effects):
    rig = build_rig(compose(*(f"rig.effects.{effect}" for effect in effects)).rig)
    plant = compile_plant(rig, STEP_S, simulated.SUBSTEPS, simulated.EVENT_LEVELS, imposed=True)
    t = STEP_S * np.arange(800)
    theta_m, gap, found = 3.0 * np.sin(6.0 * t) + 0.5 * np.sin(40.0 * t), 0.5 + 0.2 * t, []
    for follow in (simulated.follow, oracle.follow):
        q3 = np.empty(len(t))
        follow(plant, new_state(plant), theta_m, gap, list(rig.sensors).index("q3"), np.zeros(len(plant.sensor)), q3)
        found.append(q3)
    assert np.abs(found[0]).max() > 1e-4
    assert same_bits(*found)
