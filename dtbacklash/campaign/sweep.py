"""A sweep: one command over many choices, of which each is kept, none is done twice, and none stops the others.

Layout of the sweep folder: a run folder per job, ``status/<job>.json``, ``sweep.csv``, and what the application draws
of the whole. A job counts as done if its status file holds the fingerprint of its settings, its folder is complete, and
the file that it writes elsewhere, if any, is there.
Several sweeps may work in one folder at once: they share the jobs.
"""

from __future__ import annotations

import hashlib
import re
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash import files
from dtbacklash.campaign import engine
from dtbacklash.campaign.application import Application, find
from dtbacklash.campaign.backends import Launcher
from dtbacklash.campaign.jobs import Job, perform
from dtbacklash.campaign.progress import shown
from dtbacklash.config.grammar import GRAMMARS
from dtbacklash.errors import Failure, UserError

if TYPE_CHECKING:
    import pandas as pd
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
    from omegaconf import DictConfig

STATUS, TABLE = "status", "sweep.csv"
KEY = "hydra.sweep.dir"
NAME_LENGTH = 120
SILENT = "its worker returned nothing"


@dataclass
class SweepJob(Job):
    """One run of a sweep.

    name : made of its choices. choices : what makes it differ from the others. overrides : all that is asked for.
    folder : of its results. fingerprint : of its settings. mark : a file that complete results hold.
    application, settings, command : what to do, for who does it. writes : the file that it writes elsewhere.
    """

    name: str
    choices: dict[str, str]
    overrides: list[str]
    folder: Path
    fingerprint: str = ""
    mark: str = "summary.json"
    application: Application | None = None
    settings: Any = None
    command: str = ""
    writes: Path | None = None
    record: Path = field(init=False)

    def __post_init__(self) -> None:
        self.record = self.folder.parent / STATUS / f"{self.folder.name}.json"

    def status(self) -> dict[str, Any]:
        """Return what is known of the job now; ``{}`` if it has not run with these settings."""
        found = files.read_json(self.record)
        if found.get("fingerprint") != self.fingerprint:
            return {}
        complete = (self.folder / self.mark).exists() and (self.writes is None or self.writes.exists())
        return {} if found.get("status") == "done" and not complete else found

    def done(self) -> bool:
        return self.status().get("status") == "done"

    def work(self) -> None:
        assert self.application is not None
        try:
            _, row = self.application.do(self.settings, self.folder, self.command, None)
        except Exception as error:
            self.failed_by(error)
            return
        figures = {name: row.get(name) for name in self.application.figures}
        self.tell({"status": "done", "fingerprint": self.fingerprint, "figures": figures})

    def died(self, error: Exception | None) -> None:
        if isinstance(error, OSError) and error.errno in files.ENVIRONMENT:
            self.failed_by(files.cannot_write("hydra.run.dir", self.folder, error))
        else:
            self.failed(f"its worker died: {type(error).__name__}" if error else SILENT)

    def failed_by(self, error: Exception) -> None:
        """Record that there is no result: of wrong input, of a full disk, or of a mistake of ours."""
        if isinstance(error, UserError):
            self.failed(str(error), by_input=error.exit_code == UserError.exit_code)
        else:
            lines = "".join(traceback.format_exception(error))
            self.failed(f"{type(error).__name__}: {error}", details=lines)

    def failed(self, why: str, by_input: bool = False, details: str = "") -> None:
        """Record why there is no result."""
        self.tell({
            "status": "failed", "fingerprint": self.fingerprint, "error": " ".join(why.split()), "by_input": by_input,
            "traceback": details,
        })  # fmt: skip
        files.remove_if_empty(self.folder)

    def tell(self, entry: dict[str, Any]) -> None:
        """Write the status, at once or not at all; errors as for :func:`dtbacklash.files.written`."""
        files.write_json(self.record, entry, KEY, self.folder.parent)

    def tidy(self) -> None:
        super().tidy()
        for path in files.leftovers(self.folder):
            files.remove(path)
        with files.claim(files.lock_of(self.folder)):
            pass  # it goes with its holder
        files.remove_if_empty(self.folder)


@dataclass(frozen=True)
class Outcome:
    """How a sweep went.

    folder : of the sweep. table : a row a job: the choices (columns ``axes``), figures, ``status``, ``error``.
    kept : jobs that were done before. exit_code : 0 all done, 1 some failed, 2 all failed by wrong input.
    """

    folder: Path
    table: pd.DataFrame
    axes: list[str]
    kept: int
    exit_code: int


def job(config: DictConfig, folder: Path, command: str) -> None:
    """Do one job, in a worker; how it went goes to its status file, never up to the launcher.

    The application is the one called ``hydra.job.name``.
    """
    from hydra.core.hydra_config import HydraConfig

    application = find(str(HydraConfig.get().job.name))
    one = SweepJob(folder.name, {}, [], folder, mark=application.mark, application=application, command=command)
    try:
        one.settings = application.load(config)
        one.fingerprint, one.writes = application.fingerprint(one.settings), application.writes(one.settings)
    except Exception as error:
        one.failed_by(error)
        return
    perform(one)


def run(sweeper: BasicSweeper, arguments: list[str]) -> Outcome:
    """Run what is missing of a sweep, and write its table and what the application draws of it; how it went.

    Raises UserError: no job can even be set up, two would write one file (nothing is written then), or the folder
    cannot be written to. Failure: the disk is full; finished jobs stay. KeyboardInterrupt: finished jobs stay; the same
    command does the rest.
    """
    assert sweeper.config is not None
    folder = Path(str(sweeper.config.hydra.sweep.dir)).absolute()
    application = find(str(sweeper.config.hydra.job.name))
    jobs = plan(sweeper, arguments, folder, application)
    refused = _set_up(sweeper, jobs, application)
    if len(refused) == len(jobs):
        raise next(iter(refused.values()))
    able = [one for one in jobs if one.name not in refused]
    _check_apart(able, application)
    files.note_missing(folder)
    try:
        (folder / STATUS).mkdir(parents=True, exist_ok=True)
        for one in jobs:
            if one.name in refused:
                one.failed_by(refused[one.name])
        kept = sum(one.done() for one in able)
        assert sweeper.launcher is not None
        with shown("jobs") as tell:
            engine.complete(able, Launcher(sweeper.launcher.launch, words), tell)
        return finish(folder, jobs, application, kept)
    except OSError as error:
        raise files.cannot_write(KEY, folder, error) from error
    finally:
        _tidy(folder, jobs)


def plan(sweeper: BasicSweeper, arguments: list[str], folder: Path, application: Application) -> list[SweepJob]:
    """Expand the overrides of a sweep into its jobs, each with a name made of its choices, as a person writes them."""
    from hydra.core.override_parser.overrides_parser import OverridesParser

    from dtbacklash.config.hydra_app import unquoted

    assert sweeper.hydra_context is not None
    parser = OverridesParser.create(config_loader=sweeper.hydra_context.config_loader)
    parsed = parser.parse_overrides(arguments)
    swept = [one.get_key_element() for one in parsed if one.is_sweep_override()]
    short = {key: word for word, key in GRAMMARS[application.name].words.items()}
    jobs: list[SweepJob] = []
    taken: set[str] = set()
    for overrides in (entry for batch in sweeper.split_arguments(parsed, None) for entry in batch):
        pairs = [word.partition("=")[::2] for word in overrides]
        choices = {short.get(name, name): unquoted(value)
                   for name, value in ((key.lstrip("+"), value) for key, value in pairs if key in swept)}  # fmt: skip
        name = job_name(choices, overrides)
        if name not in taken:  # the same choice twice is one job
            taken.add(name)
            jobs.append(SweepJob(name, choices, application.complete(list(overrides)), folder / name))
    return jobs


def job_name(choices: dict[str, str], overrides: Sequence[str]) -> str:
    """Return a file name for a job: its choices, and a hash where that would be ambiguous or long."""
    plain = ",".join(f"{key}={value}" for key, value in choices.items()) or "job"
    safe = re.sub(r"[^A-Za-z0-9._=,+-]", "-", plain).lstrip(".")
    if safe == plain and len(safe) <= NAME_LENGTH:
        return safe
    digest = hashlib.sha256("\n".join(overrides).encode()).hexdigest()[:8]
    return f"{safe[: NAME_LENGTH - 9]}-{digest}"


def _set_up(sweeper: BasicSweeper, jobs: list[SweepJob], application: Application) -> dict[str, UserError]:
    """Compose every job here, to know what is done already and what cannot run. Returns name -> mistake."""
    from omegaconf import open_dict

    assert sweeper.hydra_context is not None
    assert sweeper.config is not None
    from dtbacklash.config.explain import explain

    loader = sweeper.hydra_context.config_loader
    refused: dict[str, UserError] = {}
    for one in jobs:
        try:
            composed = loader.load_sweep_config(sweeper.config, one.overrides)
            with open_dict(composed):
                del composed["hydra"]
            settings = application.load(composed)
            one.fingerprint, one.writes = application.fingerprint(settings), application.writes(settings)
            one.mark = application.mark
        except Exception as error:
            mistake = explain(error, one.overrides, GRAMMARS[application.name])
            if mistake is None:
                raise
            refused[one.name] = mistake
    return refused


def _check_apart(jobs: Sequence[SweepJob], application: Application) -> None:
    """Refuse jobs that would write one file elsewhere, of which the last would stay (raises UserError)."""
    first: dict[Path, SweepJob] = {}
    for one in jobs:
        if one.writes is None:
            continue
        other = first.setdefault(one.writes, one)
        if other is not one:
            here = Path.cwd()
            path = one.writes.relative_to(here) if one.writes.is_relative_to(here) else one.writes
            allowed = f"{other.name} and {one.name} would both write it; give each job a file of its own"
            plain = next((key for key in one.choices if key in GRAMMARS[application.name].settings), None)
            if plain is not None:
                apart = path.with_name(f"{path.stem}_${{{plain}}}{path.suffix}")
                allowed += f": '{application.writes_key}={apart}'"
            raise UserError(application.writes_key, path, allowed)


def words(one: Job) -> list[str]:
    """The overrides with which a launcher starts a job."""
    assert isinstance(one, SweepJob)
    from dtbacklash.config.hydra_app import quoted

    return [*one.overrides, f"{KEY}={quoted(str(one.folder.parent))}", f"hydra.sweep.subdir={quoted(one.name)}"]


def finish(folder: Path, jobs: list[SweepJob], application: Application, kept: int) -> Outcome:
    """Write ``sweep.csv`` and what the application draws of the whole.

    Raises UserError: the folder cannot be written to. Failure: the disk is full; finished jobs stay.
    """
    entries = [_entry(one) for one in jobs]
    table = gather(jobs, entries, application.figures)
    axes = list(jobs[0].choices)
    try:
        with files.written(folder / TABLE, KEY, folder) as scratch:
            table.to_csv(scratch, index=False)
        if application.finish is not None:
            application.finish(folder, table.assign(folder=[one.name for one in jobs]), axes)
    except Failure as error:
        raise Failure(error.key, error.value, f"{error.allowed}; {engine.what_stays(jobs, 'jobs')}") from error
    failed = [entry for entry in entries if entry["status"] != "done"]
    all_by_input = len(failed) == len(entries) and all(entry.get("by_input") for entry in failed)
    return Outcome(folder, table, axes, kept, 0 if not failed else 2 if all_by_input else 1)


def gather(jobs: Sequence[SweepJob], entries: Sequence[dict[str, Any]], figures: Sequence[str]) -> pd.DataFrame:
    """One row a job: its choices, its figures, ``status`` (done or failed) and ``error``."""
    import pandas as pd

    rows = []
    for one, entry in zip(jobs, entries, strict=True):
        found = entry.get("figures") or {}
        row = dict(one.choices) | {name: found.get(name) for name in figures}
        rows.append(row | {"status": entry.get("status", "failed"), "error": entry.get("error", "")})
    table = pd.DataFrame(rows)
    for name in figures:
        known = [row[name] for row in rows if row[name] is not None]
        if known and all(type(value) is int for value in known):  # whole numbers, even where a job has none
            table[name] = table[name].astype("Int64")
    return table


def _entry(one: SweepJob) -> dict[str, Any]:
    """How a job went, be it that it could not be set up or that nothing came back of it."""
    if found := one.status():
        return found
    found = files.read_json(one.record)
    if found.get("status") == "failed" and not found.get("fingerprint"):  # it could not even be loaded
        return found
    if found.get("fingerprint"):
        return {"status": "failed", "error": "another sweep, with other settings, has taken its folder"}
    return {"status": "failed", "error": SILENT}


def _tidy(folder: Path, jobs: Sequence[SweepJob]) -> None:
    """Remove the folders that were made for results which did not come."""
    for one in jobs:
        files.remove_if_empty(one.folder)
    files.remove_if_empty(folder / STATUS)
    files.forget_empty(folder)
