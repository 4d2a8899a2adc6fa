"""A frame with a blade that rings, and recordings of it: both positions under broadband noise."""

from dataclasses import replace

import numpy as np
from machine_cases import rig as rig_of

from dtbacklash.diagnosis.records import Record
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.simulate import simulate

STEP_S = 1e-3
NOISE = 2e-3
ELEMENTS = {
    "amplifier": {"kind": "amplifier", "drives": "shaker"},
    "shaker": {"kind": "actuator", "gain": "g", "drives": "frame"},
    "frame": {"kind": "mass", "mass": "m_1"},
    "foot": {"kind": "link", "between": ["ground", "frame"], "stiffness": "k_1", "damping": "c_1"},
    "blade": {"kind": "link", "between": ["frame", "tip"], "stiffness": "k_2", "damping": "c_2"},
    "tip": {"kind": "mass", "mass": "m_2"},
}
SENSORS = {"x_1": {"of": "frame", "quantity": "position"}, "x_2": {"of": "tip", "quantity": "position"}}


UNITS = {"g": "N/V", "m_1": "kg", "k_1": "N/m", "c_1": "N s/m", "m_2": "kg", "k_2": "N/m", "c_2": "N s/m"}


def blade(**changed: float) -> Rig:
    """Modes at 8 and 61 Hz; the second one rings for 0.5 % of critical damping."""
    values = {"g": 5.0, "m_1": 1.0, "k_1": 3000.0, "c_1": 4.0, "m_2": 0.2, "k_2": 2.4e4, "c_2": 0.6}
    return rig_of(ELEMENTS, SENSORS, **values | changed)


def known(rig: Rig) -> Rig:
    """The same with tolerances within which the frequencies are off by several times their width."""
    tolerances = {"g": 0.02, "m_1": 0.05, "k_1": 0.1, "c_1": 0.3, "m_2": 0.05, "k_2": 0.1, "c_2": 0.3}
    parameters = {n: replace(p, tolerance=tolerances[n], unit=UNITS[n]) for n, p in rig.config.parameters.items()}
    return build_rig(replace(rig.config, parameters=parameters))


def recorded(truth: Rig, seed: int, samples: int = 12_000) -> Record:
    """Both positions under noise of up to 100 Hz."""
    rng = np.random.default_rng(seed)
    spectrum = np.fft.rfft(rng.normal(0.0, 1.0, samples))
    spectrum[np.fft.rfftfreq(samples, STEP_S) > 100.0] = 0.0
    u = np.fft.irfft(spectrum, samples)
    u *= 2.0 / u.std() * np.minimum(1.0, np.arange(samples) / 50.0)
    shown = simulate(truth, u[:-1], STEP_S).sensors
    y = {name: values + rng.normal(0.0, NOISE * values.std(), samples) for name, values in shown.items()}
    train = np.arange(samples) < 0.6 * samples
    return Record(STEP_S, u, y, train, ~train)
