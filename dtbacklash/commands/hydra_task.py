"""What the commands that are Hydra applications have in common: the words in, one task, the exit code out."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

from dtbacklash.commands import early
from dtbacklash.config.grammar import GRAMMARS
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from dtbacklash.campaign.sweep import Outcome


def main(name: str, words: Sequence[str]) -> int:
    """Run the command ``name`` with the words behind it; returns the exit code.

    Raises UserError: whatever the user got wrong.
    """
    grammar = GRAMMARS[name]
    early.check(grammar, words)
    from dtbacklash.campaign.application import find
    from dtbacklash.config import hydra_app
    from dtbacklash.config.explain import as_written, explain

    try:
        completed = words if hydra_app.is_sweep(words) else find(name).complete(list(words))
        came = hydra_app.call(task, name, completed)
        if isinstance(came, Exception):
            raise came
    except Exception as error:
        mistake = explain(error, words, grammar)
        if mistake is None:
            raise
        raise as_written(mistake, words, grammar) from error
    if came is None:  # it was only asked to show something
        return 0
    return came if isinstance(came, int) else report(cast("Outcome", came))


def task(config: DictConfig) -> int | Exception | None:
    """What Hydra calls, once here or once a job in a worker; ``hydra.job.name`` says of which command.

    It never raises: Hydra would print several lines of its own. What went wrong is returned, as the exit code is, or
    goes to the job's status file.
    """
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    hydra = HydraConfig.get()
    folder = Path(hydra.runtime.output_dir)
    name = str(hydra.job.name)
    if hydra.mode == RunMode.MULTIRUN:
        from dtbacklash.campaign import sweep

        sweep.job(config, folder, command_line(name, hydra.overrides.task))
        return None
    from dtbacklash import files

    try:
        return _alone(name, config, folder, hydra.overrides.task)
    except Exception as error:
        files.forget_empty(folder)
        return error
    except KeyboardInterrupt:
        files.forget_empty(folder)
        raise


def _alone(name: str, config: DictConfig, folder: Path, overrides: Sequence[str]) -> int:
    """Do what was asked for, show it, return the exit code."""
    from dtbacklash.api.progress import progress
    from dtbacklash.campaign.application import find

    application = find(name)
    settings = application.load(config)  # first: a mistake in an override is told here
    try:
        bar = application.progress or (lambda: progress(application.doing))
        with bar() as tell:
            result, _ = application.do(settings, folder, command_line(name, overrides), tell)
    except UserError as error:
        if error.result is not None:  # minutes of work, which the terminal can keep
            application.show(error.result, settings, None)
        raise
    return application.show(result, settings, folder)


def report(outcome: Outcome) -> int:
    """Print the table of a sweep that has ended, and why jobs failed; returns the exit code."""
    from rich.markup import escape

    from dtbacklash.campaign.sweep import TABLE
    from dtbacklash.commands.console import shown_path, stdout_console
    from dtbacklash.report.components import tables
    from dtbacklash.report.sweep.page import terminal

    table, axes = outcome.table, outcome.axes
    tables.show(tables.of(terminal(table, axes)), "")
    for row in table[table["status"] != "done"].to_dict("records"):
        choices = ", ".join(f"{axis}={row[axis]}" for axis in axes)
        print(f"dtb: job {choices} failed: {row['error']}", file=sys.stderr)
    done = int((table["status"] == "done").sum())
    earlier = f", {outcome.kept} of them from before" if outcome.kept else ""
    console = stdout_console()
    console.print(f"{done} of {len(table)} jobs done{earlier}")
    page = outcome.folder / "report.html"
    shown = page if page.exists() else outcome.folder / TABLE
    console.print(escape(shown_path(shown)), soft_wrap=True)
    return outcome.exit_code


def command_line(name: str, overrides: Sequence[str]) -> str:
    """The command that repeats a job with these overrides, as a person writes them, quoted for a shell."""
    grammar = GRAMMARS[name]
    short = {key: word for word, key in grammar.words.items()} | {v: k for k, v in grammar.flags.items()}
    words = []
    for override in overrides:
        word = override.removeprefix("++")
        key, equals, value = word.partition("=")
        words.append(short.get(word) or f"{short.get(key, key)}{equals}{value}")
    return shlex.join(["dtb", name, *words])
