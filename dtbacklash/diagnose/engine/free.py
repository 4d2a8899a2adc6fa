"""The free parameters of a fit: nominal parameters and known effects with priors, and found effects without.

The parameters of the nominal rig and of its effects have tolerances, which are the widths of their Gaussian priors. A
found effect has values without tolerances.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.rig import TOLERANCE_MAX
from dtbacklash.physics.catalogue import find, is_found
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import SENSOR_UNIT, Parameter, Place, Role
from dtbacklash.physics.effects.table import VALUES
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig, build_rig

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

Key = tuple[str, str]
Effects = dict[Key, dict[str, float]]
#: (place, effect, parameter) -> standard error; the first two are empty for a parameter of the rig
Errors = dict[tuple[str, str, str], float]


@dataclass(frozen=True)
class Free:
    """One free parameter: of an effect at ``place``; or (``effect`` empty) a nominal one, or a sensor's zero there.

    It is fitted as ``x``: value = centre + scale x, or centre exp(x) where ``log``.
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
    recording: int = 0

    @property
    def key(self) -> Key:
        """Its place and effect."""
        return self.place, self.effect

    @property
    def is_zero(self) -> bool:
        """Whether it is what a sensor reads in a recording where the rig's position is 0."""
        return bool(self.place) and not self.effect

    @property
    def title(self) -> str:
        """The parameter's name; for an effect ``place.effect.name``."""
        if self.is_zero:
            return f"{self.place}.{self.name}"
        return f"{self.place}.{self.effect}.{self.name}" if self.effect else self.name

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
        value = self.value(x)
        ends = any(
            end != 0.0 and math.isfinite(end) and abs(value - end) <= EDGE * abs(end) for end in (self.low, self.high)
        )
        gone = x < -8.0 if self.log else abs(value) < 1e-9 * abs(self.centre)
        return ends or gone

    def per_x(self, x: float) -> float:
        """How much the value changes with x."""
        return self.value(x) if self.log else self.scale


def nominal_free(nominal: Rig, rig: Rig | None = None) -> list[Free]:
    """The known parameters that have a tolerance. rig : known effects that it does not have are left out."""
    free = []
    used = {name for spec in nominal.config.elements.values() for name in spec.values() if isinstance(name, str)}
    for name, p in nominal.config.parameters.items():
        width = abs(p.value) * p.tolerance
        if width > 0.0 and name in used:
            # a parameter keeps its sign
            least = p.value * max(1.0 - TOLERANCES_MAX * p.tolerance, LEAST_SHARE)
            low, high = sorted((least, p.value * (1.0 + TOLERANCES_MAX * p.tolerance)))
            free.append(Free("", "", name, p.value, width, False, low, high, True))
    for key, q, value, width in _known_effects(nominal, rig or nominal):
        low, high = max(value - TOLERANCES_MAX * width, q.low), min(value + TOLERANCES_MAX * width, q.high)
        free.append(Free(*key, q.name, value, width, False, low, high, True, q.role))
    return free


def zeros_free(nominal: Rig, spreads: Mapping[tuple[str, int], float]) -> list[Free]:
    """The zeros of sensors that begin anywhere. spreads : (sensor, recording) -> how much it moves, SI."""
    ends = -math.inf, math.inf
    return [
        Free(SENSOR_PREFIX + s, "", f"zero {k + 1}", nominal.sensors[s].zero(k), ANYWHERE * width, False, *ends, True,
             recording=k)
        for (s, k), width in spreads.items() if nominal.sensors[s].relative
    ]  # fmt: skip


def _known_effects(nominal: Rig, rig: Rig) -> Iterator[tuple[Key, Parameter, float, float]]:
    """(place, effect), parameter, value and prior's width of each parameter of a known effect."""
    for key, values in effects_of_rig(nominal).items():
        if not (is_known(nominal, key) and is_known(rig, key)):
            continue
        tolerances = nominal.tolerances[key[0]][key[1]]
        for p in find(nominal.kind_at(key[0]), key[1], key[0]).parameters:
            width = tolerances.get(p.name, 0.0) * (1.0 if p.role is Role.ANGLE else abs(values[p.name]))
            if width > 0.0:
                yield key, p, values[p.name], width


def effect_free(rig: Rig, key: Key, here: Place) -> list[Free]:
    """The parameters of one effect of a rig but the idle ones (:meth:`.Effect.idle`), from their values there.

    here : how its place moves, which bounds what the recording can show of its shape.
    """
    entry, values = find(rig.kind_at(key[0]), key[1], key[0]), rig.effects[key[0]][key[1]]
    free, idle, shown = [], entry.idle(values), entry.bounds_at(here)
    for p in entry.parameters:
        if p.name in idle or p.role is Role.GIVEN:
            continue
        low, high = shown.get(p.name, (p.low, p.high)) if p is not entry.size else (p.low, p.high)
        low, high = max(low, p.low), min(high, p.high)
        start = min(max(values[p.name], low), high)
        log = p.role not in (Role.ANGLE, Role.WAVE, Role.KNOT) and p.low >= 0.0 and start > 0.0
        scale = abs(start) or abs(p.typical) or 1.0
        if p.role is Role.ANGLE:
            scale = 1.0
        if p.role is Role.WAVE:  # a radian at the end of the way
            scale = 1.0 / here.way if here.way > 0.0 else 1e-3 * scale
        if p.role is Role.KNOT:  # one for all values of a table: one of them may be nearly 0
            scale = max(abs(values[q]) for q in VALUES) or scale
        free.append(Free(*key, p.name, start, scale, log, low, high, False, p.role))
    return free


def standing(free: Free, rig: Rig) -> float:
    """The ``x`` of a known parameter in a rig."""
    if free.is_zero:
        return (rig.sensors[free.place.removeprefix(SENSOR_PREFIX)].zero(free.recording) - free.centre) / free.scale
    values = rig.effects[free.place][free.effect] if free.effect else None
    value = values[free.name] if values else rig.config.parameters[free.name].value
    away = value - free.centre
    if free.role is Role.ANGLE:
        away = (away + math.pi) % (2.0 * math.pi) - math.pi
    return away / free.scale


def apply(base: Rig, free: list[Free], x: Floats) -> Rig:
    """The base rig with the free parameters at ``x``."""
    parameters = dict(base.config.parameters)
    effects = {p: {n: dict(leaves) for n, leaves in there.items()} for p, there in base.config.effects.items()}
    zeros: dict[str, list[float]] = {}
    for f, xi in zip(free, x, strict=True):
        if f.effect:
            leaves = effects[f.place][f.effect]
            leaf, value = leaves.get(f.name), f.value(xi)
            leaves[f.name] = {**leaf, "value": value} if isinstance(leaf, dict) else value
        elif f.is_zero:
            name = f.place.removeprefix(SENSOR_PREFIX)
            there = zeros.setdefault(name, list(base.sensors[name].zeros))
            there += [0.0] * (f.recording + 1 - len(there))
            there[f.recording] = f.value(xi)
        else:
            parameters[f.name] = replace(parameters[f.name], value=f.value(xi))
    sensors = base.config.sensors | {s: {**base.config.sensors[s], "zeros": there} for s, there in zeros.items()}
    return build_rig(replace(base.config, effects=effects, parameters=parameters, sensors=sensors))


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


def with_errors(rig: Rig, errors: Errors, calibrated: bool = False) -> Rig:
    """The rig with what it is known to as its tolerances, so that it can be the next nominal rig.

    Those of found effects are their standard errors. calibrated : so are those of the rig's parameters, where they are
    narrower than what was believed.
    """
    least, most = FOUND_TOLERANCES
    parameters = dict(rig.config.parameters)
    for name, belief in parameters.items() if calibrated else ():
        share = errors.get(("", "", name), math.nan) / max(abs(belief.value), 1e-300)
        if share < belief.tolerance:
            parameters[name] = replace(belief, tolerance=float(max(share, min(least, belief.tolerance))))
    rig = build_rig(replace(rig.config, parameters=parameters))
    for key, values in effects_of_rig(rig).items():
        if is_known(rig, key):
            continue
        entry, leaves = find(rig.kind_at(key[0]), key[1], key[0]), {}
        for p in entry.parameters:
            value, error = values[p.name], errors.get((*key, p.name), math.nan)
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


def unit_of(rig: Rig, free: Free) -> str:
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


def tolerances_away(nominal: Rig, rig: Rig) -> dict[str, float]:
    """Title of a known parameter -> its distance from nominal, in tolerances."""
    return {f.title: abs(standing(f, rig)) for f in nominal_free(nominal, rig)}


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
