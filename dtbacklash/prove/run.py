"""The steps of a proof: conceal, diagnose, open the seals, ask the oracle; finished steps are not repeated."""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from dtbacklash import source_hash
from dtbacklash.campaign import engine
from dtbacklash.campaign.engine import Backend, Tell
from dtbacklash.campaign.jobs import Job
from dtbacklash.errors import UserError
from dtbacklash.files import json_text, read_json, write_bytes, write_json
from dtbacklash.prove import work
from dtbacklash.prove.rules import Case
from dtbacklash.prove.seal import RECORDING

#: recordings with seeds from here on are for scores, those below are for tuning
SCORING_FROM = 10_000
CASES, CONCEALED, PLAN = "cases", "concealed", "plan.json"
#: finished cases in one file, so that a long proof can be made in parts; keys of a diagnosis that no score reads
FILE = "cases.json.gz"
_LEFT_OUT = ("settings", "checks", "limits", "candidates", "notes", "units", "next_experiment")


@dataclass(frozen=True)
class Plan:
    """The settings of a proof.

    out : folder of the results. rig : name or file; None for the rig that each case names.
    seeds : of the recordings to conceal, or empty. rigs : several rigs, each with its number of seeds.
    folder : of recordings that are concealed already, instead of seeds. key : the file that opens their seals.
    known : cases that the same code has finished; those with one of the seeds are scored as they are.
    machine : ``clean`` or ``lifelike``, see :func:`.draw.draw`.
    """

    out: Path
    rig: str | None = None
    seeds: tuple[int, ...] = ()
    folder: Path | None = None
    key: Path | None = None
    rigs: tuple[tuple[str, int], ...] = ()
    known: tuple[Case, ...] = ()
    machine: str = "clean"

    def counts(self) -> tuple[tuple[str, int], ...]:
        """(rig, number of its seeds)."""
        return self.rigs or ((str(self.rig), len(self.seeds)),)

    def alike(self) -> list[Case]:
        """The known cases of the same machine."""
        return [c for c in self.known if c.secret.get("machine", "clean") == self.machine]

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
    """Write the plan into the folder of the results, or check that it is the plan there.

    Raises UserError: the folder holds something else, or the proof of other recordings.
    """
    # other rig files or other code make other recordings of the same seeds
    files = {name for name in (plan.rig, *(name for name, _ in plan.counts())) if name and Path(name).is_file()}
    wanted = {
        "rig": plan.rig, "rigs": dict(plan.rigs), "seeds": list(plan.seeds), "folder": str(plan.folder or ""),
        "concealed_by": source_hash.digest(work.CONCEALED_BY) if plan.folder is None else "",
        "files": {name: hashlib.sha256(Path(name).read_bytes()).hexdigest() for name in sorted(files)},
    }  # fmt: skip
    if plan.machine != "clean":
        wanted["machine"] = plan.machine
    file = plan.out / PLAN
    if plan.out.exists() and not plan.out.is_dir():
        raise UserError("out", plan.out, "is a file; give a folder")
    if not file.exists():
        if plan.out.is_dir() and any(plan.out.iterdir()):
            raise UserError("out", plan.out, "holds files that are no proof; give an empty or a new folder")
        write_json(file, wanted)
    elif read_json(file) != wanted:
        allowed = "holds a proof of other recordings, or of recordings that other code made; give another folder"
        raise UserError("out", plan.out, allowed)


def conceal_missing(plan: Plan, by: Backend, tell: Tell) -> list[Path]:
    """The folders of the cases, rig by rig in order of their seeds; conceals those that are missing.

    Raises UserError: no recording in the given folder, or no key to open its seals with.
    """
    if plan.folder is not None:
        return given_cases(plan)
    from dtbacklash.prove import conceal, seal

    key = seal.read_or_make_key(plan.key_file)
    jobs, finished = [], {(c.rig, c.secret["seed"]) for c in plan.alike()}
    for name, count in plan.counts():
        rig = conceal.nominal_rig(name)
        for seed in plan.seeds[:count]:
            if (rig.config.name, seed) in finished:
                continue
            case = plan.concealed / conceal.case_id(seed, rig, key, machine=plan.machine)
            jobs.append(work.ConcealCase(case, seed, name, plan.key_file, plan.machine))
    engine.complete(jobs, by, tell, "concealing", "recordings")
    return [job.record for job in jobs]


def given_cases(plan: Plan) -> list[Path]:
    """The cases of the plan's folder; errors as for :func:`conceal_missing`."""
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
    """Check a folder's recordings, seals, key and rigs before the proof starts.

    Raises UserError: as :func:`given_cases`, or one of them is wrong.
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

    Raises KeyboardInterrupt: finished cases stay; the same again does the rest. UserError: the package was changed
    meanwhile.
    """
    function = diagnose or work.diagnose_folder
    jobs = [work.DiagnoseCase(plan.target(case), case, work.rig_of(case, plan.rig), function) for case in cases]
    engine.complete(jobs, by, tell, "diagnosing", "cases")
    _same_code(plan, jobs)


def open_seals(plan: Plan, cases: Sequence[Path]) -> dict[str, dict[str, Any]]:
    """Name of the case -> its secret as a dict.

    Raises UserError: a diagnosis is missing; the key is wrong; a seal was changed.
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
    """Ask the oracle about each diagnosed case for which it is missing; errors as for :func:`diagnose_missing`."""
    ask = oracle or work.oracle_folder
    jobs = [work.AskOracle(plan.target(c), c, work.rig_of(c, plan.rig), secrets[c.name], ask) for c in cases]
    engine.complete(jobs, by, tell, "asking the oracle", "cases")
    _same_code(plan, jobs)


def _same_code(plan: Plan, jobs: Sequence[Job]) -> None:
    """Refuse results of different code in one score."""
    others = sum(not job.done() for job in jobs)
    if others:
        raise UserError("out", plan.out, f"the package changed while {others} cases were worked on; start it again")


def gather(plan: Plan, cases: Sequence[Path], secrets: dict[str, dict[str, Any]]) -> list[Case]:
    """The cases with their answers, and the known ones of the plan, rig by rig."""
    from dtbacklash.prove.conceal import nominal_rig

    nominal, gathered = cache(nominal_rig), []
    for case in cases:
        entry, rig = read_json(plan.target(case)), nominal(work.rig_of(case, plan.rig))
        gathered.append(Case(
            case.name, secrets[case.name], entry.get("diagnosis"), entry.get("oracle") or {}, entry.get("wall_s"),
            entry.get("error", ""), {name: e.kind for name, e in rig.elements.items()}, rig.config.name,
            entry.get("cpu_s"),
        ))  # fmt: skip
    if not plan.known:
        return gathered
    wanted = {nominal(name).config.name: plan.seeds[:count] for name, count in plan.counts()}
    gathered += [c for c in plan.alike() if c.secret["seed"] in wanted.get(c.rig, ())]
    return sorted(gathered, key=lambda case: list(wanted).index(case.rig))


def codes() -> dict[str, str]:
    """Digests of the code that makes the cases of a proof."""
    parts = {"concealed_by": work.CONCEALED_BY, "diagnosed_by": work.DIAGNOSED_BY, "oracle_by": work.ORACLE_BY}
    return {name: source_hash.digest(files) for name, files in parts.items()}


def save_known(cases: Sequence[Case], file: Path) -> None:
    """Write finished cases, without the keys that no score reads."""
    entries = [asdict(case) for case in cases]
    for entry in entries:
        if entry["diagnosis"] is not None:
            entry["diagnosis"] = {k: v for k, v in entry["diagnosis"].items() if k not in _LEFT_OUT}
    text = json_text({**codes(), "cases": entries})
    write_bytes(file, gzip.compress(text.encode("utf-8"), mtime=0))


def load_known(file: Path) -> tuple[Case, ...]:
    """Read finished cases.

    Raises UserError: :func:`save_known` did not write the file, or other code made its cases.
    """
    try:
        content: dict[str, Any] = json.loads(gzip.decompress(file.read_bytes()))
        cases = tuple(Case(**entry) for entry in content["cases"])
    except (OSError, EOFError, ValueError, TypeError, KeyError) as error:
        raise UserError("known", file, f"must be a {FILE} that dtb prove docs=FOLDER wrote") from error
    others = [name for name, code in codes().items() if content.get(name) != code]
    if others:
        raise UserError("known", file, f"its cases are of other code ({', '.join(others)}); leave it out")
    return cases
