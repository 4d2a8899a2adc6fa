"""``dtb diagnose``: where a recording and a rig differ, what physics is missing, and whether it fits better."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from dtbacklash.commands.words import JOBS_MAX, VERBOSE, read_words, whole
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.physics.rig import Rig
    from dtbacklash.recording import Recording
    from dtbacklash.report.diagnosis_page import View

HELP = """\
usage: dtb diagnose recording=FILE|NAME [rig=NAME|FILE] [key=value ...] [-v]

Compares a recording with the simulation of a rig. Says where they differ, names the physics that the rig lacks,
adds it to the rig, and shows on data that it was not fitted to whether the fit improves. Writes report.html,
diagnosis.json, figures and rig.yaml, the extended rig (dtb run rig=FILE).

  recording=FILE         columns t, u and the rig's sensors (theta_m, q3, i_m, ...): CSV, Parquet, .mat, .npz, also gzip
  recording=NAME[:PART]  a recording that has a mapping (dtb recordings lists them, conf/recording adds to them)
  recording.path=FILE    where the file of a mapping is, if it is not in $DTB_RECORDINGS or fetched
  validation=FILE|PART   the recording to judge on (default: the last 30 % of the recording)
  rig=NAME|FILE          the nominal rig (default: that of the mapping, else lead_screw)
  rig.KEY=VALUE          a change of the rig, as in dtb run: rig.parameters.k.value=9500
  out=FOLDER             where the results go (default: outputs/<date>/<time>_diagnose_<recording>)
  jobs=2                 threads that share the work (default: one for each core)
  -v                     say what it is doing

The verdict is one of
  consistent        what is left over is the sensors' noise
  parameters        parameters of the rig are off; no physics is missing
  missing_physics   effects that the rig lacks, with their place, size and 95 % intervals
  unexplained       a mismatch that no effect of the catalogue explains, with the force that it would take

examples:
  dtb run controller=open_loop reference=multisine recording.save=bench.csv
  dtb diagnose recording=bench.csv rig=lead_screw
  dtb diagnose recording=emps
  dtb diagnose recording=silverbox validation=silverbox:arrow -v"""

ENTRIES = frozenset({"diagnosis.json", "report.html", "figures", "rig.yaml"})
KEYS = ("recording", "recording.path", "validation", "rig", "out", "jobs")
DEFAULT_RIG = "lead_screw"

Progress = Callable[[float, str], None]

log = logging.getLogger("dtbacklash.diagnose")


@dataclass
class Request:
    """What was asked for on the command line."""

    recording: str = ""
    path: str | None = None
    validation: str | None = None
    rig: str | None = None
    out: Path | None = None
    jobs: int = 1
    verbose: bool = False
    changes: list[str] = field(default_factory=list)


def main(words: Sequence[str]) -> int:
    """Run ``dtb diagnose``; returns the exit code."""
    if any(word in ("-h", "--help", "help") for word in words):
        print(HELP)
        return 0
    request = parse(words)
    from dtbacklash.commands.console import messages
    from dtbacklash.report import diagnosis_page
    from dtbacklash.runfolder import run_folder

    folder = (request.out or _default_folder(request)).absolute()
    with messages(request.verbose), run_folder(folder, key="out", mark="diagnosis.json", known=ENTRIES) as scratch:
        rig = nominal_rig(request)
        train, held_out = _read(request, rig)
        _log_recordings(train, held_out)
        with _progress(request.verbose) as tell:
            view = run_diagnosis(train, held_out, rig, request.jobs, tell)
            tell(1.0, "drawing the report")
            diagnosis_page.write(view, scratch)
    _show(view, folder)
    return 0


def _read(request: Request, rig: Rig) -> tuple[Recording, Recording | None]:
    """The recording, and the one to judge on if there is one: else the diagnosis holds out the recording's end."""
    from dtbacklash.recording import read_pair, read_recording

    if request.validation is None:
        return read_recording(request.recording, path=request.path, rig=rig), None
    return read_pair(request.recording, request.validation, path=request.path, rig=rig)


def run_diagnosis(train: Recording, held_out: Recording | None, rig: Rig, jobs: int, progress: Progress) -> View:
    """Diagnose, and give what the report shows."""
    from dtbacklash.diagnose import diagnose
    from dtbacklash.report.diagnosis_view import view_of

    result = diagnose(train, rig, held_out, progress=lambda text, share: progress(share, text), jobs=jobs)
    return view_of(result, _source(train), _notes(train, held_out))


def parse(words: Sequence[str]) -> Request:
    """Read the command line.

    Raises
    ------
    UserError : an unknown word, a key without a value or twice, no recording, jobs that are no whole number.
    """
    read = read_words(words, KEYS, VERBOSE, "choose one of -v, --help", prefix="rig.")
    given = read.given
    request = Request(verbose=not read.options.isdisjoint(VERBOSE), changes=read.passed)
    if "recording" not in given:
        from dtbacklash.recording import mapping_names

        raise UserError("recording", "(missing)", "give a file or one of " + ", ".join(mapping_names()))
    request.recording, request.path = given["recording"], given.get("recording.path")
    request.validation, request.rig = given.get("validation"), given.get("rig")
    request.out = Path(given["out"]) if "out" in given else None
    request.jobs = whole("jobs", given["jobs"], 1, JOBS_MAX) if "jobs" in given else os.cpu_count() or 1
    return request


def nominal_rig(request: Request) -> Rig:
    """Build the rig of ``rig=`` with its changes; names, files and changes work as in ``dtb run``.

    Raises
    ------
    UserError : no such rig, or something in it is wrong.
    """
    from dtbacklash.commands.explain import explain
    from dtbacklash.config.compose import compose
    from dtbacklash.physics.rig import build_rig

    words = [f"rig={request.rig or _mapped_rig(request) or DEFAULT_RIG}", *request.changes]
    try:
        return build_rig(compose("controller=open_loop", *words).rig)
    except Exception as error:
        mistake = explain(error, words)
        if mistake is None:
            raise
        raise mistake from error


def _mapped_rig(request: Request) -> str | None:
    """The rig that the mapping names, if ``recording=`` is one."""
    from dtbacklash.recording import load_mapping, mapping_names

    name = request.recording.partition(":")[0]
    if Path(request.recording).is_file() or name not in mapping_names():
        return None
    return load_mapping(name).rig


def _default_folder(request: Request) -> Path:
    now = datetime.now()
    stem = Path(request.recording).name.partition(".")[0] or "recording"
    stem = "".join(sign if sign.isalnum() or sign in "-_" else "_" for sign in stem)[:60]
    return Path("outputs") / f"{now:%Y-%m-%d}" / f"{now:%H-%M-%S}_diagnose_{stem}"


def _source(train: Recording) -> str:
    return f"{train.name}:{train.part}" if train.part else train.name


def _notes(train: Recording, held_out: Recording | None) -> list[str]:
    """What the reader said, and which data were fitted and which judge."""
    if held_out is None:
        return [*train.notes, f"{_span('Fitted to the beginning of', train)}; its last 30 % judge."]
    other = [f"Held-out data: {note}" for note in held_out.notes if note not in train.notes]
    return [*train.notes, *other, f"{_span('Fitted to', train)}; {_span('judged on', held_out)}."]


def _span(what: str, r: Recording) -> str:
    return f"{what} {_source(r)}, {r.t_s[0]:.6g} to {r.t_s[-1]:.6g} s ({r.samples} samples)"


def _log_recordings(train: Recording, held_out: Recording | None) -> None:
    for note in _notes(train, held_out):
        log.info(note)


@contextmanager
def _progress(verbose: bool) -> Iterator[Progress]:
    """Give a function of the fraction done and the text of the stage: lines with ``-v``, else a bar."""
    from dtbacklash.commands.console import progress

    if not verbose:
        with progress("diagnosing") as tick:
            yield lambda fraction, _text: tick(fraction)
        return
    last = ""

    def tell(fraction: float, text: str) -> None:
        nonlocal last
        if text != last:
            log.info("%3.0f %%  %s", 100 * fraction, text)
            last = text

    yield tell


def _show(view: View, folder: Path) -> None:
    """Print the verdict, the findings, the fit before and after, and where the report is."""
    from rich.markup import escape

    from dtbacklash.commands.console import shown_path, stdout_console
    from dtbacklash.report import tables
    from dtbacklash.report.diagnosis_text import lines

    console = stdout_console()
    for line in lines(view):
        tables.show(line)
    tables.show("", tables.fit(view.diagnosis["fit"]), "")
    console.print(escape(shown_path(folder / "report.html")), soft_wrap=True)
