"""Recordings for the engine: commands, what sensors show under noise, and predictors of these."""

from dataclasses import replace

import numpy as np

from dtbacklash.diagnosis.engine.predictor import Predictor
from dtbacklash.diagnosis.engine.resampling import readings
from dtbacklash.diagnosis.engine.rig_simulator import Simulated
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.simulate import simulate

STEP_S = 2e-3
#: of a channel's standard deviation, its noise
NOISE = 1e-3


def command(seconds: float, rms: float, seed: int = 1, step_s: float = STEP_S) -> np.ndarray:
    """(N,) sines with random phases, 0.2 to 8 Hz, V."""
    t = step_s * np.arange(round(seconds / step_s) + 1)
    f = 0.2 * np.arange(1, 40)
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(f))
    u = np.sin(2.0 * np.pi * f[:, None] * t + phase[:, None]).sum(axis=0)
    return rms * u / u.std()


def recorded(rig: Rig, u: np.ndarray, noise: float = NOISE, seed: int = 3, step_s: float = STEP_S) -> dict:
    """Channel -> (N,) what is recorded of a rig from rest; noise : of its standard deviation."""
    rng = np.random.default_rng(seed)
    shown = simulate(rig, u[:-1], step_s).sensors
    return {c: y + noise * y.std() * rng.standard_normal(len(u)) for c, y in shown.items()}


def predictor_of(rig: Rig, u: np.ndarray, y: dict, every: int = 1, step_s: float = STEP_S) -> Predictor:
    """A nominal rig that looks at all channels."""
    return Predictor(rig, Simulated(readings(u, y, tuple(y), step_s, every, False)))


def segments_of(rig: Rig, u: np.ndarray, y: dict) -> Segments:
    """Segments of one stretch."""
    return Segments(rig, (predictor_of(rig, u, y),))


def with_sensors(rig: Rig, **sensors: dict[str, str]) -> Rig:
    """The rig with more sensors."""
    return build_rig(replace(rig.config, sensors=dict(rig.config.sensors) | sensors))
