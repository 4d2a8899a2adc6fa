"""Whether a recording begins in motion, and the data with which its first states are fitted."""

from dataclasses import replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.compare import Block, Record, residual
from dtbacklash.diagnose.data.first_state import Beginning, moves, stands, window_of
from dtbacklash.diagnose.data.floor import sensor_noise
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.assembly import state_names
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

#: a first state explains a beginning of which rest leaves so many times more; missing physics goes on (ratio of
#: squares)
BEGINNING_RATIO = 25.0


def with_start(rig: Rig, blocks: list[Block], record: Record) -> Record:
    """The record with its positions at rest, or, if it begins in motion, with the data to fit its first states.

    In motion the first samples are masked out: with a delay they depend on what was before the recording.
    """
    shown = [n for n in record.y if rig.sensors[n].quantity in ("position", "velocity")]
    noise = {n: max(sensor_noise(v)[0], 1e-300) for n, v in record.y.items()}
    at_rest = {n: stands(record.y[n], noise[n]) for n in shown if rig.sensors[n].quantity == "position"}
    record = replace(record, stands=at_rest)
    window = {n: window_of(record.y[n], noise[n]) for n in shown}
    known = np.arange(record.samples) >= SETTINGS.delay_reach_samples
    moving = replace(
        record, train=record.train & known, held=record.held & known, judge=record.judge & known[: len(record.judge)],
        begins=Beginning(noise, window, _sizes(rig, record, window)),
    )  # fmt: skip
    if any(moves(record.y[n], noise[n], rig.sensors[n].quantity == "velocity") for n in shown):
        return moving
    return moving if any(_explains(rig, b, record, moving, noise) for b in blocks) else record


def _explains(rig: Rig, block: Block, record: Record, moving: Record, noise: dict[str, float]) -> bool:
    """Whether a first state removes nearly all of a block's residual at the beginning.

    So a motion shows in bodies that are not measured, or that reverse just then. Missing physics lasts longer, and no
    first state removes it.
    """
    first = SETTINGS.beginning_samples_min
    sigma = np.array([noise[c] for c in block.channels])
    with np.errstate(over="ignore", invalid="ignore"):
        still, fitted = (float(np.sum((residual(rig, block, r)[:first] / sigma) ** 2)) for r in (record, moving))
    return still > BEGINNING_RATIO * fitted + SETTINGS.beginning_squares


def _sizes(rig: Rig, record: Record, window: dict[str, int]) -> dict[str, tuple[float, float]]:
    """Body -> standard deviations of position and speed: measured, or of one on the same axis, or simulated."""
    found: dict[str, tuple[float, float]] = {}
    for name, width in window.items():
        sensor, values = rig.sensors[name], record.y[name]
        if sensor.quantity == "position":
            speed = (values[width:] - values[:-width]) / (width * record.sample_time_s)
            found[sensor.of] = float(np.std(values)), float(np.std(speed))
    axes = {rig.elements[b].trait.axis: size for b, size in found.items()}
    bodies = state_names(rig, rig.only("positioner") is not None)
    states = simulate(rig, record.u[:-1], record.sample_time_s, substeps=2, event_levels=4).states
    first = 1 if rig.only("motor_circuit") else 0
    for j, body in enumerate(bodies):
        if body in rig.elements and body not in found:  # a hidden body is treated with its host
            free = _spread(states[:, first + j]), _spread(states[:, first + len(bodies) + j])
            found[body] = axes.get(rig.elements[body].trait.axis, free)
    return found


def _spread(values: Floats) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(np.std(values))
    return size if np.isfinite(size) else 0.0
