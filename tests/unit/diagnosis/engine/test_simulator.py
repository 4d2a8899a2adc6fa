"""The contract between the predictor and what simulates: another simulator takes the compiled rig's place."""

from __future__ import annotations

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis.engine.predictor import Predictor
from dtbacklash.diagnosis.engine.resampling import Samples
from dtbacklash.diagnosis.engine.rig_simulator import Simulated, linear_of
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.diagnosis.engine.simulator import Linear, Pass, Simulator
from dtbacklash.physics.rig import Rig

from .conftest import command, predictor_of, recorded


class Recursion:
    """A rig without laws as a recursion in NumPy, from the first state that the compiled rig takes."""

    finely = True

    def __init__(self, readings: Samples, start: np.ndarray) -> None:
        self.readings, self.start = readings, start

    def on(self, readings: Samples) -> Recursion:
        return Recursion(readings, self.start)

    def linear(self, rig: Rig) -> Linear:
        return linear_of(rig, self.readings.sample_time_s, self.readings.channels)

    def observe(self, rig: Rig, K: np.ndarray, W: np.ndarray, opening: int) -> Pass:
        L, Y = self.linear(rig), self.readings.y
        which, x = self.readings.which(opening, Y), self.start.copy()
        E, D, X = np.zeros_like(Y), np.zeros_like(Y), np.zeros((len(Y), len(x)))
        for k, g in enumerate(which):
            X[k], D[k] = x, Y[k] - L.C[1] @ x
            E[k] = W[1, g] @ D[k]
            x = L.A[1] @ (x + K[1, g] @ D[k]) + L.volt[1] * self.readings.u[k]
        return Pass(E, D, X, self.start.copy())

    def onwards(self, rig: Rig, Z: np.ndarray) -> np.ndarray:
        L = self.linear(rig)
        X = Z @ L.A[1].T + np.outer(self.readings.u, L.volt[1])
        X[-1] = 0.0
        return X

    def shown(self, rig: Rig, Z: np.ndarray) -> np.ndarray:
        return Z @ self.linear(rig).C[1].T

    def there(self, rig: Rig) -> np.ndarray:
        return self.readings.there

    def as_read(self, rig: Rig, D: np.ndarray) -> np.ndarray:
        return np.where(self.there(rig), D, np.nan)


@pytest.mark.parametrize("name", ["oscillator", "two_mass_stage"])
def test_a_predictor_asks_any_simulator_and_finds_the_same(name):
    rig, u = nominal_rig(name), command(6.0, 1.0)
    compiled = predictor_of(rig, u, recorded(rig, u))
    start = compiled.run(rig, compiled.gains(rig, compiled.first_noise_levels())).first
    other: Simulator = Recursion(compiled.readings, start)
    plain = Predictor(rig, other)

    assert isinstance(compiled.simulated, Simulated)
    for mine, its in ((plain, compiled), (plain.first(0.4), compiled.first(0.4))):
        sizes, likelihood = Segments(rig, (its,)).tuned(rig)
        found, same = Segments(rig, (mine,)).tuned(rig)
        assert same == pytest.approx(likelihood, rel=1e-6)
        assert found[0] == pytest.approx(sizes[0], abs=1e-6)
    Z = compiled.run(rig, compiled.gains(rig, sizes[0])).X
    for asked in ("onwards", "shown"):
        expected = getattr(compiled.simulated, asked)(rig, Z)
        assert getattr(other, asked)(rig, Z) == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())
