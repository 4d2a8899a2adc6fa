"""The one table of units: how they are written in files, their SI unit and factor, and how people are shown them.

Inside, everything is SI. A unit is written as in ``V s/rad``: factors with blanks, powers with ``^``, one bar.
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple


class Unit(NamedTuple):
    """A unit's SI unit, and the factor from a value in the unit to the value in SI."""

    si: str
    factor: float


#: unit as written in a file -> SI unit, factor
UNITS: dict[str, Unit] = {
    name: Unit(si, factor)
    for si, written in {
        "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "min": 60.0, "sec": 1.0},
        "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "nm": 1e-9,
              "in": 0.0254, "inch": 0.0254},
        "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6, "µm/s": 1e-6, "μm/s": 1e-6, "in/s": 0.0254},
        "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180, "rev": 2 * math.pi},
        "rad/s": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": math.pi / 180, "°/s": math.pi / 180,
                  "rev/s": 2 * math.pi, "rpm": math.pi / 30, "1/min": math.pi / 30, "min^-1": math.pi / 30,
                  "U/min": math.pi / 30},
        "m/s^2": {"m/s^2": 1.0, "m/s2": 1.0, "m/s²": 1.0, "mm/s^2": 1e-3, "mm/s2": 1e-3, "mm/s²": 1e-3, "g": 9.80665,
                  "mg": 9.80665e-3},
        "rad/s^2": {"rad/s^2": 1.0, "rad/s2": 1.0, "rad/s²": 1.0, "deg/s^2": math.pi / 180, "deg/s2": math.pi / 180},
        "V": {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "µV": 1e-6, "μV": 1e-6, "kV": 1e3},
        "A": {"A": 1.0, "mA": 1e-3, "uA": 1e-6, "µA": 1e-6, "μA": 1e-6},
        "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "lb": 4.4482216152605, "kip": 4448.2216152605},
        "N m": {"N m": 1.0, "Nm": 1.0, "mNm": 1e-3, "mN m": 1e-3, "Ncm": 1e-2, "N cm": 1e-2},
    }.items()
    for name, factor in written.items()
}  # fmt: skip

#: what only stands beside or below other units
PARTS: dict[str, Unit] = {
    name: Unit(si, factor)
    for si, written in {
        "kg": {"kg": 1.0, "g": 1e-3, "t": 1e3},
        "ohm": {"ohm": 1.0, "Ohm": 1.0, "mohm": 1e-3, "kohm": 1e3, "Ω": 1.0},
        "H": {"H": 1.0, "mH": 1e-3, "uH": 1e-6, "µH": 1e-6, "μH": 1e-6},
        "Hz": {"Hz": 1.0, "kHz": 1e3},
        "W": {"W": 1.0, "mW": 1e-3, "kW": 1e3},
        "1": {"1": 1.0, "%": 1e-2},
    }.items()
    for name, factor in written.items()
}

#: SI unit -> the unit in which traces, settings and sentences give it; the others are given in SI
SHOWN: dict[str, str] = {"m": "mm", "m/s": "mm/s"}

#: what the name of a setting or of a column ends in -> its unit; the longer endings come first
SUFFIXES: dict[str, str] = {
    "_v_per_rad": "V/rad", "_rad_s2": "rad/s^2", "_m_s2": "m/s^2", "_rad_s": "rad/s", "_mm_s": "mm/s", "_mm": "mm",
    "_deg": "deg", "_s": "s", "_hz": "Hz",
}  # fmt: skip

#: units that may carry a prefix, and whether also kilo and mega (nobody writes kilometres of travel here)
PREFIXED = {"m": False, "s": False, "rad": False, "N": True, "V": True, "A": True, "Hz": True, "W": True, "ohm": True}
#: from this size on: factor and prefix
DOWN = ((0.1, 1.0, ""), (1e-4, 1e-3, "m"), (1e-7, 1e-6, "µ"), (0.0, 1e-9, "n"))
UP = ((1e7, 1e6, "M"), (1e4, 1e3, "k"))
SUPERSCRIPT = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")

#: units as words, as instruments write them
WORDS: dict[str, str] = {
    word: unit
    for unit, words in {
        "s": "second seconds secs sekunde sekunden", "ms": "msec millisecond milliseconds", "V": "volt volts",
        "A": "amp amps ampere amperes", "N": "newton newtons", "m": "meter meters metre metres",
        "mm": "millimeter millimeters", "deg": "degree degrees grad", "rad": "radian radians",
        "rev": "revolution revolutions turn turns umdrehung umdrehungen",
    }.items()
    for word in words.split()
}  # fmt: skip
_LOWER = {name.lower(): unit for name, unit in reversed(UNITS.items())}
_COUNTS = re.compile(
    r"counts?|cnts?|cts|inkr?\.?|incr?\.?|inkremente?|increments?|digits?|dig|lsb|steps?|ticks?|pulses?|imp\.?|impulse",
    re.IGNORECASE,
)
_COUNTED = re.compile(r"(.+?)\s*/\s*(\d+\.?\d*(?:[eE][+-]?\d+)?)")


def find(written: str) -> Unit | None:
    """Return the SI unit and the factor of a unit as written, or None if it is unknown; capitals matter in doubt.

    ``rev/4096`` is a part of a unit: that of an encoder with 4096 counts a turn.

    >>> find("mm"), find("Volt"), find("furlong")
    (Unit(si='m', factor=0.001), Unit(si='V', factor=1.0), None)
    >>> round(find("deg/10").factor * 1800 / math.pi, 9)
    1.0
    """
    found = UNITS.get(written) or _LOWER.get(written.lower()) or UNITS.get(WORDS.get(written.lower(), ""))
    part = None if found else _COUNTED.fullmatch(written)
    whole = find(part[1]) if part else None
    if part is None or whole is None or not 0.0 < float(part[2]) < math.inf:
        return found
    return Unit(whole.si, whole.factor / float(part[2]))


def are_counts(written: str) -> bool:
    """Whether a unit as written is that of counts, whose size only the sensor's maker knows."""
    return _COUNTS.fullmatch(written.strip()) is not None


def in_words(spec: object) -> str:
    """A unit that a file gives as text, or as counts: ``{counts: 4096, per: rev}`` is ``rev/4096``.

    >>> in_words({"counts": 4096, "per": "rev"})
    'rev/4096'
    """
    if isinstance(spec, dict) and set(spec) == {"counts", "per"}:
        return f"{spec['per']}/{spec['counts']}"
    return str(spec or "")


def composed(written: str) -> Unit | None:
    """The SI unit and the factor of a unit made of several: of ``kg cm^2`` they are ``kg m^2`` and 1e-4.

    Each part of it is replaced by its SI unit in its place; None where a part is unknown, or behind a second bar.
    """
    factor, parts = 1.0, []
    if written.strip()[-1:] in ("/", "*") or written.count("/") > 1:
        return None
    for part in re.split(r"([ /*]+)", written.strip()):
        if not part.strip(" /*"):
            parts.append(part)
            continue
        name, raised, power = part.partition("^")
        unit = PARTS.get(part) or find(part) or PARTS.get(name) or find(name)
        if unit is None or (raised and not re.fullmatch("-?[1-9]", power)):
            return None
        raised_to = int(power) if raised and find(part) is None else 1
        under = any("/" in one for one in parts)
        factor *= unit.factor ** (-raised_to if under else raised_to)
        parts.append(unit.si + (f"^{power}" if raised and find(part) is None else ""))
    return Unit("".join(parts).replace("*", " "), factor)


def of_kind(si: str) -> list[str]:
    """The units in which a quantity of this SI unit may be written."""
    return [name for name, unit in UNITS.items() if unit.si == si]


def whole(si: str) -> str:
    """The unit by which a sensor of this SI unit counts: lines a turn, counts a millimetre."""
    return {"rad": "rev", "m": "mm"}.get(si, si)


def suffix(unit: str) -> str:
    """What a column's name ends in: ``mm`` for mm, ``mm_s`` for mm/s, ``a`` for A."""
    return unit.lower().replace("/", "_").replace(" ", "_").replace("^", "")


def by_suffix(name: str) -> str:
    """The unit of a setting by the end of its name; empty if it has none."""
    return next((unit for end, unit in SUFFIXES.items() if name.endswith(end)), "")


def per_si(unit: str) -> float:
    """The factor from a value in SI to the value in ``unit``, a unit of the table."""
    found = find(unit)
    if found is None:
        raise KeyError(unit)
    return 1.0 / found.factor


def shown(si: str) -> tuple[str, float]:
    """The unit in which people are given a quantity of this SI unit, and the factor to it: mm and 1000 for m."""
    unit = SHOWN.get(si)
    return (unit, per_si(unit)) if unit else (si, 1.0)


def scaled(unit: str, size: float) -> tuple[float, str]:
    """The factor by which to divide a value of about ``size``, and the unit (as text) that it then has.

    A share (unit ``1``) becomes percent; units of length, force, voltage ... take a prefix.
    """
    size = abs(size)
    if unit == "1":
        return 0.01, "%"
    lead = next((unit[:i] for i, sign in enumerate(unit) if sign in " /^"), unit)
    if lead not in PREFIXED or unit[len(lead) : len(lead) + 1] == "^" or size == 0 or not math.isfinite(size):
        return 1.0, unit
    for least, factor, prefix in (UP if PREFIXED[lead] else ()) + DOWN:
        if size >= least:
            return factor, prefix + unit
    return 1.0, unit


def in_signs(unit: str) -> str:
    """A unit for a page: ``N s^2/m^2`` is ``N s²/m²``."""
    parts = unit.split("^")
    raised = [part[: _digits(part)].translate(SUPERSCRIPT) + part[_digits(part) :] for part in parts[1:]]
    return (parts[0] + "".join(raised)).replace("ohm", "Ω")


def _digits(text: str) -> int:
    """How many characters of the beginning are an exponent."""
    return len(text) - len(text.lstrip("-0123456789"))


#: exponents of kg, m, s and A
Dimension = tuple[float, float, float, float]
NUMBER: Dimension = (0.0, 0.0, 0.0, 0.0)
#: what a unit of a law's parameter is made of -> its dimension; an angle is a number
SI_DIMENSIONS: dict[str, Dimension] = {
    "1": NUMBER, "rad": NUMBER, "rev": NUMBER, "kg": (1, 0, 0, 0), "m": (0, 1, 0, 0), "s": (0, 0, 1, 0),
    "A": (0, 0, 0, 1), "N": (1, 1, -2, 0), "V": (1, 2, -3, -1), "W": (1, 2, -3, 0), "J": (1, 2, -2, 0),
    "ohm": (1, 2, -3, -2), "H": (1, 2, -2, -2), "Hz": (0, 0, -1, 0),
}  # fmt: skip


def dimension_of(unit: str) -> Dimension | None:
    """The dimension of a unit that is made of SI units, as ``N s^2/m^2``; None where it is not."""
    above, _, below = unit.partition("/")
    total: Dimension | None = NUMBER
    for sign, part in ((1.0, above.split()), (-1.0, below.split())):
        if not part and (sign > 0.0 or "/" in unit):
            return None
        for factor in part:
            name, raised, exponent = factor.partition("^")
            plain = exponent.removeprefix("-")
            if name not in SI_DIMENSIONS or (raised and not (plain.isascii() and plain.isdigit() and len(plain) == 1)):
                return None
            total = times(total, power(SI_DIMENSIONS[name], sign * (float(exponent) if raised else 1.0)))
    return total


def times(one: Dimension | None, other: Dimension | None) -> Dimension | None:
    """The dimension of a product; None where one is not known."""
    if one is None or other is None:
        return None
    kg, m, s, ampere = (a + b for a, b in zip(one, other, strict=True))
    return kg, m, s, ampere


def power(one: Dimension | None, exponent: float) -> Dimension | None:
    """The dimension of a power; None where it is not known."""
    if one is None:
        return None
    kg, m, s, ampere = (a * exponent + 0.0 for a in one)
    return kg, m, s, ampere


def of_dimension(one: Dimension | None) -> str:
    """A dimension in kg, m, s and A, for an error; that of a force is ``N``."""
    named = {power(dimension, 1.0): name for name, dimension in reversed(SI_DIMENSIONS.items())}
    if one is None or one in named:
        return named.get(one, "?")
    sides: list[str] = []
    for sign in (1.0, -1.0):
        parts = [(name, sign * a) for name, a in zip(("kg", "m", "s", "A"), one, strict=True) if sign * a > 0.0]
        sides.append(" ".join(name if a == 1.0 else f"{name}^{a:g}" for name, a in parts))
    return (sides[0] or "1") + (f"/{sides[1]}" if sides[1] else "")
