"""``dtb run``: one closed-loop experiment, or with ``-m`` a sweep over many."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from dtbacklash.config.run import RunConfig

_failures: list[Exception] = []


def main(words: Sequence[str]) -> int:
    """Run ``dtb run`` with the given overrides; returns the exit code."""
    if any(word in ("-h", "--help", "help") for word in words):
        from dtbacklash.commands import run_help

        print(run_help.text())
        return 0
    from dtbacklash.commands import hydra_app
    from dtbacklash.commands.explain import explain

    _failures.clear()
    try:
        hydra_app.call(task, "dtb run", list(words))
    except Exception as error:
        mistake = explain(error, words)
        if mistake is None:
            raise
        raise mistake from error
    if _failures:
        raise _failures[0]
    if "-m" in words or "--multirun" in words:
        from dtbacklash import sweep

        return sweep.exit_code()
    return 0


def task(config: DictConfig) -> None:
    """What Hydra calls, once here or once a job in a worker.

    It never raises: Hydra would print several lines of its own. What went wrong is kept for :func:`main`,
    or goes to the job's status file.
    """
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    hydra = HydraConfig.get()
    folder = Path(hydra.runtime.output_dir)
    if hydra.mode == RunMode.MULTIRUN:
        from dtbacklash import sweep

        sweep.job(config, folder, command_line(hydra.overrides.task))
        return
    try:
        from dtbacklash.config.load import load

        single(load(config), folder, command_line(hydra.overrides.task))
    except Exception as error:
        from dtbacklash import runfolder

        runfolder.forget_empty(folder)
        _failures.append(error)
    except KeyboardInterrupt:
        from dtbacklash import runfolder

        runfolder.forget_empty(folder)
        raise


def command_line(overrides: Sequence[str]) -> str:
    """Return the command that repeats a run with these overrides, as a person writes them, quoted for a shell."""
    return shlex.join(["dtb", "run", *(word.removeprefix("++") for word in overrides)])


def single(config: RunConfig, folder: Path, command: str) -> None:
    """Simulate ``config``, write its folder and tell the user."""
    from dtbacklash.commands import console, run_files

    with console.progress("simulating") as tick:
        result = run_files.simulate_and_write(config, folder, command, tick)
    console.print_run(result.summary, result.moves, result.estimates, folder)
    sys.stdout.flush()
