"""The core does what the same steps do in plain Python, over all rigs and effects, to the last bits."""

from pathlib import Path

import numpy as np
import pytest
from catalogued import of_each_law_and_kind
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from nominal import nominal_rig
from reference import rigs

import dtbacklash
from dtbacklash.diagnosis.engine.predictor import Predictor
from dtbacklash.diagnosis.engine.resampling import readings
from dtbacklash.diagnosis.engine.rig_simulator import Simulated
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import CATALOGUE, effects_of
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.physics.simulate import simulate

STEP_S = 2e-3
RIGS = sorted(path.stem for path in (Path(dtbacklash.__file__).parent / "conf" / "rig").glob("*.yaml"))
NOMINAL = [lambda name=name: nominal_rig(name) for name in RIGS]
OTHERS = [rigs.carriage, rigs.damper, rigs.two_inertias, rigs.geared, lambda: rigs.geared("rack"), rigs.served,
          rigs.served_carriage, rigs.oscillator]  # fmt: skip


def commands(samples: int, seed: int, rms: float, lowest_hz: float = 0.3) -> np.ndarray:
    """(samples,) sines with random phases and a step, V."""
    t, rng = STEP_S * np.arange(samples), np.random.default_rng(seed)
    f = lowest_hz * np.arange(1, 25)
    u = np.sin(2.0 * np.pi * f[:, None] * t + rng.uniform(0.0, 2.0 * np.pi, len(f))[:, None]).sum(axis=0)
    return rms * (u / u.std() + np.where(t > t.mean(), 0.5, 0.0))


def places(rig: Rig) -> list[tuple[str, str, str]]:
    """(place, kind, effect) that a rig may have."""
    there = [*rig.elements, *(SENSOR_PREFIX + sensor for sensor in rig.sensors)]
    return [(place, rig.kind_at(place), name) for place in there for name in effects_of(rig.kind_at(place))]


def sized(kind: str, name: str, times: float = 1.0) -> dict[str, float]:
    """Values of an effect: its typical ones, its size so many times as large."""
    effect = CATALOGUE[kind, name]
    values = {p.name: p.typical for p in effect.parameters}
    if effect.is_table:
        values |= {p.name: times * p.typical * (-1) ** k for k, p in enumerate(effect.parameters) if p.neutral == 0.0}
    elif np.isfinite(effect.size.typical):
        size = effect.size
        values[size.name] = min(max(times * size.typical, size.low), size.high)
    return values


def gap_of(rig: Rig, samples: int, widened: float) -> np.ndarray | None:
    """(samples + 1,) half-gap beside the rig's own, that grows and falls; None where there is no gear."""
    if not rig.only("gear") or not widened:
        return None
    t = np.linspace(0.0, 1.0, samples + 1)
    return widened * np.interp(t, [0.0, 0.1, 0.6, 0.9, 1.0], [0.0, 0.0, 1.0, 0.4, 0.4])


def predict(rig: Rig, model: Rig, u: np.ndarray, gap: np.ndarray | None = None) -> None:
    """A recording of a rig, and passes of a predictor with a model."""
    rng = np.random.default_rng(3)
    shown = simulate(rig, u[:-1], STEP_S, gap).sensors
    y = {c: v + 1e-3 * (v.std() or 1.0) * rng.standard_normal(len(u)) for c, v in shown.items()}
    y[next(iter(y))][40:60:7] = np.nan
    predictor = Predictor(model, Simulated(readings(u, y, tuple(y), STEP_S, 1, False)))
    gains = predictor.gains(model, predictor.first_noise_levels())
    passed = predictor.run(model, gains)
    states = np.nan_to_num(passed.X)
    predictor.simulated.onwards(model, states)
    predictor.simulated.shown(model, states)


@pytest.mark.parametrize("make", [*NOMINAL, *OTHERS], ids=lambda make: make().config.name)
def test_each_rig_with_each_of_its_effects(make, twice):
    # short and fast: the oracle is plain Python, and the gear is as often in and out of contact
    rig, u, tried = make(), commands(40, 1, 3.0, 3.0), 0
    simulate(rig, u, STEP_S)
    for place, kind, name in places(rig):
        try:
            with_effect = rig.with_effect(place, name, sized(kind, name))
            simulate(with_effect, u, STEP_S, gap_of(rig, len(u), 0.3))
        except UserError:  # another effect of the rig stands in its way
            continue
        tried += 1
    assert twice.calls["run"] == tried + 1
    assert tried >= 0.7 * len(places(rig))


def test_every_law_and_kind_is_among_them():
    tried = {(kind, name) for make in (*NOMINAL, *OTHERS) for _, kind, name in places(make())}
    assert set(of_each_law_and_kind(CATALOGUE)) <= tried


@pytest.mark.parametrize("name", RIGS)
def test_a_predictor_of_each_rig(name, twice):
    rig = nominal_rig(name)
    predict(rig, rig, commands(400, 2, 2.0))
    assert {"run", "observe", "onwards", "shown"} <= set(twice.calls)


@pytest.mark.check
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_drawn_rigs_and_commands(data, twice):
    rig = data.draw(st.sampled_from([*NOMINAL, *OTHERS]))()
    for place, kind, name in data.draw(st.lists(st.sampled_from(places(rig)), max_size=5, unique=True)):
        times = 10.0 ** data.draw(st.floats(-2.0, 1.0))
        try:
            rig = rig.with_effect(place, name, sized(kind, name, times))
        except UserError:
            assume(False)
    u = commands(150, data.draw(st.integers(0, 1000)), 10.0 ** data.draw(st.floats(-1.0, 1.0)))
    gap = gap_of(rig, len(u), data.draw(st.sampled_from([0.0, 0.05, 1.0])))
    substeps, levels = data.draw(st.sampled_from([0, 1, 3])), data.draw(st.sampled_from([2, 8, 16]))
    before = twice.calls.get("run", 0)
    try:
        simulate(rig, u, STEP_S, gap, substeps=substeps, event_levels=levels)
    except UserError:
        assume(False)
    assert twice.calls["run"] == before + 1


@pytest.mark.check
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_predictors_of_drawn_models(data, twice):
    rig = nominal_rig(data.draw(st.sampled_from(RIGS)))
    model = rig
    for place, kind, name in data.draw(st.lists(st.sampled_from(places(rig)), min_size=1, max_size=3, unique=True)):
        try:
            model = model.with_effect(place, name, sized(kind, name, 10.0 ** data.draw(st.floats(-2.0, 0.5))))
        except UserError:
            assume(False)
    try:
        predict(rig, model, commands(300, data.draw(st.integers(0, 1000)), 2.0))
    except (UserError, np.linalg.LinAlgError):
        assume(False)
