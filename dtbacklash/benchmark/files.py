"""The folder of a benchmark: names of its files, how they are written, and how its answers are read again.

All of it can be read with numpy and pandas alone: tables are CSV, and a ``.yaml`` is in the part of YAML that is JSON.
"""

from __future__ import annotations

import hashlib
import json
from functools import cache, partial
from pathlib import Path
from typing import Any

import pandas as pd

from dtbacklash.benchmark.vocabulary import table
from dtbacklash.errors import UserError
from dtbacklash.files import reason
from dtbacklash.prove import seal
from dtbacklash.prove.conceal import csv_text, nominal_rig
from dtbacklash.scoring.truth import Truth

README, ABOUT, HASHES, VOCABULARY, PLACES = "README.md", "benchmark.yaml", "SHA256SUMS", "vocabulary.csv", "places.csv"
CASES, MACHINES, CASE, TEST_INPUT, ANSWER = "cases", "machines", "case.yaml", "test_input.csv", "answer.json"
#: of the open split: what the sensors read in the test
TEST_OUTPUT = "test_output.csv"
#: significant digits of a number in a table
DIGITS = 9
#: a machine's name -> its nominal rig; a table -> its text
nominal, text_of = cache(nominal_rig), partial(csv_text, digits=DIGITS)


def data_text(content: Any) -> str:
    """Plain data as YAML that is JSON as well."""
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def digest(folder: Path) -> bytes:
    """``sha256  path`` of each file below a folder, in the order of their names; not of this list itself."""
    files = sorted(f for f in folder.rglob("*") if f.is_file() and f.name != HASHES)
    lines = [f"{hashlib.sha256(f.read_bytes()).hexdigest()}  {f.relative_to(folder).as_posix()}\n" for f in files]
    return "".join(lines).encode()


def sealed_content(case: Path) -> bytes:
    """The bytes that a case's seal belongs to: its recordings and its description."""
    return b"".join((case / name).read_bytes() for name in sorted(f.name for f in case.iterdir()) if name in _PUBLIC)


_PUBLIC = ("train.csv", "train_after.csv", TEST_INPUT, CASE)


def case_folders(bench: Path) -> list[Path]:
    """The folders of the cases in order.

    Raises UserError: this is no benchmark.
    """
    found = sorted(f.parent for f in (bench / CASES).glob(f"*/{CASE}"))
    if not found:
        raise UserError("bench", bench, "holds no case; dtb benchmark make writes a benchmark")
    return found


def case_of(case: Path) -> dict[str, Any]:
    """The content of a case's ``case.yaml``; raises UserError: it cannot be read."""
    try:
        content: dict[str, Any] = json.loads((case / CASE).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError("bench", case / CASE, f"cannot be read: {error}") from error
    return content


def truth_of(case: Path, key_file: Path | None) -> Truth:
    """The answer of a case: open, or sealed.

    Raises UserError: a seal without its key, or one that the key does not open; a file that was changed.
    """
    file = case / ANSWER
    try:
        if file.is_file():
            return Truth.from_json(file.read_text(encoding="utf-8"))
        if key_file is None:
            raise UserError("key", "(missing)", "the scored cases are sealed; give key=FILE, or split=development")
        return Truth.from_json(seal.open_text(case, key_file, sealed_content(case), "one of its public files"))
    except UserError:
        raise
    except OSError as error:
        raise UserError("bench", file, f"cannot be read: {reason(error)}") from error
    except (ValueError, TypeError, KeyError) as error:
        raise UserError("bench", case, f"its answer is no answer of a benchmark: {error}") from error


def places_of(bench: Path) -> dict[str, dict[str, str]]:
    """Machine -> spelling -> place; raises UserError: the table cannot be read."""
    try:
        rows = pd.read_csv(bench / PLACES, dtype=str, keep_default_na=False).to_dict("records")
        machines = dict.fromkeys(row["machine"] for row in rows)
        return {m: table((r["place"], filter(None, r["synonyms"].split(";"))) for r in rows if r["machine"] == m)
                for m in machines}  # fmt: skip
    except (OSError, ValueError, KeyError) as error:
        raise UserError("bench", bench / PLACES, f"cannot be read: {error}") from error
