"""The quick proof: a fixed set of scoring seeds, and what was reached on it.

From the seed ``FROM`` on, far above those of a full proof, the first recordings of each kind, as many as in ``QUOTAS``.
``reached.yaml`` holds what was reached, per figure as count and number of cases; a share below it is a drop.
"""

from __future__ import annotations

from importlib import resources
from typing import Any

import yaml

from dtbacklash.physics.rig import Rig
from dtbacklash.prove.score import Score

FROM = 20_000
#: recordings of each kind, by how many there are in all: six for every change, twenty for every night
QUOTAS = {
    6: {"nothing": 1, "parameters": 1, "single": 2, "several": 1, "unknown": 1},
    20: {"nothing": 3, "parameters": 3, "single": 8, "several": 3, "unknown": 3},
}
#: figures that the quick proof holds against what was reached
HELD = (
    "strict", "within_ambiguity", "nothing_found", "parameters_told", "unknown_admitted", "unknown_unnamed",
    "no_false_name", "coverage_effects", "coverage_parameters",
)  # fmt: skip
#: intervals that may be lost because another processor computes other last digits
SLACK = {"coverage_effects": 1, "coverage_parameters": 1}
#: share by which the median of the held-out error over the oracle's may rise, for the same reason
RATIO_SLACK = 0.05
HEAD = """\
# What `dtb prove --quick` reached, by rig and number of recordings: per figure [right, of]. A lower share fails it.
# Raised by copying from the reached.yaml that the quick proof writes beside its score.
"""


def quick_seeds(rig: Rig, n: int) -> tuple[int, ...]:
    """The seeds of the quick proof of ``n`` recordings on a rig, in order."""
    from dtbacklash.prove.draw import draw_kind

    left, seeds, seed = dict(QUOTAS[n]), [], FROM
    while any(left.values()):
        kind = draw_kind(seed, rig)
        if left[kind]:
            left[kind] -= 1
            seeds.append(seed)
        seed += 1
    return tuple(seeds)


def reached(rig: str, n: int) -> dict[str, Any]:
    """What was reached on a rig with ``n`` recordings; empty if nothing is on record."""
    text = (resources.files("dtbacklash.prove") / "reached.yaml").read_text(encoding="utf-8")
    return dict((yaml.safe_load(text) or {}).get(f"{rig} {n}") or {})


def reached_text(rig: str, n: int, score: Score) -> str:
    """The text of a ``reached.yaml`` that holds this score."""
    lines = [f"  {name}: [{score.figure(name).right}, {score.figure(name).of}]" for name in HELD]
    ratio = next(q for q in score.quantities if q.name == "ratio")
    if ratio.of:
        lines.append(f"  ratio: {ratio.median:.3f}")
    return HEAD + f"{rig} {n}:\n" + "\n".join(lines) + "\n"


def drops(score: Score, before: dict[str, Any]) -> list[str]:
    """One sentence for each figure that fell below what was reached."""
    found = []
    for name, there in before.items():
        if name == "ratio":
            now = next(q for q in score.quantities if q.name == "ratio").median
            if not now <= float(there) * (1.0 + RATIO_SLACK):
                found.append(f"held-out error over the oracle's: {now:.3g}, reached were {float(there):.3g}")
            continue
        right, of = there
        figure = score.figure(name)
        # cross-multiplied to be exact; a figure without a case is a drop, too
        held = figure.right + SLACK.get(name, 0)
        if held * of < right * figure.of or (of and not figure.of):
            found.append(f"{figure.what}: {figure.right}/{figure.of}, reached were {right}/{of}")
    return found
