"""Concealed fleets and changes: several lifelike recordings in one diagnosis, counted against what they hide.

A fleet is three recordings of one rig, as :mod:`dtbacklash.prove` conceals them: another motion and noise in each, and
a payload or a stiffness that differs (``own``); or one machine whose main effect acts in one recording only. A
change is two recordings: an effect that the second one gained, or that grew in it, a new payload, a lead screw's gap
that grew, or nothing; other effects and small things, which the rig lacks, are in both.
"""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.random import Generator

import dtbacklash as dtb
from dtbacklash.diagnosis.records import records_of
from dtbacklash.files import write_text
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig
from dtbacklash.prove import rules
from dtbacklash.prove.conceal import nominal_rig, recording_table
from dtbacklash.prove.draw import draw, record
from dtbacklash.prove.oracle import look
from dtbacklash.prove.secret import Secret
from dtbacklash.prove.testbench import Bench
from dtbacklash.recording.model import Recording
from dtbacklash.report.components.markdown import between, table
from studies.measure import Row

PAGE = "several_recordings.md"
BEGIN, END = "<!-- fleets: begin, made by python -m studies fleets -->", "<!-- fleets: end -->"
RIGS = "oscillator", "two_mass_stage", "rotary_drive", "pendulum"
FLEETS, CHANGES = ("payloads", "in one only"), ("added", "grown", "nothing", "payload", "gap")
#: length of a recording, s; what specimens differ by; how large an effect is before it grew
LENGTH_S, SPECIMENS, BEFORE = 5.0, (1.0, 1.15, 1.3), 0.4
#: units of a payload and of a stiffness
DIFFER = "kg", "kg m^2", "N/m", "N m/rad"
#: a main effect that changes a recording by so many times the noise counts as one that can be seen there
CLEAR = 30.0


def fleet_rows(n: int, seed: int, kept: Path) -> list[Row]:
    """A row a case, of n fleets and a quarter more changes; each is written as it is done, and not done again."""
    rows: list[Any] = pd.read_csv(kept).to_dict("records") if kept.exists() else []
    for j in range(len(rows), n + n * len(CHANGES) // 4):
        k = j - n
        one = _fleet(seed + j, RIGS[j % 4], FLEETS[j // 4 % 2]) if k < 0 else _change(seed + j, CHANGES[k % 5], k)
        rows.append(one)
        pd.DataFrame(rows).to_csv(kept, index=False)
    return rows


def _fleet(seed: int, name: str, mode: str) -> Row:
    """Three specimens, or three recordings of one machine with its main effect in one of them."""
    nominal, rng = nominal_rig(name), np.random.default_rng(seed)
    secret = draw(seed, nominal, "single", machine="lifelike")
    own, only = (_parameter(nominal, rng), None) if mode == FLEETS[0] else (None, int(rng.integers(3)))
    factors = rng.permutation(SPECIMENS) if own else np.ones(3)
    each = [
        _again(secret, nominal, k, {own: f} if own else {}, 1.0 if only in (None, k) else 0.0)
        for k, f in enumerate(factors)
    ]
    found, seconds = _diagnosed(each, nominal, own=[own] if own else None)
    case = _case(secret, nominal, found)
    (place, effect), sure = case.hidden[0], rules.sure(case)
    matched, false = case.matching.pairs, sure & case.matching.false
    said = [f.sentence for f in found.findings if (f.location, f.effect) == (place, effect)]
    return {
        "what": f"{name}: {place}.{effect}", "mode": mode if only is None else f"in {only + 1} only",
        "seen": _least_seen([s for k, s in enumerate(each) if only in (None, k)], nominal),
        "clear": _is_clear(each[only or 0], nominal),
        "said": ", ".join(f"{p}.{e}{'!' * (j in sure)}" for j, (p, e) in enumerate(case.named)) or "-",
        "right": bool(matched), "sure": len(sure), "sure_false": len(false),
        "there_only": None if only is None else any(f"It is seen in frame ({only + 1}) only." in one for one in said),
        "cpu_s": seconds,
    }  # fmt: skip


def _change(seed: int, mode: str, number: int) -> Row:
    """Before and after."""
    name = "lead_screw" if mode == "gap" else RIGS[number % 4]
    nominal, rng = nominal_rig(name), np.random.default_rng(seed)
    kind, effect = ("single", "gear.backlash") if mode == "gap" else ("several", None)
    secret = draw(seed, nominal, kind, effect, machine="lifelike")
    size = {"added": 0.0, "grown": BEFORE, "gap": BEFORE}.get(mode, 1.0)
    moved = {_parameter(nominal, rng): 1.0 + float(rng.uniform(0.1, 0.3))} if mode == "payload" else {}
    each = [_again(secret, nominal, 0, {}, size), _again(secret, nominal, 1, moved, 1.0)]
    main = secret.effects[0]
    truth = next(iter(moved), f"{main['location']}.{main['effect']}.{_size(nominal, main)}")
    truth = "" if mode == "nothing" else truth
    found, seconds = _diagnosed(each, nominal, compare="change")
    changes = found.changes or ()
    sure = [c.title for c in changes if c.confidence == "sure"]
    named = any(truth == c.title or truth in c.also_fits for c in changes) if truth else not changes
    return {
        "what": f"{name}: {truth or '-'}", "mode": mode,
        "seen": _least_seen(each[1:], nominal) if mode in ("added", "grown", "gap") else np.nan, "clear": None,
        "said": ", ".join(f"{c.title}{'!' * (c.confidence == 'sure')}" for c in changes) or "-",
        "right": named, "sure": len(sure), "sure_false": sum(title != truth for title in sure),
        "there_only": None, "cpu_s": seconds,
    }  # fmt: skip


def _parameter(rig: Rig, rng: Generator) -> str:
    """A payload or a stiffness of the rig that is not known exactly."""
    return str(rng.choice([n for n, p in rig.config.parameters.items() if p.tolerance > 0.0 and p.unit in DIFFER]))


def _size(rig: Rig, effect: dict[str, Any]) -> str:
    return find(rig.kind_at(effect["location"]), effect["effect"], effect["location"]).size.name


def _again(secret: Secret, nominal: Rig, k: int, factors: dict[str, float], size: float) -> Secret:
    """Another recording of a machine: other motion and noise, parameters and its main effect times a factor."""
    main, *others = secret.effects
    name = _size(nominal, main)
    now = [main | {"parameters": main["parameters"] | {name: size * main["parameters"][name]}}] if size else []
    moved = {n: f * secret.parameters.get(n, nominal.config.parameters[n].value) for n, f in factors.items()}
    move = secret.excitation | {"seed": secret.excitation["seed"] + k}
    return replace(
        secret, seed=secret.seed + 1000 * k, effects=[*now, *others], parameters=secret.parameters | moved,
        excitation=move, duration_s=LENGTH_S,
    )  # fmt: skip


def _least_seen(each: list[Secret], nominal: Rig) -> float:
    """The least that the main effect changes any of these recordings, in units of their noise."""
    seen = []
    for secret in each:
        without = replace(secret, effects=secret.effects[1:])
        bench = Bench(without.true_rig(nominal), without)
        plain = bench.quiet(bench.rig, *secret.laws)
        seen.append(bench.seen(replace(bench, plain=plain).quiet(secret.true_rig(nominal), *secret.laws), plain))
    return min(seen)


def _is_clear(secret: Secret, nominal: Rig) -> bool:
    """Whether the oracle of the blind proof sees the main effect in a recording: a first state may stand for it."""
    frame = recording_table(secret, nominal, *record(secret, nominal))
    (there,) = records_of(Recording.from_frame(frame, rig=nominal, trust_units=True), nominal, True, True)
    return all(look(nominal, there, asdict(secret), None)["clear"].values())


def _diagnosed(each: list[Secret], nominal: Rig, **options: Any) -> tuple[dtb.Diagnosis, float]:
    frames = [recording_table(s, nominal, *record(s, nominal)) for s in each]
    begun = time.process_time()
    found = dtb.diagnose(frames, nominal, trust_units=True, jobs=1, **options)
    return found.diagnosis, time.process_time() - begun


def _case(secret: Secret, nominal: Rig, found: dtb.Diagnosis) -> rules.Case:
    kinds = {name: element.kind for name, element in nominal.elements.items()}
    return rules.Case("", asdict(secret), found.to_json(), {}, kinds=kinds)


def fleet_words(rows: list[Row]) -> list[str]:
    """The counts in sentences."""
    all_of = pd.DataFrame(rows)
    pair = all_of["mode"].isin(CHANGES)
    words = []
    for some, what in ((all_of[~pair], "fleets"), (all_of[pair], "pairs")):
        if some.empty:
            continue
        clear, told = some[~(some.seen < CLEAR)], some[some.clear.eq(True)]
        oracle = f", where an oracle sees it {int(told.right.sum())} of {len(told)}" if len(told) else ""
        sure = f"{int(some.sure.sum())} sure, {int(some.sure_false.sum())} of them false"
        words.append(
            f"{what}: right {int(some.right.sum())} of {len(some)}, of those that show it {CLEAR:.0f} times the noise "
            f"{int(clear.right.sum())} of {len(clear)}{oracle}; {sure}; "
            f"median {some.cpu_s.median():.0f} s of processor time."
        )
    only = all_of[all_of.there_only.notna()]
    said = f"Seen in one recording only, and said so: {int(only.there_only.sum())} of {len(only)}."
    return [*words, said] if len(only) else words


def write_docs(rows: list[Row], folder: Path) -> None:
    """Bring the counts into the page: a row for each kind of fleet and pair."""
    cases = pd.DataFrame(rows)
    kind = cases["mode"].str.replace(r"in \d only", "effect in one only", regex=True)
    counts = cases.groupby(kind, sort=False)[["right", "sure", "sure_false"]].sum().astype(int)
    counts.insert(0, "cases", cases.groupby(kind, sort=False).size())
    cells = [[mode, *map(str, row)] for mode, row in zip(counts.index, counts.to_numpy(), strict=True)]
    heads = ["hidden", "diagnoses", "right", "sure names", "of these false"]
    text = table(heads, cells) + "\n\n" + " ".join(fleet_words(rows))
    page = folder / PAGE
    write_text(page, between(page.read_text(encoding="utf-8"), BEGIN, END, text))
