"""What rigs say of whole recordings, fitted part and held-out part: predictions at one set of gains, and free runs.

All models are compared at the gains of the last one, which forgive least. A free run is a simulation by the command
alone, from rest; where a recording does not begin at rest, its first readings make the state known, and judge nothing.
A machine that nothing pulls back may drift away although its physics is right: then free runs begin anew after each
window, as long as the last model predicts better than a constant.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.predictor import Gains, Predictor
from dtbacklash.diagnosis.engine.resampling import OPENING, Samples, first_read, readings
from dtbacklash.diagnosis.engine.rig_simulator import Simulated
from dtbacklash.diagnosis.engine.segments import NoiseLevels, Segments
from dtbacklash.diagnosis.engine.sensor_zeros import zeroed
from dtbacklash.diagnosis.records import Record
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate_roughly

if TYPE_CHECKING:
    from dtbacklash.diagnosis.engine.external_simulator import Modelled

#: the longest window of free runs is the recording, and the shortest so many times the readings that begin one
SHORTEST = 4
#: a free run from rest leaves less of the square of what is read first, or the machine does not begin at rest (share)
MOSTLY = 0.5
#: a free run that errs by less shows nothing: it may be what a sensor cannot resolve (times its noise)
TIMES = 2.0

NONE: Mapping[int, Rig] = {}


@dataclass(frozen=True)
class Stretch:
    """A record at the rate of its predictor: train, held : (N,) masks of what was fitted to, and of what judges."""

    record: Record
    predictor: Predictor
    train: np.ndarray
    held: np.ndarray

    @property
    def t_s(self) -> Floats:
        """(N,) the middle of each block of samples since the recording began, s."""
        r = self.predictor.readings
        middle = 0.5 * (r.every - 1) * self.record.sample_time_s
        return self.record.from_s + middle + r.sample_time_s * np.arange(len(r.u), dtype=np.float64)

    @property
    def measured(self) -> Floats:
        """(N, m) readings, SI."""
        return self.predictor.readings.y


def segments_of(rig: Rig, records: list[Record], every: list[int]) -> Segments:
    """Predictors of what is fitted to: each record up to its last sample of that kind, NaN where it is none.

    Raises
    ------
    UserError : nothing recorded shows some part that integrates.
    """
    found = []
    for record, m in zip(records, every, strict=True):
        if not record.train.any():
            continue
        end = int(np.flatnonzero(record.train)[-1]) + 1
        y = {c: np.where(record.train[:end], v[:end], np.nan) for c, v in record.y.items()}
        at_once, inputs = (None if v is None else v[:end] for v in (record.at_once, record.inputs))
        fitted = replace(record, u=record.u[:end], y=y, at_once=at_once, inputs=inputs)
        found.append(predictor_of(rig, fitted, m))
    return Segments(rig, tuple(found))


def predictor_of(rig: Rig, record: Record, every: int) -> Predictor:
    """The predictor of a record at a rate."""
    channels = tuple(c for c in rig.sensors if c in record.y and np.isfinite(record.y[c]).any())
    imposed = rig.only("positioner") is not None
    y = dict(record.y)
    for c in channels:
        if rig.sensors[c].quantity == "acceleration":  # its first shows a command that nobody recorded
            y[c] = np.concatenate([[np.nan], y[c][1:]])
    at_once, number = record.at_once, record.recording
    found = readings(record.u, y, channels, record.sample_time_s, every, imposed, at_once, number)
    if rig.config.model:
        found = replace(found, inputs=record.inputs, as_stepped=record.as_stepped)
        return Predictor(rig, _external(found, rig))
    return Predictor(rig, Simulated(found))


def _external(found: Samples, rig: Rig) -> Modelled:
    """The simulator of a model that MuJoCo or an FMU steps."""
    if rig.config.simulator == "mujoco":
        from dtbacklash.diagnosis.engine.mujoco import Stepped

        return Stepped(found, rig)
    from dtbacklash.diagnosis.engine.fmu import Exchanged

    return Exchanged(found, rig)


def _between(rig: Rig, s: Stretch) -> Floats:
    """(m,) by how much each channel differs where a command comes early or late between its logged values, drawn.

    It is off the straight line by as much as the held one is, to either side of it.
    """
    readings, record = s.predictor.readings, s.record
    if record.otherwise is None:
        return np.asarray(readings.noise)
    held, straight = sorted((record.u, record.otherwise), key=lambda u: int(np.count_nonzero(np.diff(u))))
    value = np.cumsum(np.diff(held, prepend=held[0]) != 0.0)
    side = np.random.default_rng(0).choice((-1.0, 1.0), value[-1] + 1)[value]
    ways = (straight, straight + side * (held - straight))
    one, other = (simulate_roughly(rig, u[:-1], record.sample_time_s).sensors for u in ways)
    return np.array([np.std(one[c] - other[c]) for c in readings.channels])


def _rests(s: Stretch, errors: Floats) -> bool:
    """Whether a free run from rest, with these errors (N, m), says most of what is read first, or all but noise."""
    e, y = errors[:OPENING], s.measured[:OPENING] - [first_read(y) for y in s.measured.T]
    there = np.isfinite(e)
    left, moved = (np.sum(np.where(there, part, 0.0) ** 2, axis=0) for part in (e, y))
    noise = there.sum(axis=0) * s.predictor.readings.noise**2
    return bool((left <= np.maximum(MOSTLY * moved, TIMES**2 * noise)).all())


class Predictions:
    """All records, as rigs predict them at the gains of the last model."""

    def __init__(
        self, segments: Segments, records: list[Record], every: list[int], rig: Rig, noise_levels: NoiseLevels
    ) -> None:
        self.stretches: list[Stretch] = []
        self._rig = rig
        self._gains: list[Gains] = []
        self._fitted = {p.readings.recording for p in segments.predictors}
        fitted = iter(zip(segments.predictors, noise_levels, strict=True))
        known: tuple[Predictor, Floats] | None = None
        first = segments.predictors[0], noise_levels[0]
        for record, m in zip(records, every, strict=True):
            known = next(fitted) if record.train.any() else known
            predictor = predictor_of(segments.nominal, record, m)
            size = self._noise_levels(predictor, *(known or first))
            n = len(predictor.readings.u)
            masks = [np.asarray(mask[: n * m].reshape(n, m).all(axis=1)) for mask in (record.train, record.held)]
            self.stretches.append(Stretch(record, predictor, *masks))
            self._gains.append(predictor.gains(rig, size))

    def _noise_levels(self, predictor: Predictor, other: Predictor, noise_levels: Floats) -> Floats:
        """Sizes that were found on one stretch, for another that may have other channels."""
        n = len(other.bodies)
        forces = noise_levels[:n] + np.log(other.force / predictor.force)
        noises = dict(zip(other.readings.channels, noise_levels[n:], strict=True))
        own = zip(predictor.readings.channels, predictor.nominal_noise, strict=True)
        return np.concatenate([forces, [noises.get(c, noise) for c, noise in own]])

    @property
    def channels(self) -> tuple[str, ...]:
        """All that were recorded."""
        return tuple(dict.fromkeys(c for s in self.stretches for c in s.predictor.readings.channels))

    def floors(self) -> list[Floats]:
        """Per stretch (m,) what the last model, were it true, leaves of each channel: rms of its innovations, SI."""
        found = []
        for gains in self._gains:
            root = np.linalg.inv(gains.W[1, gains.opening])
            found.append(np.sqrt(np.diag(root @ root.T)))
        return found

    def errors(self, rig: Rig, others: Mapping[int, Rig] = NONE) -> list[Floats] | None:
        """Per stretch (N, m) innovations of a rig, NaN where nothing was read; None where they do not stay finite.

        others : recording -> the rig there instead.
        """
        passes = [partial(s.predictor.errors, gains=g) for s, g in zip(self.stretches, self._gains, strict=True)]
        return self._each(rig, others, passes)

    def follows(self, rig: Rig) -> bool:
        """Whether a rig's predictions stay finite, and err by less than what was read moves, or than noise does."""
        errors, spread = self.errors(rig), self.spread()
        judged = self.mean_squares(errors, "held")
        noise = dict.fromkeys(judged, 0.0)
        for s in self.stretches:
            for c, size in zip(s.predictor.readings.channels, s.predictor.readings.noise, strict=True):
                noise[c] = max(noise.get(c, 0.0), float(size))
        return errors is not None and all(v < spread[c] ** 2 + (TIMES * noise[c]) ** 2 for c, v in judged.items())

    def furthest_off(self, rig: Rig) -> tuple[str, str, float] | None:
        """Recording, channel and time, s, at which a rig's predictions err most, by what the channel moves; or None."""
        errors, spread = self.errors(rig), self.spread()
        worst = 0.0
        found: tuple[str, str, float] | None = None
        for s, e in zip(self.stretches, errors or [], strict=False):
            for j, c in enumerate(s.predictor.readings.channels):
                off = np.nan_to_num(np.abs(e[:, j])) / spread[c]
                if off.max(initial=0.0) > worst:
                    worst, found = float(off.max()), (s.record.name, c, float(s.t_s[off.argmax()]))
        return found

    def errs_by_more(self, rig: Rig, most: list[Floats]) -> bool:
        """Whether a free run errs by clearly more than some sizes, (m,) a stretch, in SI."""
        errors = self.free(rig)
        if errors is None:
            return True
        return any(bool((np.nanstd(e, axis=0) > TIMES * m).any()) for e, m in zip(errors, most, strict=True))

    def shows(self, rig: Rig) -> bool:
        """Whether a free run errs by more than its sensors' noise and counts."""
        return self.errs_by_more(rig, [s.predictor.readings.noise for s in self.stretches])

    def unlogged(self, rig: Rig) -> bool:
        """Whether a free run errs by about as much as what a command did between its logged values makes it err."""
        if all(s.record.otherwise is None for s in self.stretches) or not self.shows(rig):
            return False
        most = [_between(rig, s) for s in self.stretches]
        return self.errs_by_more(rig, [m / TIMES**2 for m in most]) and not self.errs_by_more(rig, most)

    def free(self, rig: Rig, others: Mapping[int, Rig] = NONE) -> list[Floats] | None:
        """The same of free runs: readings less what a rig shows by its commands alone (:meth:`.Predictor.simulate`).

        NaN as well where readings make the state known from which a run begins.
        """
        return self._free(rig, self._begins[0], others)

    @property
    def window_s(self) -> float | None:
        """After so long free runs begin anew, s; None where they last for the whole recording."""
        return self._begins[1]

    @cached_property
    def _begins(self) -> tuple[list[Sequence[int]], float | None]:
        """Per stretch the samples at which free runs begin anew, for all rigs as the last model needs it; the window.

        From rest, unless that says little of what is read first: then from a state that the first readings make known.
        """
        rest = self._free(self._rig, [()] * len(self.stretches), NONE)
        begins: list[Sequence[int]] = [(0,)] * len(self.stretches)
        if rest is not None:
            begins = [() if _rests(s, e) else (0,) for s, e in zip(self.stretches, rest, strict=True)]
        drifts = any(s.predictor.simulated.linear(self._rig).drifts for s in self.stretches)
        if not drifts or self._predicts(begins):
            return begins, None
        steps = [s.predictor.readings.sample_time_s for s in self.stretches]
        window = max(h * len(s.predictor.readings.u) for h, s in zip(steps, self.stretches, strict=True))
        while window > 2 * SHORTEST * OPENING * max(steps):
            window *= 0.5
            begins = [
                range(0, len(s.predictor.readings.u), round(window / h))
                for h, s in zip(steps, self.stretches, strict=True)
            ]
            if self._predicts(begins):
                break
        return begins, window

    def _predicts(self, begins: list[Sequence[int]]) -> bool:
        """Whether free runs of the last model err by less than a constant."""
        errors, spread = self._free(self._rig, begins, NONE), self.spread()
        parts = [self.mean_squares(errors, part) for part in ("train", "held")]
        return errors is not None and all(v < spread[c] ** 2 for part in parts for c, v in part.items())

    def _free(self, rig: Rig, begins: list[Sequence[int]], others: Mapping[int, Rig]) -> list[Floats] | None:
        """Free runs that begin anew at some samples of each stretch."""
        passes = [
            partial(s.predictor.simulate, gains=g, begins=b)
            for s, g, b in zip(self.stretches, self._gains, begins, strict=True)
        ]
        return self._each(rig, others, passes)

    def _each(
        self, of: Rig, others: Mapping[int, Rig], passes: Sequence[Callable[[Rig], Floats]]
    ) -> list[Floats] | None:
        """What a pass gives on each stretch, of a rig or that of its recording; None where one does not stay finite."""
        found = []
        for stretch, errors in zip(self.stretches, passes, strict=True):
            rig = others.get(stretch.record.recording, of)
            try:
                with np.errstate(over="ignore", invalid="ignore"):
                    alone = stretch.record.recording not in self._fitted  # its sensors' zeros are its own
                    found.append(errors(zeroed(Segments(rig, (stretch.predictor,)), rig) if alone else rig))
            except (UserError, np.linalg.LinAlgError):
                return None
            if np.nanmax(np.abs(found[-1]), initial=0.0) > 1e150:
                return None
        return found

    def mean_squares(
        self, errors: list[Floats] | None, part: str, numbers: tuple[int, ...] | None = None
    ) -> dict[str, float]:
        """Channel -> mean square of errors in a part (``train``, ``held``), of some recordings or all; empty: none."""
        if errors is None:
            return {}
        found: dict[str, list[Floats]] = {}
        for s, e in zip(self.stretches, errors, strict=True):
            if numbers is None or s.record.recording in numbers:
                for j, c in enumerate(s.predictor.readings.channels):
                    found.setdefault(c, []).append(e[getattr(s, part), j] ** 2)
        joined = {c: np.concatenate(v) for c, v in found.items()}
        return {c: float(np.nanmean(v)) for c, v in joined.items() if np.isfinite(v).any()}

    def spread(self) -> dict[str, float]:
        """Channel -> standard deviation of what was read, SI."""
        found: dict[str, list[Floats]] = {}
        for s in self.stretches:
            for j, c in enumerate(s.predictor.readings.channels):
                found.setdefault(c, []).append(s.measured[:, j])
        return {c: max(float(np.nanstd(np.concatenate(v))), 1e-300) for c, v in found.items()}

    def floor(self) -> dict[str, float]:
        """Channel -> :meth:`floors`, rms over the stretches."""
        found: dict[str, list[float]] = {}
        for s, f in zip(self.stretches, self.floors(), strict=True):
            for c, value in zip(s.predictor.readings.channels, f.tolist(), strict=True):
                found.setdefault(c, []).append(value)
        return {c: float(np.sqrt(np.mean(np.square(v)))) for c, v in found.items()}
