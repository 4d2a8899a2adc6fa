"""The free parameters of a fit: nominal parameters and known effects with priors, and found effects without.

The parameters of the nominal rig and of its effects have tolerances, which are the widths of their Gaussian priors. A
found effect has values without tolerances.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.rig import TOLERANCE_MAX
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.catalogue import find, is_found
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import SENSOR_UNIT, Bounds, Parameter, Role
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig, build_rig

#: a known effect's parameter nearer to its bound has no room left, and is looked for freely (tolerances)
TOLERANCE_ROOM = 0.3
#: of an effect of the nominal rig whose own is not given: what one knows of a friction, roughly (share (an angle:
#: rad))
EFFECT_TOLERANCE = 0.3
#: what was found is known no better, from one recording to the next (share)
FOUND_TOLERANCE_MIN = 1e-3
#: nor worse, or it would not have been named (share)
FOUND_TOLERANCE_MAX = 0.5

#: least value of a nominal parameter in a fit, relative to its nominal value
LEAST_SHARE = 1e-3
#: a parameter that is beyond its tolerance gets a tolerance so many times wider, and at most this
FURTHER, WIDEST = 10.0, 3.0

Effects = dict[tuple[str, str], dict[str, float]]
Key = tuple[str, str]
#: (place, effect, parameter) -> standard error; the first two are empty for a parameter of the rig
Errors = dict[tuple[str, str, str], float]


@dataclass(frozen=True)
class Free:
    """One free parameter: of an effect at ``place``, or (``effect`` empty) a nominal one.

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
    places: frozenset[str]
    role: Role = Role.SHAPE
    counted: bool = False

    @property
    def title(self) -> str:
        """The parameter's name; for an effect ``place.effect.name``."""
        return f"{self.place}.{self.effect}.{self.name}" if self.effect else self.name

    def value(self, x: float) -> float:
        """The parameter at ``x``, within its bounds."""
        value = self.centre * math.exp(x) if self.log else self.centre + self.scale * x
        if self.role is Role.ANGLE:
            return (value + math.pi) % (2.0 * math.pi) - math.pi
        return min(max(value, self.low), self.high)

    def limits(self) -> tuple[float, float]:
        """Bounds of x."""
        if self.role is Role.ANGLE:
            return -math.inf, math.inf
        if self.log:
            low = math.log(max(self.low, 1e-300) / self.centre)
            return max(low, -12.0), min(math.log(self.high / self.centre) if math.isfinite(self.high) else 12.0, 12.0)
        return (self.low - self.centre) / self.scale, (self.high - self.centre) / self.scale


def with_priors(rig: Rig) -> Rig:
    """The rig with a tolerance for each parameter of its effects that has none; 0 for wave numbers and knots."""
    for (place, name), values in effects_of_rig(rig).items():
        known = rig.tolerances.get(place, {}).get(name, {})
        entry = find(rig.kind_at(place), name, place)
        exact = (Role.WAVE, Role.GIVEN)
        usual = {p.name: 0.0 if p.role in exact else EFFECT_TOLERANCE for p in entry.parameters}
        rig = rig.with_effect(
            place, name, {p: {"value": v, "tolerance": known.get(p, usual[p])} for p, v in values.items()}
        )
    return rig


def with_tolerance(rig: Rig, name: str, tolerance: float) -> Rig:
    """The rig with another tolerance of one of its parameters."""
    parameters = rig.config.parameters
    return build_rig(
        replace(rig.config, parameters={**parameters, name: replace(parameters[name], tolerance=tolerance)})
    )


def widened(tolerance: float) -> float:
    """The tolerance of a parameter that may be beyond the given one."""
    return max(min(FURTHER * tolerance, WIDEST), tolerance)


def with_errors(rig: Rig, errors: Errors) -> Rig:
    """The rig with the standard errors of found effects as tolerances, so that it can be the next nominal rig."""
    least, most = FOUND_TOLERANCE_MIN, FOUND_TOLERANCE_MAX
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


def effects_of_rig(rig: Rig) -> Effects:
    """(place, effect) -> values."""
    return {(place, name): values for place, there in rig.effects.items() for name, values in there.items()}


def is_known(rig: Rig, key: Key) -> bool:
    """Whether an effect of the rig has a prior because the nominal rig has it."""
    return key[1] in rig.tolerances.get(key[0], {})


def nominal_free(nominal: Rig, places: set[str] | None = None, rig: Rig | None = None) -> list[Free]:
    """The known parameters that have a tolerance (and that an element among ``places`` uses).

    rig : effects of the nominal rig that this rig does not have are left out.
    """
    most = SETTINGS.tolerances_max
    free = []
    for name, p in nominal.config.parameters.items():
        users = frozenset(e for e, spec in nominal.config.elements.items() if name in spec.values())
        width = abs(p.value) * p.tolerance
        if width > 0.0 and users and (places is None or users & places):
            # a parameter keeps its sign
            ends = p.value * max(1.0 - most * p.tolerance, LEAST_SHARE), p.value * (1.0 + most * p.tolerance)
            low, high = sorted(ends)
            free.append(Free("", "", name, p.value, width, False, low, high, True, users))
    for key, q, value, width in _known_effects(nominal, rig or nominal):
        if places is None or key[0] in places:
            low, high = max(value - most * width, q.low), min(value + most * width, q.high)
            at = frozenset({key[0]})
            free.append(Free(*key, q.name, value, width, False, low, high, True, at, q.role, q.counted))
    return free


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


def standing(free: Free, rig: Rig) -> float:
    """The ``x`` of a known parameter in a rig."""
    values = rig.effects[free.place][free.effect] if free.effect else None
    value = values[free.name] if values else rig.config.parameters[free.name].value
    away = value - free.centre
    if free.role is Role.ANGLE:
        away = (away + math.pi) % (2.0 * math.pi) - math.pi
    return away / free.scale


def tolerances_away(nominal: Rig, rig: Rig) -> dict[str, float]:
    """Title of a known parameter -> its distance from nominal, in tolerances."""
    return {f.title: abs(standing(f, rig)) for f in nominal_free(nominal, rig=rig)}


def at_limit(free: Free, x: float) -> bool:
    """Whether a known parameter is within TOLERANCE_ROOM of one of its bounds."""
    low, high = free.limits()
    return free.prior and not low + TOLERANCE_ROOM < x < high - TOLERANCE_ROOM


def stands_at_limit(free: Free, x: float) -> bool:
    """Whether a known parameter is at one of its bounds, but for the share ``bound_share``."""
    low, high = free.limits()
    share = SETTINGS.bound_share
    return free.prior and not (1.0 - share) * low < x < (1.0 - share) * high


def as_given(nominal: Rig, rig: Rig, key: Key) -> Rig:
    """The rig with the effect at (place, effect) as in the nominal rig, which mostly does not have it."""
    return _without_idle(rig.with_effect(*key, nominal.config.effects.get(key[0], {}).get(key[1])))


def taken_out(rig: Rig, key: Key) -> Rig:
    """The rig without an effect, be it the nominal rig's or not."""
    return _without_idle(rig.with_effect(*key, None))


def _without_idle(rig: Rig) -> Rig:
    """The rig without effects that cannot act any more: forces on a mass that a rigid screw moves."""
    screw = rig.only("screw")
    for place, name in effects_of_rig(rig):
        if screw is None or place != screw.neighbours.get("carries"):
            continue
        swings = isinstance(find(rig.kind_at(place), name, place).slot, slots.HiddenBody)
        if not swings and not rig.amount(screw.name, slots.Yielding, "compliance"):
            rig = rig.with_effect(place, name, None)
    return rig


def effect_free(
    rig: Rig, place: str, effect: str, values: dict[str, float], bounds: Bounds | None = None
) -> list[Free]:
    """The parameters of one effect but the idle ones (:meth:`.Effect.idle`), from the values where the fit starts.

    bounds : those within which the recording can show the effect.
    """
    entry = find(rig.kind_at(place), effect, f"rig.effects.{place}.{effect}")
    free, idle, places = [], entry.idle(values), frozenset({place})
    for p in entry.parameters:
        if p.name in idle:
            continue
        low, high = (bounds or {}).get(p.name, (p.low, p.high))
        low, high = max(low, p.low), min(high, p.high)
        start = min(max(values[p.name], low), high)
        positive = p.low > 0.0 or (p is not entry.size and p.low >= 0.0)
        log = positive and start > 0.0
        scale = abs(start) or abs(p.typical) or 1.0
        if p.role is Role.ANGLE:
            scale = 1.0
        if p.role is Role.WAVE:
            log, scale = False, 0.02 * start
        if p.role is Role.KNOT:  # one for all values of a table: one of them may be nearly 0
            scale = max(abs(values[q.name]) for q in entry.parameters if q.role is Role.KNOT) or scale
        free.append(Free(place, effect, p.name, start, scale, log, low, high, False, places, p.role, p.counted))
    return free


def known_free(evidence: Evidence, rig: Rig) -> tuple[list[Free], Floats]:
    """All known parameters, and their ``x`` in a rig."""
    free = nominal_free(evidence.nominal, rig=rig)
    return free, np.array([standing(f, rig) for f in free])


def all_free(evidence: Evidence, rig: Rig) -> tuple[list[Free], Floats]:
    """All known parameters and those of the found effects, and their ``x`` in a rig."""
    free, x = known_free(evidence, rig)
    start = list(x)
    for key, values in effects_of_rig(rig).items():
        if not is_known(rig, key):
            more = effect_free(rig, *key, values, evidence.bounds(key))
            free, start = free + more, start + [0.0] * len(more)
    return free, np.array(start)


def apply(base: Rig, free: list[Free], x: Floats) -> Rig:
    """The base rig with the free parameters at ``x``."""
    parameters = dict(base.config.parameters)
    effects = {p: {n: dict(leaves) for n, leaves in there.items()} for p, there in base.config.effects.items()}
    for f, xi in zip(free, x, strict=True):
        if f.effect:
            leaves = effects[f.place][f.effect]
            leaf, value = leaves.get(f.name), f.value(xi)
            leaves[f.name] = {**leaf, "value": value} if isinstance(leaf, dict) else value
        else:
            parameters[f.name] = replace(parameters[f.name], value=f.value(xi))
    return build_rig(replace(base.config, effects=effects, parameters=parameters))


def penalty_of(rig: Rig, nominal: Rig) -> float:
    """Sum of the squared deviations of the known parameters from their nominal values, in tolerances."""
    return sum(standing(f, rig) ** 2 for f in nominal_free(nominal, rig=rig))
