"""The course of a proof: conceal, diagnose, open the seals, ask the oracle; what is done already is not done again."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dtbacklash import sources
from dtbacklash.campaign import engine
from dtbacklash.campaign.engine import Backend, Tell
from dtbacklash.campaign.jobs import Job
from dtbacklash.errors import UserError
from dtbacklash.files import read_json, write_json
from dtbacklash.physics.rig import Rig
from dtbacklash.prove import work
from dtbacklash.prove.rules import Case
from dtbacklash.prove.seal import RECORDING

#: recordings with a seed from here on are scored; the tool is tuned on those below
SCORING_FROM = 10_000
CASES, CONCEALED, PLAN = "cases", "concealed", "plan.json"


@dataclass(frozen=True)
class Plan:
    """What is proved.

    Attributes
    ----------
    out : folder of the results. rig : name or file; None for the rig that each case names.
    seeds : of the recordings to conceal, or empty. rigs : several, each with how many of the seeds it takes.
    folder : of recordings that have been concealed already, instead of seeds. key : the file that opens their seals.
    known : cases that the same code has finished: those of these seeds are scored as they are.
    """

    out: Path
    rig: str | None = None
    seeds: tuple[int, ...] = ()
    folder: Path | None = None
    key: Path | None = None
    rigs: tuple[tuple[str, int], ...] = ()
    known: tuple[Case, ...] = ()

    def counts(self) -> tuple[tuple[str, int], ...]:
        """(rig, number of the seeds that it takes)."""
        return self.rigs or ((str(self.rig), len(self.seeds)),)

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
    wanted = {
        "rig": plan.rig, "rigs": dict(plan.rigs), "seeds": seeds, "folder": str(plan.folder or ""),
        "concealed_by": _concealed_by(plan), "files": _rig_files(plan),
    }  # fmt: skip
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
    return sources.digest(work.CONCEALED_BY) if plan.folder is None else ""


def _rig_files(plan: Plan) -> dict[str, str]:
    """Rig that is a file -> the hash of it: with another one the same seeds are other recordings."""
    names = {name for name in (plan.rig, *(name for name, _ in plan.counts())) if name and Path(name).is_file()}
    return {name: hashlib.sha256(Path(name).read_bytes()).hexdigest() for name in sorted(names)}


def conceal_missing(plan: Plan, by: Backend, tell: Tell) -> list[Path]:
    """The folders of the cases, rig by rig in order of their seeds; conceals those that are not there yet.

    Raises
    ------
    UserError : no recording in the given folder, or no key to open its seals with.
    """
    if plan.folder is not None:
        return given_cases(plan)
    from dtbacklash.prove import conceal, seal

    key = seal.read_or_make_key(plan.key_file)
    jobs, finished = [], {(c.rig, c.secret["seed"]) for c in plan.known}
    for name, count in plan.counts():
        rig = conceal.nominal_rig(name)
        for seed in plan.seeds[:count]:
            if (rig.config.name, seed) in finished:
                continue
            case = plan.concealed / conceal.case_id(seed, rig, key)
            jobs.append(work.Concealing(case, seed, name, plan.key_file))
    engine.complete(jobs, by, tell, "concealing", "recordings")
    return [job.record for job in jobs]


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
        seal.read_seal(case)
    for rig in sorted({work.rig_of(case, plan.rig) for case in cases}):
        conceal.nominal_rig(rig)


def diagnose_missing(
    plan: Plan, cases: Sequence[Path], by: Backend, tell: Tell, diagnose: work.Diagnose | None = None
) -> None:
    """Diagnose every case that this code has not diagnosed yet.

    Raises
    ------
    KeyboardInterrupt : finished cases stay; the same again does the rest.
    UserError : the package was changed while it worked.
    """
    function = diagnose or work.diagnose_folder
    jobs = [work.Diagnosing(plan.target(case), case, work.rig_of(case, plan.rig), function) for case in cases]
    engine.complete(jobs, by, tell, "diagnosing", "cases")
    _same_code(plan, jobs)


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
    plan: Plan, cases: Sequence[Path], secrets: dict[str, dict[str, Any]], by: Backend, tell: Tell,
    oracle: work.Oracle | None = None,
) -> None:  # fmt: skip
    """Let the oracle look at every diagnosed case that it has not seen; errors as for :func:`diagnose_missing`."""
    function = oracle or work.oracle_folder
    jobs = [
        work.Asking(plan.target(case), case, work.rig_of(case, plan.rig), secrets[case.name], function)
        for case in cases
    ]
    engine.complete(jobs, by, tell, "asking the oracle", "cases")
    _same_code(plan, jobs)


def _same_code(plan: Plan, jobs: Sequence[Job]) -> None:
    """Refuse results of different states of the package in one score."""
    others = sum(not job.done() for job in jobs)
    if others:
        raise UserError("out", plan.out, f"the package changed while {others} cases were worked on; start it again")


def gather(plan: Plan, cases: Sequence[Path], secrets: dict[str, dict[str, Any]]) -> list[Case]:
    """The cases with their answers, to be scored; with those that were known, rig by rig."""
    from dtbacklash.prove.conceal import nominal_rig

    found = []
    nominal: dict[str, Rig] = {}
    for case in cases:
        entry, rig = read_json(plan.target(case)), work.rig_of(case, plan.rig)
        if rig not in nominal:
            nominal[rig] = nominal_rig(rig)
        kinds = {name: element.kind for name, element in nominal[rig].elements.items()}
        found.append(Case(
            case.name, secrets[case.name], entry.get("diagnosis"), entry.get("oracle") or {}, entry.get("wall_s"),
            entry.get("error", ""), kinds, nominal[rig].config.name, entry.get("cpu_s"),
        ))  # fmt: skip
    if not plan.known:
        return found
    wanted = {nominal_rig(name).config.name: plan.seeds[:count] for name, count in plan.counts()}
    found += [c for c in plan.known if c.secret["seed"] in wanted.get(c.rig, ())]
    return sorted(found, key=lambda case: list(wanted).index(case.rig))
