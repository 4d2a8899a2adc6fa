"""``dtb prove``: diagnose concealed recordings blind, open their seals, and score."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dtbacklash.commands.words import JOBS_MAX, SEED_MOST, VERBOSE, read_words, whole
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.prove.run import Plan, Tell, Workers
    from dtbacklash.prove.score import Score

HELP = """\
usage: dtb prove [n=500] [seed=10000] [key=value ...] [-v]
       dtb prove folder=FOLDER [key=FILE] [key=value ...]
       dtb prove --quick [key=value ...]

Conceals recordings with something hidden in them (or takes a folder of dtb conceal), diagnoses each without the
answer, opens the seals, asks an oracle that knows the true structure, and scores. Started again, it does only
what is missing. Writes score.json, score.csv (a row a recording), confusion.csv, table.md, figures, report.html.

  n=500                  recordings
  seed=10000             seed of the first; scoring seeds begin at 10000, the tool is tuned on those below
  rig=lead_screw         the rig: a name, or a file
  folder=FOLDER          recordings that dtb conceal made, instead of n, seed and rig
  key=FILE               what opens their seals (default: FOLDER.key)
  out=FOLDER             where the results go (default: outputs/prove_<rig>_<seed>_<n>)
  jobs=2                 recordings at once
  backend=loky           loky: the cores of this machine; dask, ray: extras of these names
  scheduler=ADDRESS      a Dask scheduler or a Ray cluster that runs already (default: one is started here)
  docs=FOLDER            also bring the score into FOLDER/proof.md, with its figures
  --quick                a fixed set of 20 scoring seeds; exit code 1 if the score is below what was reached
  -v                     say what it is doing

examples:
  dtb prove n=20 seed=10000
  dtb prove n=500 seed=10000 jobs=8 out=proof docs=docs
  dtb prove folder=bench backend=dask scheduler=tcp://cluster:8786"""

KEYS = ("n", "seed", "rig", "folder", "key", "out", "jobs", "backend", "scheduler", "docs")
MOST = 100_000
QUICK_EXCLUDES = ("n", "seed", "folder", "key", "docs")
FOLDER_EXCLUDES = ("n", "seed")


@dataclass
class Request:
    """What was asked for on the command line."""

    given: dict[str, str]
    quick: bool = False
    verbose: bool = False

    def count(self, key: str, default: int, low: int, high: int) -> int:
        """A whole number."""
        return whole(key, self.given.get(key, str(default)), low, high)

    def path(self, key: str) -> Path | None:
        """A path, absolute, or None."""
        return Path(self.given[key]).absolute() if key in self.given else None


def main(words: Sequence[str]) -> int:
    """Run ``dtb prove``; returns the exit code."""
    if any(word in ("-h", "--help", "help") for word in words):
        print(HELP)
        return 0
    request = parse(words)
    from dtbacklash.commands.console import messages
    from dtbacklash.prove import run

    by = _workers(request)
    plan = _plan(request)
    docs = request.path("docs")
    if docs is not None:
        from dtbacklash.report.proof_page import check_docs

        check_docs(docs)
    if plan.folder is not None:
        run.check_given(plan)
    with messages(request.verbose), _nothing_half_made(plan), _progress() as tell:
        run.claim(plan)
        score = prove(plan, by, tell, _command(request), docs)
    _show(score, plan.out)
    return _compare(plan, score) if request.quick else 0


def _compare(plan: Plan, score: Score) -> int:
    """Hold a quick proof against what was reached; returns the exit code."""
    from dtbacklash.prove import quick
    from dtbacklash.prove.store import write_text

    write_text(plan.out / "reached.yaml", quick.reached_text(str(plan.rig), score))
    before = quick.reached(str(plan.rig))
    if not before:
        print(f"dtb: nothing is on record for rig={plan.rig}: this score is compared with nothing", file=sys.stderr)
    dropped = quick.drops(score, before)
    for line in dropped:
        print(f"dtb: dropped: {line}", file=sys.stderr)
    return 1 if dropped else 0


@contextmanager
def _nothing_half_made(plan: Plan) -> Iterator[None]:
    """A folder that this call made goes again if wrong input ends it before anything is in there."""
    there = plan.out.exists()
    try:
        yield
    except UserError:
        if not there and plan.out.is_dir() and not any(plan.out.glob("*/*")):
            shutil.rmtree(plan.out, ignore_errors=True)
        raise


def prove(plan: Plan, by: Workers, tell: Tell, command: str = "", docs: Path | None = None) -> Score:
    """Do what is missing of a proof and write its score; the seals are opened after the last diagnosis.

    Raises
    ------
    UserError : see :mod:`dtbacklash.prove.run`. KeyboardInterrupt : finished cases stay.
    """
    from dtbacklash.prove import run
    from dtbacklash.prove.score import score
    from dtbacklash.report import proof_page

    cases = run.conceal_missing(plan, by, tell)
    run.diagnose_missing(plan, cases, by, tell)
    secrets = run.open_seals(plan, cases)
    run.ask_oracle(plan, cases, secrets, by, tell)
    answered = run.gather(plan, cases, secrets)
    result = score(answered, {"command": command} if command else {})
    proof_page.write(result, answered, plan.out)
    if docs is not None:
        proof_page.write_docs(result, answered, docs)
    return result


def parse(words: Sequence[str]) -> Request:
    """Read the command line.

    Raises
    ------
    UserError : an unknown word, a key without a value or twice, keys that exclude each other.
    """
    read = read_words(words, KEYS, (*VERBOSE, "--quick"), "choose one of --quick, -v, --help")
    request = Request(read.given, verbose=not read.options.isdisjoint(VERBOSE), quick="--quick" in read.options)
    _check_excludes(request)
    return request


def _check_excludes(request: Request) -> None:
    for chosen, excluded in (("--quick", QUICK_EXCLUDES), ("folder", FOLDER_EXCLUDES)):
        there = request.quick if chosen == "--quick" else chosen in request.given
        for key in excluded if there else ():
            if key in request.given:
                raise UserError(key, request.given[key], f"does not go with {chosen}")
    if "key" in request.given and "folder" not in request.given:
        raise UserError("key", request.given["key"], "belongs to folder=FOLDER")


def _workers(request: Request) -> Workers:
    from dtbacklash.prove.backend import check_backend
    from dtbacklash.prove.run import Workers

    by = Workers(
        request.given.get("backend", "loky"), request.count("jobs", 2, 1, JOBS_MAX), request.given.get("scheduler")
    )  # fmt: skip
    check_backend(by.backend, by.scheduler)
    return by


def _plan(request: Request) -> Plan:
    from dtbacklash.prove.conceal import nominal_rig
    from dtbacklash.prove.other_rig import check_concealable, loop_sensors
    from dtbacklash.prove.quick import quick_seeds
    from dtbacklash.prove.run import Plan

    out, folder = request.path("out"), request.path("folder")
    if folder is not None:
        out = out or Path("outputs").absolute() / f"prove_{folder.name}"
        return Plan(out, request.given.get("rig"), folder=folder, key=request.path("key"))
    rig = request.given.get("rig", "lead_screw")
    nominal = nominal_rig(rig)
    check_concealable(nominal)
    loop_sensors(nominal)
    stem = Path(rig).stem
    if request.quick:
        return Plan(out or Path("outputs").absolute() / f"prove_quick_{stem}", rig, quick_seeds())
    n, first = request.count("n", 500, 1, MOST), request.count("seed", 10_000, 0, SEED_MOST)
    out = out or Path("outputs").absolute() / f"prove_{stem}_{first}_{n}"
    return Plan(out, rig, tuple(range(first, first + n)))


def _command(request: Request) -> str:
    """What repeats this score: without the places of files and the choice of workers."""
    kept = [f"{k}={v}" for k, v in request.given.items() if k in ("n", "seed", "rig")]
    if "folder" in request.given:
        kept = [f"folder={Path(request.given['folder']).name}"]
    elif not request.quick and not kept:
        kept = ["n=500", "seed=10000"]
    return " ".join(["dtb prove", *(["--quick"] if request.quick else []), *kept])


@contextmanager
def _progress() -> Iterator[Tell]:
    """Give a function of the stage and the cases done: a bar with the time left, or lines where no terminal is."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from dtbacklash.commands.console import announce_compilation

    announce_compilation()
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("recordings"),
        TimeRemainingColumn(),
    )  # fmt: skip
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    rows: dict[str, int] = {}

    def tell(stage: str, done: int, total: int) -> None:
        if stage not in rows:
            rows[stage] = bar.add_task(stage, total=total, completed=done)
        bar.update(rows[stage], completed=done)  # type: ignore[arg-type]
        if not console.is_terminal:
            print(f"{stage}: {done} of {total}", file=sys.stderr, flush=True)

    with bar:
        yield tell


def _show(score: Score, folder: Path) -> None:
    """Print the score, and where the report is."""
    from rich.markup import escape

    from dtbacklash.commands.console import shown_path, stdout_console
    from dtbacklash.report import tables

    tables.show(tables.proof(score), "")
    stdout_console().print(escape(shown_path(folder / "report.html")), soft_wrap=True)
