"""Wrong units: a channel that is what the command does to the rig, once it is multiplied by 1000 or 57.3.

The factor s on a channel (:mod:`.plausible`) is 1 in right units and 1/1000 for millimetres read as metres. A recording
is refused only if s lies near a unit's factor (within a factor 4 of 1000, 2.2 of 57.3), and the motion accounts for at
least a quarter of what else may use the command up; or if a rig that comes to rest by itself moves hundreds of times as
much as the command can make it, all the time. Missing physics does not do that. It may do what rpm, revolutions and
inches do, a command that is clipped at a third, say: near these smaller factors (within a factor 1.25, where the motion
accounts for nearly all) nothing is refused, there is a doubt, and the diagnosis says what it was.

A recording without such evidence passes; then the note about what was assumed is all there is. That is so where
friction or a stop takes all of the command at almost every time, where what is missing is nonlinear to a degree that
the linear rig predicts nothing of the motion, where an encoder shows a few counts, and where somebody else than the
command moved the machine.

Who is to blame: the rotor's angle, where a channel behind the screw fits the command but not the angle; the command,
where a channel is too small by a factor that no unit of it explains (a command in mV, in counts of a converter).
"""

from __future__ import annotations

import math
from collections.abc import Mapping as Dict
from typing import NamedTuple

import numpy as np

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.channels import filled
from dtbacklash.recording.model import Recording
from dtbacklash.recording.plausible import SAMPLES_WIRING, Bench, Scale, scales
from dtbacklash.recording.refusal import Refused

#: SI unit -> units that are mistaken for one another; the first is SI
MISTAKEN = {
    "m": ("m", "mm", "um", "in"),
    "m/s": ("m/s", "mm/s", "in/s"),
    "rad": ("rad", "deg", "mrad", "rev"),
    "rad/s": ("rad/s", "deg/s", "rpm"),
    "A": ("A", "mA"),
    "N": ("N", "kN"),
}
#: SI unit -> factors between what was recorded and what it was read as
FACTORS: dict[str, tuple[float, ...]] = {
    si: tuple(factor for other in others for factor in (units.per_si(other), 1 / units.per_si(other)))
    for si, (_, *others) in MISTAKEN.items()
}
NEAR = 0.2  # power of a unit's factor: as far from it s may lie
SHARE = 0.25  # of what the command leaves that the motion has to account for
SMALL = 50.0  # smaller factors come nearer to what missing physics makes of s: they need a plainer motion
SHARE_SMALL, REACH_SMALL = 0.85, 1.25
SUSTAINED = 300.0  # times what the command can do, at all times
ALIKE = 3.0  # a factor that is nearer to 1 is right
COMMAND = "u"


class Doubt(NamedTuple):
    """A channel whose unit may be wrong, and a clause that says how it looks."""

    channel: str
    looks: str


def doubts_of(rig: Rig, recording: Recording) -> list[Doubt]:
    """What looks to be in a wrong unit, although physics may explain it; looked for in the longest stretch.

    Raises
    ------
    UserError : with the key ``recording``: a channel is off by the factor of a wrong unit.
    """
    if recording.trust_units:
        return []
    a, b = max(recording.stretches, key=lambda s: s[1] - s[0])
    parts = {name: values[a:b] for name, values in recording.channels.items()}
    channels = {name: filled(part) for name, part in parts.items() if np.isfinite(part).any()}
    try:
        with np.errstate(all="ignore"):  # squares of values like 1e-300 are zero; nothing here depends on them
            return check_units(rig, channels, recording.sample_time_s, recording.command, recording.assumed_units)
    except Refused as refusal:
        raise UserError("recording", recording.name, str(refusal)) from refusal


def check_units(
    rig: Rig, channels: dict[str, Floats], sample_time_s: float, command: str, assumed: dict[str, str]
) -> list[Doubt]:
    """Refuse a channel that is off by the factor of a wrong unit; what physics may do as well is a doubt.

    Parameters
    ----------
    channels : name -> (N,) values in SI. command : see :mod:`.command`. assumed : channel -> what it was read in.

    Raises
    ------
    Refused : names the channel, what it was read in, and what would fit.
    """
    found = scales(rig, channels, sample_time_s, command)
    off = {name: factor for name, scale in found.items() if (factor := _off(rig.sensors[name].unit, scale))}
    large = {name for name, factor in off.items() if max(factor, 1.0 / factor) > SMALL}
    bench = Bench.of(rig, channels, sample_time_s, command, SAMPLES_WIRING) if large else None
    for pair in bench.pairs(alike=False) if bench else ():
        reversal = bench.reversal(pair, unlike=True) if bench and large & set(pair) else None
        if reversal is not None and reversal.wrong:
            a, b = pair
            raise Refused(
                f"channels {a} and {b} look to have changed places: only the other way round they are what the "
                "command u does to this rig; swap them in the file or in its mapping, or give "
                "recording.trust_units=true if they are right"
            )
    doubts = []
    for name, factor in off.items():
        blamed, by = _blamed(rig, name, factor, channels, sample_time_s, command, found, assumed)
        read, whole = assumed.get(blamed) or _si(rig, blamed), units.whole(_si(rig, blamed))
        counts = by > SMALL and blamed != COMMAND and _are_whole(channels[blamed], read)
        looks = _looks(blamed, found[blamed].factor if counts and blamed in found else by, read, counts)
        if name in large:
            unit = f"{whole}/4096, for as many counts a {whole}," if counts else "UNIT,"
            raise Refused(
                f"channel {blamed} looks to be in a wrong unit: {looks}; give recording.units.{blamed}={unit} or "
                "recording.trust_units=true if they are right"
            )
        doubts.append(Doubt(blamed, looks))
    return doubts


def _off(unit: str, scale: Scale) -> float | None:
    """The factor of a wrong unit, of the channel or of the command: that of a converter's counts may be any."""
    counts = scale.share > SHARE and 0.0 < scale.factor < 1.0 / SMALL
    return mistaken(unit, scale) or (scale.factor if counts else None)


def mistaken(unit: str, scale: Scale) -> float | None:
    """The factor of the wrong unit that a scale shows, or None."""
    for factor in FACTORS.get(unit, ()):
        size = abs(math.log(factor))
        share, reach = (SHARE, NEAR * size) if size > math.log(SMALL) else (SHARE_SMALL, math.log(REACH_SMALL))
        if scale.share > share and scale.factor > 0.0 and abs(math.log(scale.factor / factor)) < reach:
            return factor
        if factor > 1.0 and scale.sustained > SUSTAINED and abs(math.log(scale.sustained / factor)) < reach:
            return factor
    return None


def _blamed(
    rig: Rig, name: str, factor: float, channels: dict[str, Floats], step_s: float, command: str,
    found: dict[str, Scale], assumed: Dict[str, str],
) -> tuple[str, float]:  # fmt: skip
    """Which channel is wrong where ``name`` does not fit what drives it, and by what factor."""
    angle = Bench(rig, channels, step_s, command).driver(name)
    if angle != COMMAND:
        alone = scales(rig, {COMMAND: channels[COMMAND], name: channels[name]}, step_s, command).get(name)
        if alone and alone.share > SHARE and abs(math.log(max(alone.factor, 1e-300))) < math.log(ALIKE):
            return angle, 1.0 / factor
    read = assumed.get(name, _si(rig, name)).partition(" (")[0]
    if factor < 1.0 / SMALL and not _explained(_si(rig, name), read, factor):
        return COMMAND, 1.0 / (found[name].factor or factor)
    return name, factor


def _explained(si: str, read: str, factor: float) -> bool:
    """Whether a unit that people mistake for the one that was read explains a factor."""
    per_read = (units.find(read) or units.UNITS[si]).factor
    sizes = [abs(math.log(units.per_si(unit) * per_read / factor)) for unit in MISTAKEN[si]]
    return min(sizes) < NEAR * abs(math.log(factor))


def _are_whole(values: Floats, read: str) -> bool:
    """Whether what was read in a unit was whole numbers, as a sensor's counts are."""
    unit = units.find(read.partition(" (")[0])
    raw = values / (unit.factor if unit else 1.0)
    return bool(np.all(np.abs(raw - np.rint(raw)) < 1e-6 * np.maximum(1.0, np.abs(raw))))


def _looks(name: str, factor: float, read: str, counts: bool) -> str:
    """How a channel looks beside what the command does. counts : whether its values are whole numbers."""
    size = f"{factor:.4g} too large" if factor > 1 else f"{1 / factor:.4g} too small"
    said = f"it was read in {read}, and its values are about a factor {size} "
    if name == COMMAND:
        return said + "for what this rig does (as with mV, or counts of a converter, read as V)"
    if counts:
        return said + "for what the command u does to this rig, and whole numbers (as with counts of a sensor)"
    written = read.partition(" (")[0]
    per_read = (units.find(written) or units.Unit("", 1.0)).factor
    kind = units.of_kind((units.find(written) or units.Unit("", 1.0)).si)
    other = min(kind, key=lambda unit: abs(math.log(units.per_si(unit) * per_read / factor)), default=written)
    return said + f"for what the command u does to this rig (as with {other} read as {written})"


def _si(rig: Rig, name: str) -> str:
    return rig.command_unit if name == COMMAND else rig.sensors[name].unit
