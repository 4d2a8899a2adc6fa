"""A sweep: many runs, of which each is kept, none is done twice, and none stops the others.

Layout of the sweep folder: a run folder per job, ``status/<job>.json``, ``sweep.csv`` and ``sweep.png``. A
job counts as done if its status file holds the fingerprint of its settings
(:func:`dtbacklash.config.load.fingerprint`) and its folder is there.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import shutil
import signal
import threading
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash import runfolder
from dtbacklash.errors import UserError
from dtbacklash.runfolder import PARTIAL, hidden_sibling, reason

if TYPE_CHECKING:
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
    from omegaconf import DictConfig

STATUS = "status"
FIGURES_OF_MERIT = (
    "overshoot_pct_max",
    "settling_time_s_max",
    "peak_voltage_v",
    "n_estimations",
    "n_accepted",
)
NAME_LENGTH = 120
# one thread a job: the jobs themselves fill the cores
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

_exit_codes: list[int] = []
_parents: list[Path] = []  # the sweeps that this process directs; empty in a worker


@dataclass
class Job:
    """One run of a sweep: its name, the choices that make it differ, where it lives."""

    name: str
    choices: dict[str, str]
    overrides: list[str]
    folder: Path
    fingerprint: str = ""

    @property
    def status_file(self) -> Path:
        return status_file(self.folder)

    def status(self) -> dict[str, Any]:
        """Return what is known of the job now; ``{}`` if it has not run with these settings."""
        try:
            found = json.loads(self.status_file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        if found.get("fingerprint") != self.fingerprint:
            return {}
        if found.get("status") == "done" and not (self.folder / "summary.json").exists():
            return {}
        return dict(found)


def status_file(folder: Path) -> Path:
    """Where the job with the run folder ``folder`` says how it went."""
    return folder.parent / STATUS / f"{folder.name}.json"


def exit_code() -> int:
    """Exit code of the last sweep: 0 all done, 1 some failed, 2 all failed by wrong input."""
    return _exit_codes[-1] if _exit_codes else 1


def job(config: DictConfig, folder: Path, command: str) -> None:
    """Run one job in a worker; how it went goes to its status file, never up to the launcher."""
    from dtbacklash.commands.run_files import simulate_and_write
    from dtbacklash.config.load import fingerprint, load

    # Ctrl-C goes to the whole process group; the parent ends the workers and tidies up
    if not _parents and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    mark = ""
    try:
        settings = load(config)
        mark = fingerprint(settings)
        result = simulate_and_write(settings, folder, command)
        found = {name: result.summary.get(name) for name in FIGURES_OF_MERIT}
        write_status(folder, {"status": "done", "fingerprint": mark, "figures": found})
    except UserError as error:
        _failed(folder, mark, str(error), by_input=True)
    except Exception as error:
        lines = "".join(traceback.format_exception(error))
        _failed(folder, mark, f"{type(error).__name__}: {error}", by_input=False, details=lines)


def _failed(folder: Path, mark: str, why: str, by_input: bool, details: str = "") -> None:
    one_line = " ".join(why.split())
    entry = {
        "status": "failed",
        "fingerprint": mark,
        "error": one_line,
        "by_input": by_input,
        "traceback": details,
    }
    with contextlib.suppress(OSError):  # the disk may be full: the table then says that nothing came back
        write_status(folder, entry)
    _remove_if_empty(folder)


def write_status(folder: Path, entry: dict[str, Any]) -> None:
    """Write the status of the job in ``folder``, at once or not at all."""
    from dtbacklash.commands.run_files import json_able

    target = status_file(folder)
    target.parent.mkdir(parents=True, exist_ok=True)
    scratch = hidden_sibling(target, PARTIAL)
    scratch.write_text(json.dumps(json_able(entry), indent=2), encoding="utf-8")
    scratch.replace(target)


def run(sweeper: BasicSweeper, arguments: list[str]) -> None:
    """Run what is missing of a sweep and gather its table and its figure.

    Raises
    ------
    UserError : no job can even be set up; nothing is written then.
    KeyboardInterrupt : finished jobs stay; the same command does the rest.
    """
    from dtbacklash.sweep_report import finish

    assert sweeper.config is not None
    folder = Path(str(sweeper.config.hydra.sweep.dir)).absolute()
    jobs = plan(sweeper, arguments, folder)
    refused = _set_up(sweeper, jobs)
    if len(refused) == len(jobs):
        raise next(iter(refused.values()))
    runfolder.note_missing(folder)
    _parents.append(folder)
    try:
        (folder / STATUS).mkdir(parents=True, exist_ok=True)
        for name, mistake in refused.items():
            _failed(folder / name, "", str(mistake), by_input=True)
        missing = [one for one in jobs if one.name not in refused and one.status().get("status") != "done"]
        _run_missing(sweeper, missing, len(jobs))
        _tidy(folder, jobs)
        _exit_codes.append(finish(folder, jobs, kept=len(jobs) - len(missing) - len(refused)))
    except KeyboardInterrupt:
        _tidy(folder, jobs)
        done = sum(one.status().get("status") == "done" for one in jobs)
        text = f": {done} of {len(jobs)} jobs are done and stay; the same command does the rest"
        raise KeyboardInterrupt(text) from None
    except OSError as error:
        raise UserError("hydra.sweep.dir", folder, f"cannot be written: {reason(error)}") from error


def plan(sweeper: BasicSweeper, arguments: list[str], folder: Path) -> list[Job]:
    """Expand the overrides of a sweep into its jobs, each with a name made of its choices."""
    from hydra.core.override_parser.overrides_parser import OverridesParser

    assert sweeper.hydra_context is not None
    parser = OverridesParser.create(config_loader=sweeper.hydra_context.config_loader)
    parsed = parser.parse_overrides(arguments)
    swept = [one.get_key_element() for one in parsed if one.is_sweep_override()]
    jobs: list[Job] = []
    taken: set[str] = set()
    for overrides in (entry for batch in sweeper.split_arguments(parsed, None) for entry in batch):
        pairs = [word.partition("=")[::2] for word in overrides]
        choices = {key.lstrip("+"): value for key, value in pairs if key in swept}
        name = job_name(choices, overrides)
        if name not in taken:  # the same choice twice is one job
            taken.add(name)
            jobs.append(Job(name, choices, list(overrides), folder / name))
    return jobs


def job_name(choices: dict[str, str], overrides: Sequence[str]) -> str:
    """Return a file name for a job: its choices, and a hash where that would be ambiguous or long."""
    plain = ",".join(f"{key}={value}" for key, value in choices.items()) or "job"
    safe = re.sub(r"[^A-Za-z0-9._=,+-]", "-", plain).lstrip(".")
    if safe == plain and len(safe) <= NAME_LENGTH:
        return safe
    digest = hashlib.sha256("\n".join(overrides).encode()).hexdigest()[:8]
    return f"{safe[: NAME_LENGTH - 9]}-{digest}"


def _set_up(sweeper: BasicSweeper, jobs: list[Job]) -> dict[str, UserError]:
    """Compose every job here, to know what is done already and what cannot run. Returns name -> mistake."""
    from omegaconf import open_dict

    from dtbacklash.commands.explain import explain
    from dtbacklash.config.load import fingerprint, load

    assert sweeper.hydra_context is not None
    assert sweeper.config is not None
    loader = sweeper.hydra_context.config_loader
    refused: dict[str, UserError] = {}
    for one in jobs:
        try:
            composed = loader.load_sweep_config(sweeper.config, one.overrides)
            with open_dict(composed):
                del composed["hydra"]
            one.fingerprint = fingerprint(load(composed))
        except Exception as error:
            mistake = explain(error, one.overrides)
            if mistake is None:
                raise
            refused[one.name] = mistake
    return refused


def _run_missing(sweeper: BasicSweeper, missing: list[Job], total: int) -> None:
    from dtbacklash.sweep_report import watch

    if not missing:
        return
    for name in THREADS:
        os.environ.setdefault(name, "1")
    with watch(missing, total):
        _launch(sweeper, missing)


def _launch(sweeper: BasicSweeper, jobs: list[Job]) -> None:
    """Hand ``jobs`` to the launcher; if a worker dies, the unfinished ones get another chance alone."""
    assert sweeper.launcher is not None
    for one in jobs:
        one.status_file.unlink(missing_ok=True)  # a failure from before is tried again
    words = [
        [
            *one.overrides,
            f"hydra.sweep.dir={_quoted(one.folder.parent)}",
            f"hydra.sweep.subdir={_quoted(one.name)}",
        ]
        for one in jobs
    ]
    try:
        sweeper.launcher.launch(words, initial_job_idx=0)
    except Exception as error:
        unfinished = [one for one in jobs if not one.status()]
        if len(jobs) == 1 and unfinished:
            _failed(
                jobs[0].folder,
                jobs[0].fingerprint,
                f"its worker died: {type(error).__name__}",
                by_input=False,
            )
            return
        for one in unfinished:
            _launch(sweeper, [one])


def _quoted(value: object) -> str:
    """Quote ``value`` for Hydra's override grammar."""
    text = str(value).replace("\\", "\\\\").replace("'", "\\'")
    return f"'{text}'"


def _tidy(folder: Path, jobs: list[Job]) -> None:
    """Remove what ended workers left half-written."""
    for leftover in folder.glob(f".*{PARTIAL}"):
        shutil.rmtree(leftover, ignore_errors=True)
    for leftover in (folder / STATUS).glob(f".*{PARTIAL}"):
        leftover.unlink(missing_ok=True)
    for one in jobs:
        _remove_if_empty(one.folder)
    _remove_if_empty(folder / STATUS)
    runfolder.forget_empty(folder)


def _remove_if_empty(folder: Path) -> None:
    try:
        folder.rmdir()
    except OSError:
        return  # not there, or it holds the results of an earlier run
