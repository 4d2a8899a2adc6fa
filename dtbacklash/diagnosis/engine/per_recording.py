"""What each of several recordings says of one value that they share: its size there, all else as all of them say."""

from collections.abc import Collection
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from dtbacklash.diagnosis.engine.fit import FittedModel
from dtbacklash.diagnosis.engine.intervals import NORMAL95, Values, covariance_of, inverse, stretches
from dtbacklash.diagnosis.engine.parameters import FreeParameter
from dtbacklash.diagnosis.engine.recording_effects import may_differ, split
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.physics.catalogue import find


@dataclass(frozen=True)
class RecordingValue:
    """A value in one recording, by its number.

    value, error : with its standard error, in the parameter's unit. visible : whether the shared value would show
    there. there : whether it does. own : whether it is free there, and no recording shares it.
    """

    recording: int
    value: float
    error: float
    visible: bool
    there: bool
    own: bool = False


def in_each(
    segments: Segments, model: FittedModel, values: Values, titles: Collection[str]
) -> dict[str, tuple[RecordingValue, ...]]:
    """Title -> its value in each recording; empty of one recording.

    The shared column is split into one for each recording, and the fit moves on by one step.
    """
    if len(segments.recordings) < 2 or not values.errors:
        return {}
    found: dict[str, tuple[RecordingValue, ...]] = {}
    for j, f in enumerate(values.free):
        if f.shared_title not in titles or f.is_zero:
            continue
        if f.recording is not None:
            size = f.value(values.x[j])
            one = _of(f, model, size, values.errors[f.place, f.effect, f.label], size, True)
            found[f.shared_title] = (*found.get(f.shared_title, ()), one)
        elif may_differ(f, model.rig):
            found[f.shared_title] = _split(segments, model, values, j)
    return found


def _split(segments: Segments, model: FittedModel, values: Values, j: int) -> tuple[RecordingValue, ...]:
    """The shared value j in each recording."""
    f, x = values.free[j], values.x[j]
    each = split(segments, values.jacobian[:, j])
    J = np.hstack([np.delete(values.jacobian, j, axis=1), each])
    n = each.shape[1]
    moved = -(inverse(J) @ (J.T @ values.rows))[-n:]
    variances = np.diag(covariance_of(J, values.rows, stretches(segments)))[-n:]
    slope, found = abs(float(f.per_x(x))), []
    law = slope * find(model.rig.kind_at(f.place), f.effect, f.place).formulation_error if f.effect else 0.0
    for k, step, variance, column in zip(segments.recordings, moved, variances, each.T, strict=True):
        error = float(np.hypot(slope * np.sqrt(max(variance, 0.0)), law)) if column.any() else np.inf
        value = f.value(x) + slope * float(step) if column.any() else np.nan
        found.append(_of(f, model, value, error, f.value(x), False, k))
    return tuple(found)


def _of(
    f: FreeParameter, model: FittedModel, value: float, error: float, shared: float, own: bool, k: int | None = None
) -> RecordingValue:
    """What a value and its error say; of a parameter of the rig, whether it is away from its nominal value."""
    neutral: float | None = f.centre
    if f.effect and not f.prior:
        neutral = find(model.rig.kind_at(f.place), f.effect, f.place).size.neutral
    nothing = neutral if neutral is not None and np.isfinite(neutral) else 0.0
    recording = f.recording if k is None else k
    assert recording is not None
    there = abs(value - nothing) > NORMAL95 * error
    return RecordingValue(recording, value, error, own or abs(shared - nothing) > NORMAL95 * error, bool(there), own)


def difference(model: FittedModel, values: Values, title: str) -> tuple[float, float]:
    """How much larger a value that is free in each of two recordings is in the second one, and its standard error.

    What is uncertain in both alike, as the scale of all forces, is not in it.
    """
    js = [j for j, f in enumerate(values.free) if f.shared_title == title]
    of, slopes = values.free[js[0]], np.array([float(values.free[j].per_x(values.x[j])) for j in js])
    turned = slopes * [-1.0, 1.0]
    law = find(model.rig.kind_at(of.place), of.effect, of.place).formulation_error if of.effect else 0.0
    error = np.hypot(np.sqrt(turned @ values.covariance[np.ix_(js, js)] @ turned), law * turned.sum())
    first, second = (values.free[j].value(values.x[j]) for j in js)
    return second - first, float(error)


def stands(each: Collection[RecordingValue], apart: float) -> bool:
    """Whether a shared value is there in each recording that can show it, and alike: no two further apart than that.

    apart : standard errors of their difference.
    """
    seen = [one for one in each if one.visible]
    if any(one.own for one in each):
        return any(one.there for one in each)
    near = all(abs(a.value - b.value) < apart * np.hypot(a.error, b.error) for a, b in combinations(seen, 2))
    return near and all(one.there for one in seen)
