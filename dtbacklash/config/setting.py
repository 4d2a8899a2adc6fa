"""A setting is declared once, in its field: default, unit, bounds, meaning. Checks, help and docs read that.

delay_s: float = setting(4.0, "from the full buffer to the new gap in force", at_least=0)
"""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from dtbacklash import units
from dtbacklash.errors import UserError

METADATA = "setting"
#: what a setting that holds a path names
INPUT, OUTPUT = "input", "output"


@dataclass(frozen=True)
class Setting:
    """What a field says of itself.

    meaning : a phrase. unit : of a number, where the name does not end in it (``delay_s``).
    above, below : excluded bounds. at_least, at_most : included bounds.
    choices : what a text may be; empty: anything.
    path : ``INPUT`` or ``OUTPUT`` for the name of a file or folder, which may hold any sign; else empty.
    word : how a person writes the setting, where that is not its dotted key.
    flag : an option that sets it to true, e.g. ``--quick``.
    shown : the default in words, where its value does not say it.
    """

    meaning: str
    unit: str = ""
    above: float = -math.inf
    at_least: float = -math.inf
    below: float = math.inf
    at_most: float = math.inf
    choices: tuple[str, ...] = ()
    path: str = ""
    word: str = ""
    flag: str = ""
    shown: str = ""

    def check(self, key: str, value: object) -> None:
        """Refuse a value that this setting may not have (raises UserError naming ``key``); None is no value."""
        if value is None or isinstance(value, bool):
            return
        if isinstance(value, (int, float)):
            self._check_number(key, value)
        elif self.choices:
            for one in value if isinstance(value, list) else [value]:
                if str(one) not in self.choices:
                    raise UserError(key, str(one), "choose one of " + ", ".join(self.choices))

    def _check_number(self, key: str, value: float) -> None:
        finite = math.isfinite(value)
        if finite and self.above < value < self.below and self.at_least <= value <= self.at_most:
            return
        phrase = " and ".join(["finite"] * (not finite) + self.limits()) or "finite"
        unit = self.unit or units.by_suffix(key)
        raise UserError(key, value, f"must be {phrase}" + (f" {unit}" if unit and phrase[-1].isdigit() else ""))

    def limits(self) -> list[str]:
        """The bounds in words, without the unit; a whole number with all its digits."""
        words = {"at least": self.at_least, "above": self.above, "at most": self.at_most, "below": self.below}
        bounds = {word: f"{b}" if isinstance(b, int) else f"{b:g}" for word, b in words.items() if abs(b) < math.inf}
        return ["positive" if word == "above" and float(b) == 0 else f"{word} {b}" for word, b in bounds.items()]

    def allowed(self) -> str:
        """Say what the setting accepts, without its unit; empty if anything goes."""
        return ", ".join(self.choices) or " and ".join(self.limits())


def number(key: str, value: float, unit: str = "", **bounds: Any) -> None:
    """Refuse NaN, infinities and values outside of ``bounds``, those of a :class:`Setting`.

    Raises UserError: names ``key`` and the whole allowed range in ``unit`` (default: the one that the key ends in).
    """
    Setting("", unit, **bounds).check(key, value)


def setting(default: Any, meaning: str, choices: Iterable[str] = (), **more: Any) -> Any:
    """A dataclass field with its :class:`Setting`; ``default`` may be a function that makes it (``dict``)."""
    metadata = {METADATA: Setting(meaning, choices=tuple(choices), **more)}
    if callable(default):
        return field(default_factory=default, metadata=metadata)
    return field(default=default, metadata=metadata)


def check(section: Any, prefix: str = "") -> None:
    """Check every declared setting of a dataclass; for its ``__post_init__``.

    Raises UserError: names the dotted key (``prefix`` and the field, or the setting's word), the value, what is
    allowed.
    """
    for one in dataclasses.fields(section):
        declared = one.metadata.get(METADATA)
        if declared is not None:
            declared.check(declared.word or prefix + one.name, getattr(section, one.name))


@dataclass(frozen=True)
class Declared:
    """One setting of a schema: its dotted key, type, default and :class:`Setting`."""

    key: str
    kind: Any
    default: Any
    about: Setting

    @property
    def word(self) -> str:
        """How a person writes it on the command line."""
        return self.about.word or self.key

    @property
    def unit(self) -> str:
        """The unit of a number; empty if it has none."""
        return self.about.unit or units.by_suffix(self.key)

    @property
    def plain_kind(self) -> Any:
        """The type without ``| None``."""
        if isinstance(self.kind, types.UnionType):
            return next(kind for kind in typing.get_args(self.kind) if kind is not type(None))
        return self.kind

    @property
    def is_number(self) -> bool:
        """Whether it is a number."""
        return self.plain_kind in (float, int)

    @property
    def is_mapping(self) -> bool:
        """Whether it is a mapping with free keys."""
        return typing.get_origin(self.kind) is dict

    def shown(self) -> str:
        """The default as one writes it on the command line."""
        default = "null" if self.default is None else self.default
        if isinstance(default, bool):
            return str(default).lower()
        return self.about.shown or (f"{default:g}" if isinstance(default, float) else str(default))

    def allowed(self) -> str:
        """What it accepts."""
        return "true, false" if self.kind is bool else self.about.allowed()


def declared(schema: type, prefix: str = "") -> Iterator[Declared]:
    """Every setting of a schema and of the sections in it, in order."""
    kinds = typing.get_type_hints(schema)
    for one in dataclasses.fields(schema):
        kind = kinds[one.name]
        if isinstance(kind, type) and dataclasses.is_dataclass(kind):
            yield from declared(kind, f"{prefix}{one.name}.")
            continue
        factory: Callable[[], Any] | Any = one.default_factory
        default = one.default if factory is dataclasses.MISSING else factory()
        yield Declared(prefix + one.name, kind, default, one.metadata[METADATA])
