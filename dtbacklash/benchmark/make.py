"""Make the benchmark's folder; finished cases are kept, so that it can be made in parts."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.resources import files as resources
from pathlib import Path
from typing import Any

import pandas as pd

from dtbacklash.benchmark import files, machines, real, vocabulary
from dtbacklash.benchmark.conceal import ConcealedCase, conceal
from dtbacklash.benchmark.plan import MACHINES, SEED, VERSION, CasePlan, commitment, plan_cases
from dtbacklash.campaign import engine
from dtbacklash.campaign.engine import Backend, Tell
from dtbacklash.campaign.jobs import Job
from dtbacklash.errors import Failure, UserError
from dtbacklash.files import json_text, read_json, write_bytes, write_text, written
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.rig_file import rig_content
from dtbacklash.prove import seal
from dtbacklash.scoring.truth import Truth

NAME = "dtbacklash benchmark"


def make(out: Path, key_file: Path, by: Backend, tell: Tell, seed: int = SEED, per_machine: int | None = None) -> int:
    """Write a benchmark into a folder; returns the number of its cases.

    key_file : opens the seals; made if it is not there. The same seed and key give the same concealed cases to the
    byte. seed : the folder names the published one only.
    per_machine : concealed cases of each machine, for a smaller one; None: all.

    Raises UserError: the folder holds something else, or seals of another key, or a key lies in it.
    KeyboardInterrupt: finished cases stay.
    """
    seal.check_apart(key_file, out, "benchmark")
    name = out / files.ABOUT
    if out.exists() and (not out.is_dir() or (any(out.iterdir()) and read_json(name).get("name") != NAME)):
        raise UserError("out", out, "holds something else; give an empty or a new folder")
    if name.exists() and not key_file.exists():
        raise UserError("key", key_file, f"is not there, and {out} was begun with it; give its key or a new folder")
    key = seal.read_or_make_key(key_file)
    plan = plan_cases(seed, per_machine, key)
    about = {"name": NAME, "version": VERSION, "concealed": len(plan), "commitment": commitment(seed, len(plan), key)}
    about |= {"seed": seed} if seed == SEED else {}
    for case in (out / files.CASES / p.number for p in plan):
        if (case / seal.SEALED).exists():
            files.truth_of(case, key_file)
    if name.exists() and read_json(name) != about:
        raise UserError("out", out, "holds a benchmark of another seed, size or key; give a new folder")
    write_text(name, files.data_text(about))
    jobs = [MakeCase(out / files.CASES / p.number, p, key_file) for p in plan]
    engine.complete(jobs, by, tell, "concealing", "cases")
    for j, recording in enumerate(real.RECORDINGS):
        _write_real(out / files.CASES / f"{len(plan) + j + 1:03d}", recording)
    _write_machines(out)
    _write_vocabulary(out)
    write_text(out / files.README, resources("dtbacklash.benchmark").joinpath("entry.md").read_text(encoding="utf-8"))
    write_bytes(out / files.HASHES, files.digest(out))
    return len(plan) + len(real.RECORDINGS)


@dataclass(frozen=True)
class MakeCase(Job):
    """Make one case in the folder ``record``."""

    record: Path
    plan: CasePlan
    key_file: Path

    def done(self) -> bool:
        return self.record.exists()

    def work(self) -> None:
        rig = files.nominal(self.plan.machine)
        write_case(self.record, self.plan, rig, conceal(self.plan, rig), seal.read_key(self.key_file))

    def died(self, error: Exception | None) -> None:
        raise error or Failure("seed", self.plan.seed, "no case came of it: its worker died")


def write_case(folder: Path, plan: CasePlan, rig: Rig, case: ConcealedCase, key: bytes) -> None:
    """Write a case, complete or not at all."""
    with written(folder) as scratch:
        scratch.mkdir()
        for name, table in case.recordings.items():
            (scratch / f"{name}.csv").write_text(files.text_of(table), encoding="utf-8")
        (scratch / files.TEST_INPUT).write_text(files.text_of(case.test_input), encoding="utf-8")
        (scratch / files.CASE).write_text(files.data_text(_case_content(plan, rig, case)), encoding="utf-8")
        if plan.split == "development":
            (scratch / files.ANSWER).write_text(case.truth.to_json(), encoding="utf-8")
            output = files.text_of(pd.DataFrame({"t": case.test_input["t"], **case.truth.test}))
            (scratch / files.TEST_OUTPUT).write_text(output, encoding="utf-8")
            return
        sealed = seal.seal_text(case.truth.to_json(), files.sealed_content(scratch), key)
        (scratch / seal.SEALED).write_text(json_text(sealed), encoding="utf-8")


def _case_content(plan: CasePlan, rig: Rig, case: ConcealedCase) -> dict[str, Any]:
    """The content of a case's ``case.yaml``."""
    channels = {name: rig.sensors[name] for name in case.truth.test}
    instruments = {
        name: {"of": s.of, "quantity": s.quantity, "unit": s.recorded_in, "noise": case.noise[name],
               "count": case.resolution[name]}
        for name, s in channels.items()
    }  # fmt: skip
    train = case.recordings["train"]
    return {
        "case": plan.number, "machine": plan.machine, "split": plan.split,
        "task": "change" if plan.kind == "change" else "missing", "recordings": [f"{n}.csv" for n in case.recordings],
        "test": files.TEST_INPUT, "sample_time_s": float(f"{train['t'].iloc[1]:.{files.DIGITS}g}"),
        "columns": {"t": "s", "r": "the reference of its controller (no input)", "u": "V",
                    **{n: s.recorded_in for n, s in channels.items()}},
        "predict": list(channels), "instruments": instruments,
    }  # fmt: skip


def _write_real(folder: Path, recording: real.Real) -> None:
    """Write the case of a real recording: a copy if its licence allows one, else how to fetch it.

    An earlier copy stays if none can be made now.
    """
    about, copy = real.about(recording), real.table(recording)
    if copy is None and (folder / "train.csv").exists():
        return
    truth = Truth(folder.name, about["machine"], "real", "real", False, list(recording.hidden), list(recording.allowed))
    content: dict[str, Any] = {"case": folder.name, "split": "real", "task": "missing", **about}
    shutil.rmtree(folder, ignore_errors=True)
    with written(folder) as scratch:
        scratch.mkdir()
        if copy is not None:
            frame, units = copy
            (scratch / "train.csv").write_text(files.text_of(frame), encoding="utf-8")
            content |= {"recordings": ["train.csv"], "columns": units}
        (scratch / files.CASE).write_text(files.data_text(content), encoding="utf-8")
        (scratch / files.ANSWER).write_text(truth.to_json(), encoding="utf-8")


def _write_machines(out: Path) -> None:
    """Write each machine as data, in words, and as an MJCF where it can be one; machines of real recordings as data."""
    for name in _machines():
        rig = files.nominal(name)
        write_text(out / files.MACHINES / f"{name}.yaml", files.data_text(rig_data(rig)))
        if name in MACHINES:
            write_text(out / files.MACHINES / f"{name}.md", machines.description(name, rig))
            if model := machines.mjcf(rig):
                write_text(out / files.MACHINES / f"{name}.xml", model)


def rig_data(rig: Rig) -> dict[str, Any]:
    """A rig as plain data, without empty fields."""

    def plain(value: Any) -> Any:
        if hasattr(value, "__dataclass_fields__"):
            value = asdict(value)
        if isinstance(value, dict):
            return {key: plain(item) for key, item in value.items() if item not in (None, "", {}, [])}
        return [plain(item) for item in value] if isinstance(value, list | tuple) else value

    found: dict[str, Any] = plain(rig_content(rig))
    return found


def _machines() -> Sequence[str]:
    return list(dict.fromkeys([*MACHINES, *(str(real.about(recording)["machine"]) for recording in real.RECORDINGS)]))


def _write_vocabulary(out: Path) -> None:
    rows = [
        {"machine": name, "place": place, "synonyms": what if count == 1 else "", "what": what}
        for name in _machines()
        for there in [machines.places(files.nominal(name))]
        for place, what in there
        for count in [sum(w == what or vocabulary.plain(p) == vocabulary.plain(what) for p, w in there)]
    ]
    write_text(out / files.PLACES, files.text_of(pd.DataFrame(rows)))
    write_text(out / files.VOCABULARY, vocabulary.FILE.read_text(encoding="utf-8"))
