"""What a rig may lack: laws at places, errors of sensors, tables over states; by the catalogue's declarations alone."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.attempts import attempt
from dtbacklash.diagnosis.engine.motion import Motion
from dtbacklash.diagnosis.engine.parameters import Key
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.physics.catalogue import is_found
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Effect, Role, Values
from dtbacklash.physics.effects.table import KNOTS, SHAPES, STATES, VALUES
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig

#: wave numbers that are scanned: of a rotor up to so many a turn, and finer ones that stand out in what the
#: predictor has to correct (:meth:`.Motion.ripples`); of what slides so many over the way, at such steps
WAVES_A_TURN, WAVES_OF_WAY, WAVE_STEP = 48, 24, 0.25
#: and of a law that has to be simulated for each of them
WAVES_SIMULATED = 12
#: a dry friction is offered at so many times its start as well: a body comes to rest under a large one
FRICTIONS = (1.0, 4.0, 12.0)
#: what a table is over lies between these quantiles of the state
TABLE_SPAN = (0.002, 0.998)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One way in which a rig may differ.

    values : where it begins. as_it_is : whether its column is that of these values, and not one per unit of its size.
    angle : the phase that goes with its size as two columns, or empty. recordings : those in which its phase is free,
    as positions begin anywhere in each; empty: it is shared. own : recording -> phase there.
    """

    place: str
    effect: Effect
    values: Values
    as_it_is: bool
    angle: str = ""
    recordings: tuple[int, ...] = ()
    own: tuple[tuple[int, float], ...] = ()

    @property
    def key(self) -> Key:
        """(place, effect)."""
        return self.place, self.effect.name

    @property
    def counts(self) -> int:
        """Parameters that a fit may move; idle ones stay."""
        idle = self.effect.idle(self.values)
        return sum(p.role is not Role.GIVEN and p.name not in idle for p in self.effect.parameters)

    @property
    def columns(self) -> int:
        """How many columns it has."""
        return KNOTS if self.effect.is_table else 2 if self.angle else 1

    def put(self, rig: Rig, size: Floats | None) -> Rig:
        """The rig with it; size : (1,) its size, (2,) its sine and cosine, (2 recordings,) the same in each, (KNOTS,) a
        table's values; None as it is.

        Raises
        ------
        UserError : the rig cannot have it.
        """
        values, of = dict(self.values), self.effect.size
        if self.effect.is_table:
            assert size is not None
            values |= dict(zip(VALUES, map(float, size), strict=True))
            return rig.with_effect(*self.key, values)
        own = self.own
        if self.angle and size is not None:
            waves = size.reshape(-1, 2)
            sizes, phases = np.hypot(*waves.T), np.arctan2(waves[:, 1], waves[:, 0])
            values[of.name], values[self.angle] = float(np.sqrt(np.mean(sizes**2))), float(phases[np.argmax(sizes)])
            own = tuple(zip(self.recordings, phases.tolist(), strict=True)) if len(waves) > 1 else ()
        elif not self.as_it_is and size is not None:
            values[of.name] = float(size[0])
        values[of.name] = float(np.clip(values[of.name], of.low, of.high))
        if values[of.name] == of.neutral:
            values[of.name] = 0.1 * self.values[of.name]
        angle = self.effect.of_role(Role.ANGLE)
        title = ".".join((*self.key, angle.name if angle else ""))
        return rig.with_effect(*self.key, values).owning({(k, title): phase for k, phase in own})


def hypotheses(
    segments: Segments, rig: Rig, motion: Motion, without: tuple[Key, ...] = (), tables: bool = False
) -> Iterator[Hypothesis]:
    """All laws that a rig may lack, at each of their starts; or all tables. without : keys that are not asked about."""
    unseen = unseen_positions(segments)
    for place in rig.places:
        if place.startswith(SENSOR_PREFIX) and place not in segments.sensors:
            continue
        for effect in rig.takes(place).values():
            if (
                effect.is_table != tables
                or (place, effect.name) in without
                or rig.effect(place, effect.name) is not None
            ):
                continue
            if is_found(effect) and effect.name not in rig.config.laws:  # another recording showed it
                continue
            drives = rig.elements[place].neighbours.get("drives") if place in rig.elements else None
            if {place, drives} & unseen and {"position", "angle"} & slots.asked(effect):
                continue
            if not _possible(rig, place, effect) or not _of_both_signs(effect, motion.states(place)):
                continue
            starts = _table(place, effect, motion) if tables else _laws(place, effect, motion, segments.anywhere)
            yield from attempt(list, starts) or ()


def unseen_positions(segments: Segments) -> set[str]:
    """Bodies whose position no reading shows, as none but speeds are read."""
    L = segments.linear
    scale = np.array([max(segments.predictors[0].spread.get(s, 1.0), 1e-12) for s in L.states])
    fixed = np.vstack([(L.A[1] - np.eye(len(scale))) * scale / scale[:, None], L.C[1] * scale])
    hidden = null_space(fixed, rcond=1e-9)
    if not hidden.size:
        return set()
    first = L.speed - len(L.bodies)
    return {b for j, b in enumerate(L.bodies) if np.abs(hidden[first + j]).max() > 1e-6}


def _possible(rig: Rig, place: str, effect: Effect) -> bool:
    """Whether the rig can be built with the effect, and the effect can act there."""
    screw = rig.only("screw")
    base = screw.neighbours.get("carries") if screw else None
    swings = isinstance(effect.slot, slots.HiddenBody)
    if place == base and not swings and not (screw and rig.amount(screw.name, slots.Yielding, "compliance")):
        return False  # a rigid screw moves this mass, whatever acts on it
    if effect.is_table:
        return True
    return attempt(rig.with_effect, place, effect.name, {effect.size.name: effect.size.typical}) is not None


def _of_both_signs(effect: Effect, states: dict[str, Floats]) -> bool:
    """Whether a law that differs by a sign meets both."""
    state = states.get(effect.of_both_signs)
    if state is None:
        return True
    low, high = np.quantile(state, TABLE_SPAN)
    return bool(low < 0.0 < high)


def _laws(place: str, effect: Effect, motion: Motion, anywhere: tuple[int, ...]) -> Iterator[Hypothesis]:
    """A law at each of its starts, within what the recording can show. anywhere : see :class:`.Segments`."""
    here = motion(place)
    if not effect.is_shown(here):
        return
    bounds, angle = effect.bounds_at(here), effect.of_role(Role.ANGLE)
    starts = effect.start_values(here)
    wave = effect.of_role(Role.WAVE)
    if wave is not None:
        low, high = bounds.get(wave.name, (wave.low, wave.high))
        turns, lead = wave.unit == "1/rev", isinstance(effect.slot, slots.Lead)
        waves = _waves(low, min(high, WAVES_SIMULATED) if lead else high, turns, here.way)
        if turns and not lead:
            finer = motion.ripples(place, WAVES_A_TURN)
            waves = np.append(waves, finer[finer <= high])
        starts = [{**starts[0], wave.name: float(w)} for w in waves]
    as_it_is = effect.size.role is not Role.SIZE or not effect.slot.proportional
    # a phase that scales with the size is two columns
    paired = angle is not None and not as_it_is and (effect.size.neutral == 0.0)
    if paired and wave is None:
        starts = starts[:1]
    seen = []
    if as_it_is and effect.size.neutral == 0.0 and starts:  # a small one grows as it does
        yield Hypothesis(place, effect, starts[0], False)
    for start in starts:
        values = {n: float(np.clip(v, *bounds[n])) if n in bounds else v for n, v in start.items()}
        if values in seen:
            continue
        seen.append(values)
        turned = (angle.name, anywhere) if paired and angle else ()
        yield Hypothesis(place, effect, values, as_it_is, *turned)
        if isinstance(effect.slot, slots.Contact):
            for factor in FRICTIONS:
                size = effect.size
                yield Hypothesis(place, effect, {**values, size.name: min(values[size.name] * factor, size.high)}, True)


def _waves(low: float, high: float, turns: bool, way: float) -> Floats:
    """Wave numbers that are scanned: whole ones a turn, or over the way."""
    if turns:
        whole = np.arange(max(1.0, np.ceil(low)), min(high, WAVES_A_TURN) + 1.0)
        return np.append(0.5, whole) if low <= 0.5 else whole
    if not way > 0.0:
        return np.zeros(0)
    turn = 2.0 * np.pi / way
    return np.arange(max(low, turn), min(high, WAVES_OF_WAY * turn), WAVE_STEP * turn)


def _table(place: str, effect: Effect, motion: Motion) -> Iterator[Hypothesis]:
    """A table over a state that moves."""
    over = SHAPES[effect.name].over
    states = motion.states(place)
    if over not in states:
        return
    knots = knots_of(states[over], over in ("speed", "stretch rate"))
    if knots is not None:
        values = {**dict.fromkeys(VALUES, 0.0), **dict(zip(STATES, knots.tolist(), strict=True)), "bend": 1.0}
        yield Hypothesis(place, effect, values, False)


def knots_of(state: Floats, rate: bool) -> Floats | None:
    """(KNOTS,) knots over a state: dense where it often is; of a rate, dense around rest; None where it rests."""
    low, high = np.quantile(state, TABLE_SPAN)
    if not high - low > 1e-9 * max(abs(high), abs(low), 1e-300):
        return None
    if rate:
        even = np.linspace(-1.0, 1.0, KNOTS)
        knots = max(abs(low), abs(high)) * np.sign(even) * even**2
    else:
        often = np.quantile(state, np.linspace(*TABLE_SPAN, KNOTS))
        knots = 0.5 * often + 0.5 * np.linspace(low, high, KNOTS)
    return knots if (np.diff(knots) > 0.0).all() else None
