"""``dtb paper``: every figure of the paper and ``claims.csv``."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from dtbacklash.errors import UserError

HELP = """\
usage: dtb paper [out=FOLDER]

Reproduces the figures of the paper (4, 6, 7, 8, 10, 13, 14) and checks its statements in claims.csv.
Exit code 0 if every claim holds, 1 if any fails.

  out=FOLDER   where the results go (default: outputs/<date>/<time>_paper)"""

ENTRIES = frozenset({"claims.csv", "figures", "report.html", "summary.json"})


def main(words: Sequence[str]) -> int:
    """Run ``dtb paper``; returns the exit code."""
    if any(word in ("-h", "--help", "help") for word in words):
        print(HELP)
        return 0
    folder = _folder(words)
    from dtbacklash.commands.console import progress, shown_path
    from dtbacklash.paper import run_paper
    from dtbacklash.runfolder import run_folder

    with (
        run_folder(folder, key="out", mark="claims.csv", known=ENTRIES) as scratch,
        progress("paper") as tick,
    ):
        passed = run_paper(scratch, tick)
    print(shown_path(folder / "claims.csv"))
    return 0 if passed else 1


def _folder(words: Sequence[str]) -> Path:
    now = datetime.now()
    folder = Path("outputs") / f"{now:%Y-%m-%d}" / f"{now:%H-%M-%S}_paper"
    for word in words:
        key, equals, value = word.partition("=")
        if key != "out" or not equals or not value:
            raise UserError("argument", word, "dtb paper takes only out=FOLDER")
        folder = Path(value)
    return folder.absolute()
