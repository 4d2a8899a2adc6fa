"""What moves a rig that is no motor with gear and screw in a concealed recording, in its own scales.

Nothing here is a size of one machine: a command is as large as an amplifier's signals are, a reference as large as such
a command can follow, times go with the loop's bandwidth and with the frequencies at which the structure swings.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.random import Generator

from dtbacklash.arrays import Floats
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.prove import tuning
from dtbacklash.prove.excitation import chirp, course, draw_seed, multisine
from dtbacklash.prove.simulator.given import Loop
from dtbacklash.prove.simulator.rig import simulate_other
from dtbacklash.prove.tuning import Plant

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


def _highest_hz(rng: Generator, plant: Plant, step_s: float) -> float:
    free = float(rng.uniform(*WITHOUT_MODES_HZ))
    beyond = float(rng.uniform(*BEYOND_MODES))
    return min(beyond * float(plant.modes_hz.max()) if len(plant.modes_hz) else free, SAMPLING_SHARE / step_s)


def _imposed(rng: Generator, rig: Rig) -> dict[str, Any]:
    """A course of a positioner, in V: a brake has to slip."""
    travel, strokes, f_max = _travel(rig), float(rng.uniform(*STROKES)), float(rng.uniform(*MACHINE_HZ))
    slips = [
        rig.elements[end].values["friction"] / link.values["stiffness"] / travel
        for link in rig.links() for end in link.neighbours["between"] if "friction" in _values(rig, end)
    ]  # fmt: skip
    return {"form": "command_multisine", "f_max_hz": f_max} | ({"rms_v": strokes * max(slips)} if slips else {})


def _travel(rig: Rig) -> float:
    positioner = rig.only("positioner")
    assert positioner is not None
    return positioner.values["travel"]


def _values(rig: Rig, name: str) -> dict[str, float]:
    return rig.elements[name].values if name in rig.elements else {}


def _amplitude(move: dict[str, Any], rig: Rig, duration_s: float, step_s: float) -> float:
    """The size of the reference at which the linear rig's command is as large as drawn: it is proportional to it."""
    linear = build_rig(replace(rig.config, effects={}))
    t_s = times(duration_s, step_s)
    alone = loop_of({**move, "amplitude": 1.0, "dither_v": 0.0, "limit_v": math.inf}, t_s, np.zeros(len(t_s)))
    size = float(np.sqrt(np.mean(simulate_other(linear, alone, step_s).u ** 2)))
    return math.sqrt(move["rms_v"] ** 2 - move["dither_v"] ** 2) / size


def times(duration_s: float, step_s: float) -> Floats:
    """(N+1,) the instants of the samples, s."""
    return np.asarray(step_s * np.arange(round(duration_s / step_s) + 1, dtype=np.float64))


def loop_of(move: dict[str, Any], t_s: Floats, force: Floats) -> Loop:
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
