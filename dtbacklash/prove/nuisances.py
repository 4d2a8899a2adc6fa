"""The small things of a lifelike recording: what a real machine has beside the one thing that is hidden.

Three to ten of them, of the catalogue and outside of it. Their sizes are scaled together, so that what is hidden is at
least five times as large as all of them, and these are ``LEFT`` at the same command.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.random import Generator

from dtbacklash.physics.catalogue import CATALOGUE, effects_of
from dtbacklash.physics.effects import slots
from dtbacklash.physics.element_kinds import GROUND, ROTARY
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.prove import effect_sizes, excitation
from dtbacklash.prove.secret import Secret, laws, with_effects
from dtbacklash.prove.simulator.given import Unlisted
from dtbacklash.prove.simulator.machine import carried_mass, driven_body
from dtbacklash.prove.simulator.rig import Trial
from dtbacklash.prove.testbench import Bench

#: how many there are, and the share of them that is of the catalogue
COUNT, LISTED = (3, 10), 0.5
#: mean square of what they change together at the same command, in units of the noise's: of that a diagnosis, which
#: may pull its simulation towards the recording, sees a part. Its rms as a share of what is hidden, and at most
LEFT, SHARE, SHARE_MOST = (40.0, 500.0), (0.01, 0.03), 0.2
#: the smallest beside the largest; each is sized within a factor, and left out where the rig shows less than a share
SPREAD, NEAR, SHOWN = 0.2, 2.0, 0.3
#: all of them are scaled by this factor at most
FACTOR_MOST = 10.0
#: each alone is sized in a recording of this length, s; all together in the whole one. What a recording shows at its
#: peaks only would have another size there
ALONE_S, AT_PEAKS = 5.0, ("saturation", "bumper")

DESCRIPTIONS = effect_sizes.DESCRIPTIONS | {
    "coloured_force": "an unmeasured coloured force",
    "double_ripple": "a ripple of two frequencies over the position",
    "wandering_friction": "a dry friction whose level wanders",
    "creep": "a dry friction that gives way elastically long before it slides",
    "position_gain": "a torque or force constant that depends on the position",
    "gain_drift": "a torque or force constant that drifts slowly",
    "interpolation": "an encoder's interpolation error, periodic in its reading",
    "curved_scale": "a scale whose gain depends on the position",
    "reading_drift": "a reading that drifts slowly",
    "clock_jitter": "samples that are not taken at the times that are written",
}
CLOCK = "clock"
_BODY = ("coloured_force", "double_ripple", "wandering_friction", "creep")
#: what is a dry friction or a play, by an effect of the catalogue
FRICTIONS = ("coulomb_friction", "ground_friction", "stribeck_friction", "hysteresis", "dry_friction")


def small_laws(rig: Rig, channels: Sequence[str]) -> list[tuple[str, str]]:
    """(location, name) of what the catalogue lacks wherever the rig takes it; sensors are those that are recorded."""
    found = [*effect_sizes.unknown_entries(rig), (CLOCK, "clock_jitter")]
    for element in rig.elements.values():
        if element.trait.trait == slots.BODY and element.name != carried_mass(rig):
            found += [(element.name, name) for name in _BODY]
        elif element.kind == "actuator" or element.trait.trait == slots.WINDING:
            found += [(element.name, name) for name in ("position_gain", "gain_drift")]
    for name in channels:
        sensor, place = rig.sensors[name], SENSOR_PREFIX + name
        found.append((place, "reading_drift"))
        if sensor.quantity == "position":
            found += [(place, "interpolation"), (place, "curved_scale")]
    return found


def akin(rig: Rig, place: str, name: str) -> list[tuple[str, str]]:
    """The effects of the catalogue that are a right name for a law that it lacks: a friction, a play."""
    if name == "angular_play":
        return [(place, "backlash")]
    if name not in ("wandering_friction", "creep"):
        return []
    held = [link.name for link in rig.links() if set(link.neighbours["between"]) == {GROUND, place}]
    return [(p, e) for p in (place, *held) for e in FRICTIONS if e in effects_of(rig.kind_at(p))]


#: strength -> the entry in the secret; with the first guess of the strength, and the largest
_Made = Callable[[float], dict[str, Any]]
_Range = tuple[_Made, float, float]


@dataclass(frozen=True)
class _Thing:
    """A small thing of a strength, and its visibility; ``made`` : strength -> its entry in the secret."""

    made: _Made
    strength: float
    most: float
    visibility: float

    def times(self, factor: float) -> dict[str, Any]:
        """Its entry, scaled."""
        strength = min(factor * self.strength, self.most)
        return self.made(strength) | {"visibility": self.visibility * strength / self.strength}


@dataclass(frozen=True)
class _Stage:
    """The rig with what is hidden, and its run: small things are compared with it at the same command."""

    bench: Bench
    run: Trial
    main: tuple[Unlisted, ...]

    @classmethod
    def of(cls, rig: Rig, secret: Secret) -> _Stage:
        """The stage of a rig with what is hidden in it."""
        run = Bench(rig, secret).quiet(rig, *secret.laws)
        return cls(Bench(rig, secret, run), run, secret.laws)

    def seen(self, *things: dict[str, Any]) -> float:
        """How much these change the recording, in units of the noise."""
        rig = with_effects(self.bench.rig, [thing for thing in things if "effect" in thing])
        return self.bench.seen(self.bench.quiet(rig, *self.main, *laws(things)), self.run)


def with_small_things(rng: Generator, listed: list[tuple[str, str]], plain: Rig, secret: Secret) -> Secret | None:
    """Add the small things; None if the rig does not bear them beside what is hidden.

    listed : (location, effect) of the catalogue where the rig takes it. plain : the true rig without what is hidden.
    """
    rig = with_effects(plain, secret.effects)
    stage = _Stage.of(rig, secret)
    seen = min((v for name, v in secret.visibility.items() if name != "parameters"), default=math.inf)
    least, most = (math.sqrt(left) for left in LEFT)
    if stage.run.diverged or seen * SHARE_MOST < least:
        return None
    low, high = (min(max(share * seen, least), most, SHARE_MOST * seen) for share in SHARE)
    low = least if math.isinf(seen) else low
    target = math.exp(float(rng.uniform(math.log(low), math.log(high))))
    things = _things(rng, stage, listed, target)
    if len(things) < COUNT[0]:
        return None
    joint = cache(lambda factor: stage.seen(*(thing.times(factor) for thing in things)))
    factor = effect_sizes.strength_for(joint, target, 1.0, FACTOR_MOST)
    entries, together = [thing.times(factor) for thing in things], joint(factor)
    full = with_effects(rig, [entry for entry in entries if "effect" in entry])
    wild = stage.bench.wild(full, stage.run, *stage.main, *laws(entries))
    if wild or not LEFT[0] / effect_sizes.NEAR**2 <= together**2 <= LEFT[1] * effect_sizes.NEAR**2:
        return None
    return replace(secret, beside=entries, beside_visibility=together)


def _things(rng: Generator, stage: _Stage, listed: list[tuple[str, str]], target: float) -> list[_Thing]:
    """Draw them, one at a time, each of its share of the target."""
    rig, secret = stage.bench.rig, stage.bench.secret
    brief = _Stage.of(rig, replace(secret, duration_s=min(ALONE_S, secret.duration_s)))
    moving = effect_sizes.motion_of(rig, stage.run, secret.duration_s, secret.excitation["f_max_hz"])
    recorded = {SENSOR_PREFIX + name for name in secret.channels}
    known = [(p, e) for p, e in listed if e not in AT_PEAKS and (p in rig.elements or p in recorded)]
    lacking = small_laws(rig, secret.channels)
    pools = [[pool[j] for j in rng.permutation(len(pool))] for pool in (known, lacking)]
    count = int(rng.integers(COUNT[0], COUNT[1] + 1))
    shares = np.exp(rng.uniform(math.log(SPREAD), 0.0, count))
    things: list[_Thing] = []
    taken = [(e["location"], e["effect"]) for e in secret.effects] + [(u.location, u.name) for u in stage.main]
    while len(things) < count and any(pools):
        pool = pools[0] if pools[0] and (rng.random() < LISTED or not pools[1]) else pools[1]
        place, name = pool.pop()
        if _excluded(rig, place, name, taken):
            continue
        draw = _listed if pool is pools[0] else _lacking
        wanted = target * float(shares[len(things)] / np.sqrt(np.sum(shares**2)))
        made, guess, most = draw(rng, secret, rig, moving, place, name)
        if thing := _sized(brief, made, guess, most, wanted):
            things.append(thing)
            taken += [(place, name), *akin(rig, place, name)]
    return things


def _excluded(rig: Rig, place: str, name: str, taken: list[tuple[str, str]]) -> bool:
    """Whether something is there that is the same, or nearly."""
    there = {other for where, other in taken if where == place}
    excludes = {other for (_, n), effect in CATALOGUE.items() if n == name for other in effect.excludes}
    alike = {(place, name), *akin(rig, place, name)}
    return bool(alike & set(taken) or excludes & there)


def _listed(rng: Generator, secret: Secret, rig: Rig, moving: effect_sizes.Moved, place: str, name: str) -> _Range:
    shape = rig.takes(place)[name].draw_shape(rng, moving.at(place))

    def made(strength: float) -> dict[str, Any]:
        return {"location": place, "effect": name, "parameters": shape.values(strength)}

    return made, shape.guess, shape.most


def _lacking(rng: Generator, secret: Secret, rig: Rig, moving: effect_sizes.Moved, place: str, name: str) -> _Range:
    if name in effect_sizes.DESCRIPTIONS:
        scale, guess, most = effect_sizes.unknown_range(rng, rig, place, name, moving)
        law = Unlisted(place, name, 0.0, scale, seed=excitation.draw_seed(rng))
    elif place in rig.elements:
        law, guess, most = _of_body(rng, rig, moving, place, name)
    else:
        law, guess, most = _of_sensor(rng, secret, moving, place, name)
    more = {"description": f"{DESCRIPTIONS[name]} ({place})", "akin": [list(key) for key in akin(rig, place, name)]}
    told = {name: value for name, value in asdict(law).items() if value != 0.0}  # the others stand at their defaults
    return lambda size: told | {"size": size} | more, guess, most


def _of_body(
    rng: Generator, rig: Rig, moving: effect_sizes.Moved, place: str, name: str
) -> tuple[Unlisted, float, float]:
    """(law without its size, first guess of the size, largest size) of a force, or of a drive's gain."""
    law = Unlisted(place, name, 0.0, seed=excitation.draw_seed(rng))
    if name in ("position_gain", "gain_drift"):
        return replace(law, scale=moving.place[driven_body(rig) or ""]), 0.02, 0.5
    at = moving.at(place)
    guess, most = 0.02 * at.force, at.force_most
    if name == "double_ripple":
        turns = rig.elements[place].trait.axis == ROTARY and at.reach > math.pi
        first, second = (float(rng.integers(*waves)) for waves in ((2, 9), (9, 30)))
        wave = 1.0 if turns else math.pi / at.reach
        phase, shift, share = (float(rng.uniform(*ends)) for ends in ((-3.1, 3.1), (-3.1, 3.1), (0.3, 0.9)))
        law = replace(law, scale=share, wave=first * wave, second=second * wave, phase=phase, shift=shift)
    elif name == "wandering_friction":
        law = replace(law, scale=0.02 * moving.velocity[place])
    elif name == "creep":
        law = replace(law, scale=moving.place[place] * float(rng.uniform(0.02, 0.2)))
    return law, guess, most


def _of_sensor(
    rng: Generator, secret: Secret, moving: effect_sizes.Moved, place: str, name: str
) -> tuple[Unlisted, float, float]:
    """The same of an error of a scale or of the clock."""
    law = Unlisted(place, name, 0.0, phase=float(rng.uniform(-3.1, 3.1)), seed=excitation.draw_seed(rng))
    if name == "clock_jitter":
        return law, 0.02 * secret.sample_time_s, 0.3 * secret.sample_time_s
    sensor = place.removeprefix(SENSOR_PREFIX)
    shown = moving.shown[sensor]
    if name == "interpolation":
        period = max(shown / float(rng.uniform(5.0, 40.0)), 8.0 * secret.resolution[sensor])
        return replace(law, wave=2.0 * math.pi / period), 0.01 * period, 0.1 * period
    return replace(law, scale=shown), *((1e-3, 0.1) if name == "curved_scale" else (1e-3 * shown, 0.1 * shown))


def _sized(stage: _Stage, made: _Made, guess: float, most: float, wanted: float) -> _Thing | None:
    """The thing of about the wanted visibility; None where the rig does not show it, or shows too much."""
    if not 0.0 < guess < math.inf or not most > 0.0:
        return None
    visibility = cache(lambda strength: stage.seen(made(strength)))
    strength = effect_sizes.strength_for(visibility, wanted, guess, most, NEAR)
    shown = visibility(strength)
    return _Thing(made, strength, most, shown) if SHOWN * wanted <= shown <= wanted / SHOWN else None
