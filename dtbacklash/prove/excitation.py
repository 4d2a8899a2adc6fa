"""What moves a motor with gear and screw in a concealed recording; courses of references, commands, disturbances."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator

from dtbacklash.arrays import Floats
from dtbacklash.physics.rig import Rig
from dtbacklash.prove.simulator.given import Loop

#: the rig of the paper turns once in 2 mm; others with a screw move and are measured in proportion to their lead
PAPER_TURN_M = 2e-3
SHARE_OPEN_LOOP = 0.12
#: bandwidth of the loop around the motor's angle, rad/s, and how far its gain is drawn from it
INNER_RAD_S = 150.0
MULTISINE_LINES = 24
#: band of a coloured force, Hz; of a slow drift, periods in the recording; how far friction wanders, as a share of it
COLOURED_HZ, SLOW_PERIODS, WANDERING = (0.3, 12.0), (0.3, 4.0), 0.5


def turn_m(rig: Rig) -> float:
    """Travel of the screw in one turn of the motor, m."""
    screw = rig.only("screw")
    assert screw is not None
    return 2.0 * np.pi * screw.values["lead"]


def draw_excitation(rng: Generator, rig: Rig) -> dict[str, Any]:
    """Draw what moves a rig in cascade; plain numbers and words.

    Closed loop: ``form`` is ``steps`` (random levels, random dwells), ``staircase`` or ``multisine``, on top of which a
    small multisine turns the motor round often. Open loop: a multisine or repeated chirp of the voltage.
    """
    size = turn_m(rig) / PAPER_TURN_M * 1e-3
    if rng.random() < SHARE_OPEN_LOOP:
        return {
            "form": str(rng.choice(["voltage_multisine", "voltage_chirp"])), "seed": draw_seed(rng),
            "rms_v": float(rng.uniform(0.6, 2.0)), "f_min_hz": float(rng.uniform(0.2, 0.5)),
            "f_max_hz": float(rng.uniform(6.0, 20.0)),
        }  # fmt: skip
    circuit = rig.only("motor_circuit")
    assert circuit is not None
    return {
        "form": str(rng.choice(["steps", "staircase", "multisine"], p=[0.5, 0.2, 0.3])), "seed": draw_seed(rng),
        "amplitude_m": float(rng.uniform(0.5, 2.0)) * size, "dwell_s": float(rng.uniform(0.3, 0.9)),
        "ripple": float(rng.uniform(0.05, 0.15)), "f_max_hz": float(rng.uniform(5.0, 12.0)),
        "gain_v_per_rad": circuit.values["emf_constant"] * INNER_RAD_S * float(rng.uniform(0.5, 1.1)),
        "filter_rad_s": float(rng.uniform(15.0, 60.0)), "integral_per_s": float(rng.choice([0.0, 0.0, 0.15, 0.3])),
    }  # fmt: skip


def draw_seed(rng: Generator) -> int:
    return int(rng.integers(2**31))


def loop_of(excitation: dict[str, Any], t_s: Floats, force: Floats) -> Loop:
    """The signals of an excitation in cascade, (N+1,) samples each. ``force`` : a disturbance."""
    rng, none = np.random.default_rng(excitation["seed"]), np.zeros(len(t_s))
    form = excitation["form"]
    if form.startswith("voltage"):
        draw = multisine if form == "voltage_multisine" else chirp
        u = excitation["rms_v"] * draw(rng, t_s, excitation["f_min_hz"], excitation["f_max_hz"])
        return Loop(False, u, none, force)
    amplitude = excitation["amplitude_m"]
    r = amplitude * course(rng, form, t_s, excitation["dwell_s"])
    r = r + amplitude * excitation["ripple"] * multisine(rng, t_s, 0.5, excitation["f_max_hz"])
    return Loop(
        True, r, none, force, excitation["gain_v_per_rad"], excitation["filter_rad_s"], excitation["integral_per_s"]
    )


def course(rng: Generator, form: str, t_s: Floats, dwell_s: float) -> Floats:
    """A reference of size 1: ``steps``, ``staircase`` or ``multisine``."""
    if form == "multisine":
        return 0.5 * multisine(rng, t_s, 0.1, 3.0)
    return (_steps if form == "steps" else _staircase)(rng, t_s, dwell_s)


def disturbance(seed: int, duration_s: float, sample_time_s: float) -> Floats:
    """(N+1,) a force with a course of its own, rms 1: slow noise, and a few strokes."""
    rng = np.random.default_rng([seed, 1])
    t_s: Floats = sample_time_s * np.arange(round(duration_s / sample_time_s) + 1, dtype=np.float64)
    course = multisine(rng, t_s, 0.05, 4.0)
    for start in rng.uniform(0.0, duration_s, max(3, round(duration_s / 3.0))):
        length = rng.uniform(0.05, 0.6)
        inside = (t_s >= start) & (t_s < start + length)
        course = course + 2.0 * rng.choice([-1.0, 1.0]) * inside * np.sin(np.pi * (t_s - start) / length) ** 2
    return np.asarray(course / np.sqrt(np.mean(course**2)))


def course_of(law: str, seed: int, t_s: Floats) -> Floats:
    """(N+1,) the course in time of a law that the catalogue lacks, rms about 1; zeros for a law that has none."""
    duration_s, step_s = float(t_s[-1]), float(t_s[1] - t_s[0])
    if law == "disturbance":
        return disturbance(seed, duration_s, step_s)
    rng = np.random.default_rng([seed, 2])
    if law == "clock_jitter":
        return rng.standard_normal(len(t_s))
    if law == "coloured_force":
        return multisine(rng, t_s, *COLOURED_HZ)
    if law not in ("gain_drift", "reading_drift", "wandering_friction"):
        return np.zeros(len(t_s))
    slow = multisine(rng, t_s, SLOW_PERIODS[0] / duration_s, SLOW_PERIODS[1] / duration_s)
    slow = (slow - slow.mean()) / slow.std()
    return np.maximum(1.0 + WANDERING * slow, 0.1) if law == "wandering_friction" else slow


def multisine(rng: Generator, t_s: Floats, f_min_hz: float, f_max_hz: float) -> Floats:
    """Lines spread evenly in log frequency, random phases, rms 1, beginning softly."""
    lines = np.geomspace(f_min_hz, f_max_hz, MULTISINE_LINES) * rng.uniform(0.95, 1.05, MULTISINE_LINES)
    phases = rng.uniform(0.0, 2.0 * np.pi, MULTISINE_LINES)
    total = np.zeros(len(t_s))
    for frequency, phase in zip(lines, phases, strict=True):
        total += np.sin(2.0 * np.pi * frequency * t_s + phase)
    return np.asarray(total * np.sqrt(2.0 / MULTISINE_LINES) * -np.expm1(-t_s / 0.1))


def chirp(rng: Generator, t_s: Floats, f_min_hz: float, f_max_hz: float) -> Floats:
    """Sweeps up and down in log frequency, each 4 to 8 s, rms 1."""
    period = rng.uniform(4.0, 8.0)
    share = 1.0 - np.abs(2.0 * (t_s / period % 1.0) - 1.0)
    frequency = f_min_hz * (f_max_hz / f_min_hz) ** share
    phase = 2.0 * np.pi * np.cumsum(frequency) * (t_s[1] - t_s[0])
    return np.asarray(np.sqrt(2.0) * np.sin(phase))


def _levels(t_s: Floats, edges: list[float], levels: list[float]) -> Floats:
    return np.asarray(levels)[np.searchsorted(np.asarray(edges), t_s, side="right")]


def _steps(rng: Generator, t_s: Floats, dwell_s: float) -> Floats:
    """Random levels from -1 to 1, each at least 0.3 away from the one before, held for random times."""
    edges, levels = [0.2], [0.0]
    while edges[-1] < t_s[-1]:
        level = rng.uniform(-1.0, 1.0)
        if abs(level - levels[-1]) >= 0.3:
            levels.append(level)
            edges.append(edges[-1] + dwell_s * rng.uniform(0.5, 2.5))
    return _levels(t_s, edges, [*levels, 0.0])


def _staircase(rng: Generator, t_s: Floats, dwell_s: float) -> Floats:
    """Up and down in three to five treads."""
    treads = int(rng.integers(3, 6))
    course = np.concatenate([np.arange(-treads, treads), np.arange(treads, -treads, -1)]) / treads
    course = np.roll(course, -treads)  # begin at zero
    count = int(np.ceil(t_s[-1] / dwell_s)) + 1
    return np.asarray(np.resize(course, count)[np.minimum((t_s / dwell_s).astype(int), count - 1)])
