"""The course of a proof: conceal, diagnose, open the seals, ask the oracle; what is done already is not done again."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dtbacklash import sources
from dtbacklash.errors import UserError
from dtbacklash.prove import work
from dtbacklash.prove.backend import workers
from dtbacklash.prove.rules import Case
from dtbacklash.prove.seal import RECORDING
from dtbacklash.prove.store import read_json, write_json

log = logging.getLogger("dtbacklash.prove")

#: recordings with a seed from here on are scored; the tool is tuned on those below
SCORING_FROM = 10_000
#: the parts of the package that a seed's recording depends on
CONCEALED_BY = (
    *(f"prove/{n}.py" for n in ("conceal", "draw", "excitation", "other_arrays", "other_rig", "other_step", "secret")),
    "prove/sizes.py", "physics/catalogue.py", "physics/rig.py",
)  # fmt: skip
CASES, CONCEALED, PLAN = "cases", "concealed", "plan.json"

#: (stage, cases done, cases in all)
Tell = Callable[[str, int, int], None]
Task = tuple[Callable[..., Any], tuple[Any, ...]]


@dataclass(frozen=True)
class Workers:
    """Who does the work: a backend of :mod:`.backend`, how many at once, and where its scheduler is."""

    backend: str = "loky"
    jobs: int = 2
    scheduler: str | None = None


@dataclass(frozen=True)
class Plan:
    """What is proved.

    Attributes
    ----------
    out : folder of the results. rig : name or file; None, in a folder, for the rig that each case names.
    seeds : of the recordings to conceal, or empty.
    folder : of recordings that have been concealed already, instead of seeds. key : the file that opens their seals.
    """

    out: Path
    rig: str | None = None
    seeds: tuple[int, ...] = ()
    folder: Path | None = None
    key: Path | None = None

    @property
    def concealed(self) -> Path:
        """Where the concealed recordings are."""
        return self.folder or self.out / CONCEALED

    @property
    def key_file(self) -> Path:
        """The file that opens the seals."""
        return self.key or self.concealed.with_name(self.concealed.name + ".key")

    def target(self, case: Path) -> Path:
        """The file of a case's result."""
        return self.out / CASES / f"{case.name}.json"


def claim(plan: Plan) -> None:
    """Take the folder of the results for this plan, or find that it is this plan's already.

    Raises
    ------
    UserError : the folder holds something else, or the proof of other recordings.
    """
    seeds = list(plan.seeds)
    wanted = {"rig": plan.rig, "seeds": seeds, "folder": str(plan.folder or ""), "concealed_by": _concealed_by(plan)}
    file = plan.out / PLAN
    if plan.out.exists() and not plan.out.is_dir():
        raise UserError("out", plan.out, "is a file; give a folder")
    if not file.exists():
        if plan.out.is_dir() and any(plan.out.iterdir()):
            raise UserError("out", plan.out, "holds files that are no proof; give an empty or a new folder")
        write_json(file, wanted)
    elif read_json(file) != wanted:
        raise UserError(
            "out",
            plan.out,
            "holds a proof of other recordings, or of recordings that other code made; give another folder",
        )


def _concealed_by(plan: Plan) -> str:
    """Which code makes the recordings: with other code the same seeds are other recordings."""
    return sources.digest(CONCEALED_BY) if plan.folder is None else ""


def conceal_missing(plan: Plan, by: Workers, tell: Tell) -> list[Path]:
    """The folders of the cases, in order of their seeds; conceals those that are not there yet.

    Raises
    ------
    UserError : no recording in the given folder, or no key to open its seals with.
    """
    if plan.folder is not None:
        return given_cases(plan)
    from dtbacklash.prove import conceal, seal

    assert plan.rig is not None
    rig, key = conceal.nominal_rig(plan.rig), seal.read_or_make_key(plan.key_file)
    cases = {seed: plan.concealed / conceal.case_id(seed, rig, key) for seed in plan.seeds}
    missing = [seed for seed, case in cases.items() if not case.exists()]
    tasks: list[Task] = [(work.conceal_case, (seed, plan.rig, plan.concealed, plan.key_file)) for seed in missing]
    kept = len(cases) - len(missing)
    try:
        _spread(tasks, by, lambda done: tell("concealing", kept + done, len(cases)))
    except KeyboardInterrupt:
        done = sum(case.exists() for case in cases.values())
        raise KeyboardInterrupt(f": {done} of {len(cases)} recordings are made; the same command goes on") from None
    return list(cases.values())


def given_cases(plan: Plan) -> list[Path]:
    """The cases of a folder that has been concealed before; errors as for :func:`conceal_missing`."""
    assert plan.folder is not None
    if not plan.folder.is_dir():
        raise UserError("folder", plan.folder, "is no folder; dtb conceal makes one")
    found = sorted(f.parent for f in plan.folder.glob(f"*/{RECORDING}"))
    if not found:
        raise UserError("folder", plan.folder, "holds no concealed recording; dtb conceal makes some")
    if not plan.key_file.is_file():
        raise UserError("key", plan.key_file, "is not there; without it the seals cannot be opened")
    return found


def check_given(plan: Plan) -> None:
    """Refuse a folder whose recordings, seals, key or rigs are wrong, before hours are spent.

    Raises
    ------
    UserError : as :func:`given_cases`, no key in the key's file, a seal that is none, a rig that there is not.
    """
    from dtbacklash.prove import conceal, seal

    cases = given_cases(plan)
    seal.read_key(plan.key_file)
    for case in cases:
        seal.check_seal(case)
    for rig in sorted({work.rig_of(case, plan.rig) for case in cases}):
        conceal.nominal_rig(rig)


def diagnose_missing(
    plan: Plan, cases: Sequence[Path], by: Workers, tell: Tell, diagnose: work.Diagnose | None = None
) -> None:
    """Diagnose every case that this code has not diagnosed yet.

    Raises
    ------
    KeyboardInterrupt : finished cases stay; the same again does the rest.
    UserError : the package was changed while it worked.
    """
    function = diagnose or work.diagnose_folder
    by_case: dict[Path, Task] = {
        case: (work.diagnose_case, (case, plan.target(case), work.rig_of(case, plan.rig), function)) for case in cases
    }
    for case in cases:
        if not work.diagnosed(plan.target(case)):
            plan.target(case).unlink(missing_ok=True)  # what other code found is no result of this one
    _complete("diagnosing", by_case, lambda case: plan.target(case).exists(), by, tell)
    for case in cases:
        if not plan.target(case).exists():
            work.record_death(case, plan.target(case))
    _same_code(plan, [case for case in cases if not work.diagnosed(plan.target(case))])


def open_seals(plan: Plan, cases: Sequence[Path]) -> dict[str, dict[str, Any]]:
    """Case -> what was hidden in it, as JSON.

    Raises
    ------
    UserError : a diagnosis is still missing; the key is wrong; a seal was tampered with.
    """
    from dtbacklash.prove.seal import open_seal

    unread = [case for case in cases if not work.diagnosed(plan.target(case))]
    if unread:
        raise UserError("out", plan.out, f"{len(unread)} of {len(cases)} diagnoses are missing: the seals stay shut")
    return {case.name: asdict(open_seal(case, plan.key_file)) for case in cases}


def ask_oracle(
    plan: Plan, cases: Sequence[Path], secrets: dict[str, dict[str, Any]], by: Workers, tell: Tell,
    oracle: work.Oracle | None = None,
) -> None:  # fmt: skip
    """Let the oracle look at every diagnosed case that it has not seen; errors as for :func:`diagnose_missing`."""
    function = oracle or work.oracle_folder
    by_case: dict[Path, Task] = {
        case: (work.oracle_case, (case, plan.target(case), work.rig_of(case, plan.rig), secrets[case.name], function))
        for case in cases
    }
    for case in cases:
        if not work.looked_at(plan.target(case)):
            work.forget_oracle(plan.target(case))
    _complete("asking the oracle", by_case, lambda case: work.has_oracle(plan.target(case)), by, tell)
    _same_code(
        plan, [case for case in cases if work.has_oracle(plan.target(case)) and not work.looked_at(plan.target(case))]
    )


def _same_code(plan: Plan, others: Sequence[Path]) -> None:
    """Refuse results of different states of the package in one score."""
    if others:
        raise UserError(
            "out", plan.out, f"the package changed while {len(others)} cases were worked on; start it again"
        )


def gather(plan: Plan, cases: Sequence[Path], secrets: dict[str, dict[str, Any]]) -> list[Case]:
    """The cases with their answers, to be scored."""
    found = []
    for case in cases:
        entry = read_json(plan.target(case))
        found.append(Case(
            case.name, secrets[case.name], entry.get("diagnosis"), entry.get("oracle") or {}, entry.get("wall_s"),
            entry.get("error", ""),
        ))  # fmt: skip
    return found


def _complete(what: str, by_case: dict[Path, Task], ready: Callable[[Path], bool], by: Workers, tell: Tell) -> None:
    """Do the tasks of those cases that are not ready; where a worker died, each of the rest once more, alone."""
    missing = [case for case in by_case if not ready(case)]
    kept = len(by_case) - len(missing)
    try:
        try:
            _spread([by_case[case] for case in missing], by, lambda done: tell(what, kept + done, len(by_case)))
        except UserError:
            raise
        except Exception as error:  # a task catches its own: this is the backend's
            log.warning("a worker died (%s): the unfinished cases are tried once more, one by one", error)
        for case in missing:
            if not ready(case):
                with contextlib.suppress(RuntimeError):
                    _spread([by_case[case]], Workers("loky", 2), lambda _: None)
    except KeyboardInterrupt:
        stay = f": {sum(map(ready, by_case))} of {len(by_case)} cases are done and stay; the same command does the rest"
        raise KeyboardInterrupt(stay) from None


def _spread(tasks: list[Task], by: Workers, done: Callable[[int], None]) -> None:
    """Do the tasks, in any order; ``done`` is told how many have been."""
    done(0)
    if not tasks:
        return
    if by.backend == "loky" and by.jobs == 1:
        for count, (function, arguments) in enumerate(tasks, 1):
            function(*arguments)
            done(count)
        return
    from joblib import Parallel, delayed

    with workers(by.backend, by.jobs, by.scheduler):
        calls = (delayed(function)(*arguments) for function, arguments in tasks)
        for count, _ in enumerate(Parallel(return_as="generator_unordered", batch_size=1)(calls), 1):
            done(count)
