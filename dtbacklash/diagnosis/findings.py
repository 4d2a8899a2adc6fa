"""What a diagnosis names and models, and the parameters that it recalibrates: plain data in SI."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from dtbacklash.files import json_able
from dtbacklash.physics.rig import Rig

#: ``one_of``: this effect or one of those that also fit
Confidence = Literal["sure", "one_of", "partial"]

#: the ends of a 95 % interval, in the unit of the value; NaN or infinite where it is open
Interval = tuple[float, float]

#: plain data as JSON knows it
Document = dict[str, Any]


@dataclass(frozen=True)
class ParameterEstimate:
    """A fitted parameter of an effect: value and ``ci95`` in ``unit`` (SI)."""

    value: float
    unit: str
    ci95: Interval


@dataclass(frozen=True)
class Alternative:
    """An effect at an element or a sensor that this recording cannot tell from a finding.

    reason : why no other recording can, in words; empty where one may.
    """

    location: str
    effect: str
    reason: str = ""

    def to_json(self) -> Document:
        """A row of ``also_fits``; the reason where there is one."""
        row: Document = {"location": self.location, "effect": self.effect}
        return row | ({"reason": self.reason} if self.reason else {})


@dataclass(frozen=True)
class Instead:
    """What would be named if a finding's effect were not in the catalogue, and how much worse it would fit.

    value, unit : its size. times_the_error : its held-out error, relative to that of the finding.
    """

    location: str
    effect: str
    value: float
    unit: str
    times_the_error: float


@dataclass(frozen=True)
class Ground:
    """What one part of a name rests on: a lead over the best fit that does without it.

    stands : whether the lead is clear. against : the best rival, None where there is none or where the effect is left
    out. ratio : of the rms that the two leave. t : the lead in standard errors. agree : share of the stretches.
    share : of the effort of free form that the law explains; of a law alone, None where it is not drawn over a state.
    recordings : the ratio in each recording that was left out of both fits in turn, above 1 where the name predicts it.
    """

    stands: bool
    ratio: float | None = None
    t: float | None = None
    agree: float | None = None
    against: Alternative | None = None
    share: float | None = None
    recordings: tuple[float, ...] = ()

    def to_json(self) -> Document:
        """A part of ``evidence``."""
        row: Document = json_able({name: getattr(self, name) for name in ("stands", "ratio", "t", "agree")})
        row |= {"share": json_able(self.share)} if self.share is not None else {}
        row |= {"recordings": json_able(list(self.recordings))} if self.recordings else {}
        return row | ({"against": self.against.to_json()} if self.against else {})


@dataclass(frozen=True)
class Evidence:
    """What a name rests on: rivals elsewhere, rivals at its place and the form of the law, and the fit without it."""

    where: Ground
    law: Ground
    size: Ground

    @property
    def sure(self) -> bool:
        """Whether all three stand."""
        return self.where.stands and self.law.stands and self.size.stands

    def to_json(self) -> Document:
        """``evidence`` of a finding."""
        return {"where": self.where.to_json(), "law": self.law.to_json(), "size": self.size.to_json()}


@dataclass(frozen=True)
class Finding:
    """One effect that the rig lacks.

    Attributes
    ----------
    location : an element or ``sensor_<name>``. effect : its name in the catalogue.
    parameters : by name. also_fits : what cannot be told from it. when : where in time it matters, one clause.
    instead : the second best, if one explains a part. sentence : what a person would say.
    confidence : ``sure`` where place, law and size stand; ``one_of`` where it is this effect or one of ``also_fits``;
    else what is open is in ``evidence`` and ``also_fits``. evidence : what the name rests on.
    """

    location: str
    effect: str
    parameters: dict[str, ParameterEstimate]
    also_fits: tuple[Alternative, ...]
    when: str
    instead: Instead | None
    sentence: str
    confidence: Confidence = "sure"
    evidence: Evidence | None = None

    def to_json(self) -> Document:
        """A row of ``findings``."""
        row: Document = json_able(replace(self, evidence=None))
        row["evidence"] = self.evidence.to_json() if self.evidence else None
        return row | {"also_fits": [other.to_json() for other in self.also_fits]}


@dataclass(frozen=True)
class Cause:
    """What one of several recordings says of a cause that they share.

    said : ``seen``, ``not seen``, or ``cannot be seen here``: the shared size would not show. value, ci95 : in ``unit``
    (SI), as this recording alone asks for, all else as all recordings say.
    """

    said: str
    value: float
    unit: str
    ci95: Interval


@dataclass(frozen=True)
class Changed:
    """A value that is not the same after as before: ``title`` (a parameter, or place.effect.size), in ``unit`` (SI).

    before, after : value and 95 % interval in the two recordings. confidence : ``sure`` where the two are apart and no
    other change explains as much, ``one_of`` where others fit alike. also_fits : titles of these.
    sentence : the same in words.
    """

    title: str
    unit: str
    before: ParameterEstimate
    after: ParameterEstimate
    confidence: Confidence
    also_fits: tuple[str, ...]
    sentence: str


@dataclass(frozen=True)
class Recalibrated:
    """A parameter of the rig that had to move: ``nominal``, ``value`` and ``ci95`` in ``unit`` (SI).

    also_fits : effects that this recording cannot tell from the parameter, which took their place.
    """

    nominal: float
    value: float
    unit: str
    ci95: Interval
    also_fits: tuple[Alternative, ...] = ()

    def to_json(self) -> Document:
        """A row of ``recalibrated``; ``also_fits`` where there is any."""
        row: Document = {name: json_able(getattr(self, name)) for name in ("nominal", "value", "unit", "ci95")}
        return row | ({"also_fits": [other.to_json() for other in self.also_fits]} if self.also_fits else {})


@dataclass(frozen=True)
class Blind:
    """A direction in which the recording determines the parameters less than their tolerances do.

    parameters : name -> relative change along it, of those that take part. tolerances : the error that the data alone
    leave along it. sentence : the same in words.
    """

    parameters: dict[str, float]
    tolerances: float
    sentence: str


@dataclass(frozen=True)
class Calibration:
    """All known parameters of the rig as fitted, whether they had to move or not.

    parameters : by name, with 95 % intervals that what was believed beforehand narrows. correlation : of their errors,
    name -> name -> -1 to 1. blind : directions, the blindest first.
    """

    parameters: dict[str, Recalibrated]
    correlation: dict[str, dict[str, float]]
    blind: tuple[Blind, ...]

    def to_json(self) -> Document:
        """``calibration`` of ``diagnosis.json``."""
        rows = {name: row.to_json() for name, row in self.parameters.items()}
        blind = [json_able(asdict(one)) for one in self.blind]
        return {"parameters": rows, "correlation": json_able(self.correlation), "blind": blind}


@dataclass(frozen=True)
class Formula:
    """A family of laws that was fitted to a table, and how it compares with it.

    Attributes
    ----------
    family : in words. law : the formula, in the states and parameters of a law of one's own. parameters : name ->
        (value, low, high), the ends of a 95 % interval. unit : name -> unit, where it has one.
    left : what it leaves of what judges, rms, as a ratio to what the table leaves. tied : whether the recording cannot
        tell it from the best one. chosen : whether it takes the place of the table.
    """

    family: str
    law: str
    parameters: dict[str, tuple[float, float, float]]
    units: dict[str, str]
    left: float
    tied: bool
    chosen: bool = False

    def to_json(self) -> Document:
        """A row of ``formulas``."""
        parameters = {
            name: {"value": value, "unit": self.units.get(name, ""), "ci95": [low, high]}
            for name, (value, low, high) in self.parameters.items()
        }
        return {"family": self.family, "law": self.law, "parameters": json_able(parameters),
                "left": json_able(self.left), "tied": self.tied, "chosen": self.chosen}  # fmt: skip


@dataclass(frozen=True)
class Modelled:
    """The effort that no name explains, as the rig has it now.

    Attributes
    ----------
    location : an element. effect : ``found_1`` where a formula takes the place of the table, else the table's name.
    state, state_unit : over which it is. times : a second state that multiplies it, or empty. unit : of its values.
    points : (state, value, standard error), a row a knot. instead_of : (location, effect) of the names that the rig
        does without, since it leaves less with this alone.
    formulas : families that were tried, the best first. sentence : what a person would say. rig : with all of it.
    """

    location: str
    effect: str
    state: str
    state_unit: str
    times: str
    unit: str
    points: tuple[tuple[float, float, float], ...]
    instead_of: tuple[tuple[str, str], ...]
    formulas: tuple[Formula, ...]
    sentence: str
    rig: Rig = field(repr=False)

    def to_json(self) -> Document:
        """``modelled`` of ``diagnosis.json``."""
        names = ("location", "effect", "state", "state_unit", "times", "unit", "points", "sentence")
        row: Document = json_able({name: getattr(self, name) for name in names})
        row["instead_of"] = [{"location": place, "effect": effect} for place, effect in self.instead_of]
        return row | {"formulas": [formula.to_json() for formula in self.formulas]}
