"""From a recording to a controller that works again, on concealed rigs.

An independent simulator records a machine in its loop, through an encoder and noisy sensors; the recording is diagnosed
without knowing what is hidden; then the loop runs on the true machine, believing in the nominal rig, in what was found
(the twin alone, the design alone, both), and in the truth. Of each sort the first seed counts from which on the hidden
thing shows in the recording by ``LEAST_VISIBLE`` times the noise, in closed loop: no result is looked at.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dtbacklash.closed_loop_check import COLUMNS, VARIANTS, compare, table
from dtbacklash.config.compose import compose
from dtbacklash.control.belief import Belief, Beliefs, settled
from dtbacklash.diagnosis import Record, diagnose_records
from dtbacklash.files import json_able, write_json, write_text
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.prove import draw as drawing
from dtbacklash.prove.secret import Secret
from dtbacklash.report.components.markdown import between
from dtbacklash.report.components.markdown import table as markdown_table
from studies.measure import Row

#: of a recording, the first part is fitted to
FITTED_SHARE = 0.7
PAGE, ROWS = "closing.md", "proof/closing.json"
BEGIN, END = "<!-- concealed: begin, made by python -m studies close_the_loop -->", "<!-- concealed: end -->"
KNOWN_BEGIN, KNOWN_END = BEGIN.replace("concealed", "known"), END.replace("concealed", "known")
#: machines whose truth is given to the model
KNOWN = {
    "k 8000 N/m, Coulomb friction 0.03 N m": (
        "parameters.k.value=8000", "effects.motor_bearing.coulomb_friction.torque=0.03",
    ),
    "screw compliance 1e-5 m/N": ("effects.screw.compliance.compliance=1e-5",),
    "ground friction 0.2 N on mass_3, c 45 N s/m": (
        "effects.mass_3.ground_friction.force=0.2", "parameters.c.value=45",
    ),
    "cogging 0.03, Coulomb friction 0.02 N m": (
        "effects.motor_bearing.cogging.torque=0.03", "effects.motor_bearing.coulomb_friction.torque=0.02",
    ),
}  # fmt: skip
LEAST_VISIBLE = 30.0
#: the loop that knows what was found may overshoot by this many times the one that knows the truth; an overshoot within
#: the settling band is as good as any other
BAR, BAND_PCT = 1.3, 1.0


def _off(name: str, share: float) -> Callable[[Secret, Rig], bool]:
    """Whether a parameter is off by at least a share."""

    def wanted(secret: Secret, rig: Rig) -> bool:
        known = rig.config.parameters[name].value
        return abs(secret.parameters.get(name, known) / known - 1.0) >= share

    return wanted


#: sort -> kind, effect, and what else has to be so
SORTS: dict[str, tuple[str, str | None, Callable[[Secret, Rig], bool]]] = {
    "Coulomb friction": ("single", "motor_bearing.coulomb_friction", lambda s, r: True),
    "cogging": ("single", "motor_bearing.cogging", lambda s, r: True),
    "stiffness": ("parameters", None, _off("k", 0.1)),
    "compliance": ("single", "screw.compliance", lambda s, r: True),
    "ground friction": ("single", "mass_3.ground_friction", lambda s, r: True),
    "hysteresis": ("single", "link_1.hysteresis", lambda s, r: True),
    "pitch error": ("single", "screw.pitch_error", lambda s, r: True),
    "several": ("several", None, lambda s, r: True),
}


def closing_rows(seed: int, kept: Path) -> list[Row]:
    """A row a belief of each sort; results are kept in ``kept`` as soon as they are there, and not made twice."""
    rig = build_rig(compose("rig=lead_screw").rig)
    done: dict[str, Any] = json.loads(kept.read_text(encoding="utf-8")) if kept.is_file() else {}
    if done.get("seed") != seed:
        done = {"seed": seed, "sorts": {}}
    for sort in SORTS:
        if sort not in done["sorts"]:
            done["sorts"][sort] = json_able(_closed(rig, sort, seed))
            write_json(kept, done)
    return [
        {"what": f"{sort}: {row['belief']}", **{name: row[name] for name in COLUMNS[1:]}}
        for sort, found in done["sorts"].items() for row in found["rows"]
    ]  # fmt: skip


def _recorded(secret: Secret, rig: Rig) -> Record:
    """What the concealing simulator records of a secret, its first ``FITTED_SHARE`` to be fitted to."""
    _, run = drawing.record(secret, rig)
    measured = {c: np.ascontiguousarray(run.seen[c]) for c in secret.channels}
    train = np.arange(len(run.u)) < round(FITTED_SHARE * len(run.u))
    return Record(secret.sample_time_s, np.ascontiguousarray(run.u), measured, train, ~train)


def _closed(rig: Rig, sort: str, first: int) -> dict[str, Any]:
    secret = _drawn(rig, sort, first)
    diagnosis = diagnose_records(rig, [_recorded(secret, rig)], jobs=2)
    config = compose("controller=nimc_twin", "sensors=encoder", "figures=false")
    true = secret.true_rig(rig)
    rows = table(compare(replace(config, rig=true.config), rig, diagnosis.extended)).to_dict("records")
    hidden = [f"{e['effect']} at {e['location']}" for e in secret.effects]
    wrong = [f"{n} {100 * (v / rig.config.parameters[n].value - 1):+.0f} %" for n, v in secret.parameters.items()]
    return {
        "seed": secret.seed, "hidden": [*hidden, *wrong], "verdict": diagnosis.verdict,
        "named": [f"{f.effect} at {f.location}" for f in diagnosis.findings], "rows": rows,
    }  # fmt: skip


def _drawn(rig: Rig, sort: str, seed: int) -> Secret:
    """The first recording of a sort that shows what it hides."""
    kind, effect, wanted = SORTS[sort]
    while True:
        secret = drawing.draw(seed, rig, kind=kind, effect=effect)
        names = [f"{e['location']}.{e['effect']}" for e in secret.effects] or ["parameters"]
        seen = min(secret.visibility.get(name, 0.0) for name in names)
        if seen >= LEAST_VISIBLE and secret.controller != "open_loop" and wanted(secret, rig):
            return secret
        seed += 1


def verdicts(kept: dict[str, Any]) -> dict[str, tuple[bool, bool]]:
    """Sort -> whether the loop that believes in what was found meets the bar, and is no worse than before."""
    found = {}
    for sort, entry in kept["sorts"].items():
        overshoot = {row["belief"]: _pct(row["overshoot_pct"]) for row in entry["rows"]}
        found[sort] = (
            overshoot["both"] <= max(BAR * overshoot["truth"], BAND_PCT),
            overshoot["both"] <= max(overshoot["nominal"], BAND_PCT) + 0.05,
        )
    return found


def _pct(value: float | None) -> float:
    return math.inf if value is None else value


def known_table() -> str:
    """The table of machines whose truth is given to the model: what there is to gain at most, sensors ideal."""
    heads = ["machine", "belief", "overshoot [%]", "settling [s]", "estimates accepted", "largest gap error [deg]"]
    nominal, rows = build_rig(compose("rig=lead_screw").rig), []
    for machine, words in KNOWN.items():
        config = compose("controller=nimc_twin", "figures=false", *(f"rig.{word}" for word in words))
        # the same form of the internal model for both, so that only what is believed differs
        form = settled(config, Beliefs(Belief(build_rig(config.rig)), Belief(nominal))).controller.internal_model
        config = replace(config, controller=replace(config.controller, internal_model=form))
        for row in table(compare(config, nominal, build_rig(config.rig))).to_dict("records"):
            if row["belief"] in ("nominal", "truth"):
                rows.append([
                    machine, str(row["belief"]), _text(row["overshoot_pct"]), _text(row["settling_time_s"]),
                    f"{row['accepted']} of {row['estimations']}", _text(row["largest_gap_error_deg"]),
                ])  # fmt: skip
    return markdown_table(heads, rows)


def closing_words(kept_file: Path) -> list[str]:
    """What the campaign shows, in sentences."""
    judged = verdicts(json.loads(kept_file.read_text(encoding="utf-8")))
    met, no_worse = (sum(v[j] for v in judged.values()) for j in (0, 1))
    missed = [sort for sort, v in judged.items() if not all(v)]
    said = [
        f"Overshoot with what was found at most {BAR:g} times that with the truth, or within {BAND_PCT:g} %: "
        f"{met} of {len(judged)}. Never more than before, or within {BAND_PCT:g} %: {no_worse} of {len(judged)}."
    ]
    return said + ([f"Missed: {', '.join(missed)}."] if missed else [])


def write_docs(kept_file: Path, folder: Path) -> None:
    """Bring the table into the page, between its marks."""
    kept = json.loads(kept_file.read_text(encoding="utf-8"))
    if kept_file != folder / ROWS:
        write_json(folder / ROWS, kept)
    heads = ["hidden", "named", *(f"{name} [%]" for name in VARIANTS), "gap error, nominal / both [deg]"]
    rows = []
    for entry in kept["sorts"].values():
        by = {row["belief"]: row for row in entry["rows"]}
        errors = " / ".join(_text(by[b]["largest_gap_error_deg"]) for b in ("nominal", "both"))
        rows.append([
            ", ".join(entry["hidden"]), ", ".join(entry["named"]) or entry["verdict"],
            *(_text(by[name]["overshoot_pct"]) for name in VARIANTS), errors,
        ])  # fmt: skip
    words = " ".join(closing_words(kept_file))
    text = (folder / PAGE).read_text(encoding="utf-8")
    text = between(text, KNOWN_BEGIN, KNOWN_END, known_table())
    write_text(folder / PAGE, between(text, BEGIN, END, f"{words}\n\n{markdown_table(heads, rows)}"))


def _text(value: float | None) -> str:
    return "-" if value is None or math.isnan(value) else f"{value:.2f}"
