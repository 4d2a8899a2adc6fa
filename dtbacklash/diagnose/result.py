"""The result of a diagnosis, typed: what ``diagnosis.json`` holds, and what its figures show.

Everything here is plain data in SI: the report draws it, Python reads it, and nothing has to be simulated again.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.modelled import Modelled
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.files import json_able
from dtbacklash.physics.rig import Rig

Verdict = Literal["consistent", "parameters", "missing_physics", "unexplained"]
CONSISTENT: Verdict = "consistent"
PARAMETERS: Verdict = "parameters"
MISSING: Verdict = "missing_physics"
UNEXPLAINED: Verdict = "unexplained"

Confidence = Literal["sure", "partial"]

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
    recordings : the ratio in each recording, where there are several: the name stands in those where it is above 1.
    """

    stands: bool
    ratio: float | None = None
    t: float | None = None
    agree: float | None = None
    against: Alternative | None = None
    share: float | None = None
    recordings: tuple[float, ...] = ()

    def to_json(self) -> Document:
        """A part of ``stands``."""
        row: Document = json_able({name: getattr(self, name) for name in ("stands", "ratio", "t", "agree")})
        row |= {"share": json_able(self.share)} if self.share is not None else {}
        row |= {"recordings": json_able(list(self.recordings))} if self.recordings else {}
        return row | ({"against": self.against.to_json()} if self.against else {})


@dataclass(frozen=True)
class Stands:
    """What a name rests on: rivals elsewhere, rivals at its place and the form of the law, and the fit without it."""

    where: Ground
    law: Ground
    size: Ground

    @property
    def sure(self) -> bool:
        """Whether all three stand."""
        return self.where.stands and self.law.stands and self.size.stands

    def to_json(self) -> Document:
        """``stands`` of a finding."""
        return {"where": self.where.to_json(), "law": self.law.to_json(), "size": self.size.to_json()}


@dataclass(frozen=True)
class Left:
    """What a channel shows beside the extended rig: ``rms`` in ``unit`` (SI), as a share of the motion, in floors."""

    rms: float
    unit: str
    of_motion: float
    floors: float


@dataclass(frozen=True)
class Explained:
    """How much of the mismatch the extended rig explains, of what judges.

    free_running, compared : shares of the nominal rig's mean square error above the floor, simulated by the commands
    alone and as the rigs are compared; None where the nominal one leaves noise or nothing stays finite.
    left : per channel. enough : whether that is what the user called enough; None where nothing was called so.
    modelled : the same two shares with what no name explains as a table or formula; None where nothing is modelled.
    beats_a_constant : whether one of the two simulations leaves less than the signals' own variance; not in
    ``diagnosis.json``.
    """

    free_running: float | None
    compared: float | None
    left: dict[str, Left]
    enough: bool | None = None
    beats_a_constant: bool = True
    modelled: tuple[float | None, float | None] | None = None

    def to_json(self) -> Document:
        """``explained`` of ``diagnosis.json``."""
        row: Document = json_able(self)
        if self.modelled is not None:
            row["modelled"] = json_able({"free_running": self.modelled[0], "compared": self.modelled[1]})
        gone = ("beats_a_constant",) if self.modelled is not None else ("beats_a_constant", "modelled")
        return {name: value for name, value in row.items() if name not in gone}


@dataclass(frozen=True)
class Finding:
    """One effect that the rig lacks.

    Attributes
    ----------
    location : an element or ``sensor_<name>``. effect : its name in the catalogue.
    parameters : by name. also_fits : what cannot be told from it. when : where in time it matters, one clause.
    instead : the second best, if one explains a part. sentence : what a person would say. stands : what the name rests
    on. confidence : ``sure`` where place, law and size stand; else what is open is in ``stands`` and ``also_fits``.
    """

    location: str
    effect: str
    parameters: dict[str, ParameterEstimate]
    also_fits: tuple[Alternative, ...]
    when: str
    instead: Instead | None
    sentence: str
    confidence: Confidence = "sure"
    stands: Stands | None = None

    def to_json(self) -> Document:
        """A row of ``findings``."""
        row: Document = json_able(replace(self, stands=None))
        row["stands"] = self.stands.to_json() if self.stands else None
        return row | {"also_fits": [other.to_json() for other in self.also_fits]}


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
class ModelErrors:
    """An error of the models, normalised by the signals' standard deviations; None where there is none.

    modelled : of the extended rig with what no name explains as a table or formula; None where there is none.
    """

    nominal: float | None
    recalibrated: float | None
    extended: float | None
    modelled: float | None = None


@dataclass(frozen=True)
class FitTable:
    """Errors of the models on the samples they were fitted to and on those held out.

    metric : ``nrmse``, rms error by standard deviation. channels : over which it is the rms.
    noise_floor : what a true model would leave.
    """

    metric: str
    channels: tuple[str, ...]
    train: ModelErrors
    held_out: ModelErrors
    noise_floor: float


@dataclass(frozen=True)
class RecordingUsed:
    """One of several recordings that were diagnosed together.

    Attributes
    ----------
    name : of the recording. samples : that it has. sample_time_s : between two of them.
    fitted, judged : samples that were fitted to, and that judged. held_out : errors of the models on what judged,
        normalised by the recording's own standard deviations; None where nothing of it judged.
    zeros : position channel -> its zero against that of the first recording, in ``unit`` (SI), as the nominal rig shows
        it.
    """

    name: str
    samples: int
    sample_time_s: float
    fitted: int
    judged: int
    held_out: ModelErrors | None = None
    zeros: dict[str, dict[str, float | str]] = field(default_factory=dict)

    def to_json(self) -> Document:
        """A row of ``recordings``; ``zeros`` where there are any."""
        row: Document = json_able(self)
        if row["held_out"]:
            del row["held_out"]["modelled"]
        return row if self.zeros else {name: value for name, value in row.items() if name != "zeros"}


@dataclass(frozen=True)
class FreeRunning:
    """The same errors with nothing measured coming to help: from the commands and the first sample alone.

    None where a simulation does not stay finite.
    """

    train: ModelErrors
    held_out: ModelErrors


@dataclass(frozen=True)
class Candidate:
    """One entry of the bank.

    score : fall of minus twice the log-likelihood that its signature promises. held_out : what its fit leaves of the
    held-out part, in noise floors; None where it was not fitted. verdict : what became of it.
    """

    location: str
    effect: str
    score: float
    held_out: float | None
    verdict: str


@dataclass(frozen=True)
class Rest:
    """The effort that explains most of what no law explains.

    state, state_unit, effort_unit : SI. explained : share of the held-out mismatch that it explains.
    recovered : (state, effort, standard error of the effort), a row a knot.
    """

    state: str
    state_unit: str
    effort_unit: str
    explained: float
    recovered: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Located:
    """Where what is left sits: a block of the rig, the element in it, and the share of the mismatch that is left.

    ``shown`` : whether the recording shows that it is there; not in ``diagnosis.json``.
    """

    block: str
    location: str
    share: float
    rest: Rest | None = None
    shown: bool = True

    def to_json(self) -> Document:
        """As in ``diagnosis.json``: the rest's entries beside the others, if there are any."""
        found: Document = {"block": self.block, "location": self.location, "share": self.share}
        return found | (json_able(self.rest) if self.rest else {})


@dataclass(frozen=True)
class Check:
    """One test of the result; the verdict depends on those on whiteness only.

    Attributes
    ----------
    check : what is tested, of which channel or parameter.
    statistic : None where it could not be computed. operator : ``<`` or ``>``, as the statistic should compare with
        the threshold. passed : whether it does. comment : what the statistic is, and what a failure means.
    source : of the test.
    """

    check: str
    statistic: float | None
    operator: Literal["<", ">"]
    threshold: float
    passed: bool
    comment: str
    source: str

    def to_json(self) -> Document:
        """A row of ``checks``; ``passed`` is called ``pass`` there."""
        row: Document = json_able(self)
        return {"pass" if name == "passed" else name: value for name, value in row.items()}


@dataclass(frozen=True)
class Limit:
    """How large an effect that was not found could still be.

    parameter : its size, in ``unit`` (SI). at : its other parameters, for which the bound holds. upper95 : more would
    have been seen. lower95 : less would have been seen, of a size that does more the smaller it is (a saturation's
    limit). Neither: this recording cannot show the effect.
    """

    location: str
    effect: str
    parameter: str
    unit: str
    at: dict[str, float] = field(default_factory=dict)
    upper95: float | None = None
    lower95: float | None = None

    @property
    def visible(self) -> bool:
        """Whether the recording bounds the effect at all."""
        return self.upper95 is not None or self.lower95 is not None

    def to_json(self) -> Document:
        """A row of ``limits``: the bound, or ``visible: false``."""
        row: Document = {name: getattr(self, name) for name in ("location", "effect", "parameter", "unit")}
        bounds = {name: getattr(self, name) for name in ("upper95", "lower95") if getattr(self, name) is not None}
        return row | (bounds or {"visible": False}) | ({"at": self.at} if self.at else {})


@dataclass(frozen=True)
class Curve:
    """One channel of a recording and what the models say.

    Attributes
    ----------
    name : of the channel. unit : SI.
    t_s, measured, nominal, extended : (N,) each. ``extended`` may be recalibrated only, or equal to ``nominal``.
    held_out_from_s : from here on the models were not fitted; None: nowhere here.
    noise_floor : what a true model leaves, rms, in ``unit``; None: not known.
    """

    name: str
    unit: str
    t_s: Floats
    measured: Floats
    nominal: Floats
    extended: Floats
    held_out_from_s: float | None = None
    noise_floor: float | None = None

    @property
    def changed(self) -> bool:
        """Whether the extended model says anything else than the nominal one."""
        return not np.array_equal(self.nominal, self.extended)


def _none() -> Floats:
    return np.empty(0)


@dataclass(frozen=True)
class LawShown:
    """A law, and what the recording says of it with no law assumed, both against one state and in the same units.

    Attributes
    ----------
    location, effect : where, and the effect; ``effect`` is empty where nothing explains what was recovered.
    state_label, effort_label : e.g. ``speed of motor bearing`` and ``missing torque``. state_unit, effort_unit : SI.
    law_state, law_effort : (M,) the law, empty where there is none; its ends meet where it is a loop.
    state, recovered, error : (K,) points with the standard error of the effort; empty where none were recovered.
    share : of the recovered effort that the law explains, NaN where there is no law.
    """

    location: str
    effect: str
    state_label: str
    effort_label: str
    state_unit: str
    effort_unit: str
    law_state: Floats = field(default_factory=_none)
    law_effort: Floats = field(default_factory=_none)
    state: Floats = field(default_factory=_none)
    recovered: Floats = field(default_factory=_none)
    error: Floats = field(default_factory=_none)
    share: float = float("nan")


@dataclass(frozen=True)
class Shown:
    """What the figures of a diagnosis show.

    evidence : element or ``sensor_<name>`` -> its share of the evidence against the nominal rig; the shares add up to
    1, or there are none. curves : a channel and a recording each. laws : of the findings, then what nothing explains.
    floors : channel -> held-out rms error of the models, in noise floors.
    """

    evidence: dict[str, float] = field(default_factory=dict)
    curves: tuple[Curve, ...] = ()
    laws: tuple[LawShown, ...] = ()
    floors: dict[str, ModelErrors] = field(default_factory=dict)


@dataclass(frozen=True)
class Work:
    """How much was done, for the paragraph of methods.

    sample_time_s : of the recordings. fitted, judged : samples that were fitted to, and that judged.
    blocks : into which the rig was cut: (channels that judge it, channel that drives it or "", channel that it is
    pulled towards or ""). floor : channel -> what a true model leaves, rms, SI. bank : effects that were tried by
    their signatures. fits : of them in full. smooth : whether the command passes smoothly through its samples.
    """

    sample_time_s: float
    fitted: int
    judged: int
    blocks: tuple[tuple[tuple[str, ...], str, str], ...]
    floor: dict[str, float]
    bank: int
    fits: int
    smooth: bool = False


@dataclass(frozen=True)
class Diagnosis:
    """The result of a diagnosis.

    Attributes
    ----------
    verdict : one of the four. summary : two or three sentences. findings : the effects that the rig lacks.
    recalibrated : parameter -> how far it had to move. fit, free_running : errors of the models. explained : how much
    of the mismatch the extended rig explains, and what is left.
    candidates : the bank, best first. located : where what nothing explains sits. checks : tests of the result.
    limits : how large what was not found could still be. next_experiment : what to record or measure next.
    notes : what its reader said of the recording, and how it was used.
    units : channel -> unit that was read, and whether that was assumed. source : name of the recording.
    recordings : where several were diagnosed together, what was used of each, in their order.
    fault : of wiring, a sensor or the sampling, because of which no physics was looked for; else empty.
    calibration : of all known parameters, where the recording was diagnosed.
    modelled : what no name explains, as a table or formula in the rig.
    stopped : what was being done when it was stopped, of which this is what was known; else empty.
    nominal : the rig as it was given. extended : recalibrated, with what was found. shown, work : for the report.
    """

    verdict: Verdict
    summary: str
    findings: tuple[Finding, ...]
    recalibrated: dict[str, Recalibrated]
    fit: FitTable
    candidates: tuple[Candidate, ...]
    located: Located | None
    next_experiment: str
    nominal: Rig
    extended: Rig
    free_running: FreeRunning | None = None
    explained: Explained | None = None
    checks: tuple[Check, ...] = ()
    limits: tuple[Limit, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    source: str = "recording"
    shown: Shown = field(default_factory=Shown)
    work: Work | None = None
    recordings: tuple[RecordingUsed, ...] = ()
    fault: str = ""
    calibration: Calibration | None = None
    modelled: Modelled | None = None
    stopped: str = ""

    @property
    def rig(self) -> Rig:
        """The extended rig, with what no name explains as a table or formula where that is modelled."""
        return self.modelled.rig if self.modelled else self.extended

    def to_json(self) -> Document:
        """The content of ``diagnosis.json``: plain data, null for what is not finite."""
        names = (
            "verdict", "summary", "findings", "recalibrated", "fit", "free_running", "candidates", "located", "checks",
            "limits", "units", "next_experiment", "notes",
        )  # fmt: skip
        document: Document = {"stopped_early": self.stopped} if self.stopped else {}
        document |= {name: json_able(getattr(self, name)) for name in names}
        document["findings"] = [finding.to_json() for finding in self.findings]
        document["recalibrated"] = {name: row.to_json() for name, row in self.recalibrated.items()}
        document["explained"] = self.explained.to_json() if self.explained else None
        document["located"] = json_able(self.located.to_json()) if self.located else None
        document["checks"] = [check.to_json() for check in self.checks]
        document["limits"] = [limit.to_json() for limit in self.limits]
        document["calibration"] = self.calibration.to_json() if self.calibration else None
        document["settings"] = SETTINGS.to_json()
        if self.modelled:
            document["modelled"] = self.modelled.to_json()
        else:
            tables = [document[name] for name in ("fit", "free_running") if document[name]]
            for errors in (table[part] for table in tables for part in ("train", "held_out")):
                del errors["modelled"]
        if self.recordings:
            document["recordings"] = [recording.to_json() for recording in self.recordings]
        return document
