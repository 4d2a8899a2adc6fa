"""The free parameters of a fit: nominal parameters and known effects with priors, and found effects without.

The parameters of the nominal rig and of its effects have tolerances, which are the widths of their Gaussian priors. A
found effect has values without tolerances.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.rig import TOLERANCE_MAX
from dtbacklash.physics.catalogue import find, is_found
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import SENSOR_UNIT, Parameter, Place, Role
from dtbacklash.physics.effects.table import VALUES
from dtbacklash.physics.rig import SENSOR_PREFIX, ZERO, Rig, build_rig

#: of an effect of the nominal rig whose own is not given: what one knows of a friction, roughly (share; an angle: rad)
EFFECT_TOLERANCE = 0.3
#: what was found is known no better, from one recording to the next, nor worse, or it would not have been named (share)
FOUND_TOLERANCES = 1e-3, 0.5
#: how far from nominal a fit looks for a parameter (tolerances), and what is left of it at least (share)
TOLERANCES_MAX, LEAST_SHARE = 6.0, 1e-2
#: a value nearer to its limit was not chosen by the data (share)
EDGE = 1e-3
#: steps of differences: of a law's parameter (its scale), of a nominal one (tolerances)
LAW_STEP, NOMINAL_STEP = 0.02, 0.05
#: a sensor's zero is known as well as nothing: the width of its prior (of how much it moves)
ANYWHERE = 1e3
#: and so, nearly, is a parameter that belongs to one recording: a payload, a tension (share; an angle: rad)
OWN_TOLERANCE = 0.5

Key = tuple[str, str]
Effects = dict[Key, dict[str, float]]
#: (place, effect, label of the parameter) -> standard error; the first two are empty for a parameter of the rig
Errors = dict[tuple[str, str, str], float]


@dataclass(frozen=True)
class FreeParameter:
    """One free parameter: of an effect at ``place``; or (``effect`` empty) a nominal one, or a sensor's zero there.

    It is fitted as ``x``: value = centre + scale x, or centre exp(x) where ``log``. recording : the number of the one
    that it belongs to; None: it is shared.
    """

    place: str
    effect: str
    name: str
    centre: float
    scale: float
    log: bool
    low: float
    high: float
    prior: bool
    role: Role = Role.SHAPE
    recording: int | None = None

    @property
    def key(self) -> Key:
        """Its place and effect."""
        return self.place, self.effect

    @property
    def is_zero(self) -> bool:
        """Whether it is what a sensor reads in a recording where the rig's position is 0."""
        return bool(self.place) and not self.effect

    @property
    def shared_title(self) -> str:
        """The parameter's name; for an effect ``place.effect.name``, for a zero ``sensor_x.zero``."""
        return ".".join(filter(None, (self.place, self.effect, self.name)))

    @property
    def label(self) -> str:
        """Its name; of one recording with its number, from 1."""
        return self.name if self.recording is None else in_recording(self.name, self.recording)

    @property
    def title(self) -> str:
        """The same with place and effect."""
        return ".".join(filter(None, (self.place, self.effect, self.label)))

    @property
    def step(self) -> float:
        """Of a difference, in x."""
        return LAW_STEP / ANYWHERE if self.is_zero else NOMINAL_STEP if self.prior else LAW_STEP

    def value(self, x: float) -> float:
        """The parameter at ``x``, within its bounds."""
        value = self.centre * math.exp(min(max(x, -60.0), 60.0)) if self.log else self.centre + self.scale * x
        if self.role is Role.ANGLE:
            return (value + math.pi) % (2.0 * math.pi) - math.pi
        return min(max(value, self.low), self.high)

    def at_end(self, x: float) -> bool:
        """Whether a law's parameter stands at the end of what the recording can show: the data did not choose it."""
        if self.prior or self.role in (Role.ANGLE, Role.KNOT):
            return False
        if self.recording is not None and self.role in (Role.SIZE, Role.TIME):  # one may have nothing of it
            return False
        value = self.value(x)
        ends = any(
            end != 0.0 and math.isfinite(end) and abs(value - end) <= EDGE * abs(end) for end in (self.low, self.high)
        )
        gone = x < -8.0 if self.log else abs(value) < 1e-9 * abs(self.centre)
        return ends or gone

    def per_x(self, x: float) -> float:
        """How much the value changes with x."""
        return self.value(x) if self.log else self.scale


def in_recording(name: str, recording: int) -> str:
    """The name of what belongs to one recording."""
    return f"{name} in recording {recording + 1}"


def held(rig: Rig, title: str, recordings: Sequence[int]) -> list[int | None]:
    """Who has values of one parameter: None where some recordings share one, then those that own one."""
    owners = [k for k in recordings if k < len(rig.own) and title in rig.own[k]]
    return [*([None] if len(owners) < len(recordings) else []), *owners]


def nominal_free(nominal: Rig, rig: Rig | None = None, recordings: Sequence[int] = (0,)) -> list[FreeParameter]:
    """The known parameters that have a tolerance, or belong to a recording.

    rig : known effects that it does not have are left out; what it owns is free in each recording that owns it.
    recordings : those that are fitted to.
    """
    free, rig = [], rig or nominal
    used = nominal.config.used
    for name, p in nominal.config.parameters.items():
        if name not in used:
            continue
        for recording, centre, share in _holders(nominal, rig, name, p.value, p.tolerance, recordings):
            width = abs(centre) * share
            if width > 0.0:
                # a parameter keeps its sign
                least = centre * max(1.0 - TOLERANCES_MAX * share, LEAST_SHARE)
                low, high = p.within(*sorted((least, centre * (1.0 + TOLERANCES_MAX * share))))
                free.append(FreeParameter("", "", name, centre, width, False, low, high, True, recording=recording))
    for key, q, value, tolerance in _known_effects(nominal, rig):
        for recording, centre, share in _holders(nominal, rig, ".".join((*key, q.name)), value, tolerance, recordings):
            width = share * (1.0 if q.role is Role.ANGLE else abs(centre))
            if width > 0.0:
                low, high = max(centre - TOLERANCES_MAX * width, q.low), min(centre + TOLERANCES_MAX * width, q.high)
                free.append(FreeParameter(*key, q.name, centre, width, False, low, high, True, q.role, recording))
    return free


def _holders(
    nominal: Rig, rig: Rig, title: str, value: float, tolerance: float, recordings: Sequence[int]
) -> Iterator[tuple[int | None, float, float]]:
    """(recording or None, nominal value, tolerance) of each free value of one parameter.

    What is given for a recording is known as well as what is given for all; what is only said to be its own is not.
    """
    for k in held(rig, title, recordings):
        if k is None:
            yield None, value, tolerance
            continue
        given = nominal.own[k].get(title, value) if k < len(nominal.own) else value
        yield k, given, tolerance if given != value else max(tolerance, OWN_TOLERANCE)


def zeros_free(nominal: Rig, spreads: Mapping[tuple[str, int], float]) -> list[FreeParameter]:
    """The zeros of sensors that begin anywhere. spreads : (sensor, recording) -> how much it moves, SI."""
    ends = -math.inf, math.inf
    return [
        FreeParameter(SENSOR_PREFIX + s, "", ZERO, nominal.of(k).sensors[s].zero, ANYWHERE * width, False, *ends, True,
             recording=k)
        for (s, k), width in spreads.items() if nominal.sensors[s].relative
    ]  # fmt: skip


def _known_effects(nominal: Rig, rig: Rig) -> Iterator[tuple[Key, Parameter, float, float]]:
    """(place, effect), parameter, value and tolerance of each parameter of a known effect."""
    for key, values in effects_of_rig(nominal).items():
        if not (is_known(nominal, key) and is_known(rig, key)):
            continue
        tolerances = nominal.tolerances[key[0]][key[1]]
        for p in find(nominal.kind_at(key[0]), key[1], key[0]).parameters:
            if p.role is not Role.GIVEN:
                yield key, p, values[p.name], tolerances.get(p.name, 0.0)


def effect_free(rig: Rig, key: Key, here: Place, recordings: Sequence[int] = (0,)) -> list[FreeParameter]:
    """The parameters of one effect of a rig but the idle ones (:meth:`.Effect.idle`), from their values there.

    here : how its place moves, which bounds what the recording can show of its shape. recordings : as above.
    """
    entry, values = find(rig.kind_at(key[0]), key[1], key[0]), rig.effects[key[0]][key[1]]
    free, idle, shown = [], entry.idle(values), entry.bounds_at(here)
    for p in entry.parameters:
        if p.name in idle or p.role is Role.GIVEN:
            continue
        of_shape = p is not entry.size or isinstance(entry.slot, slots.JointPlay)  # a gap of nothing has other steps
        low, high = shown.get(p.name, (p.low, p.high)) if of_shape else (p.low, p.high)
        low, high = max(low, p.low), min(high, p.high)
        holders = held(rig, ".".join((*key, p.name)), recordings)
        free += [_own_free(rig, key, p, k, low, high) for k in holders if k is not None]
        if None not in holders:
            continue
        start = min(max(values[p.name], low), high)
        log = p.role not in (Role.ANGLE, Role.WAVE, Role.KNOT) and p.low >= 0.0 and start > 0.0
        scale = abs(start) or abs(p.typical) or 1.0
        if p.role is Role.ANGLE:
            scale = 1.0
        if p.role is Role.WAVE:  # a radian at the end of the way
            scale = 1.0 / here.way if here.way > 0.0 else 1e-3 * scale
        if p.role is Role.KNOT:  # one for all values of a table: one of them may be nearly 0
            scale = max(abs(values[q]) for q in VALUES) or scale
        free.append(FreeParameter(*key, p.name, start, scale, log, low, high, False, p.role))
    return free


def _own_free(rig: Rig, key: Key, p: Parameter, recording: int, low: float, high: float) -> FreeParameter:
    """A parameter of an effect that belongs to one recording: it may come to nothing there."""
    start = rig.own[recording][".".join((*key, p.name))]
    usual = max(abs(rig.effects[key[0]][key[1]][p.name]), abs(start)) or p.typical or 1.0
    scale = 1.0 if p.role is Role.ANGLE else usual
    return FreeParameter(*key, p.name, min(max(start, low), high), scale, False, low, high, False, p.role, recording)


def standing(free: FreeParameter, rig: Rig) -> float:
    """The ``x`` of a known parameter in a rig."""
    rig = rig if free.recording is None else rig.of(free.recording)
    if free.is_zero:
        return (rig.sensors[free.place.removeprefix(SENSOR_PREFIX)].zero - free.centre) / free.scale
    values = rig.effects[free.place][free.effect] if free.effect else None
    value = values[free.name] if values else rig.config.parameters[free.name].value
    away = value - free.centre
    if free.role is Role.ANGLE:
        away = (away + math.pi) % (2.0 * math.pi) - math.pi
    return away / free.scale


def apply(base: Rig, free: list[FreeParameter], x: Floats) -> Rig:
    """The base rig with the free parameters at ``x``."""
    values: dict[tuple[str, ...], float] = {}
    own = [dict(there) for there in base.own]
    for f, xi in zip(free, x, strict=True):
        if f.recording is not None:
            own += [{} for _ in range(f.recording + 1 - len(own))]
            own[f.recording][f.shared_title] = f.value(xi)
        else:
            values[(f.place, f.effect, f.name) if f.effect else (f.name,)] = f.value(xi)
    return build_rig(base.config.with_values(values), tuple(own))


def with_priors(rig: Rig) -> Rig:
    """The rig with a tolerance for each parameter of its effects that has none; 0 for wave numbers and knots."""
    for (place, name), values in effects_of_rig(rig).items():
        known = rig.tolerances.get(place, {}).get(name, {})
        entry = find(rig.kind_at(place), name, place)
        exact = (Role.WAVE, Role.GIVEN)
        usual = {p.name: 0.0 if p.role in exact else EFFECT_TOLERANCE for p in entry.parameters}
        leaves = {p: {"value": v, "tolerance": known.get(p, usual[p])} for p, v in values.items()}
        rig = rig.with_effect(place, name, leaves)
    return rig


def with_errors(rig: Rig, errors: Errors, calibrated: bool = False, recording: int = 0) -> Rig:
    """The rig with what it is known to as its tolerances, so that it can be the next nominal rig.

    Those of found effects are their standard errors. calibrated : so are those of the rig's parameters, where they are
    narrower than what was believed. recording : it is the rig as in this one.
    """
    owned = rig.own[recording] if recording < len(rig.own) else {}
    rig = rig.of(recording)

    def error_of(*path: str) -> float:
        own = ".".join(filter(None, path)) in owned
        return errors.get((path[0], path[1], in_recording(path[2], recording) if own else path[2]), math.nan)

    least, most = FOUND_TOLERANCES
    parameters = dict(rig.config.parameters)
    for name, belief in parameters.items() if calibrated else ():
        share = error_of("", "", name) / max(abs(belief.value), 1e-300)
        if share < belief.tolerance:
            parameters[name] = replace(belief, tolerance=float(max(share, min(least, belief.tolerance))))
    rig = build_rig(replace(rig.config, parameters=parameters))
    for key, values in effects_of_rig(rig).items():
        if is_known(rig, key):
            continue
        entry, leaves = find(rig.kind_at(key[0]), key[1], key[0]), {}
        for p in entry.parameters:
            value, error = values[p.name], error_of(*key, p.name)
            relative = error if p.role is Role.ANGLE else error / max(abs(value), 1e-300)
            # a value of a table or of a found formula may be nearly 0, and is no name that has to be known
            widest = TOLERANCE_MAX if entry.is_table or is_found(entry) else most
            known = np.clip(relative, least, widest) if math.isfinite(relative) else most
            leaves[p.name] = {"value": value, "tolerance": 0.0 if p.role is Role.GIVEN else float(known)}
        rig = rig.with_effect(*key, leaves)
    return rig


def unit_at(rig: Rig, place: str, unit: str) -> str:
    """A parameter's unit; SENSOR_UNIT is replaced by the unit of the sensor at the place."""
    sensor = rig.sensors.get(place.removeprefix(SENSOR_PREFIX))
    return sensor.unit if sensor and unit == SENSOR_UNIT else unit


def unit_of(rig: Rig, free: FreeParameter) -> str:
    """The unit of a free parameter."""
    if free.is_zero:
        return unit_at(rig, free.place, SENSOR_UNIT)
    if not free.effect:
        return rig.config.parameters[free.name].unit
    entry = find(rig.kind_at(free.place), free.effect, free.place)
    return unit_at(rig, free.place, next(p.unit for p in entry.parameters if p.name == free.name))


def effects_of_rig(rig: Rig) -> Effects:
    """(place, effect) -> values."""
    return {(place, name): values for place, there in rig.effects.items() for name, values in there.items()}


def is_known(rig: Rig, key: Key) -> bool:
    """Whether an effect of the rig has a prior because the nominal rig has it."""
    return key[1] in rig.tolerances.get(key[0], {})


def tolerances_away(nominal: Rig, rig: Rig) -> dict[tuple[str, int | None], float]:
    """(shared title, recording) of a known parameter -> its distance from nominal, in tolerances."""
    recordings = range(max(len(rig.own), 1))
    return {(f.shared_title, f.recording): abs(standing(f, rig)) for f in nominal_free(nominal, rig, recordings)}


def taken_out(rig: Rig, key: Key) -> Rig:
    """The rig without an effect, and without those that cannot act any more: forces on what a rigid screw moves."""
    rig = rig.with_effect(*key, None)
    screw = rig.only("screw")
    for place, name in effects_of_rig(rig):
        if screw is None or place != screw.neighbours.get("carries"):
            continue
        swings = isinstance(find(rig.kind_at(place), name, place).slot, slots.HiddenBody)
        if not swings and not rig.amount(screw.name, slots.Yielding, "compliance"):
            rig = rig.with_effect(place, name, None)
    return rig
