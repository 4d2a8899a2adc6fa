"""The errors of the models, what is explained and left, and what the figures of a diagnosis show: plain data in SI."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.findings import Cause, Document
from dtbacklash.files import json_able


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
    causes : ``place.effect``, or the name of a parameter that had to move -> its share of the mismatch: by how much the
    mean square error would grow were it alone taken out again, so divided that they add up to what all explain,
    simulated freely, or as compared where a constant would do as well.
    left : per channel. enough : whether that is what the user called enough; None where nothing was called so.
    modelled : the same two shares with what no name explains as a table or formula; None where nothing is modelled.
    unknown : body -> unknown force of the recalibrated rig (``before``) and of the last one (``after``), as shares of
    ``force``, the rms force that moves the body, in ``unit``.
    beats_a_constant : whether one of the two simulations leaves less than the signals' own variance; not in
    ``diagnosis.json``.
    """

    free_running: float | None
    compared: float | None
    left: dict[str, Left]
    enough: bool | None = None
    beats_a_constant: bool = True
    modelled: tuple[float | None, float | None] | None = None
    unknown: dict[str, dict[str, float | str]] = field(default_factory=dict)
    causes: dict[str, float] = field(default_factory=dict)

    def to_json(self) -> Document:
        """``explained`` of ``diagnosis.json``."""
        row: Document = json_able(self)
        if self.modelled is not None:
            row["modelled"] = json_able({"free_running": self.modelled[0], "compared": self.modelled[1]})
        gone = ("beats_a_constant",) if self.modelled is not None else ("beats_a_constant", "modelled")
        return {name: value for name, value in row.items() if name not in gone}


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
    causes : title of a cause -> what the recording says of it.
    zeros : position channel that is not absolute -> ``value`` that it reads at position 0, in ``unit`` (SI).
    """

    name: str
    samples: int
    sample_time_s: float
    fitted: int
    judged: int
    held_out: ModelErrors | None = None
    zeros: dict[str, dict[str, float | str]] = field(default_factory=dict)
    causes: dict[str, Cause] = field(default_factory=dict)

    def to_json(self) -> Document:
        """A row of ``recordings``; ``zeros`` and ``causes`` where there are any."""
        row: Document = json_able(self)
        if row["held_out"]:
            del row["held_out"]["modelled"]
        return {name: value for name, value in row.items() if value or name not in ("zeros", "causes")}


@dataclass(frozen=True)
class FreeRunning:
    """The same errors with nothing measured coming to help: simulated from the first sample by the commands alone.

    None where a simulation does not stay finite. window_s : after so long the simulation begins anew, s; None where it
    lasts for the whole recording.
    """

    train: ModelErrors
    held_out: ModelErrors
    window_s: float | None = None


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
class PlotData:
    """What the figures of a diagnosis show.

    evidence : element or ``sensor_<name>`` -> its share of the evidence against the nominal rig; the shares add up to
    1, or there are none. curves : a channel and a recording each, as the rigs are compared; alone : the same by the
    commands alone, empty where one does not stay finite. laws : of the findings, then what nothing explains.
    floors : channel -> held-out rms error of the models, in noise floors.
    """

    evidence: dict[str, float] = field(default_factory=dict)
    curves: tuple[Curve, ...] = ()
    laws: tuple[LawShown, ...] = ()
    floors: dict[str, ModelErrors] = field(default_factory=dict)
    alone: tuple[Curve, ...] = ()


@dataclass(frozen=True)
class Work:
    """How much was done, for the paragraph of methods.

    sample_time_s : of the recordings. fitted, judged : samples that were fitted to, and that judged.
    every : samples that one reading of the predictor stands for. floor : channel -> what a true model leaves, rms, SI.
    columns : effects that were tried by their columns. fits : of them in full. smooth : whether the command passes
    smoothly through its samples. depth : how much was looked for, ``full``, ``quick`` or ``none``.
    """

    sample_time_s: float
    fitted: int
    judged: int
    every: int
    floor: dict[str, float]
    columns: int
    fits: int
    smooth: bool = False
    depth: str = "full"


@dataclass(frozen=True, eq=False)
class Profile:
    """The likelihood along one parameter, all others fitted anew at each of its values.

    title : of the parameter. values : (K,) in its unit, rising. rises : (K,) of -2 log likelihood with priors above
    its least; white errors reach 3.84 at the ends of a 95 % interval. fitted : the value that was found. error : its
    standard error, which is wider where errors are not white, or how the law is formulated matters.
    """

    title: str
    values: Floats
    rises: Floats
    fitted: float
    error: float
