"""Cases that a proof has finished, in one file: a proof of many recordings can be made in parts, on several days or
machines.

The file says which code concealed, diagnosed and asked the oracle. Cases of other code are not taken: one score is the
score of one method.
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
#: what no score reads of a diagnosis
_LEFT_OUT = ("settings", "checks", "limits", "candidates", "notes", "units", "next_experiment")


def codes() -> dict[str, str]:
    """Which code the cases of a proof are made by: digests of its parts."""
    parts = {"concealed_by": CONCEALED_BY, "diagnosed_by": DIAGNOSED_BY, "oracle_by": ORACLE_BY}
    return {name: sources.digest(files) for name, files in parts.items()}


def save(cases: Sequence[Case], file: Path) -> None:
    """Write finished cases, without what no score reads of them."""
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
    UserError : the file is none of :func:`save`, or its cases are other code's.
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
