"""Finished cases of a proof in one file, so that a long proof can be made in parts, on several days or machines.

The file holds digests of the code that made the cases; cases of other code are refused.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dtbacklash import sources
from dtbacklash.errors import UserError
from dtbacklash.files import json_text, write_bytes
from dtbacklash.prove.rules import Case
from dtbacklash.prove.work import CONCEALED_BY, DIAGNOSED_BY, ORACLE_BY

FILE = "cases.json.gz"
#: keys of a diagnosis that no score reads
_LEFT_OUT = ("settings", "checks", "limits", "candidates", "notes", "units", "next_experiment")


def codes() -> dict[str, str]:
    """Digests of the code that makes the cases of a proof."""
    parts = {"concealed_by": CONCEALED_BY, "diagnosed_by": DIAGNOSED_BY, "oracle_by": ORACLE_BY}
    return {name: sources.digest(files) for name, files in parts.items()}


def save(cases: Sequence[Case], file: Path) -> None:
    """Write finished cases, without the keys that no score reads."""
    entries = [asdict(case) for case in cases]
    for entry in entries:
        if entry["diagnosis"] is not None:
            entry["diagnosis"] = {k: v for k, v in entry["diagnosis"].items() if k not in _LEFT_OUT}
    text = json_text({**codes(), "cases": entries})
    write_bytes(file, gzip.compress(text.encode("utf-8"), mtime=0))


def load(file: Path) -> tuple[Case, ...]:
    """Read finished cases.

    Raises
    ------
    UserError : :func:`save` did not write the file, or other code made its cases.
    """
    try:
        content: dict[str, Any] = json.loads(gzip.decompress(file.read_bytes()))
        cases = tuple(Case(**entry) for entry in content["cases"])
    except (OSError, EOFError, ValueError, TypeError, KeyError) as error:
        raise UserError("known", file, f"must be a {FILE} that dtb prove docs=FOLDER wrote") from error
    others = [name for name, code in codes().items() if content.get(name) != code]
    if others:
        raise UserError("known", file, f"its cases are of other code ({', '.join(others)}); leave it out")
    return cases
