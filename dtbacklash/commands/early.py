"""What can be told of a command line at once: words that nothing reads, rigs and recordings that are nowhere.

Hydra would tell it as well, after half a second of imports, and the reader after seconds.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from dtbacklash.config.grammar import FOLDER_WORD, Grammar, unknown_key
from dtbacklash.config.groups import LAUNCHER, RIGS, options
from dtbacklash.errors import UserError

_SHOWS = ("-c", "--cfg", "-i", "--info")
_SWEEPS = ("-m", "--multirun")
_NAME = re.compile(r"[\w-]+")
SOURCE = "recording.source"


def check(grammar: Grammar, words: Sequence[str]) -> None:
    """Refuse a command line that cannot become one; one that passes may still be wrong.

    Raises
    ------
    UserError : a key that no setting has; a rig, or a recording, that there is not.
    """
    given = [(key.lstrip("+"), value) for key, equals, value in (word.partition("=") for word in words)
             if equals and not key.startswith(("-", "~"))]  # fmt: skip
    known = {*grammar.settings, *grammar.words, *grammar.groups, *RIGS, LAUNCHER, FOLDER_WORD, "hydra", "recording"}
    sections = {key.split(".")[0] for key in known}
    for key, value in given:
        if key.strip() and key.split(".")[0] not in sections:
            raise UserError(key, value, unknown_key(key, grammar))
    if any(word.partition("=")[0] in (*_SHOWS, *_SWEEPS) for word in words):
        return
    for key, value in given:
        if key in RIGS and key in grammar.groups and _NAME.fullmatch(value) and value not in (*options(key), "null"):
            raise UserError(key, value, f"choose one of {', '.join(options(key))}, or the path of a YAML file")
    if SOURCE in grammar.settings:
        _check_recording({SOURCE if key == grammar.settings[SOURCE].word else key: value for key, value in given})


def _check_recording(given: dict[str, str]) -> None:
    source = given.get(SOURCE, "")
    # Hydra reads quotes and functions, and several values are a sweep's
    if source in ("", "null") or any(sign in source for sign in "'\"()") or ("," in source and source[0] != "["):
        return
    from dtbacklash.recording import locate, sources_of

    several = sources_of(source)
    for one in several:
        locate.resolve(one, given.get("recording.path") if len(several) == 1 else None)
