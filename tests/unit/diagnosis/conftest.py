"""Recordings for the diagnosis: commands, the rig, and what its sensors would show."""

from dataclasses import replace

import machine_cases as cases
import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis.records import Record
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

STEP_S = 1e-3
COUNTS = {"theta_m": 2 * np.pi / 4096, "q3": 5e-7}
NOISE = {"q3": 1e-6}


def command(seconds: float, seed: int) -> np.ndarray:
    """Sines with random phases, 0.1 to 15 Hz, V."""
    t = np.arange(round(seconds / STEP_S) + 1) * STEP_S
    f = np.arange(1, 150) * 0.1
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(f))
    u = np.sin(2 * np.pi * f[:, None] * t + phase[:, None]).sum(axis=0)
    return 2.0 * u / u.std()


def recorded(rig: Rig, seconds: float = 12.0, seed: int = 1, u: np.ndarray | None = None) -> Record:
    """What an encoder and a laser sensor record of a rig, open loop. u : another command than :func:`command`, V."""
    u = command(seconds, seed) if u is None else u
    shown = simulate(rig, u[:-1], STEP_S).sensors
    rng = np.random.default_rng(seed)
    y = {}
    for name, count in COUNTS.items():
        noisy = shown[name] + rng.normal(0.0, NOISE.get(name, 0.0), len(u))
        y[name] = count * np.round(noisy / count)
    train = np.arange(len(u)) < 0.7 * len(u)
    return Record(STEP_S, u, y, train, ~train)


@pytest.fixture(scope="session")
def rig() -> Rig:
    return nominal_rig("lead_screw")


def record_of(case: cases.Case) -> tuple[Rig, Record]:
    u, channels = case.frame["u"].to_numpy(), {n: case.frame[n].to_numpy() for n in case.frame if n in case.rig.sensors}
    train = np.arange(len(u)) < 0.7 * len(u)
    return case.rig, Record(STEP_S, u, channels, train, ~train)


def with_(record: Record, **channels: np.ndarray) -> Record:
    return replace(record, y={**record.y, **channels})


def failed(found) -> list[str]:
    return [c.check for c in found.checks if not c.passed]


@pytest.fixture(scope="session")
def clean(rig) -> Record:
    return recorded(rig)


@pytest.fixture(scope="session")
def machine_recordings() -> dict[str, tuple[Rig, Record]]:
    return {case.name: record_of(case) for case in cases.all_cases()}
