"""Which columns are channels, and in which units they are.

A column is known by its name (``q3``) or by its name with a unit (``q3 [mm]``, ``q3_mm``; see :mod:`.heads`). Its unit
is, in this order: what ``units=`` says, what the mapping says, what the header says, what the rig's sensor declares
(``recorded_in``), SI. Nothing else is assumed, for any rig.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping as Dict
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.errors import UserError
from dtbacklash.physics.fmus import unit_of
from dtbacklash.physics.rig import Rig
from dtbacklash.recording import heads
from dtbacklash.recording.command import NONE
from dtbacklash.recording.heads import TIME
from dtbacklash.recording.mapping import Channel, Mapping
from dtbacklash.recording.refusal import Refused
from dtbacklash.recording.table import EMPTY, Column, Table

COMMAND, REFERENCE = "u", "r"
ASSUMED, DECLARED, HEADER, GIVEN, MAPPED = "assumed", "declared by the rig", "header", "given", "mapping"

#: SI units of names that every recording may have, and of sensors by the habit of their names where there is no rig
ALWAYS = {TIME: "s", REFERENCE: "m", COMMAND: "V"}
_HABITS = ((re.compile(r"q(\d*|[a-z])"), "m"), (re.compile(r"theta(_[a-z])?"), "rad"), (re.compile(r"i(_[a-z])?"), "A"))


@dataclass
class Picked:
    """Columns chosen as channels, in SI, before any check.

    t_s : their times, or None. no_times : a column of times without values, or empty. clocks : channel -> times of its
    own, s. sample_time_s : of a recording without times. columns : channel -> what it was read from. units : channel ->
    SI unit. assumed : channel (and ``t``) -> the unit it was read in and who says so, ``mm (declared by the rig)``.
    """

    t_s: Floats | None = None
    sample_time_s: float | None = None
    channels: dict[str, Floats] = field(default_factory=dict)
    no_times: str = ""
    clocks: dict[str, Floats] = field(default_factory=dict)
    columns: dict[str, Channel] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    assumed: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    heads: list[str] = field(default_factory=list)


class _Head(NamedTuple):
    """A column that is a channel: the channel's name, and the unit as the header has it (empty: none)."""

    channel: str
    written: str


class _Names:
    """The names that channels may have: those of the rig's sensors, or without a rig those that carry a unit."""

    def __init__(self, rig: Rig | None, given: Dict[str, str]) -> None:
        self.rig, self.given = rig, dict(given)
        self.sensors = {s.name: s for s in rig.sensors.values()} if rig else {}
        self.commands = rig.config.commands if rig else {}
        known = [*ALWAYS, *self.sensors, *self.commands, *self.given]
        self.by_lower = {name.lower(): name for name in reversed(known)}
        for name, text in self.given.items():
            if rig and name not in ALWAYS and name not in self.sensors and name not in self.commands:
                raise UserError(f"recording.units.{name}", text, f"no such channel; {_has(rig)}")
            unit = units.find(str(text))
            wanted = self.si(name) if name in ALWAYS or name in self.sensors else ()
            if unit is None or (wanted and unit.si not in wanted):
                fitting = [other for si in wanted or dict.fromkeys(u.si for u in units.UNITS.values())
                           for other in units.of_kind(si)]  # fmt: skip
                raise UserError(f"recording.units.{name}", text, "choose one of " + ", ".join(dict.fromkeys(fitting)))

    def find(self, text: str) -> str | None:
        """The channel called ``text``, or None."""
        for name in (text, self.by_lower.get(text.lower(), text), text.lower()):
            if name in ALWAYS or name in self.sensors or name in self.commands or name in self.given:
                return name
            if heads.names_time(name):
                return TIME
            if not self.rig and any(pattern.fullmatch(name) for pattern, _ in _HABITS):
                return name
        return None

    def parse(self, label: str, written: str) -> _Head | None:
        """Read the head of a column; ``written`` is its unit where a line of its own states it."""
        for head in heads.readings(label, written):
            unit, last = head.unit or written, heads.last(head.name)
            channel = self.find(head.name) or self.find(last)
            if channel:
                times = (units.find(unit) or units.Unit("", 1.0)).si == "s"  # whatever it is called: X in s
                return _Head(TIME if times and "s" not in self.si(channel, unit) else channel, unit)
            if not self.rig and last and units.find(unit) and head.between != heads.BLANK:
                return _Head(last, unit)
        return None

    def si(self, channel: str, written: str = "") -> tuple[str, ...]:
        """The SI units that a channel may have; the first is what it has if nothing is said."""
        if channel == REFERENCE:
            output = self.rig.output_sensor() if self.rig else None
            return (output.unit if output else "m", "m", "rad", "m/s", "rad/s", "V")
        if channel == COMMAND and self.rig and self.rig.command_unit != ALWAYS[COMMAND]:
            return self.rig.command_unit, ALWAYS[COMMAND]  # a volt stands for one
        if channel in self.commands:  # whatever the model's actuator takes
            said = units.find(self.given.get(channel, written))
            return (said.si if said else "1",)
        if channel in ALWAYS:
            return (ALWAYS[channel],)
        if channel in self.sensors:
            return (self.sensors[channel].unit,)
        habit = next((si for pattern, si in _HABITS if pattern.fullmatch(channel)), None)
        said = units.find(self.given.get(channel, written))
        return tuple(unit for unit in (habit, said.si if said else None) if unit) or ("",)

    def declared(self, channel: str) -> str:
        """The unit that the rig declares for the column of a channel, or empty."""
        if channel == REFERENCE and self.rig:
            output = self.rig.output_sensor()
            return output.recorded_in if output else ""
        return self.sensors[channel].recorded_in if channel in self.sensors else ""

    def settle(self, column: str, channel: str, written: str, who: str = HEADER) -> tuple[units.Unit, str]:
        """The unit of a column, and a text that says which it is and who says so (raises Refused)."""
        said = [(self.given.get(channel, ""), GIVEN), (written, who), (self.declared(channel), DECLARED)]
        said.sort(key=lambda one: units.are_counts(one[0]))  # what says how large a count is comes first
        text, who = next(((text, who) for text, who in said if text), (self.si(channel)[0], ASSUMED))
        unit = units.Unit("1", 1.0) if text == "1" else units.find(text)
        if self.rig and channel in self.sensors and self.sensors[channel].quantity == "value":
            return self._per_model(self.rig, column, channel, text), f"{text} ({who})"
        if not text:
            raise Refused(
                f"nothing says the unit of column {column}; write {column} [UNIT], or give units={{{channel}: UNIT}}"
            )
        if unit is None and units.are_counts(text):
            whole = units.whole(self.si(channel)[0])
            counts = f"{{counts: 4096, per: {whole}}}"
            raise Refused(
                f"column {column} is in {text}: say how large one is, as units={{{channel}: {whole}/4096}} for 4096 of "
                f"them per {whole}; in a mapping `unit: {counts}`, in the rig's sensor `recorded_in: {counts}`"
            )
        wanted, give = self.si(channel, text), f"units={{{channel}: UNIT}}"
        if unit is None or unit.si not in wanted:
            si, key, name = wanted[0], "time" if channel == TIME else channel, json.dumps(column, ensure_ascii=False)
            why = f" ({who}), and {channel} is measured in {si}" if unit else f", which is no known unit; give {give}"
            line = f"`{key}: {{column: {name}, scale: 0.5, unit: {si}}}`"
            mend = f"; where 1 {text} stands for 0.5 {si}, a mapping says so with {line}" if si else ""
            raise Refused(f"column {column} is in {text}{why}{mend}")
        return unit, f"{text} ({who})"

    def _per_model(self, rig: Rig, column: str, channel: str, text: str) -> units.Unit:
        """From a column's unit to that of a model's variable; where either says none, numbers stand as they are."""
        variable = self.sensors[channel].of
        own = unit_of(rig.config, variable)
        said, theirs = units.find(text), units.find(own)
        if said and theirs and said.si == theirs.si:
            return units.Unit("1", said.factor / theirs.factor)
        if own and text not in ("1", own):
            raise Refused(f"column {column} is in {text}, and {variable} of the FMU in {own}")
        return units.Unit("1", 1.0)

    def overruled(self, channel: str, written: str, who: str) -> list[str]:
        """A sentence where ``units=`` says another unit than the head or the mapping; else none."""
        given = self.given.get(channel, "")
        if not given or not written or units.find(given) == units.find(written):
            return []
        return [f"Channel {channel} is read in {given}, as given, though the {who} says {written}."]


#: channel -> the column that becomes it, and how; the unit that is said for it, and who says that
_Chosen = dict[str, tuple[Channel, str, str]]


def pick(
    table: Table, rig: Rig | None, given: Dict[str, str], mapping: Mapping | None = None, part: str = ""
) -> Picked:
    """Channels by their names, or by a mapping and cut to one of its parts.

    Raises
    ------
    Refused : a unit of another kind, two columns for one channel, a channel that is no column of numbers.
    UserError : ``units`` names a channel or a unit that is not known.
    """
    names = _Names(rig, given)
    step = table.constants.get("dt")
    picked = Picked(sample_time_s=step, heads=list(table.columns))
    if mapping is None:
        chosen = _by_name(table, names, picked)
    else:
        picked.sample_time_s, picked.notes = mapping.sample_time_s or step, list(mapping.notes)
        chosen = _by_mapping(table, names, mapping, picked)
    picked.no_times = next((n for n, c in table.columns.items() if c.unusable == EMPTY and heads.is_time(n)), "")
    absent = [name for name in given if name not in chosen]
    if absent:
        allowed = f"no such column; {mapping.name if mapping else 'it'} has {', '.join(chosen)}"
        raise UserError(f"recording.units.{absent[0]}", given[absent[0]], allowed)
    rows = slice(*mapping.parts[part]) if mapping and part else slice(None)
    if rows.stop and rows.stop > table.rows:
        raise Refused(f"has {table.rows} rows, and the part {part} ends at row {rows.stop}")
    for name, (channel, written, who) in chosen.items():
        values = _numbers(table, channel.column, picked)[rows]
        if channel.si:  # a factor straight to SI, in a unit of the mapping's own
            unit, picked.assumed[name] = units.Unit(channel.si, 1.0), f"{channel.si} ({MAPPED})"
        else:
            unit, picked.assumed[name] = names.settle(channel.column, name, written, who)
            picked.notes += names.overruled(name, written, who)
        picked.columns[name] = channel
        values = values * (channel.scale * unit.factor)
        values = values + channel.offset * unit.factor if channel.offset else values
        if name == TIME:
            picked.t_s = values
            continue
        picked.channels[name], picked.units[name] = values, unit.si
        clock = None if mapping and TIME in chosen else _clock(table, table.columns[channel.column], picked)
        if clock is not None:
            picked.clocks[name] = clock[rows]
    if mapping is None and _is_command(table, picked):  # open loop: the reference is the command
        picked.channels[REFERENCE], picked.units[REFERENCE] = picked.channels[COMMAND], "V"
        picked.assumed[REFERENCE] = "V (it is the command)"
    return picked


def _by_name(table: Table, names: _Names, picked: Picked) -> _Chosen:
    """The columns that are called like a channel; the others are noted."""
    if table.numbered:
        raise Refused(_unnamed(table, names.rig))
    found = {name: names.parse(name, column.unit) for name, column in table.columns.items()}
    timed = _times(table, found)
    chosen: _Chosen = {}
    unused = [name for name, head in found.items() if head is None or (head.channel == TIME and name != timed)]
    for name, head in sorted(found.items(), key=lambda one: one[0] in unused):
        # a bare x1 beside x1 [mm]: which of them is meant is not for us to say
        channel = heads.last(name) if name in unused or head is None else head.channel
        if channel in chosen and (name not in unused or channel != TIME):
            one = chosen[channel][0].column
            raise Refused(f"has two columns for {channel}, {one} and {name}; leave one out")
        if head is not None and name not in unused:
            chosen[channel] = Channel(name), head.written, HEADER
    clocks = {column.clock for column in table.columns.values()}
    unused = [name for name in unused if name not in clocks]
    empty = [name for name in unused if table.columns[name].unusable == EMPTY]
    for what, those in (("that are no channels of the rig", [n for n in unused if n not in empty]),
                        ("without values", empty)):  # fmt: skip
        if those:
            shown = ", ".join(those[:8]) + (" ..." if len(those) > 8 else "")
            picked.notes.append(f"Columns {what} are not used: {shown}.")
    return chosen


def _by_mapping(table: Table, names: _Names, mapping: Mapping, picked: Picked) -> _Chosen:
    """The columns that a mapping names."""
    time, chosen = mapping.time, _Chosen()
    if time is None and not mapping.sample_time_s:
        used = {channel.column for channel in mapping.channels.values()}
        left = {name: names.parse(name, c.unit) for name, c in table.columns.items() if name not in used}
        time = Channel(timed) if (timed := _times(table, left)) else None
    for name, channel in {**({TIME: time} if time else {}), **mapping.channels}.items():
        column = _find(table, channel.column, mapping)
        head = heads.unit_of(column, table.columns[column].unit, names.si(name))
        other = (units.find(head) or units.Unit("", 1.0)).si not in names.si(name)
        head = "" if channel.scale != 1.0 and other else head  # the scale is that of a count, or of a volt
        said = (channel.unit, MAPPED) if channel.unit else (head, HEADER)
        chosen[name] = replace(channel, column=column), *said
        if channel.unit and head and units.find(head) != units.find(channel.unit) and name not in names.given:
            picked.notes.append(
                f"Channel {name} is read in {channel.unit}, as the mapping says, though the header says {head}."
            )
    return chosen


def _times(table: Table, found: dict[str, _Head | None]) -> str:
    """The column of times: ``t`` rather than another one of such a name; empty where there is none."""
    timed = [name for name, head in found.items()
             if head and head.channel == TIME and table.columns[name].unusable != EMPTY]  # fmt: skip
    plain = [name for name in timed if any(heads.last(h.name).lower() == TIME for h in heads.readings(name))]
    first = next(iter(table.columns.items()), None)
    if not timed and first is not None and first[1].values is not None and found.get(first[0]) is None:
        written = first[1].unit or next(heads.readings(first[0])).unit
        unit = units.find(written)
        if unit is not None and unit.si == "s" and bool(np.all(np.diff(first[1].values) > 0.0)):  # X in s
            found[first[0]] = _Head(TIME, written)
            return first[0]
    return next(iter([*plain, *timed]), "")


def _clock(table: Table, column: Column, picked: Picked) -> Floats | None:
    """The times of a column that has its own, s; None: those of all."""
    clock = table.columns.get(column.clock)
    if clock is None or clock.values is None:
        return None
    unit = units.find(clock.unit)
    picked.assumed.setdefault(TIME, f"{clock.unit} ({HEADER})" if unit else f"s ({ASSUMED})")
    return clock.values * (unit.factor if unit else 1.0)


def _unnamed(table: Table, rig: Rig | None) -> str:
    """What to write for a file whose columns have no names."""
    sensors = [name for name, _ in zip(rig.sensors if rig else ("SENSOR",), range(2, len(table.columns)), strict=False)]
    columns = {name: str(k) for k, name in enumerate([COMMAND, *sensors], 1)}
    return f"has no header: write the numbers of its columns, from 0, into a mapping, as in {_mapping('0', columns)}"


def _mapping(time: str, columns: Dict[str, str]) -> str:
    """A mapping in a line, and how it is given."""
    channels = ", ".join(f"{name}: {column}" for name, column in columns.items())
    return f"MAPPING.yaml: {{files: [FILE], time: {time}, channels: {{{channels}}}}}, and give recording=MAPPING.yaml"


def _is_command(table: Table, picked: Picked) -> bool:
    """Whether the column r repeats the column u."""
    r, u = (table.columns[picked.columns[name].column].values if name in picked.channels else None
            for name in (REFERENCE, COMMAND))  # fmt: skip
    said = picked.assumed.get(REFERENCE, "").endswith((f"({ASSUMED})", f"({DECLARED})"))
    return r is not None and u is not None and said and np.allclose(r, u, rtol=1e-12, atol=0.0)


def _find(table: Table, name: str, mapping: Mapping) -> str:
    """The column called so, whatever its capitals; or that of the number, from 0."""
    found = name if name in table.columns else {head.lower(): head for head in table.columns}.get(name.lower())
    if found is None and name.isdecimal() and int(name) < len(table.columns):
        found = list(table.columns)[int(name)]
    if found is None:
        known = ", ".join(list(table.columns)[:12])
        raise Refused(f"has no column {name}, which the mapping {mapping.name} needs; it has {known}")
    return found


def _numbers(table: Table, name: str, picked: Picked) -> Floats:
    """The numbers of a column that is a channel; texts in their place are missing values (raises Refused)."""
    column = table.columns[name]
    if column.values is None:
        raise Refused(f"column {name} {column.unusable}")
    if column.unusable not in ("", EMPTY):
        picked.notes.append(f"Column {name} {column.unusable}: missing values.")
    return column.values


def without_command(picked: Picked) -> None:
    """Make the command of a recording of which its user says that there was none: 0 V (raises Refused)."""
    u = picked.channels.get(COMMAND)
    if u is not None and np.nan_to_num(u).any():
        raise Refused(f"was said to have no command (command={NONE}), and its column {COMMAND} is not 0")
    if picked.channels and u is None:
        picked.channels[COMMAND] = np.zeros(len(next(iter(picked.channels.values()))))
        picked.units[COMMAND], picked.assumed[COMMAND] = "V", "V (no command)"


def check_present(picked: Picked, rig: Rig | None) -> None:
    """Refuse a recording without the command or without a sensor (raises Refused).

    Of a model with several commands, the first one is ``u`` as well.
    """
    names = list(picked.channels)
    for column, actuator in (rig.config.commands if rig else {}).items():
        if column not in names:
            raise Refused(f"lacks the column {column}, the command of {actuator}; the file has {', '.join(names)}")
        if COMMAND not in picked.channels:
            picked.channels[COMMAND], picked.units[COMMAND] = picked.channels[column], picked.units[column]
    shown = picked.heads or names
    has = "the file has " + ", ".join(shown[:12]) + (", ..." if len(shown) > 12 else "")
    if rig is None:
        has += "; without a rig a column needs a unit: x1 [mm]"
    else:
        has += f"; {rig.config.name} wants {COMMAND} and some of {', '.join(rig.sensors)}: "
        columns = dict.fromkeys([COMMAND, *rig.sensors], "COLUMN")
        has += f"rename the columns, or write a mapping, as in {_mapping('COLUMN', columns)}"
    if COMMAND not in picked.channels:
        raise Refused(
            f"lacks the column {COMMAND} (the command); {has}; or give recording.command=none if there was none"
        )
    sensors = [name for name in names if name not in (COMMAND, REFERENCE)]
    if rig is not None:
        sensors = [name for name in sensors if name in rig.sensors]
        if not sensors:
            raise Refused(f"holds none of the sensors of {rig.config.name}; {has}")
    if not sensors:
        raise Refused(f"lacks a measured channel beside the command; {has}")


def unit_notes(assumed: Dict[str, str]) -> list[str]:
    """One sentence about the units that no file, mapping or argument has stated; none if all were stated."""
    parts = []
    for who, words in ((ASSUMED, "taken as SI, since nothing is said"), (DECLARED, "as the rig declares")):
        groups: dict[str, list[str]] = {}
        for name, text in assumed.items():
            unit, _, by = text.partition(" (")
            if by == f"{who})":
                groups.setdefault(unit, []).append(name)
        if groups:
            parts.append(", ".join(f"{', '.join(g)} in {u or '1'}" for u, g in groups.items()) + f" ({words})")
    return [f"Units: {'; '.join(parts)}."] if parts else []


def _has(rig: Rig) -> str:
    return f"{rig.config.name} has {', '.join([*ALWAYS, *rig.sensors])}"
