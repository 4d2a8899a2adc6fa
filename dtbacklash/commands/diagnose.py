"""``dtb diagnose``: where a recording and a rig differ, what physics is missing, and whether it fits better."""

from __future__ import annotations

import logging
import os
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash import files
from dtbacklash.campaign.application import Application
from dtbacklash.config.application import quoted, unquoted
from dtbacklash.config.commands import DiagnoseConfig
from dtbacklash.config.grammar import RUN_FOLDER, SWEEP_FOLDER
from dtbacklash.config.groups import recordings
from dtbacklash.config.load import load, settings_hash
from dtbacklash.files import run_folder

if TYPE_CHECKING:
    import pandas as pd

    from dtbacklash.commands.console import Tell
    from dtbacklash.diagnose import Diagnosis
    from dtbacklash.physics.rig import Rig
    from dtbacklash.recording import Recording

MARK, TABLE = "diagnosis.json", "diagnose.csv"
ENTRIES = frozenset({MARK, "report.html", "figures", "rig.yaml"})
FIGURES = ("verdict", "findings", "held_out_nominal", "held_out_extended", "noise_floor")

log = logging.getLogger("dtbacklash.diagnose")


def single(config: DiagnoseConfig, folder: Path, command: str) -> int:
    """Diagnose, write the folder and say what was found; returns the exit code."""
    from dtbacklash.commands.console import progress

    with progress("diagnosing") as tell:
        found = diagnose_and_write(config, folder, config.jobs or os.cpu_count() or 1, tell)
    _show(found, folder)
    return 0


def work(config: DiagnoseConfig, folder: Path, command: str) -> dict[str, Any]:
    """The same as a job of a sweep, on one thread unless ``jobs`` says otherwise; returns a row of the table."""
    found = diagnose_and_write(config, folder, config.jobs or 1)
    named = [f"{one.location}.{one.effect or 'unexplained'}" for one in found.findings]
    return {
        "verdict": found.verdict,
        "findings": ", ".join(named or found.recalibrated),
        "held_out_nominal": found.fit.held_out.nominal,
        "held_out_extended": found.fit.held_out.extended,
        "noise_floor": found.fit.noise_floor,
    }


def diagnose_and_write(config: DiagnoseConfig, folder: Path, jobs: int, tell: Tell | None = None) -> Diagnosis:
    """Read, diagnose, and write the folder, complete or not at all."""
    from dtbacklash.diagnose.say.sentences import notes_of
    from dtbacklash.diagnose.settings import settings
    from dtbacklash.physics.rig import build_rig
    from dtbacklash.report.diagnosis import page

    say = tell or _silent
    with run_folder(folder, RUN_FOLDER, MARK, ENTRIES) as scratch:
        rig = build_rig(config.rig)
        say(0.0, "reading the recording")
        train, held_out = read(config, rig)
        for note in notes_of(train, held_out, settings().held_out_share):
            log.info(note)
        diagnosis = run_diagnosis(train, held_out, rig, jobs, say)
        say(1.0, "drawing the report")
        page.write(diagnosis, scratch)
    return diagnosis


def _silent(share: float, text: str = "") -> None:
    """Tell nobody."""


def read(config: DiagnoseConfig, rig: Rig) -> tuple[Recording, Recording | None]:
    """The recording, and the one to judge on if there is one: else the diagnosis holds out the recording's end."""
    from dtbacklash.recording import read_pair, read_recording

    source, how = config.recording.source, config.recording
    assert source is not None
    units: dict[str, Any] = {"units": how.units, "trust_units": how.trust_units}
    if config.validation is None:
        return read_recording(source, path=how.path, rig=rig, **units), None
    return read_pair(source, config.validation, path=how.path, rig=rig, **units)


def run_diagnosis(train: Recording, held_out: Recording | None, rig: Rig, jobs: int, tell: Tell) -> Diagnosis:
    """Diagnose; ``tell`` is told the share done, and what is being done."""
    from dtbacklash.diagnose import diagnose

    return diagnose(train, rig, held_out, progress=lambda text, share: tell(share, text), jobs=jobs)


def with_rig(words: list[str]) -> list[str]:
    """The words of one diagnosis with the rig of the recording's mapping, unless they choose one."""
    given = {key.lstrip("+"): value for key, _, value in (word.partition("=") for word in words)}
    source = given.get("recording") or given.get("recording.source")
    if "rig" in given or not source:
        return words
    source = unquoted(source)
    name = source.partition(":")[0]
    if not name.endswith((".yaml", ".yml")) and (Path(source).is_file() or name not in recordings()):
        return words
    from dtbacklash.recording import load_mapping

    rig = load_mapping(name).rig
    return [*words, f"rig={quoted(rig)}"] if rig else words


def _show(diagnosis: Diagnosis, folder: Path) -> None:
    """Print the verdict, the findings, the fit before and after, and where the report is."""
    from rich.markup import escape

    from dtbacklash.commands.console import shown_path, stdout_console
    from dtbacklash.report.diagnosis.text import lines
    from dtbacklash.report.kit import tables

    console = stdout_console()
    for line in lines(diagnosis):
        tables.show(line)
    tables.show("", tables.fit(asdict(diagnosis.fit)), "")
    console.print(escape(shown_path(folder / "report.html")), soft_wrap=True)


def fingerprint(config: DiagnoseConfig) -> str:
    """A hash of all that decides the diagnosis: settings but the number of threads, the files, the code."""
    from dtbacklash.recording import locate

    files = [config.validation, config.recording.path]
    if config.recording.source:
        files.append(str(locate.resolve(config.recording.source, config.recording.path)[0]))
    return settings_hash(replace(config, jobs=None), files)


def finish(folder: Path, table: pd.DataFrame, axes: list[str]) -> None:
    """Write ``diagnose.csv``, a row a recording (or whatever differs), and a page with it that leads to each report."""
    from dtbacklash.report.sweep import page

    with files.written(folder / TABLE, SWEEP_FOLDER, folder) as scratch:
        table.to_csv(scratch, index=False)
    page.write(folder, table, axes)


APPLICATION = Application(
    "diagnose", partial(load, schema=DiagnoseConfig), fingerprint, work, MARK, FIGURES, finish, with_rig
)
