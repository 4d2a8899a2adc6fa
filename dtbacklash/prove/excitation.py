"""What moves a rig in a concealed recording: a motor with gear and screw in cascade, any other in its own scales."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.random import Generator

from dtbacklash.arrays import Floats
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.prove import tuning
from dtbacklash.prove.simulator.given import Loop
from dtbacklash.prove.simulator.rig import simulate_other
from dtbacklash.prove.tuning import Drive

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


# any other rig, in its own scales: a command is as large as an amplifier's signals are, a reference as large as such a
# command can follow, times go with the loop's bandwidth and with the frequencies at which the structure swings

#: rms of the command, V: an amplifier takes 10 V at most
COMMAND_V = (0.6, 3.0)
#: rms of what is added to the command of a closed loop, as a share of all of it; and the loop's limit
DITHER, LIMIT = (0.2, 0.5), 8.0
#: share made in open loop, where a loop can be closed: of rigs that springs hold, and of others
OPEN_GROUNDED, OPEN_FREE = 0.5, 0.25
#: a level is held for so long, s, and at least for so many times 1/bandwidth; the prefilter takes a share of that
DWELL_S, DWELLS, SETTLES = (0.3, 0.9), 10.0, (4.0, 8.0)
#: the command reaches this far above the highest mode, but not above a share of the sampling rate; Hz without a mode
BEYOND_MODES, SAMPLING_SHARE, WITHOUT_MODES_HZ = (1.3, 2.5), 0.15, (6.0, 20.0)
#: the lowest frequency of a command, Hz: of what drifts, the displacement goes with its inverse square
LOWEST_HZ, LOWEST_DRIFTING_HZ = (0.2, 0.5), (0.5, 1.0)
#: a test machine moves slowly, Hz, and this many times as far as its brake gives way elastically
MACHINE_HZ, STROKES = (2.0, 6.0), (1.0, 3.0)
#: strokes that take a drift away last so long, s, and no longer than this share of the recording
STROKE_S, STROKE_SHARE = 2.0, 0.25


def draw_motion(rng: Generator, rig: Rig, duration_s: float, step_s: float) -> dict[str, Any]:
    """Draw what moves the rig; plain numbers and words.

    Closed loop: a PID on the driven body's position follows ``steps``, a ``staircase`` or a ``multisine``, and a small
    multisine is added to its command. Open loop: a multisine or repeated chirp of the command.
    """
    plant = tuning.plant_of(rig)
    omega, rms_v = tuning.crossing_rad_s(rng, plant, step_s), math.exp(float(rng.uniform(*np.log(COMMAND_V))))
    least = LOWEST_DRIFTING_HZ if plant.drifts else LOWEST_HZ
    move: dict[str, Any] = {
        "seed": draw_seed(rng), "rms_v": rms_v, "f_min_hz": float(rng.uniform(*least)),
        "f_max_hz": _highest_hz(rng, plant, step_s), "pid": "", "drifts": plant.drifts,
    }  # fmt: skip
    opened = rng.random() < (OPEN_GROUNDED if plant.grounded else OPEN_FREE)
    if not plant.driven:
        return move | _imposed(rng, rig)
    if opened or omega is None:
        return move | {"form": str(rng.choice(["command_multisine", "command_chirp"]))}
    dwell_s = max(float(rng.uniform(*DWELL_S)), DWELLS / omega)
    move |= {
        "form": str(rng.choice(["steps", "staircase", "multisine"], p=[0.5, 0.2, 0.3])), "pid": plant.sensor,
        "dwell_s": dwell_s, "filter_rad_s": min(float(rng.uniform(*SETTLES)) / dwell_s, 0.5 * omega),
        "dither_v": rms_v * float(rng.uniform(*DITHER)), "limit_v": LIMIT * rms_v, **tuning.pid(plant, omega),
    }  # fmt: skip
    return move | {"amplitude": _amplitude(move, rig, duration_s, step_s)}


def _highest_hz(rng: Generator, plant: Drive, step_s: float) -> float:
    free = float(rng.uniform(*WITHOUT_MODES_HZ))
    beyond = float(rng.uniform(*BEYOND_MODES))
    return min(beyond * float(plant.modes_hz.max()) if len(plant.modes_hz) else free, SAMPLING_SHARE / step_s)


def _imposed(rng: Generator, rig: Rig) -> dict[str, Any]:
    """A course of a positioner, in V: a brake has to slip."""
    positioner = rig.only("positioner")
    assert positioner is not None
    travel, strokes, f_max = positioner.values["travel"], float(rng.uniform(*STROKES)), float(rng.uniform(*MACHINE_HZ))
    slips = [
        rig.elements[end].values["friction"] / link.values["stiffness"] / travel
        for link in rig.links() for end in link.neighbours["between"] if "friction" in _values(rig, end)
    ]  # fmt: skip
    return {"form": "command_multisine", "f_max_hz": f_max} | ({"rms_v": strokes * max(slips)} if slips else {})


def _values(rig: Rig, name: str) -> dict[str, float]:
    return rig.elements[name].values if name in rig.elements else {}


def _amplitude(move: dict[str, Any], rig: Rig, duration_s: float, step_s: float) -> float:
    """The size of the reference at which the linear rig's command is as large as drawn: it is proportional to it."""
    linear = build_rig(replace(rig.config, effects={}))
    t_s = times(duration_s, step_s)
    alone = loop_of_motion({**move, "amplitude": 1.0, "dither_v": 0.0, "limit_v": math.inf}, t_s, np.zeros(len(t_s)))
    size = float(np.sqrt(np.mean(simulate_other(linear, alone, step_s).u ** 2)))
    return math.sqrt(move["rms_v"] ** 2 - move["dither_v"] ** 2) / size


def times(duration_s: float, step_s: float) -> Floats:
    """(N+1,) the instants of the samples, s."""
    return np.asarray(step_s * np.arange(round(duration_s / step_s) + 1, dtype=np.float64))


def loop_of_motion(move: dict[str, Any], t_s: Floats, force: Floats) -> Loop:
    """The signals of a motion, (N+1,) samples each. ``force`` : a disturbance."""
    rng, none, form = np.random.default_rng(move["seed"]), np.zeros(len(t_s)), move["form"]
    if not move["pid"]:
        draw = multisine if form == "command_multisine" else chirp
        u = move["rms_v"] * draw(rng, t_s, move["f_min_hz"], move["f_max_hz"])
        return Loop(False, _without_drift(u, t_s) if move["drifts"] else u, none, force)
    r = move["amplitude"] * course(rng, form, t_s, move["dwell_s"])
    dither = move["dither_v"] * multisine(rng, t_s, move["f_min_hz"], move["f_max_hz"])
    return Loop(
        True, r, dither, force, move["gain"], move["filter_rad_s"], move["integral"], move["limit_v"], move["pid"],
        move["rate"], move["corner_rad_s"],
    )  # fmt: skip


def _without_drift(u: Floats, t_s: Floats) -> Floats:
    """The command with two strokes at its beginning that leave a free mass without a mean speed and a mean position."""
    step_s, stroke_s = t_s[1] - t_s[0], min(STROKE_S, STROKE_SHARE * t_s[-1])
    phase = 2.0 * np.pi * np.minimum(t_s / stroke_s, 1.0)
    strokes = [1.0 - np.cos(phase), np.sin(phase)]
    later = t_s > stroke_s

    def drift(course: Floats) -> tuple[float, float]:
        speed = np.cumsum(course) * step_s
        return float(speed[later].mean()), float((np.cumsum(speed) * step_s)[later].mean())

    moved = np.array([drift(stroke) for stroke in strokes]).T
    return np.asarray(u - np.linalg.solve(moved, np.array(drift(u))) @ np.array(strokes))
