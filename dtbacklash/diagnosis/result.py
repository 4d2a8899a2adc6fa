"""The result of a diagnosis, typed: what ``diagnosis.json`` holds, and what its figures show.

Everything here is plain data in SI: the report draws it, Python reads it, and nothing has to be simulated again. Only
the profile likelihoods are computed where they are asked for.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from dtbacklash.diagnosis.findings import Calibration, Changed, Document, Finding, Modelled, Recalibrated
from dtbacklash.diagnosis.planning import Observed
from dtbacklash.diagnosis.plot_data import Explained, FitTable, FreeRunning, PlotData, RecordingUsed, Work
from dtbacklash.diagnosis.settings import SETTINGS
from dtbacklash.files import json_able
from dtbacklash.physics.rig import Rig

if TYPE_CHECKING:
    from dtbacklash.diagnosis.engine.intervals import Profiles

Verdict = Literal["consistent", "parameters", "missing_physics", "unexplained"]
CONSISTENT: Verdict = "consistent"
PARAMETERS: Verdict = "parameters"
MISSING: Verdict = "missing_physics"
UNEXPLAINED: Verdict = "unexplained"


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
class RemainingLaw:
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
    rest: RemainingLaw | None = None
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
    suspected : which number in the rig looks like a typo, in a sentence; else empty.
    first : what its user has to know before he believes it; else empty. zeros : those of the sensors of one recording
        that begin anywhere, in a sentence that is a note as well.
    changes : what changed from the first recording to the second, where that was asked (``compare=change``).
    stopped : what was being done when it was stopped, of which this is what was known; else empty.
    observed : how the machine was seen to move and what is open, for the experiment after it.
    profiles : those of the fitted parameters, which hold the recordings.
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
    shown: PlotData = field(default_factory=PlotData)
    work: Work | None = None
    recordings: tuple[RecordingUsed, ...] = ()
    fault: str = ""
    calibration: Calibration | None = None
    modelled: Modelled | None = None
    stopped: str = ""
    suspected: str = ""
    observed: Observed | None = None
    first: str = ""
    zeros: str = ""
    changes: tuple[Changed, ...] | None = None
    profiles: Profiles | None = field(default=None, repr=False, compare=False)

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
        document |= {"suspected": self.suspected} if self.suspected else {}
        document |= {name: json_able(getattr(self, name)) for name in names}
        document["findings"] = [finding.to_json() for finding in self.findings]
        document["recalibrated"] = {name: row.to_json() for name, row in self.recalibrated.items()}
        document["explained"] = self.explained.to_json() if self.explained else None
        document["located"] = json_able(self.located.to_json()) if self.located else None
        document["checks"] = [check.to_json() for check in self.checks]
        document["limits"] = [limit.to_json() for limit in self.limits]
        document["calibration"] = self.calibration.to_json() if self.calibration else None
        document["settings"] = SETTINGS.to_json()
        document |= {"observed": self.observed.to_json()} if self.observed else {}
        if self.modelled:
            document["modelled"] = self.modelled.to_json()
        else:
            tables = [document[name] for name in ("fit", "free_running") if document[name]]
            for errors in (table[part] for table in tables for part in ("train", "held_out")):
                del errors["modelled"]
        if self.changes is not None:
            document["changes"] = [json_able(one) for one in self.changes]
        if self.recordings:
            document["recordings"] = [recording.to_json() for recording in self.recordings]
        return document
