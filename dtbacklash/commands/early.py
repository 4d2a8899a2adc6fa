"""What can be told of a command line at once: keys, choices and numbers that cannot be, recordings that are nowhere.

Hydra would tell it as well, after a second of imports, and the reader after seconds.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, get_origin

from dtbacklash.config.grammar import FOLDER_WORD, OPEN_LOOP, Grammar, kind_of, unknown_key
from dtbacklash.config.groups import LAUNCHER, RIGS, options
from dtbacklash.config.setting import Declared
from dtbacklash.errors import UserError

_SHOWS = ("-c", "--cfg", "-i", "--info")
_SWEEPS = ("-m", "--multirun")
_NAME = re.compile(r"[A-Za-z_][\w-]*")
_NUMBER = re.compile(r"[+-]?\d{1,15}(\.\d{0,15})?")
#: what YAML reads as something else than a text
_WORDS = ("null", "none", "true", "false", "yes", "no", "on", "off", "nan", "inf")
SOURCE = "recording.source"


def check(grammar: Grammar, words: Sequence[str]) -> None:
    """Refuse a command line that cannot become one; one that passes may still be wrong.

    Raises
    ------
    UserError : a key that no setting has; a choice or a recording that there is not; a number out of its range.
    """
    given = [(key.lstrip("+"), value) for key, equals, value in (word.partition("=") for word in words)
             if equals and not key.startswith(("-", "~"))]  # fmt: skip
    groups = (*grammar.groups, *RIGS, LAUNCHER)
    known = {*grammar.settings, *grammar.known_keys(), *grammar.words, *groups, FOLDER_WORD, "recording"}
    sections = {*(key.split(".")[0] for key in known), "hydra"}
    inside = (
        one.word for one in grammar.settings.values() if get_origin(one.plain_kind) in (dict, list) or one.kind is Any
    )
    free = (*grammar.open_mappings, *(f"{name}." for name in (*inside, *RIGS, "hydra")))
    for key, value in given:
        section = key.split(".")[0]
        there = section in sections and (key in {*known, section, *OPEN_LOOP} or key.startswith(free))
        if key.strip() and not there:
            raise UserError(key, value, unknown_key(key, grammar))
    if any(word.partition("=")[0] in (*_SHOWS, *_SWEEPS) for word in words):
        return
    elsewhere = any(key == "hydra.searchpath" for key, _ in given)  # there may be other options
    for key, value in given:
        if key in grammar.groups and not elsewhere and _NAME.fullmatch(value) and value not in (*options(key), "null"):
            path = ", or the path of a YAML file" if key in RIGS else ""
            raise UserError(key, value, f"choose one of {', '.join(options(key))}{path}")
        if (one := grammar.settings.get(grammar.words.get(key, key))) is not None:
            _check_value(key, value, one, grammar)
    if SOURCE in grammar.settings:
        _check_recording({SOURCE if key == grammar.settings[SOURCE].word else key: value for key, value in given})


def _check_value(key: str, value: str, one: Declared, grammar: Grammar) -> None:
    """Refuse a plain word where a number is wanted or where it is none of the choices, and a number out of range."""
    if _NUMBER.fullmatch(value):
        whole = value.lstrip("+-").isdigit()
        if one.is_number and (whole or one.plain_kind is float):
            one.about.check(one.word, one.plain_kind(value))
        return
    if not _NAME.fullmatch(value) or value.lower() in _WORDS:
        return
    if one.is_number:
        raise UserError(key, value, f"must be {kind_of(one.key, grammar)}")
    if one.plain_kind is str:
        one.about.check(one.word, value)


def _check_recording(given: dict[str, str]) -> None:
    source = given.get(SOURCE, "")
    # Hydra reads quotes and functions, and several values are a sweep's
    if source in ("", "null") or any(sign in source for sign in "'\"()") or ("," in source and source[0] != "["):
        return
    from dtbacklash.recording import locate, sources_of

    several = sources_of(source)
    for one in several:
        locate.resolve(one, given.get("recording.path") if len(several) == 1 else None)
