"""``dtb diagnose``: where a recording and a rig differ, what physics is missing, and whether it fits better."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from dtbacklash import files
from dtbacklash.campaign.application import Application
from dtbacklash.config.commands import DiagnoseConfig
from dtbacklash.config.grammar import RUN_FOLDER, SWEEP_FOLDER
from dtbacklash.config.groups import recordings
from dtbacklash.config.hydra_app import quoted, unquoted
from dtbacklash.config.load import settings_hash
from dtbacklash.errors import UserError
from dtbacklash.files import run_folder

if TYPE_CHECKING:
    import pandas as pd

    from dtbacklash.api.progress import Tell
    from dtbacklash.diagnosis import Diagnosis
    from dtbacklash.diagnosis.preliminary import Depth
    from dtbacklash.physics.rig import Rig
    from dtbacklash.recording import Recording

MARK, TABLE = "diagnosis.json", "diagnose.csv"
NOTES_SAID = 5  # lines
INTERRUPTED = 130  # exit code
FIGURES = ("verdict", "findings", "held_out_nominal", "held_out_extended", "noise_floor")

log = logging.getLogger("dtbacklash.diagnose")


def do(config: DiagnoseConfig, folder: Path, command: str, tell: Tell | None) -> tuple[Diagnosis, dict[str, Any]]:
    """Read, diagnose, and write the folder, complete or not at all; gives the diagnosis and its row of the table.

    A job of a sweep, which nobody watches, works on one thread unless ``jobs`` says otherwise.
    """
    from dtbacklash.api.durations import timed
    from dtbacklash.diagnosis.preliminary import DRAWING, READING, Stages
    from dtbacklash.physics.rig import build_rig

    jobs = config.jobs or (os.cpu_count() if tell else None) or 1
    depth = "quick" if config.compare and config.search == "full" else config.search
    say, stages = tell or _silent, Stages(cast("Depth", depth))
    diagnosis = None
    try:
        with run_folder(folder, RUN_FOLDER, MARK, files.DIAGNOSIS_ENTRIES) as scratch:
            rig = build_rig(config.rig)
            say(0.0, stages.reached(READING, 0.0)[0])
            train, held_out = read(config, rig)
            notes = *_notes(train, held_out), *_untold(train, rig)
            with timed(say, rig, train, config.search, jobs) as said:
                noted = _after_notes(said, notes, tell is not None)
                # a job of a sweep that was stopped is not done
                diagnosis = run_diagnosis(train, held_out, rig, jobs, noted, config, keep=tell is not None)
                text, share = stages.reached(DRAWING, 1.0)
                said(share, text)
                _write(diagnosis, scratch)
    except UserError as error:  # the disk is full, say: what was found is not lost with it
        error.result = diagnosis
        raise
    named = [f"{one.location}.{one.effect or 'unexplained'}" for one in diagnosis.findings]
    return diagnosis, {
        "verdict": diagnosis.verdict,
        "findings": ", ".join(named or diagnosis.recalibrated),
        "held_out_nominal": diagnosis.fit.held_out.nominal,
        "held_out_extended": diagnosis.fit.held_out.extended,
        "noise_floor": diagnosis.fit.noise_floor,
    }


def _write(diagnosis: Diagnosis, folder: Path) -> None:
    """Write the files of a diagnosis; where Ctrl-C comes meanwhile, anew: what was found is not lost by a second."""
    from dtbacklash.report.diagnosis import page

    try:
        page.write(diagnosis, folder)
    except KeyboardInterrupt:
        if diagnosis.stopped:
            raise
        page.write(diagnosis, folder)


def _after_notes(
    tell: Callable[[float, str], None], notes: Sequence[str], watched: bool
) -> Callable[[float, str], None]:
    """The same, which says notes on the recording first: once all that was asked for has been accepted."""
    pending = [notes]

    def noted(share: float, text: str) -> None:
        if pending:
            say_notes(pending.pop(), watched)
        tell(share, text)

    return noted


def _silent(share: float, text: str = "", left: Callable[[], float | None] | None = None) -> None:
    """Tell nobody."""


def say_notes(notes: Sequence[str], watched: bool) -> None:
    """Say what the reader did and took for granted, before the answer: units first, a few lines; all with -v.

    watched : whether somebody looks at the terminal; a job of a sweep is read in its report.
    """
    for note in notes:
        log.info(note)
    if not watched or log.isEnabledFor(logging.INFO):
        return
    first = sorted(notes, key=lambda note: "Units: " not in note)  # a wrong unit costs most
    more = len(first) - NOTES_SAID
    shown = (
        first if more <= 0 else [*first[: NOTES_SAID - 1], f"{more + 1} more notes on the recording: in the report."]
    )
    for note in shown:
        print(f"dtb: {note}", file=sys.stderr, flush=True)


def read(
    config: DiagnoseConfig, rig: Rig
) -> tuple[Recording | list[Recording], Recording | list[Recording] | int | None]:
    """The recordings, and what is to judge if something is: else the diagnosis holds out the recordings' ends."""
    from dtbacklash.recording import read_together

    source, how = config.recording.source, config.recording
    assert source is not None
    return read_together(
        source,
        config.validation,
        path=how.path,
        rig=rig,
        units=how.units,
        trust_units=how.trust_units,
        command=how.command,
        sample_time_s=how.sample_time_s,
        rows=how.rows,
    )


def _notes(train: Recording | list[Recording], held_out: Recording | list[Recording] | int | None) -> Sequence[str]:
    from dtbacklash.diagnosis.explain.sentences import notes_of
    from dtbacklash.diagnosis.settings import SETTINGS

    if isinstance(train, list) or isinstance(held_out, (list, int)):
        return [f"{r.name}: {note}" for r in ([train] if not isinstance(train, list) else train) for note in r.notes]
    return notes_of(train, held_out, SETTINGS.held_out_share)


def _untold(train: Recording | list[Recording], rig: Rig) -> tuple[str, ...]:
    from dtbacklash.diagnosis.explain.observability_notes import beforehand

    first = train[0] if isinstance(train, list) else train
    return beforehand(rig, first.channels)


def run_diagnosis(
    train: Recording | list[Recording], held_out: Recording | list[Recording] | int | None, rig: Rig, jobs: int,
    tell: Callable[[float, str], None], config: DiagnoseConfig, keep: bool = False,
) -> Diagnosis:  # fmt: skip
    """Diagnose; ``tell`` is told the share done, and what is being done."""
    from dtbacklash.diagnosis import diagnose

    said, depth = config.enough, cast("Depth", config.search)
    return diagnose(
        train, rig, held_out, progress=lambda text, share: tell(share, text), jobs=jobs, enough=said, depth=depth,
        keep=keep, own=config.own, given=config.given, hold_out=config.hold_out, compare=config.compare,
    )  # fmt: skip


def with_rig(words: list[str]) -> list[str]:
    """The words of one diagnosis with the rig of the recording's mapping, unless they choose one."""
    given = {key.lstrip("+"): value for key, _, value in (word.partition("=") for word in words)}
    source = given.get("recording") or given.get("recording.source")
    if "rig" in given or not source:
        return words
    source = _first(unquoted(source))
    name = source.partition(":")[0]
    if not name.endswith((".yaml", ".yml")) and (Path(source).is_file() or name not in recordings()):
        return words
    from dtbacklash.recording import load_mapping

    rig = load_mapping(name).rig
    return [*words, f"rig={quoted(rig)}"] if rig else words


def _first(source: str) -> str:
    """The first of several recordings; what is written where it means none, as reading it says what is wrong."""
    if not any(sign in source for sign in "[*?"):
        return source
    from dtbacklash.recording import sources_of

    try:
        return sources_of(source)[0]
    except UserError:
        return source


def show(diagnosis: Diagnosis, config: DiagnoseConfig, folder: Path | None) -> int:
    """Print the first screen, the command that uses the result, and where the report is; returns the exit code.

    folder : None where nothing could be written; then the rig that was found is printed instead.
    """
    from rich.markup import escape

    from dtbacklash.commands.console import shown_path, stdout_console
    from dtbacklash.physics.rig_file import rig_yaml
    from dtbacklash.report.components import tables
    from dtbacklash.report.diagnosis.text import lines
    from dtbacklash.report.diagnosis.words import design_command, next_command

    console = stdout_console()
    tables.show(*lines(diagnosis), "")
    if folder is None:
        print(f"The rig that was found, which could not be written:\n\n{rig_yaml(diagnosis.rig)}")
        return 1
    if not diagnosis.fault:
        run = next_command(diagnosis, shown_path(folder / "rig.yaml"))
        console.print(escape(f"To use what was found: {run}"), soft_wrap=True)
        if design := design_command(diagnosis, shown_path(folder)):
            console.print(escape(f"To tell apart what is open: {design}"), soft_wrap=True)
    console.print(escape(shown_path(folder / "report.html")), soft_wrap=True)
    return INTERRUPTED if diagnosis.stopped else 0


def fingerprint(config: DiagnoseConfig) -> str:
    """A hash of all that decides the diagnosis: settings but those of how it is done, the files, the code."""
    from dtbacklash.recording import locate, sources_of

    files = [*(sources_of(config.validation, "validation") if config.validation else []), config.recording.path]
    files += [config.rig.model] if config.rig.model else []
    for source in sources_of(config.recording.source) if config.recording.source else []:
        files.append(str(locate.resolve(source, config.recording.path)[0]))
    return settings_hash(replace(config, jobs=None), files)


def finish(folder: Path, table: pd.DataFrame, axes: list[str]) -> None:
    """Write ``diagnose.csv``, a row a recording (or whatever differs), and a page with it that leads to each report."""
    from dtbacklash.report.sweep import page

    with files.written(folder / TABLE, SWEEP_FOLDER, folder) as scratch:
        table.to_csv(scratch, index=False)
    page.write(folder, table, axes)


APPLICATION = Application(
    "diagnose", fingerprint, do, show, MARK, FIGURES, "diagnosing", finish=finish, complete=with_rig
)
