"""What a finished search and its judgement amount to: verdict, moved parameters, and what is left."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from dtbacklash.diagnosis.engine.change_detection import Change
from dtbacklash.diagnosis.engine.confidence import JudgedModel
from dtbacklash.diagnosis.engine.fit import FittedModel, as_given, as_it_stands
from dtbacklash.diagnosis.engine.intervals import NORMAL95, Values
from dtbacklash.diagnosis.engine.parameters import FreeParameter, Key, standing, tolerances_away
from dtbacklash.diagnosis.engine.per_recording import RecordingValue, stands
from dtbacklash.diagnosis.engine.selection import StepwiseSelection
from dtbacklash.diagnosis.findings import Confidence, Modelled
from dtbacklash.diagnosis.predictions import Predictions
from dtbacklash.diagnosis.result import CONSISTENT, MISSING, PARAMETERS, UNEXPLAINED, Verdict
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig

#: something is missing, where nothing is named, above so many times what makes a search look for tables
MISSED = 3.0


@dataclass(frozen=True)
class Conclusion:
    """Everything that is said and shown comes from here.

    judged.model is the extended rig. away : :func:`had_to_move`. modelled, with_table : what no
    name explains, and the rig that has it. in_each : title -> what each of several recordings says of it. left_out : of
    the recalibrated and the extended rig, where each recording is left out in turn, number -> the rig as the others
    have it. predicted : name -> what each recording, left out, loses without it (:func:`.turns.predicted`). changes :
    between two recordings, where that was asked.
    """

    search: StepwiseSelection
    judged: JudgedModel
    away: Sequence[FreeParameter]
    values: Values
    seen: Predictions
    modelled: Modelled | None
    with_table: FittedModel | None
    course: str
    full: bool
    in_each: Mapping[str, tuple[RecordingValue, ...]] = field(default_factory=dict)
    left_out: tuple[Mapping[int, Rig], Mapping[int, Rig]] = ({}, {})
    predicted: Mapping[Key, tuple[float, ...]] = field(default_factory=dict)
    changes: tuple[Change, ...] | None = None

    @property
    def model(self) -> FittedModel:
        """The extended rig: recalibrated, with the names."""
        return self.judged.model

    @property
    def last(self) -> FittedModel:
        """The same with what is modelled by no name."""
        return self.with_table or self.model

    def unknown(self, model: FittedModel) -> dict[str, float]:
        """Body -> unknown force, a share of what acts there."""
        return self.search.segments.unknown(model.noise_levels)

    @property
    def before(self) -> float:
        """The largest unknown force of the recalibrated rig."""
        return self.search.unknown(self.search.nothing)

    @property
    def left(self) -> float:
        """The largest unknown force of the extended rig."""
        return self.search.unknown(self.model)

    @cached_property
    def follows(self) -> bool:
        """Whether the extended rig, with readings to correct it, errs by less than what was read moves where it judges.

        Else the recording has a fault, or belongs to another machine: nothing that was found in it is sure.
        """
        return self.seen.follows(self.model.rig)

    @property
    def explains(self) -> bool:
        """Whether little is left beside what was missing."""
        return self.follows and self.search.explains(self.model)

    @property
    def moved(self) -> dict[str, tuple[float, float]]:
        """Title of a known parameter that had to move -> (value, standard error)."""
        errors = self.values.errors
        return {
            self.label(f.shared_title, f.recording): (
                f.value(standing(f, self.model.rig)), errors.get((f.place, f.effect, f.label), np.inf)
            )
            for f in self.away
        }  # fmt: skip

    def beyond(self) -> dict[str, float]:
        """Title of a known parameter -> its distance from nominal, in tolerances."""
        away = tolerances_away(self.search.segments.nominal, self.model.rig)
        return {self.label(title, recording): far for (title, recording), far in away.items()}

    @property
    def sizes(self) -> dict[Key, str]:
        """Name -> the title of its size; tables have none."""
        entries = {key: find(self.model.rig.kind_at(key[0]), key[1], key[0]) for key in self.model.keys}
        return {key: ".".join((*key, e.size.name)) for key, e in entries.items() if not e.is_table}

    @cached_property
    def certainty(self) -> dict[Key, Confidence]:
        """How sure each name is: as judged, if it is more than nothing, stands in each recording and predicts it.

        None is where most of what was unknown is left beside names and tables, or where a clock had to be set right:
        the rest of its error acts as frictions and delays do.
        """
        sizes, timed = self.sizes, not any(s.record.retimed for s in self.seen.stretches)
        explained = self.follows and self.search.explains(self.last)
        return {
            key: self.judged.certainty.get(key, "partial")
            if self.full and timed and explained and is_there(self.model, self.values, key)
            and self.stands_in_each(sizes[key]) and not self.not_predicted(key) else "partial"
            for key in sizes
        }  # fmt: skip

    @property
    def known(self) -> bool:
        """Whether some name is sure, or one of several."""
        return any(mark != "partial" for mark in self.certainty.values())

    def stands_in_each(self, title: str) -> bool:
        """Whether a value is there, and alike, in each of several recordings that can show it."""
        return title not in self.in_each or stands(self.in_each[title], self.search.rules.min_t)

    def not_predicted(self, key: Key) -> tuple[int, ...]:
        """The recordings that could show a name and, left out, are predicted no better with it."""
        blind = {one.recording for one in self.in_each.get(self.sizes[key], ()) if not one.visible}
        ratios = zip(self.search.segments.recordings, self.predicted.get(key, ()), strict=False)
        return tuple(k for k, ratio in ratios if k not in blind and not ratio > 1.0)

    def named(self, recording: int) -> str:
        """What a recording is called."""
        return next((s.record.name for s in self.seen.stretches if s.record.recording == recording), "") or (
            f"recording {recording + 1}"
        )

    def label(self, name: str, recording: int | None) -> str:
        """A parameter's name or title; of what belongs to one recording with what that is called."""
        return name if recording is None else f"{name} in {self.named(recording)}"

    def verdict(self, enough: bool | None) -> Verdict:
        """The verdict. enough : whether what is left is what the user called so."""
        rules = self.search.rules
        named = [k for k in self.model.keys if not find(self.model.rig.kind_at(k[0]), k[1], k[0]).is_table]
        if named:
            known = self.known or not self.full  # a quick search says what is likeliest
            return MISSING if enough or (known and self.explains) else UNEXPLAINED
        if self.with_table is not None and not enough:
            return UNEXPLAINED
        rig, missed = (
            self.model.rig,
            not enough and (self.left > MISSED * rules.unexplained_attention or not self.follows),
        )
        if missed and self.seen.shows(rig) and not self.seen.unlogged(rig):
            return UNEXPLAINED
        return PARAMETERS if self.moved else CONSISTENT


def had_to_move(search: StepwiseSelection, model: FittedModel, values: Values) -> list[FreeParameter]:
    """The known parameters that had to move beside a model's names, against the same names on the rig as it was given.

    The names are there in both: a friction that is missing moves a stiffness, and may hide that it had to move.
    """
    known = [f for f in values.free if f.prior and not f.is_zero]
    away = [f for f in known if abs(standing(f, model.rig)) > search.rules.min_shift]
    given = as_given(search.segments, search.motion, model) if away else None
    if given is None:
        return []
    last = as_it_stands(search.segments, search.motion, model)
    clears = search.unknown(last) < search.rules.clearing_ratio * search.unknown(given)
    asked = 0.0 if clears else MISSED * search.rules.min_gain * search.segments.count
    return [] if given.loss - last.loss < max(search.least, asked) else away


def is_there(model: FittedModel, values: Values, key: Key) -> bool:
    """Whether the size of a name is not nothing within its interval; tables have none."""
    entry = find(model.rig.kind_at(key[0]), key[1], key[0])
    if entry.is_table:
        return True
    if model.rig.effect(*key) is None:
        return False
    neutral = entry.size.neutral or 0.0
    sizes = [(f.value(x), values.errors[*key, f.label]) for f, x in zip(values.free, values.x, strict=True)
             if f.key == key and f.name == entry.size.name]  # fmt: skip
    return any((abs(value - neutral) if np.isfinite(neutral) else abs(value)) > NORMAL95 * e for value, e in sizes)
