"""Words ``key=value`` to a section of settings, for the commands that are no applications of Hydra; and their help."""

from __future__ import annotations

import difflib
import textwrap
import typing
from collections.abc import Sequence
from typing import Any, TypeVar

from dtbacklash.config.setting import Declared, declared
from dtbacklash.errors import UserError

Config = TypeVar("Config")
WIDTH, COLUMN = 116, 28


def read(schema: type[Config], words: Sequence[str]) -> Config:
    """The settings in ``words``, checked.

    Raises
    ------
    UserError : an unknown key, one given twice, a value of the wrong kind or out of range.
    """
    known = {one.key: one for one in declared(schema)}
    given: dict[str, Any] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not key:
            raise UserError("argument", word, "write key=value")
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.6)
            meant = f"did you mean {near[0]}?" if near else "choose one of " + ", ".join(known)
            raise UserError(key, value, f"no such setting; {meant}")
        if key in given:
            raise UserError(key, value, "is given twice")
        given[key] = _value(known[key], value)
    return schema(**given)


def _value(one: Declared, text: str) -> Any:
    if text in ("", "null"):
        if one.default is None:
            return None
        raise UserError(one.key, text, "needs a value")
    kind = one.plain_kind
    if typing.get_origin(kind) is list:
        return [part.strip() for part in text.strip("[]").split(",") if part.strip()]
    if kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            raise UserError(one.key, text, "must be a whole number" if kind is int else "must be a number") from None
    return text


def rows(schema: type) -> list[str]:
    """The lines of a help text: each setting with its default and meaning."""
    lines: list[str] = []
    for one in declared(schema):
        unit = f" [{one.unit}]" if one.unit else ""
        head, meaning = f"  {one.key}={one.shown()}", textwrap.wrap(one.about.meaning + unit, WIDTH - COLUMN)
        if len(head) >= COLUMN:
            lines += [head, *(" " * COLUMN + line for line in meaning)]
        else:
            lines += [f"{head:<{COLUMN}}{meaning[0]}", *(" " * COLUMN + line for line in meaning[1:])]
    return lines
