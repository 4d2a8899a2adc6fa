"""Physics that the catalogue lacks, concealed on five rigs: where a table is put, what it leaves, which formula it is.

Only laws over the states of a place count: an unmeasured disturbance, a mass that changes with the position, a gain by
direction and a play by angle are none, and a table can model them in part at best.
"""

from __future__ import annotations

import tempfile
from itertools import count
from pathlib import Path

from dtbacklash.errors import UserError
from dtbacklash.prove.conceal import conceal
from dtbacklash.prove.seal import RECORDING, open_seal
from studies.measure import Row

RIGS = ("oscillator", "two_mass_stage", "pendulum", "rotary_drive", "lead_screw")
#: what is hidden -> (state, state that multiplies, families that hold the true law)
TRUTH = {
    "position_damping": ("position", "speed", ("an even power", "a cubic polynomial")),
    "root_spring": ("stretch", "", ("a power",)),
    "speed_stiffening": ("stretch rate", "stretch", ("an even power",)),
}
#: of an oracle's held-out error, which is the noise's; and what is left without any model has to be so much more
NEAR, VISIBLE = 1.3, 1.3


def modelled_rows(n: int, seed: int) -> list[Row]:
    """A row for each of ``n`` recordings a rig on which such a law leaves clearly more than noise."""
    return [row for rig in RIGS for row in _of_rig(rig, n, seed)]


def _of_rig(rig: str, n: int, seed: int) -> list[Row]:
    from dtbacklash import diagnose

    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as scratch:
        key = Path(scratch) / "key"
        for number in count(seed):
            if len(rows) == n:
                return rows
            try:
                case = conceal(number, rig, Path(scratch) / "hidden", kind="unknown", key_file=key)
            except UserError:
                continue
            secret = open_seal(case, key)
            hidden = secret.unknown or {}
            if hidden.get("name") not in TRUTH:
                continue
            found = diagnose(case / RECORDING, rig).diagnosis
            floor, held = found.fit.noise_floor, found.fit.held_out
            if (held.recalibrated or 0.0) < VISIBLE * floor:
                continue
            state, times, families = TRUTH[hidden["name"]]
            model = found.modelled
            there = model is not None and (model.location, model.state, model.times) == (
                hidden["location"],
                state,
                times,
            )
            first = [f.family for f in model.formulas if f.tied] if model else []
            rows.append({
                "rig": rig, "hidden": hidden["name"].replace("_", " "), "seed": number,
                "left by the names": (held.extended or 0.0) / floor,
                "left by the model": (held.modelled or held.extended or 0.0) / floor,
                "place and state": "right" if there else "wrong" if model else "none",
                "formulas": "; ".join(first) or "-",
                "family": "right" if there and set(first) & set(families) else "wrong" if first else "none",
                "sure names": sum(f.confidence == "sure" for f in found.findings),
            })  # fmt: skip
    return rows


def modelled_words(rows: list[Row], seed: int) -> list[str]:
    """How many are modelled within ``NEAR`` of the noise, and how many true families are first or tied."""
    near = sum(float(row["left by the model"]) <= NEAR for row in rows)
    right = sum(row["family"] == "right" for row in rows)
    alone = sum(row["family"] == "wrong" and ";" not in str(row["formulas"]) for row in rows)
    sure = sum(int(row["sure names"]) > 0 for row in rows)
    return [
        f"Seeds from {seed}. Held-out error within {NEAR} of the noise's: {near} of {len(rows)}; the true family first "
        f"or tied: {right}; a false family alone: {alone}; with a sure name: {sure}."
    ]
