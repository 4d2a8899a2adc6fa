"""``dtb benchmark``: make a benchmark that any tool can enter, and score a tool's answers."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

from dtbacklash.commands.help import of_command
from dtbacklash.config.benchmark import PARTS, MakeConfig, ScoreConfig
from dtbacklash.config.twin import read
from dtbacklash.errors import UserError


def main(words: Sequence[str]) -> int:
    """Run ``dtb benchmark``; returns the exit code."""
    if not words:
        print(of_command("benchmark", ["--help"]))
        return 0
    part, *rest = words
    if part not in PARTS:
        raise UserError("benchmark", part, "choose one of " + ", ".join(PARTS))
    return _make(read(MakeConfig, rest)) if part == "make" else _score(rest)


def _make(config: MakeConfig) -> int:
    from dtbacklash.benchmark.make import make
    from dtbacklash.campaign.backends import OwnProcess, Workers
    from dtbacklash.campaign.progress import shown
    from dtbacklash.commands.console import shown_path
    from dtbacklash.prove.seal import key_path

    out = Path(config.out).expanduser().absolute()
    key = Path(config.key).expanduser().absolute() if config.key else key_path(out)
    # never in this process: Ctrl-C at the end of a simulation would be lost in the callback of a weak reference
    by = Workers("loky", config.jobs) if config.jobs > 1 else OwnProcess()
    with shown("cases") as tell:
        count = make(out, key, by, tell, config.seed, config.per_machine)
    print(f"{count} cases in {shown_path(out)}; read its README.md")
    print(f"the key: {shown_path(key)}; keep it and the seed apart until the answers are written")
    return 0


def _score(words: Sequence[str]) -> int:
    from dtbacklash.benchmark.score import score_folder
    from dtbacklash.commands.console import shown_path
    from dtbacklash.report.benchmark import page
    from dtbacklash.report.components import tables

    folders = [word for word in words if "=" not in word]
    config = read(ScoreConfig, [word for word in words if "=" in word])
    if len(folders) != 2:
        raise UserError("argument", " ".join(folders) or "(missing)", "write dtb benchmark score ANSWERS BENCH")
    answers, bench = (Path(folder).expanduser().absolute() for folder in folders)
    out = Path(config.out or time.strftime(f"outputs/%Y-%m-%d/%H-%M-%S_score_{answers.name.replace('%', '%%')}"))
    out = out.expanduser().absolute()
    key = Path(config.key).expanduser() if config.key else None
    score = score_folder(answers, bench, key, config.split, config.tool or answers.name)
    page.write(score, out)
    for line in score.problems:
        print(f"dtb: {line}", file=sys.stderr)
    tables.show(tables.of(page.figures_table(score, "all")))
    print(shown_path(out / "report.html"))
    return 0
