"""Heads of columns: a name, and maybe a unit, in any of the ways in which people write the two together.

``x1 [mm]``, ``x1 (mm)``, ``x1 {mm}``, ``x1_mm``, ``v_mm_s``, ``x1 / mm``, ``x1, mm``, ``x1 in mm``, ``x1 mm``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from dtbacklash import units

_BRACKET = re.compile(r"[\[({<]\s*([^\[\](){}<>]*?)\s*[\])}>]")
_BETWEEN = re.compile(r"\s+in\s+|[\s_/,]+")  # between a name and a unit without brackets


BRACKET, SIGN, BLANK = "bracket", "sign", "blank"
TIME = "t"
#: other names of the column t, in small letters, with blanks for what joins words
TIMES = frozenset({
    "time", "times", "timestamp", "timestamps", "zeit", "zeitstempel", "uhrzeit", "datetime", "date time", "x value",
    "x axis", "elapsed", "elapsed time", "time elapsed", "time stamp", "stamp", "sec", "secs", "seconds", "ts",
    "relative time", "rel time", "test time", "run time", "runtime", "messzeit", "laufzeit", "absolute time",
    "system time",
})  # fmt: skip
#: those that say the unit as well
CLOCKS = {"millis": "ms", "micros": "us", "milliseconds": "ms", "msec": "ms", "nanoseconds": "ns", "ms": "ms"}
_JOINTS = re.compile(r"[\s_.%-]+|\(\)$")


class Head(NamedTuple):
    """A name and a unit (empty: none), and what stands between them.

    What is in brackets is meant as a unit even if none is known; behind a mere blank it is one if the name is known.
    """

    name: str
    unit: str
    between: str = BLANK


def readings(text: str, written: str = "") -> Iterator[Head]:
    """The ways in which a head may be read, the likeliest first; ``theta_m`` is a name before it is a length.

    ``written`` : the unit where a line of its own states it; only brackets count more.
    """
    text = text.strip()
    brackets = list(_BRACKET.finditer(text))
    known = [found for found in brackets if units.find(found.group(1))]
    last = [found for found in brackets if found.end() == len(text) and found.start() > 0]
    for found in (known or last)[-1:]:
        yield Head((text[: found.start()] + text[found.end() :]).strip(), found.group(1), BRACKET)
        return
    yield Head(text, written, SIGN)
    stated = units.find(written)
    for found in _BETWEEN.finditer(text):
        unit = _known(text[found.end() :])
        if unit and found.start() > 0 and (not written or (stated and units.find(unit) == stated)):
            yield Head(text[: found.start()], unit, SIGN if found.group().strip() else BLANK)


def unit_of(text: str, written: str, si: tuple[str, ...]) -> str:
    """The unit in the head of a column that someone else has named a channel, measured in one of ``si``; or empty.

    Without brackets, what is a unit of another kind is a part of the name (``Kanal_A`` of a position).
    """
    for head in readings(text, written):
        unit = units.find(head.unit)
        if head.unit and (
            head.unit == written or head.between == BRACKET or (unit is not None and (unit.si in si or si == ("",)))
        ):
            return head.unit
    return ""


def is_time(text: str) -> bool:
    """Whether a head is that of times."""
    names = [name for reading in readings(text) for name in (reading.name, last(reading.name))]
    return any(name.lower() == TIME or names_time(name) for name in names)


def last(name: str) -> str:
    """The last part of a name in a structure, or of a topic: ``log.x1``, ``/joint/x1``."""
    return re.split("[./]", name)[-1].strip()


def names_time(name: str) -> bool:
    """Whether a name is another one of the column t."""
    plain = _JOINTS.sub(" ", name.lower()).strip()
    return plain in TIMES or plain in CLOCKS


def unit_in_name(name: str) -> str:
    """The unit of times whose name says it, ``millis``; or empty."""
    return CLOCKS.get(_JOINTS.sub(" ", name.lower()).strip(), "")


def bare(text: str) -> str:
    """The head without what stands in brackets, whatever that is: ``Zeit [hh:mm:ss]`` of time stamps is ``Zeit``."""
    return _BRACKET.sub("", text).strip()


def _known(text: str) -> str:
    """The unit written so, with ``_`` for a bar or a blank, or empty."""
    for written in (text, text.replace("_", "/"), text.replace("_", " ")):
        if units.find(written):
            return written
    return ""
