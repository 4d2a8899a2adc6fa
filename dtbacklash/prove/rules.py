"""The rules by which one diagnosis is judged against what was hidden. All of them stand here; none looks elsewhere.

A case is *clear* when an oracle (see :mod:`.oracle`) sees everything that was hidden in it; the bars of the score
count clear cases, and the score shows all of them beside that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.effects.declare import Role

Key = tuple[str, str]

KINDS = ("nothing", "parameters", "single", "several", "unknown")
#: stands for the kind of a place that is no element; its name begins with it
SENSOR = "sensor"
#: an unknown effect can be seen when it changes the signals by this many times their noise
UNKNOWN_CLEAR = 3.0
#: a diagnosis without a finding may say one of these where no physics is missing
NOTHING_MISSING = ("consistent", "parameters")


@dataclass(frozen=True)
class Case:
    """One concealed recording with its answer.

    Attributes
    ----------
    id : name of its folder. secret : what was hidden, as its JSON. diagnosis : content of ``diagnosis.json``, or
    None where the diagnosis failed. oracle : see :func:`.oracle.look`. wall_s, cpu_s : time and processor time
    of the diagnosis. error : why it failed. kinds : kind of each element of the rig, by its name. rig : its name.
    """

    id: str
    secret: dict[str, Any]
    diagnosis: dict[str, Any] | None
    oracle: dict[str, Any]
    wall_s: float | None = None
    error: str = ""
    kinds: dict[str, str] = field(default_factory=dict)
    rig: str = ""
    cpu_s: float | None = None

    def kind_of(self, location: str) -> str:
        """The kind of the element at a location, or ``sensor``."""
        return SENSOR if location.startswith(f"{SENSOR}_") else self.kinds[location]

    @property
    def kind(self) -> str:
        """What sort of thing was hidden, one of ``KINDS``."""
        return str(self.secret["kind"])

    @property
    def hidden(self) -> list[Key]:
        """(location, effect) of each hidden effect of the catalogue."""
        return [(e["location"], e["effect"]) for e in self.secret["effects"]]

    @property
    def findings(self) -> list[dict[str, Any]]:
        """The findings that name an effect."""
        return [f for f in (self.diagnosis or {}).get("findings", []) if f.get("effect")]

    @property
    def named(self) -> list[Key]:
        """(location, effect) of each finding."""
        return [(f["location"], f["effect"]) for f in self.findings]

    @property
    def recalibrated(self) -> dict[str, dict[str, Any]]:
        """What is said of each parameter of the rig that had to move, by its name."""
        return (self.diagnosis or {}).get("recalibrated", {})

    @property
    def verdict(self) -> str:
        """The verdict, or ``failed``."""
        return str(self.diagnosis["verdict"]) if self.diagnosis else "failed"

    def visibility(self, key: Key) -> float:
        """Rms change of the measured signals by one effect, in units of their noise; NaN if it is not known."""
        return float(self.secret.get("visibility", {}).get(".".join(key), math.nan))

    @property
    def unknown_visibility(self) -> float:
        """The same for what the catalogue lacks."""
        unknown = self.secret.get("unknown")
        return self.visibility((unknown["location"], unknown["name"])) if unknown else math.nan


def also(finding: dict[str, Any]) -> set[Key]:
    """What a finding, or a recalibrated parameter, says that it cannot be told from."""
    return {(a["location"], a["effect"]) for a in finding.get("also_fits", [])}


def matches(case: Case) -> dict[int, int]:
    """Hidden effect -> finding, by index: one to one, by name first, then by the stated ambiguity.

    Of all assignments the one with most exact matches among those with most matches.
    """
    hidden, findings = case.hidden, case.findings
    if not hidden or not findings:
        return {}
    worth = np.zeros((len(hidden), len(findings)))
    for i, key in enumerate(hidden):
        for j, finding in enumerate(findings):
            exact = key == (finding["location"], finding["effect"])
            worth[i, j] = 1.01 if exact else float(key in also(finding))
    rows, columns = linear_sum_assignment(worth, maximize=True)
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if worth[i, j] > 0.0}


def exact(case: Case) -> set[int]:
    """Indices of the hidden effects that a finding names at the right place."""
    named = case.named
    return {i for i, key in enumerate(case.hidden) if key in named}


def strict(case: Case) -> bool:
    """Exactly the hidden set of (location, effect), no more and no less."""
    return case.diagnosis is not None and sorted(case.named) == sorted(case.hidden)


def within_ambiguity(case: Case) -> bool:
    """Each hidden effect is a finding or in a finding's ``also_fits``, one to one, and no finding is left over.

    A recalibrated parameter may say, too, that it cannot be told from an effect.
    """
    if case.diagnosis is None:
        return False
    paired = matches(case)
    told = set().union(*(also(row) for row in case.recalibrated.values()))
    left = [key for i, key in enumerate(case.hidden) if i not in paired]
    return len(paired) == len(case.findings) and told.issuperset(left)


def no_physics(case: Case) -> bool:
    """No finding, and a verdict that says that no physics is missing."""
    findings = (case.diagnosis or {}).get("findings", [])
    return case.verdict in NOTHING_MISSING and not findings


def called_consistent(case: Case) -> bool:
    """The verdict is that what is left over is the sensors' noise."""
    return case.verdict == "consistent"


def unknown_admitted(case: Case) -> bool:
    """Physics that the catalogue lacks: called unexplained, or all that is found is at the right place."""
    if case.diagnosis is None:
        return False
    places = {f.get("location") for f in case.diagnosis.get("findings", [])}
    return case.verdict == "unexplained" or places == {case.secret["unknown"]["location"]}


def unknown_unnamed(case: Case) -> bool:
    """Physics that the catalogue lacks is not given a name: the right place with a law of the catalogue is one too.

    What is called unexplained may have findings, if they are said to be partial: one that is said to be sure is a name.
    """
    return case.diagnosis is not None and not sure(case)


def sure(case: Case) -> set[int]:
    """Indices of the findings that are a name to be relied on: all but those that an ``unexplained`` calls partial."""
    qualified = case.verdict == "unexplained"
    return {j for j, f in enumerate(case.findings) if not qualified or f.get("confidence") == "sure"}


def no_false_name(case: Case) -> bool:
    """Each name to be relied on is hidden, or in the finding's stated ambiguity, one to one.

    What is missed is no false name, nor is a wrong "no physics is missing"; the right place with a wrong law is one.
    """
    return case.diagnosis is not None and sure(case) <= set(matches(case).values())


def beaten(case: Case) -> bool:
    """Whether physics that the catalogue lacks is such that its true law clearly beats the best of the catalogue.

    A case in which the diagnosis failed counts, as in :func:`clear`.
    """
    return case.diagnosis is None or bool(case.oracle.get("unlisted_clear", False))


def clear(case: Case) -> bool:
    """Whether an oracle sees everything that was hidden. Where nothing was hidden there is nothing to see.

    A case in which the diagnosis failed counts, whatever the oracle says: it is wrong by every rule.
    """
    if case.diagnosis is None:
        return True
    if case.kind == "unknown":
        return case.unknown_visibility >= UNKNOWN_CLEAR
    if case.kind in ("single", "several"):
        seen = case.oracle.get("clear", {})
        return all(seen.get(".".join(key), False) for key in case.hidden)
    return True


def right(case: Case) -> bool:
    """Whether the diagnosis is right by the strict rule of its kind."""
    if case.kind in ("nothing", "parameters"):
        return no_physics(case)
    return unknown_admitted(case) and unknown_unnamed(case) if case.kind == "unknown" else strict(case)


def clear_parameters(case: Case) -> list[str]:
    """The wrong parameters that an oracle sees one by one: without moving this one, none of the others fits."""
    return [name for name, seen in case.oracle.get("clear_parameters", {}).items() if seen]


def right_parameters(case: Case) -> int:
    """How many of the clear wrong parameters were recalibrated, each with an interval that holds its true value."""
    there = case.recalibrated
    return sum(
        name in there and holds(there[name]["ci95"], case.secret["parameters"][name]) for name in clear_parameters(case)
    )


def holds(interval: list[float | None], truth: float, period: float | None = None) -> bool:
    """Whether an interval holds the truth; of an angle, modulo its period. No interval holds nothing."""
    low, high = interval
    if low is None or high is None or not (math.isfinite(low) and math.isfinite(high)):
        return False
    if period is None:
        return low <= truth <= high
    middle = 0.5 * (low + high)
    away = (truth - middle + 0.5 * period) % period - 0.5 * period
    return abs(away) <= 0.5 * (high - low)


def intervals_of(case: Case, i: int) -> list[bool]:
    """For each parameter of one hidden effect that was named exactly: whether its interval holds the truth."""
    if i not in exact(case):
        return []
    truth = case.secret["effects"][i]["parameters"]
    found = case.findings[case.named.index(case.hidden[i])]["parameters"]
    angles = _angles(case.hidden[i][1])
    return [
        holds(found[name]["ci95"], value, 2.0 * math.pi if name in angles else None)
        for name, value in truth.items() if name in found
    ]  # fmt: skip


def _angles(effect: str) -> set[str]:
    """The parameters of an effect that are angles."""
    entries = [entry for (_, name), entry in CATALOGUE.items() if name == effect]
    return {p.name for entry in entries for p in entry.parameters if p.role is Role.ANGLE}


def effect_intervals(case: Case) -> list[bool]:
    """The same for all hidden effects of a case."""
    return [held for i in range(len(case.hidden)) for held in intervals_of(case, i)]


def nominal_intervals(case: Case) -> list[bool]:
    """For each recalibrated parameter of a case whose structure is right: whether its interval holds the truth."""
    structure = no_physics(case) if case.kind in ("nothing", "parameters") else strict(case)
    if case.kind == "unknown" or not structure or case.diagnosis is None:
        return []
    truth = case.secret["parameters"]
    return [holds(there["ci95"], truth.get(name, there["nominal"])) for name, there in case.recalibrated.items()]


def error_ratio(case: Case) -> float:
    """Held-out error of the diagnosed rig over the oracle's; infinite where the diagnosis failed."""
    losses = case.oracle.get("held_out", {})
    if case.diagnosis is None or losses.get("extended") is None:
        return math.inf
    return float(losses["extended"]) / float(losses["oracle"])
