"""The blocks into which a rig is cut, and the gains by which each is pulled towards its measurement.

A block that integrates is pulled at a share of the recording's tempo; one that is far from its recording, faster.
"""

from dataclasses import replace

import numpy as np

from dtbacklash.diagnose.data.compare import Block, Record, longest_step_s, part_of, poles_of, residual
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.errors import UserError
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.bodies import natural_frequencies_hz
from dtbacklash.physics.rig import Rig

#: a simulation further off is pulled faster: laws would be evaluated along a motion that never was (share of the
#: motion)
PULL_ERROR_SHARE_MAX = 0.2


def observer_gains(bandwidth_rad_s: float, step_s: float) -> tuple[float, float]:
    """Gains per sample on position and velocity, of a critically damped observer of two integrators."""
    return 2.0 * bandwidth_rad_s * step_s, bandwidth_rad_s**2 * step_s


def cut(rig: Rig, channels: tuple[str, ...], sample_time_s: float, tempo_rad_s: float) -> list[Block]:
    """The blocks of a rig for the recorded channels. tempo_rad_s : see :mod:`.tempo`.

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
    others = tuple(n for n in known if n not in motor_side)
    if angle and rig.only("screw"):
        blocks = [_pulled(Block("motor", tuple(motor_side), tempo, step_s=sample_time_s), rig, sample_time_s)]
        return blocks + ([Block("structure", others, tempo, imposed=angle, step_s=sample_time_s)] if others else [])
    return [_pulled(Block("rig", known, tempo, step_s=sample_time_s), rig, sample_time_s)]


def _angle_sensor(rig: Rig, known: tuple[str, ...]) -> str | None:
    rotor = rig.motor_rotor()
    for name in known:
        sensor = rig.sensors[name]
        if rotor and sensor.quantity == "position" and sensor.of == rotor.name:
            return name
    return None


def _pulled(block: Block, rig: Rig, sample_time_s: float) -> Block:
    """The block with gains: on the position, with two integrators also on the velocity.

    Without a measured position the position stays free, and a speed that integrates is pulled.
    """
    integrators = _integrators(rig, block, sample_time_s)
    if integrators == 0:
        return block
    names = [n for n in block.channels if rig.sensors[n].quantity == "position"]
    if not names and integrators == 1:
        return block
    if not names:
        names = [n for n in block.channels if rig.sensors[n].quantity == "velocity"]
        if not names:
            allowed = "needs a measured position or velocity where the rig integrates"
            raise UserError("recording", ", ".join(block.channels), allowed)
        return replace(block, pulled=names[0], gains=(_bandwidth(block), 0.0))
    b = _bandwidth(block) / sample_time_s
    gains = (b * sample_time_s, 0.0) if integrators == 1 else observer_gains(b, sample_time_s)
    return replace(block, pulled=names[0], gains=gains)


def _bandwidth(block: Block) -> float:
    """Bandwidth of the pull, rad per sample."""
    return min(SETTINGS.pull_ratio * block.tempo, SETTINGS.pull_per_sample_max)


def guided(rig: Rig, block: Block, records: list[Record]) -> Block:
    """The block with a pull that is fast enough for the nominal rig to stay near its recording.

    Where the simulation is far from the recording, every law is evaluated along a wrong motion: a hardening spring then
    looks like a stop. The pull begins at the slowest mode, or at the bandwidth of :func:`cut` if that is faster, and is
    doubled until the nominal rig follows the recorded positions and speeds. A block that follows without a pull, or
    that a measured angle drives, stays as it is.
    """
    names = [n for n in block.channels if rig.sensors[n].quantity == "position"]
    if block.imposed or not names:
        return block
    step = longest_step_s(records)
    fastest = SETTINGS.pull_per_sample_max / step
    swing = natural_frequencies_hz(rig)
    b = 0.5 * max(2.0 * np.pi * float(swing.min()) if len(swing) else 0.0, _bandwidth(block) / step)
    while b < fastest and _astray(rig, block, records) > PULL_ERROR_SHARE_MAX:
        b = min(2.0 * b, fastest)
        block = replace(block, pulled=block.pulled or names[0], gains=observer_gains(b, step))
    return block


def _astray(rig: Rig, block: Block, records: list[Record]) -> float:
    """The largest rms error of a predicted position or speed, relative to its standard deviation."""
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
    slowest = SETTINGS.integrator_ratio * block.at(sample_time_s).tempo / sample_time_s
    return int(np.sum(np.abs(poles_of(plant)) < slowest))


def zero_channels(rig: Rig, block: Block, sample_time_s: float) -> tuple[str, ...]:
    """The position channels of a block that show where their zero is: each but one that the block integrates to.

    A free body begins where it is measured, wherever the sensor's zero is; what is tied to the ground, to an imposed
    angle or to another measured body does not.
    """
    free = block.pulled if _integrators(rig, block, sample_time_s) else None
    return tuple(c for c in block.channels if rig.sensors[c].quantity == "position" and c != free)


def position_unknown(rig: Rig, block: Block, sample_time_s: float) -> bool:
    """Whether the block's position drifts freely and is not recorded, so that no law of it can be identified."""
    measured = any(rig.sensors[n].quantity == "position" for n in block.channels)
    return not measured and _integrators(rig, block, sample_time_s) > 0
