"""Units that may stand in files, and what the name of a column says about its unit."""

from __future__ import annotations

import math
import re

#: unit as written in a file -> SI unit, factor
UNITS: dict[str, tuple[str, float]] = {
    "s": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6), "µs": ("s", 1e-6), "min": ("s", 60.0),
    "m": ("m", 1.0), "cm": ("m", 1e-2), "mm": ("m", 1e-3), "um": ("m", 1e-6), "µm": ("m", 1e-6),
    "in": ("m", 0.0254),
    "m/s": ("m/s", 1.0), "mm/s": ("m/s", 1e-3), "in/s": ("m/s", 0.0254),
    "rad": ("rad", 1.0), "mrad": ("rad", 1e-3), "deg": ("rad", math.pi / 180), "°": ("rad", math.pi / 180),
    "rev": ("rad", 2 * math.pi),
    "rad/s": ("rad/s", 1.0), "deg/s": ("rad/s", math.pi / 180), "rpm": ("rad/s", math.pi / 30),
    "V": ("V", 1.0), "mV": ("V", 1e-3), "A": ("A", 1.0), "mA": ("A", 1e-3),
    "N": ("N", 1.0), "kN": ("N", 1e3), "lb": ("N", 4.4482216152605), "kip": ("N", 4448.2216152605),
}  # fmt: skip

#: SI unit -> unit of a plain column, as `dtb run recording.save=` writes it
PLAIN: dict[str, str] = {
    "s": "s", "m": "mm", "m/s": "mm/s", "rad": "rad", "rad/s": "rad/s", "V": "V", "A": "A", "N": "N",
}  # fmt: skip

#: SI unit of the plain columns that every rig has, and of sensors by the habit of their names
_ALWAYS = {"t": "s", "r": "m", "u": "V"}
_HABITS = ((re.compile(r"q(\d*|[a-z])"), "m"), (re.compile(r"theta(_[a-z])?"), "rad"), (re.compile(r"i(_[a-z])?"), "A"))

_BRACKET = re.compile(r"\s*[\[(]\s*([^\])]*?)\s*[\])]\s*$")


def find(unit: str) -> tuple[str, float] | None:
    """Return the SI unit and the factor of ``unit``, or None if it is unknown; capitals matter only in doubt."""
    if unit in UNITS:
        return UNITS[unit]
    lower = {name.lower(): value for name, value in reversed(UNITS.items())}
    return lower.get(unit.lower())


def plain_si(name: str, sensors: dict[str, str]) -> str | None:
    """Return the SI unit of a plain channel ``name``, or None if there is no such channel.

    ``sensors`` are those of the rig, with their SI units; without any, the lead-screw rig's habits hold.
    """
    if name in _ALWAYS:
        return _ALWAYS[name]
    if sensors:
        return sensors.get(name)
    return next((unit for pattern, unit in _HABITS if pattern.fullmatch(name)), None)


def parse(column: str, sensors: dict[str, str], written: str = "") -> tuple[str, str, float] | None:
    """Return channel, SI unit and factor of a column, or None for a column that is no channel.

    Known are plain names (``q3``), names with a unit in brackets (``q3 [mm]``) or as a suffix (``q3_mm``),
    and a unit in a line of its own (``written``).
    """
    label = column.strip()
    bracket = _BRACKET.search(label)
    if bracket:
        label, written = label[: bracket.start()].strip(), bracket.group(1)
    for text in (label, label.lower()):
        # a whole name first: theta_m and i_m are channels, not lengths
        for words in (0, 1, 2):
            parts = text.rsplit("_", words)
            si = plain_si(parts[0], sensors)
            if si is None or len(parts) != words + 1:
                continue
            unit = find(written or "/".join(parts[1:]) or PLAIN.get(si, si))
            return (parts[0], *unit) if unit else None
    return None
