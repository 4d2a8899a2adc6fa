"""What each setting of the diagnosis does: halved and doubled, on recordings of development seeds.

A recording is diagnosed once with the usual settings; it is noted which of these were asked for. One that was not
cannot change the result, to the last bit, and is not tried. Of every other one the result is compared with the usual
one: whether any digit of it changed, whether the verdict or a name did, and whether it is right by the rules of the
blind proof (what a finding says it cannot be told from counts as named).

A share above a half is moved towards 0 and 1 by halving and doubling its distance from 1; a ratio that is at least 1,
its distance from 1. Every result is kept as soon as it is there; a run that is repeated goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import takewhile
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from joblib import Parallel, delayed

from dtbacklash import sources
from dtbacklash.campaign.backends import workers
from dtbacklash.config.compose import compose
from dtbacklash.config.setting import declared
from dtbacklash.diagnose import Record, diagnose_records
from dtbacklash.diagnose.settings import DiagnoseSettings, using
from dtbacklash.files import write_json, write_text
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.prove import draw as drawing
from dtbacklash.prove.rules import Case, right, within_ambiguity
from dtbacklash.prove.secret import Secret
from dtbacklash.report.kit.markdown import table
from studies.measure import Row

DURATION_S = 6.0
FITTED_SHARE = 0.7
PAGE, ROWS = "ablation.md", "proof/ablation.json"


@dataclass(frozen=True)
class Concealed:
    """A recording that is drawn: rig, seed (of development), kind, and the effect if it is given."""

    rig: str
    seed: int
    kind: str
    effect: str | None = None

    @property
    def name(self) -> str:
        """Its name among the results."""
        return f"{self.rig}, {self.effect or self.kind}, seed {self.seed}"


#: in this order: the first few are one of each sort, on different rigs
RECORDINGS = (
    Concealed("oscillator", 4003, "single"),
    Concealed("two_mass_stage", 4006, "unknown"),
    Concealed("rotary_drive", 4005, "single"),
    Concealed("pendulum", 4007, "parameters"),
    Concealed("lead_screw", 4001, "single", "motor_bearing.coulomb_friction"),
    Concealed("oscillator", 4008, "nothing"),
    Concealed("two_mass_stage", 4010, "several"),
    Concealed("pendulum", 4012, "single"),
    Concealed("rotary_drive", 4009, "several"),
    Concealed("lead_screw", 4300, "unknown"),
)


def ablation_rows(n: int, names: list[str], minutes: float, kept: Path) -> list[Row]:
    """Try settings on the first ``n`` recordings, for so many minutes at most, and say what they do.

    Parameters
    ----------
    names : of the settings; empty: all. kept : file in which the results stand, of this code or of none.
    """
    code = _code()
    found: dict[str, Any] = json.loads(kept.read_text(encoding="utf-8")) if kept.is_file() else {}
    if found.get("code") != code:
        found = {"code": code, "duration_s": DURATION_S, "recordings": {}}
    until = time.monotonic() + 60.0 * minutes
    recordings = found["recordings"]
    chosen = RECORDINGS[:n]
    with workers("loky", os.cpu_count() or 1):
        spread = Parallel(return_as="generator_unordered", batch_size=1, pre_dispatch="n_jobs")
        missing = (one for one in chosen if one.name not in recordings)
        for name, usual in spread(delayed(_usual)(one) for one in missing):
            recordings[name] = usual | {"tried": {}}
            write_json(kept, found)
        recordings = {one.name: recordings[one.name] for one in RECORDINGS if one.name in recordings}
        found["recordings"] = recordings
        trials = (
            (one, f"{setting} {how}", setting, value)
            for setting, how, value in _variants(names)
            for one in chosen
            if setting in recordings[one.name]["read"] and f"{setting} {how}" not in recordings[one.name]["tried"]
        )
        in_time = takewhile(lambda _: time.monotonic() < until, trials)
        for name, what, outcome in spread(delayed(_tried)(*trial) for trial in in_time):
            recordings[name]["tried"][what] = outcome
            write_json(kept, found)
    return summary(found)


def _code() -> str:
    """Digest of the code that makes the results."""
    return sources.digest(("diagnose", "physics", "prove"))


@cache
def _recorded(one: Concealed) -> tuple[Secret, Rig, Record]:
    rig = build_rig(compose("controller=open_loop", f"rig={one.rig}").rig)
    with patch.object(drawing, "DURATION_S", (DURATION_S, DURATION_S)):
        secret = drawing.draw(one.seed, rig, one.kind, one.effect)
    return secret, rig, record_of(secret, rig)


def record_of(secret: Secret, rig: Rig) -> Record:
    """What the concealing simulator records of a secret, its first ``FITTED_SHARE`` to be fitted to."""
    _, run = drawing.record(secret, rig)
    measured = {c: np.ascontiguousarray(run.seen[c]) for c in secret.channels}
    train = np.arange(len(run.u)) < round(FITTED_SHARE * len(run.u))
    return Record(secret.sample_time_s, np.ascontiguousarray(run.u), measured, train, ~train)


def _usual(one: Concealed) -> tuple[str, dict[str, Any]]:
    """A recording's name, and the result with the usual settings and which of them were asked for."""
    read: set[str] = set()

    class Watched(DiagnoseSettings):
        def __getattribute__(self, name: str) -> Any:
            read.add(name)
            return super().__getattribute__(name)

    watched = Watched()
    read.clear()
    outcome = _outcome(one, watched)
    known = {setting.key for setting in declared(DiagnoseSettings)}
    return one.name, {"usual": outcome, "read": sorted(known & read)}


def _tried(one: Concealed, what: str, setting: str, value: float) -> tuple[str, str, dict[str, Any]]:
    """A recording's name, what is tried, and the result with one setting changed."""
    one_other: dict[str, Any] = {setting: value}
    changed = replace(DiagnoseSettings(), **one_other)
    return one.name, what, {"value": value} | _outcome(one, changed)


def _outcome(one: Concealed, chosen: DiagnoseSettings) -> dict[str, Any]:
    """Verdict, names, whether they are right, and a digest of all digits but those of the checks' thresholds."""
    secret, rig, record = _recorded(one)
    try:
        with using(chosen):
            diagnosis = replace(diagnose_records(rig, [record]), settings=DiagnoseSettings())
    except Exception as error:  # what breaks a diagnosis is a result as well
        return {"verdict": f"fails: {error!r}"[:200], "named": [], "right": False, "digest": ""}
    document = diagnosis.to_json()
    case = Case("", json.loads(secret.to_json()), document, {})
    named = sorted(".".join(key) for key in case.named)
    correct = right(case) or (bool(case.hidden) and within_ambiguity(case))
    document["checks"] = [[row["check"], row["statistic"]] for row in document["checks"]]
    text = json.dumps(document, sort_keys=True)
    return {
        "verdict": case.verdict, "named": named, "right": correct,
        "digest": hashlib.sha256(text.encode()).hexdigest()[:16],
    }  # fmt: skip


def _variants(names: list[str]) -> Iterator[tuple[str, str, float]]:
    """(setting, ``halved`` or ``doubled``, value) of each setting of ``names``, in their order; empty: of all."""
    known = {one.key: one for one in declared(DiagnoseSettings)}
    for name in names or known:
        value, bounds = known[name].default, known[name].about
        least = max(bounds.above, bounds.at_least)
        most = min(bounds.below, bounds.at_most)
        for how, factor in (("halved", 0.5), ("doubled", 2.0)):
            if isinstance(value, int):
                moved: float = max(round(factor * value), math.ceil(least), 1)
            elif math.isfinite(most) and (value > 0.5 * most or factor * value >= most):
                moved = most - (most - value) / factor
            elif least >= 1.0:
                moved = least + factor * (value - least)
            else:
                moved = factor * value
            if moved != value and least <= moved <= most and moved not in (bounds.above, bounds.below):
                yield name, how, moved


def summary(found: dict[str, Any]) -> list[Row]:
    """A row a setting and direction: on how many recordings it was asked for and tried, and what it changed there."""
    rows: list[Row] = []
    recordings = found["recordings"].values()
    for setting, how, value in _variants([]):
        key = f"{setting} {how}"
        read = [r for r in recordings if setting in r["read"]]
        pairs = [(r["usual"], r["tried"][key]) for r in read if key in r["tried"]]
        if not pairs:
            continue
        names = [(a, b) for a, b in pairs if (a["verdict"], a["named"]) != (b["verdict"], b["named"])]
        rows.append({
            "what": setting, "usual": getattr(DiagnoseSettings(), setting), "tried": value,
            "recordings": len(recordings), "not_read": len(recordings) - len(read), "diagnosed": len(pairs),
            "any_digit": sum(a["digest"] != b["digest"] for a, b in pairs), "verdict_or_name": len(names),
            "to_right": sum(b["right"] and not a["right"] for a, b in names),
            "to_wrong": sum(a["right"] and not b["right"] for a, b in names),
        })  # fmt: skip
    return rows


HEADS = (
    "setting", "usual", "tried", "not read in", "diagnosed", "any digit changed", "verdict or name changed", "to right",
    "to wrong",
)  # fmt: skip


def page(found: dict[str, Any]) -> str:
    """The text of ``docs/ablation.md``."""
    rows, recordings = summary(found), found["recordings"]
    usual = table(
        ("recording", "verdict", "named", "right", "settings read"),
        ((name, r["usual"]["verdict"], ", ".join(r["usual"]["named"]) or "-", "yes" if r["usual"]["right"] else "no",
          str(len(r["read"]))) for name, r in recordings.items()),
    )  # fmt: skip
    keys = ("usual", "tried", "not_read", "diagnosed", "any_digit", "verdict_or_name", "to_right", "to_wrong")
    body = table(HEADS, ([f"`{row['what']}`", *(f"{row[k]:g}" for k in keys)] for row in rows))
    every = [one.key for one in declared(DiagnoseSettings)]
    tried = {row["what"] for row in rows if row["diagnosed"]}
    idle = [n for n in every if all(n not in r["read"] for r in recordings.values())]
    left = [n for n in every if n not in tried and n not in idle]
    state = "the present state" if found["code"] == _code() else "an earlier state"
    return INTRO.format(
        state=state,
        duration=found["duration_s"], count=len(recordings), settings=len(every), tried=len(tried), usual=usual,
        body=body, idle=_listed(idle), left=_listed(left),
    )  # fmt: skip


def _listed(names: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in names) or "none"


def write_docs(kept: Path, folder: Path) -> None:
    """Write the page, and the results that it is made from beside it."""
    found = json.loads(kept.read_text(encoding="utf-8"))
    if kept != folder / ROWS:
        write_json(folder / ROWS, found)
    write_text(folder / PAGE, page(found))


INTRO = """\
<!-- Made by `python -m studies ablation --docs docs`. Run it again, do not change this page. -->

# What each setting of the diagnosis does

Each [setting](settings.md) halved and doubled (a share above a half: its distance from 1; a ratio of at least 1: its
excess over 1), on concealed recordings of development seeds, {duration:g} s each. What a diagnosis did not ask for
cannot change it, and was not run. *Right* is by the rules of [the blind proof](proof.md); what a finding says it cannot
be told from counts as named.

Diagnosed so far: {tried} of {settings} settings on {count} recordings, by {state} of the code. A row with fewer
diagnosed recordings than were read in is not finished; `python -m studies ablation --n 10 --docs docs` goes on where
it stopped (hours), and begins anew where the code of the diagnosis has changed since.

With the usual settings:

{usual}
Changed one at a time; the counts are of recordings:

{body}
The thresholds of the checks, some of which are settings, are not among the digits. A setting that changes none on the
recordings that read it has done nothing *here*: on {count} recordings that is a reason to look, not to remove it.

Read by none of these recordings: {idle}.

Read, and not tried yet: {left}.
"""
