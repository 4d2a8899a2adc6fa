"""All rules by which a diagnosis is judged against what was hidden.

A case is *clear* when an oracle (see :mod:`.oracle`) sees everything that was hidden in it. The bars of the score count
clear cases; the score shows the figures of all cases beside them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.effects.declare import Role
from dtbacklash.physics.effects.table import SHAPES
from dtbacklash.prove.secret import allowed_in
from dtbacklash.scoring.shares import holds
from dtbacklash.scoring.truth import UNLISTED, Key, Matching

#: the kind of a sensor's place
SENSOR = "sensor"
#: an unknown effect can be seen when it changes the signals by this many times their noise
UNKNOWN_CLEAR = 3.0
#: the findings to rely on
CERTAIN = ("sure", "one_of")
#: verdicts that say that no physics is missing
NOTHING_MISSING = ("consistent", "parameters")


@dataclass(frozen=True)
class Case:
    """One concealed recording with its answer.

    id : name of its folder. secret : :class:`.secret.Secret` as a dict. diagnosis : content of ``diagnosis.json``, or
    None where the diagnosis failed. oracle : see :func:`.oracle.look`. wall_s, cpu_s : time and processor time
    of the diagnosis. error : why it failed. kinds : element of the rig -> its kind. rig : name of the rig.
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
        """The kind of what was hidden, one of ``KINDS`` of :mod:`.secret`."""
        return str(self.secret["kind"])

    @property
    def hidden(self) -> list[Key]:
        """(location, effect) of each hidden effect of the catalogue."""
        return [(e["location"], e["effect"]) for e in self.secret["effects"]]

    @property
    def lifelike(self) -> bool:
        """Whether there are small things beside what was hidden."""
        return self.secret.get("machine") == "lifelike"

    @property
    def findings(self) -> list[dict[str, Any]]:
        """The findings that name an effect."""
        return [f for f in (self.diagnosis or {}).get("findings", []) if f.get("effect")]

    @property
    def named(self) -> list[Key]:
        """(location, effect) of each finding."""
        return [(f["location"], f["effect"]) for f in self.findings]

    @cached_property
    def matching(self) -> Matching:
        """The findings, matched with what is hidden; a table means physics that the catalogue lacks."""
        unknown = self.secret.get("unknown")
        return Matching(
            [*self.hidden, *([(unknown["location"], UNLISTED)] if unknown else [])], [_meaning(k) for k in self.named],
            allowed_in(self.secret), [{_meaning(k) for k in also(f)} for f in self.findings],
            [j for j, f in enumerate(self.findings) if f.get("confidence") == "one_of"],
        )  # fmt: skip

    @property
    def recalibrated(self) -> dict[str, dict[str, Any]]:
        """Recalibrated parameter of the rig -> what the diagnosis says about it."""
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
        """The same for physics that the catalogue lacks."""
        unknown = self.secret.get("unknown")
        return self.visibility((unknown["location"], unknown["name"])) if unknown else math.nan


def also(finding: dict[str, Any]) -> set[Key]:
    """The effects that a finding, or a recalibrated parameter, cannot be told from, as the diagnosis says."""
    return {(a["location"], a["effect"]) for a in finding.get("also_fits", [])}


def _meaning(key: Key) -> Key:
    return (key[0], UNLISTED) if key[1] in SHAPES else key


def strict(case: Case) -> bool:
    """The findings are exactly the hidden (location, effect)."""
    return case.diagnosis is not None and sorted(case.named) == sorted(case.hidden)


def within_ambiguity(case: Case) -> bool:
    """Each hidden effect is a finding or in a finding's ``also_fits``, one to one, and no finding is left over.

    An effect may also stand in the ``also_fits`` of a recalibrated parameter.
    """
    if case.diagnosis is None:
        return False
    paired = case.matching.pairs
    told = set().union(*(also(row) for row in case.recalibrated.values()))
    left = [key for i, key in enumerate(case.hidden) if i not in paired]
    return len(paired) == len(case.findings) and told.issuperset(left)


def no_physics(case: Case) -> bool:
    """No finding, and a verdict that says that no physics is missing."""
    findings = (case.diagnosis or {}).get("findings", [])
    return case.verdict in NOTHING_MISSING and not findings


def unknown_admitted(case: Case) -> bool:
    """Physics that the catalogue lacks: called unexplained, or all findings are at the right place."""
    if case.diagnosis is None:
        return False
    places = {f.get("location") for f in case.diagnosis.get("findings", [])}
    return case.verdict == "unexplained" or places == {case.secret["unknown"]["location"]}


def unknown_unnamed(case: Case) -> bool:
    """Physics that the catalogue lacks gets no sure name, not even one at the right place."""
    return case.diagnosis is not None and not sure(case)


def sure(case: Case) -> set[int]:
    """Indices of the findings that are called sure, whatever the verdict."""
    return {j for j, f in enumerate(case.findings) if f.get("confidence") == "sure"}


def certain(case: Case) -> set[int]:
    """Indices of the findings to rely on: sure, or one of several."""
    return {j for j, f in enumerate(case.findings) if f.get("confidence") in CERTAIN}


def right_names(case: Case) -> set[int]:
    """Indices of the findings that mean something that is hidden, or one of the small things beside it."""
    return case.matching.right | case.matching.harmless


def no_false_name(case: Case) -> bool:
    """Each finding to rely on is hidden, or in its stated ambiguity, one to one; what is missed is no false name.

    In a lifelike case it may be one of the small things as well.
    """
    return case.diagnosis is not None and certain(case).isdisjoint(case.matching.false)


def main_named(case: Case) -> bool:
    """Each hidden effect is a finding or in a finding's ``also_fits``, one to one, whatever else was found."""
    return case.diagnosis is not None and set(range(len(case.hidden))) <= set(case.matching.pairs)


def main_sure(case: Case) -> bool:
    """The same, and these findings are to be relied on."""
    return main_named(case) and set(case.matching.pairs.values()) <= certain(case)


def said_with_certainty(case: Case) -> bool:
    """What is hidden is named, to be relied on, and said to be missing."""
    return case.verdict == "missing_physics" and main_sure(case)


def beaten(case: Case) -> bool:
    """Whether the true law of unknown physics clearly beats the catalogue's best; true where the diagnosis failed."""
    return case.diagnosis is None or bool(case.oracle.get("unlisted_clear", False))


def clear(case: Case) -> bool:
    """Whether an oracle sees everything that was hidden.

    True where nothing was hidden, and where the diagnosis failed, so that the case counts as wrong.
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
    """Whether the diagnosis is right by the strict rule of its kind; beside small things by that of the main effect."""
    if case.lifelike:
        return main_named(case) and no_false_name(case)
    if case.kind in ("nothing", "parameters"):
        return no_physics(case)
    return unknown_admitted(case) and unknown_unnamed(case) if case.kind == "unknown" else strict(case)


def right_parameters(case: Case) -> list[bool]:
    """Of each wrong parameter that an oracle sees, whether it was recalibrated with an interval that holds the truth.

    The oracle sees a parameter if moving only the others does not fit.
    """
    clear = [name for name, seen in case.oracle.get("clear_parameters", {}).items() if seen]
    moved, truth = case.recalibrated, case.secret["parameters"]
    return [name in moved and holds(moved[name]["ci95"], truth[name]) for name in clear]


def intervals_of(case: Case, i: int) -> list[bool]:
    """Per parameter of hidden effect ``i``, if it was named exactly: whether its interval holds the truth."""
    if i not in case.matching.exact:
        return []
    truth = case.secret["effects"][i]["parameters"]
    found = case.findings[case.named.index(case.hidden[i])]["parameters"]
    effects = [effect for (_, name), effect in CATALOGUE.items() if name == case.hidden[i][1]]
    angles = {p.name for effect in effects for p in effect.parameters if p.role is Role.ANGLE}
    return [
        holds(found[name]["ci95"], value, 2.0 * math.pi if name in angles else None)
        for name, value in truth.items() if name in found
    ]  # fmt: skip


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


def explained(case: Case, model: str) -> float:
    """Share of the recalibrated rig's held-out mean square that a model takes: the ``extended`` or the ``oracle``'s."""
    losses = case.oracle.get("held_out", {})
    if losses.get(model) is None:
        return 0.0
    return 1.0 - (float(losses[model]) / float(losses["recalibrated"])) ** 2


def error_ratio(case: Case) -> float:
    """Held-out error of the diagnosed rig over the oracle's; infinite where the diagnosis failed."""
    losses = case.oracle.get("held_out", {})
    if case.diagnosis is None or losses.get("extended") is None:
        return math.inf
    return float(losses["extended"]) / float(losses["oracle"])
