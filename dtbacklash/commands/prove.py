"""``dtb prove``: diagnose concealed recordings blind, open their seals, and score."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash.campaign import progress
from dtbacklash.campaign.application import Application
from dtbacklash.config.commands import ProveConfig
from dtbacklash.config.load import settings_hash
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.campaign.backends import Workers
    from dtbacklash.campaign.engine import Tell
    from dtbacklash.prove.run import Plan
    from dtbacklash.prove.score import Score

MARK = "score.json"
FIGURES = (
    "strict", "within_ambiguity", "nothing_found", "parameters_told", "unknown_admitted", "main_named", "sure_right",
)  # fmt: skip


def do(config: ProveConfig, folder: Path, command: str, tell: Tell | None) -> tuple[Any, dict[str, Any]]:
    """Check what can be checked, then do what is missing of the proof; gives plan and score, and the score's shares."""
    from dtbacklash.prove import run

    by = _workers(config)
    plan = _plan(config, folder)
    if config.known is not None:
        plan = replace(plan, known=run.load_known(Path(config.known).absolute()))
    docs = Path(config.docs).absolute() if config.docs is not None else None
    if docs is not None:
        from dtbacklash.report.proof.page import check_docs

        check_docs(docs, config.machine)
    if plan.folder is not None:
        run.check_given(plan)
    with _nothing_half_made(plan):
        run.claim(plan)
        _write_rig(config, plan)
        score = prove(plan, by, tell or _silent, _command(config), docs)
    shares = {f.name: f for f in score.figures if f.name in FIGURES}
    return (plan, score), {name: share.right / share.of if share.of else None for name, share in shares.items()}


def _silent(stage: str, done: int, total: int) -> None:
    """Tell nobody."""


def prove(plan: Plan, by: Workers, tell: Tell, command: str = "", docs: Path | None = None) -> Score:
    """Do what is missing of a proof and write its score; the seals are opened after the last diagnosis.

    Raises UserError: see :mod:`dtbacklash.prove.run`. KeyboardInterrupt: finished cases stay.
    """
    from dtbacklash.prove import run
    from dtbacklash.prove.score import score
    from dtbacklash.report.proof import page as proof_page

    cases = run.conceal_missing(plan, by, tell)
    run.diagnose_missing(plan, cases, by, tell)
    secrets = run.open_seals(plan, cases)
    run.ask_oracle(plan, cases, secrets, by, tell)
    answered = run.gather(plan, cases, secrets)
    result = score(answered, {"command": command} if command else {})
    proof_page.write(result, answered, plan.out)
    if docs is not None:
        proof_page.write_docs(result, answered, docs, plan.machine)
    return result


def _compare(plan: Plan, score: Score, config: ProveConfig) -> int:
    """Hold a quick proof against what was reached; returns the exit code."""
    from dtbacklash.files import write_text
    from dtbacklash.prove import quick

    rig, n = config.rig.name, config.quick_count()
    write_text(plan.out / "reached.yaml", quick.reached_text(rig, n, score))
    before = quick.reached(rig, n)
    if not before:
        print(f"dtb: no score of rig={rig} was stored before, so this one is compared with nothing", file=sys.stderr)
    dropped = quick.drops(score, before)
    for line in dropped:
        print(f"dtb: dropped: {line}", file=sys.stderr)
    return 1 if dropped else 0


@contextmanager
def _nothing_half_made(plan: Plan) -> Iterator[None]:
    """What this call put into a folder that was empty goes again if wrong input ends it before any work is done."""
    import shutil

    fresh = not plan.out.is_dir() or not any(plan.out.iterdir())
    try:
        yield
    except UserError:
        if fresh and plan.out.is_dir() and not any(plan.out.glob("*/*")):
            shutil.rmtree(plan.out, ignore_errors=True)
        raise


def _workers(config: ProveConfig) -> Workers:
    from dtbacklash.campaign.backends import Workers, check_backend

    check_backend(config.backend, config.scheduler)
    return Workers(config.backend, config.jobs, config.scheduler)


def _plan(config: ProveConfig, out: Path) -> Plan:
    from dtbacklash.api import rigs
    from dtbacklash.physics.rig import build_rig
    from dtbacklash.prove.quick import quick_seeds
    from dtbacklash.prove.run import Plan
    from dtbacklash.prove.simulator.rig import check_concealable

    name = rigs.called(config.rig) or str(out / rigs.FILE)
    if config.folder is not None:
        key = Path(config.key).absolute() if config.key is not None else None
        chosen = name if _rig_is_chosen() else None  # else each case names its own
        return Plan(out, chosen, folder=Path(config.folder).absolute(), key=key)
    if config.rigs:
        return replace(_plan_of_several(config, out), machine=config.machine)
    nominal = build_rig(config.rig)
    check_concealable(nominal)
    every = range(config.seed, config.seed + config.n)
    seeds = quick_seeds(nominal, config.quick_count()) if config.quick else tuple(every)
    return Plan(out, name, seeds, machine=config.machine)


def _plan_of_several(config: ProveConfig, out: Path) -> Plan:
    from dtbacklash.prove.conceal import nominal_rig
    from dtbacklash.prove.run import Plan
    from dtbacklash.prove.simulator.rig import check_concealable

    if _rig_is_chosen():
        raise UserError("rigs", ", ".join(config.rigs), "does not go with rig")
    counts = config.counts()
    for name in counts:
        check_concealable(nominal_rig(name))
    files = {name: str(Path(name).resolve()) if name.endswith((".yaml", ".yml")) else name for name in counts}
    last = config.seed + max(counts.values())
    return Plan(out, None, tuple(range(config.seed, last)), rigs=tuple((files[n], c) for n, c in counts.items()))


def _rig_is_chosen() -> bool:
    from hydra.core.hydra_config import HydraConfig

    words = [word.lstrip("+") for word in HydraConfig.get().overrides.task]
    return any(word.startswith(("rig=", "rig.")) for word in words)


def _write_rig(config: ProveConfig, plan: Plan) -> None:
    """A rig that is no option of ``rig=``, or was changed, goes into the proof's folder: the workers read it there.

    Raises UserError: the folder holds the proof of another rig.
    """
    from dtbacklash.api import rigs
    from dtbacklash.physics.rig import build_rig
    from dtbacklash.physics.rig_file import rig_yaml

    file = plan.out / rigs.FILE
    if plan.rig != str(file):
        return
    rig = build_rig(config.rig)
    if file.exists() and file.read_text(encoding="utf-8") != rig_yaml(rig):
        raise UserError("out", plan.out, "holds a proof of another rig; give another folder")
    file.write_text(rig_yaml(rig), encoding="utf-8")


def _command(config: ProveConfig) -> str:
    """What repeats this score: without the places of files and the choice of workers."""
    if config.quick:
        kept = ["--quick", *(["n=6"] if config.quick_count() == 6 else [])]
    elif config.folder is not None:
        kept = [f"folder={Path(config.folder).name}"]
    elif config.rigs:
        kept = [f"'rigs=[{','.join(f'{name}:{n}' for name, n in config.counts().items())}]'", f"seed={config.seed}"]
    else:
        kept = [f"n={config.n}", f"seed={config.seed}"]
    kept += [] if config.machine == "clean" else [f"machine={config.machine}"]
    return " ".join(["dtb prove", *kept, *([] if config.rig.name == "lead_screw" else [f"rig={config.rig.name}"])])


def show(proved: tuple[Plan, Score], config: ProveConfig, folder: Path) -> int:
    """Print the score and where the report is; with ``--quick`` hold the score against what was reached."""
    from rich.markup import escape

    from dtbacklash.commands.console import shown_path, stdout_console
    from dtbacklash.report.components import tables
    from dtbacklash.report.proof.text import shares_table, terminal

    plan, score = proved
    tables.show(tables.of(shares_table(score)), "", *terminal(score), "")
    stdout_console().print(escape(shown_path(plan.out / "report.html")), soft_wrap=True)
    return _compare(plan, score, config) if config.quick else 0


def fingerprint(config: ProveConfig) -> str:
    """A hash of all that decides the score: settings but who does the work, and the code."""
    return settings_hash(replace(config, jobs=1, backend="loky", scheduler=None, docs=None, known=None), [config.key])


APPLICATION = Application("prove", fingerprint, do, show, MARK, FIGURES, progress=lambda: progress.shown("recordings"))
