"""What is off by a factor, too far for a column to show: lines of an encoder, a slipped point, a radius for a diameter.

Where one sensor reads four times what is there, nothing else that the rig predicts is right, and everything seems to be
missing. So before anything is searched, each gain is tried at the factors that a wrong number makes of it, and so is
each parameter of the rig. A gain that explains most of what could be explained is where a search starts.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.diagnosis.engine.fit import FitProblem, FittedModel
from dtbacklash.diagnosis.engine.motion import Motion
from dtbacklash.diagnosis.engine.parameters import Key, nominal_free, taken_out
from dtbacklash.diagnosis.engine.segments import NoiseLevels, Segments
from dtbacklash.diagnosis.engine.sensor_zeros import zeroed
from dtbacklash.diagnosis.parallel import spread
from dtbacklash.diagnosis.settings import DiagnoseSettings
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig

GAIN = "gain_error"
#: of a gain: lines, edges and bits of an encoder, radians of a turn, a range
GAINS = (2.0, 2.5, 4.0, 5.0, 2.0 * np.pi, 8.0, 10.0)
#: beyond the last of them: what still falls there is a sensor that the rig does better without
BEYOND = 20.0
#: of a parameter: a radius for a diameter, a slipped point, a prefix
NUMBERS = (2.0, 10.0, 100.0, 1e3)
#: a factor is what is wrong if it brings so much of what a perfect model would (share of -2 log likelihood)
MOSTLY = 0.5
#: a gain that is off by less is no wrong number (logarithm)
LEAST = np.log(1.4)


@dataclass(frozen=True)
class ScaleError:
    """A gain (place, effect) or a parameter ("", name) that is off by a factor, the rig with it, and how likely."""

    key: Key
    factor: float
    rig: Rig
    noise_levels: NoiseLevels
    loss: float


def begin(segments: Segments, rules: DiagnoseSettings) -> ScaleError | None:
    """The gain that is off by a factor, if one explains most of what the nominal rig lacks, and no parameter more.

    Of several that nothing tells apart a sensor's; the amplifier's is none where a parameter does the same.
    """
    gains = near_best(segments, gains_off(segments, segments.nominal), rules.min_gain)
    if not gains:
        return None
    sensors = [one for one in gains if one.key[0].startswith(SENSOR_PREFIX)]
    best = [*sensors, *gains][0]
    near = near_best(
        segments, [best, *numbers_off(segments, segments.nominal, rules, {*NUMBERS, best.factor})], rules.min_gain
    )
    return best if best in near and (sensors or len(near) == 1) else None


def numbers_instead(
    segments: Segments, noise_levels: NoiseLevels, model: FittedModel, motion: Motion, worth: float
) -> list[ScaleError]:
    """Parameters of the rig that, off by the factor of a gain of a model, do what it does; all else fitted anew.

    noise_levels : of the model, on these segments. A gain that is off by less than a radius for a diameter has none.
    """
    found: list[ScaleError] = []
    for key in model.keys:
        times = 1.0 + model.rig.effects[key[0]][key[1]]["relative"] if key[1] == GAIN else 1.0
        if abs(np.log(times)) < LEAST:
            continue
        with_gain = FitProblem(segments, model.rig, model.keys, motion, model.stiff).homotopy_fit(
            noise_levels, None, (1.0,)
        )
        bare = replace(model, rig=taken_out(model.rig, key), keys=tuple(k for k in model.keys if k != key))
        for name in _numbers(segments, segments.nominal) if with_gain else ():
            for factor in (times, 1.0 / times):
                m = _with_number(segments, noise_levels, bare, motion, name, factor)
                if m is not None and with_gain is not None and m.loss < with_gain.loss + worth * segments.count:
                    found.append(ScaleError(("", name), factor, m.rig, m.noise_levels, m.loss))
    return sorted(found, key=lambda one: one.loss)


def numbers_suspected(
    segments: Segments,
    noise_levels: NoiseLevels,
    model: FittedModel,
    motion: Motion,
    rules: DiagnoseSettings,
    begun: Rig,
) -> list[ScaleError]:
    """Parameters of the rig that explain more, off by a factor, than the names of a model do, the likeliest first.

    The rig with such a number, the names fitted anew or gone, has to be likelier than the model by what a name earns,
    and to leave less unknown force. noise_levels : of the model, here. begun : the rig from which the search began.
    """
    suspects = near_best(segments, numbers_off(segments, begun, rules), rules.min_gain)
    if not suspects or not model.keys:
        return suspects
    named = FitProblem(segments, model.rig, model.keys, motion, model.stiff).homotopy_fit(noise_levels, None, (1.0,))
    if named is None:
        return suspects
    found, alone = [], replace(model, rig=begun, keys=())
    for one in suspects:
        fits = [_with_number(segments, one.noise_levels, m, motion, one.key[1], one.factor) for m in (model, alone)]
        best = min((m for m in fits if m is not None), key=lambda m: m.score, default=None)
        if best is None or segments.most_unknown(best.noise_levels) > segments.most_unknown(named.noise_levels):
            continue
        if best.score < named.score - rules.min_gain * segments.count:
            found.append(replace(one, rig=best.rig, noise_levels=best.noise_levels, loss=best.loss))
    return found


def _with_number(
    segments: Segments, noise_levels: NoiseLevels, model: FittedModel, motion: Motion, name: str, factor: float
) -> FittedModel | None:  # fmt: skip
    """A model with a parameter of the rig off by a factor, fitted anew; None where that is no rig."""
    away = {name: factor * segments.nominal.config.parameters[name].value}
    try:
        there = replace(segments, nominal=segments.nominal.with_parameters(away))
        rig = model.rig.with_parameters(away)
        return FitProblem(there, rig, model.keys, motion, model.stiff).homotopy_fit(noise_levels, None, (1.0, 0.1, 1.0))
    except (UserError, np.linalg.LinAlgError):
        return None


def _numbers(segments: Segments, rig: Rig) -> dict[str, float]:
    """The parameters of a rig that have a tolerance."""
    return {f.name: rig.config.parameters[f.name].value for f in nominal_free(segments.nominal) if not f.effect}


def gains_off(segments: Segments, rig: Rig) -> list[ScaleError]:
    """Each gain of a sensor or an amplifier at its likeliest factor, if that explains most of what is missing."""
    amplifier, before = rig.only("amplifier"), segments.tuned(rig)[1]
    best: dict[Key, ScaleError] = {}
    for place in [*sorted(segments.sensors), *([amplifier.name] if amplifier else [])]:
        if GAIN not in rig.takes(place) or rig.effect(place, GAIN) is not None:
            continue
        for way in (1.0, -1.0):
            last: ScaleError | None = None
            for factor in (*GAINS, BEYOND):
                times = factor**way
                one = _off(segments, (place, GAIN), times, rig.with_effect(place, GAIN, {"relative": times - 1.0}))
                if one is None or not one.loss < (last.loss if last else before):
                    if last is not None:  # what is left of a gain's error falls all the way to its factor
                        best[last.key] = _likelier(best.get(last.key), last)
                    break
                last = one
    return [one for one in best.values() if before - one.loss > _mostly(segments, before)]


def numbers_off(
    segments: Segments, rig: Rig, rules: DiagnoseSettings, factors: Collection[float] = NUMBERS
) -> list[ScaleError]:
    """The same of the rig's parameters; or those that earn what a name does, and clear the unknown force as it does."""
    noise_levels, before = segments.tuned(rig)
    little, earned = rules.clearing_ratio * segments.most_unknown(noise_levels), rules.min_gain * segments.count
    best: dict[Key, ScaleError] = {}
    ways = sorted({way for one in factors for way in (one, 1.0 / one)})
    asked = [
        (name, by, rig.with_parameters({name: by * v})) for name, v in _numbers(segments, rig).items() for by in ways
    ]
    for one in spread(lambda a: _off(segments, ("", a[0]), *a[1:]), asked):
        if one is not None:
            best[one.key] = _likelier(best.get(one.key), one)
    return [
        one for one in best.values() if before - one.loss > _mostly(segments, before)
        or (segments.most_unknown(one.noise_levels) < little and before - one.loss > earned)
    ]  # fmt: skip


def _off(segments: Segments, key: Key, factor: float, other: Rig) -> ScaleError | None:
    """What is off by a factor, with zeros and noise levels anew; None where the rig cannot be so."""
    try:
        there = zeroed(segments, other)
        return ScaleError(key, factor, there, *segments.tuned(there))
    except (UserError, np.linalg.LinAlgError):
        return None


def _likelier(first: ScaleError | None, second: ScaleError) -> ScaleError:
    return second if first is None or second.loss < first.loss else first


def _mostly(segments: Segments, before: float) -> float:
    """Most of what a model could bring that leaves noise alone, -2 log likelihood."""
    return MOSTLY * max(before - segments.floor, 0.0)


def near_best(segments: Segments, found: Sequence[ScaleError], worth: float) -> list[ScaleError]:
    """The likeliest, and what a name's worth does not tell from it: only ratios of some numbers show; best first."""
    best = min((one.loss for one in found), default=0.0)
    return sorted((one for one in found if one.loss <= best + worth * segments.count), key=lambda one: one.loss)
