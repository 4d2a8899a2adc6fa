"""The pull of each block towards its measurement: into which blocks a rig is cut, and how fast each is pulled.

One that integrates is pulled at a share of the recording's tempo; one that is too far from its recording, faster.
"""

from dataclasses import replace

import numpy as np

from dtbacklash.diagnose.data.compare import Block, Record, part_of, poles_of, residual
from dtbacklash.diagnose.settings import settings
from dtbacklash.errors import UserError
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.bodies import natural_frequencies_hz
from dtbacklash.physics.rig import Rig


def observer_gains(bandwidth_rad_s: float, step_s: float) -> tuple[float, float]:
    """Per sample, on position and velocity: of a critically damped observer of two integrators."""
    return 2.0 * bandwidth_rad_s * step_s, bandwidth_rad_s**2 * step_s


def cut(rig: Rig, channels: tuple[str, ...], sample_time_s: float, tempo_rad_s: float) -> list[Block]:
    """The blocks of a rig for the channels that were recorded.

    tempo_rad_s : how fast it moves there (:mod:`.tempo`).

    Raises
    ------
    UserError : none of the rig's sensors was recorded.
    """
    known = tuple(name for name in rig.sensors if name in channels)
    if not known:
        allowed = f"has no channel of this rig; it needs one of {', '.join(rig.sensors)}"
        raise UserError("recording", ", ".join(channels) or rig.config.name, allowed)
    angle, tempo = _angle_sensor(rig, known), tempo_rad_s * sample_time_s
    motor_side = [n for n in known if rig.elements[rig.sensors[n].of].trait.motor_side]
    beyond = tuple(n for n in known if n not in motor_side)
    if angle and rig.only("screw"):
        blocks = [_pulled(Block("motor", tuple(motor_side), tempo), rig, sample_time_s)]
        return blocks + ([Block("structure", beyond, tempo, imposed=angle)] if beyond else [])
    return [_pulled(Block("rig", known, tempo), rig, sample_time_s)]


def _angle_sensor(rig: Rig, known: tuple[str, ...]) -> str | None:
    rotor = rig.motor_rotor()
    for name in known:
        sensor = rig.sensors[name]
        if rotor and sensor.quantity == "position" and sensor.of == rotor.name:
            return name
    return None


def _pulled(block: Block, rig: Rig, sample_time_s: float) -> Block:
    """Choose the gains: one on the position per integrator, both for two (a critically damped observer)."""
    integrators = _integrators(rig, block, sample_time_s)
    if integrators == 0:
        return block
    names = [n for n in block.channels if rig.sensors[n].quantity == "position"]
    if not names:
        return _without_position(block, rig, integrators, sample_time_s)
    b = _bandwidth(block) / sample_time_s
    gains = (b * sample_time_s, 0.0) if integrators == 1 else observer_gains(b, sample_time_s)
    return replace(block, pulled=names[0], gains=gains)


def _bandwidth(block: Block) -> float:
    """Of the pull towards a measurement, rad per sample."""
    return min(settings().pull_ratio * block.tempo, settings().pull_per_sample_max)


def guided(rig: Rig, block: Block, records: list[Record]) -> Block:
    """The block with a pull that is as fast as it has to be for the nominal rig to stay near its recording.

    Where a model is far off, or swings out of step with its recording, every law is evaluated along a motion that
    never was: a spring that hardens then looks like a stop. The pull begins at the slowest mode, or at the bandwidth
    of the pull of what integrates if that is faster, and is doubled until
    the simulation of the nominal rig follows the recorded positions and speeds; one that follows by itself, or driven
    by a measured angle, is left alone.
    """
    rules = settings()
    names = [n for n in block.channels if rig.sensors[n].quantity == "position"]
    if block.imposed or not names:
        return block
    step, fastest = records[0].sample_time_s, rules.pull_per_sample_max / records[0].sample_time_s
    swing = natural_frequencies_hz(rig)
    b = 0.5 * max(2.0 * np.pi * float(swing.min()) if len(swing) else 0.0, _bandwidth(block) / step)
    while b < fastest and _astray(rig, block, records) > rules.pull_error_share_max:
        b = min(2.0 * b, fastest)
        block = replace(block, pulled=block.pulled or names[0], gains=observer_gains(b, step))
    return block


def _astray(rig: Rig, block: Block, records: list[Record]) -> float:
    """The largest error of a position or speed that the rig predicts, relative to what it does."""
    moving = [j for j, n in enumerate(block.channels) if rig.sensors[n].quantity in ("position", "velocity")]
    worst = 0.0
    for record in records:
        sizes = np.array([np.std(record.y[c]) for c in block.channels])
        with np.errstate(all="ignore"):
            errors = np.sqrt(np.mean(residual(rig, block, record, "rough") ** 2, axis=0)) / np.maximum(sizes, 1e-300)
        worst = max(worst, float(np.max(np.nan_to_num(errors[moving], nan=np.inf))))
    return worst


def _integrators(rig: Rig, block: Block, sample_time_s: float) -> int:
    plant = compile_plant(part_of(rig, block), sample_time_s, imposed=block.imposed is not None)
    return int(np.sum(np.abs(poles_of(plant)) < settings().integrator_ratio * block.tempo / sample_time_s))


def _without_position(block: Block, rig: Rig, integrators: int, sample_time_s: float) -> Block:
    """Nothing shows where the block is: its position is left free, and a speed that integrates is pulled."""
    if integrators == 1:
        return block
    names = [n for n in block.channels if rig.sensors[n].quantity == "velocity"]
    if not names:
        allowed = "needs a measured position or velocity where the rig integrates"
        raise UserError("recording", ", ".join(block.channels), allowed)
    return replace(block, pulled=names[0], gains=(_bandwidth(block), 0.0))


def adrift(rig: Rig, block: Block, sample_time_s: float) -> bool:
    """Whether the block's position is free and recorded nowhere: a law that depends on it cannot be seen."""
    measured = any(rig.sensors[n].quantity == "position" for n in block.channels)
    return not measured and _integrators(rig, block, sample_time_s) > 0
