"""Draw what a recording conceals, all of it from one seed, and make the recording."""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.random import Generator

from dtbacklash.arrays import Floats
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import CATALOGUE, effects_of
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.prove import excitation, motion, sizes, tuning
from dtbacklash.prove.bench import Bench, errors_in_cascade, errors_of
from dtbacklash.prove.secret import INSTRUMENTS, KINDS, Secret
from dtbacklash.prove.simulator.given import Errors, Loop, Unknown
from dtbacklash.prove.simulator.rig import EFFECTS, Run, check_concealable, simulate_other
from dtbacklash.prove.unlisted import DESCRIPTIONS, unknown_entries, unknown_range

#: how often each kind is drawn
SHARES = {"nothing": 0.10, "parameters": 0.12, "single": 0.43, "several": 0.20, "unknown": 0.15}
#: an effect is as visible as a draw from this range, even in logarithms, in units of the noise
VISIBILITY = (1.0, 300.0)
#: a parameter that is the matter is off by this many tolerances; one that is not, by less than one
WRONG, SLIGHT = (0.7, 2.0), 1.0
DURATION_S = (20, 30)
#: what is hidden is drawn anew, this often, if it cannot be seen on this rig (the warming of a motor that runs light)
#: or the loop does not stay finite
LEAST_VISIBLE, ATTEMPTS = 0.5, 40
#: a seed's stream is [seed, attempt], and the hash of the rig's name but for rigs in cascade, which came first; that of
#: its sensors' noise and that of its kind have these in the place of the attempt
NOISE_STREAM, KIND_STREAM = 10**6, 2 * 10**6
#: what is hidden is drawn from a stream of its own name, ending in which of these and the hash of the name: a new entry
#: of the catalogue leaves every recording as it was in which it is not hidden itself
PICK_STREAM, SHAPE_STREAM = 1, 2
Stream = tuple[int, ...]


def entries(rig: Rig) -> list[tuple[str, str]]:
    """(location, effect) of the catalogue wherever the rig takes it and does not have it yet."""
    screw = rig.only("screw")
    carried = screw.neighbours.get("carries") if screw else None
    places = [name for name in rig.elements if name != carried] + [SENSOR_PREFIX + name for name in rig.sensors]
    return [(p, e) for p in places for e in effects_of(rig.kind_at(p)) if e in EFFECTS and rig.effect(p, e) is None]


def draw(
    seed: int, rig: Rig, kind: str | None = None, effect: str | None = None, instruments: str | None = None
) -> Secret:
    """Draw what is hidden in one recording; the same seed and choices give the same secret to the last bit.

    Parameters
    ----------
    rig : the nominal rig. kind : one of KINDS, or None to draw it. effect : ``location.effect`` to hide it alone.
    instruments : ``minimal`` (the loop's sensors) or ``rich`` (all), or None to draw it.

    Raises
    ------
    UserError : a rig that cannot be concealed, an unknown kind, effect or instruments.
    """
    check_concealable(rig)
    wanted = check_choices(rig, kind, effect, instruments)
    hidden = wanted[0] or draw_kind(seed, rig)
    for attempt in range(ATTEMPTS):
        secret = _draw(stream_of(seed, attempt, rig), rig, hidden, *wanted[1:])
        if secret is not None and (wanted[1] is not None or _is_seen(secret)):
            return secret
    allowed = f"nothing of `{effect or hidden}` could be hidden in it so that it shows and the loop is stable"
    raise UserError("rig", rig.config.name, allowed)


def stream_of(seed: int, which: int, rig: Rig) -> Stream:
    """Where the draws of a seed for one rig come from."""
    return (seed, which) if tuning.in_cascade(rig) else (seed, which, name_hash(rig.config.name))


def draw_kind(seed: int, rig: Rig) -> str:
    """What a recording with this seed hides, by SHARES."""
    rng = np.random.default_rng(stream_of(seed, KIND_STREAM, rig))
    return str(rng.choice(list(SHARES), p=list(SHARES.values())))


def _is_seen(secret: Secret) -> bool:
    """Whether everything that was hidden can be seen; parameters that are slightly off need not be."""
    hidden = [v for name, v in secret.visibility.items() if name != "parameters" or secret.kind == "parameters"]
    return all(v >= LEAST_VISIBLE for v in hidden)


def check_choices(
    rig: Rig, kind: str | None, effect: str | None, instruments: str | None
) -> tuple[str | None, tuple[str, str] | None, str | None]:
    """Check the user's choices; returns kind, (location, effect) and instruments, as far as they are settled.

    Raises
    ------
    UserError : an unknown kind, effect or instruments, or choices that exclude each other.
    """
    if kind is not None and kind not in KINDS:
        raise UserError("kind", kind, f"choose one of {', '.join(KINDS)}")
    if instruments is not None and instruments not in INSTRUMENTS:
        raise UserError("instruments", instruments, f"choose one of {', '.join(INSTRUMENTS)}")
    if effect is None:
        return kind, None, instruments
    if kind not in (None, "single"):
        raise UserError("kind", kind, "effect= hides a single one: leave kind= out, or write kind=single")
    place, _, name = effect.partition(".")
    known = entries(rig)
    if (place, name) not in known:
        names = [e for p, e in known if p == place]
        if names:
            raise UserError("effect", effect, f"at {place} choose one of {', '.join(names)}")
        places = ", ".join(dict.fromkeys(p for p, _ in known))
        raise UserError("effect", effect, f"write location.effect; locations: {places}")
    if place.startswith(SENSOR_PREFIX) and place.removeprefix(SENSOR_PREFIX) not in tuning.fewest_sensors(rig):
        if instruments == "minimal":
            raise UserError("instruments", instruments, f"rich, or {place} is not recorded")
        instruments = "rich"
    return "single", (place, name), instruments


def _draw(
    stream: Stream, nominal: Rig, kind: str, chosen: tuple[str, str] | None, instruments: str | None
) -> Secret | None:
    """One attempt with the stream of a seed; None if the loop did not stay finite."""
    rng, seed, cascade = np.random.default_rng(stream), stream[0], tuning.in_cascade(nominal)
    drawn = str(rng.choice(INSTRUMENTS))  # drawn in any case, so that a choice does not change the rest
    instruments = instruments or drawn
    duration_s, step_s = float(rng.integers(DURATION_S[0], DURATION_S[1] + 1)), tuning.sample_time_s(nominal)
    if cascade:
        move = excitation.draw_excitation(rng, nominal)
        errors = errors_in_cascade(rng, nominal)
    else:
        move = motion.draw_motion(rng, nominal, duration_s, step_s)
    parameters = _parameters(rng, nominal, kind)
    channels = tuning.fewest_sensors(nominal) if instruments == "minimal" else list(nominal.sensors)
    rig = nominal.with_parameters(parameters) if parameters else nominal
    bench = Bench(rig, move, channels, duration_s, step_s)
    plain = bench.quiet(rig)
    if plain.diverged:
        return None
    noise, resolution = errors if cascade else errors_of(rng, nominal, move, plain)
    bench = replace(bench, plain=plain, noise=noise, resolution=resolution)
    secret = Secret(
        seed=seed, rig=nominal.config.name, kind=kind, parameters=parameters, excitation=move,
        controller="open_loop" if not bench.loop().closed else "cascade" if cascade else "pid",
        instruments=instruments, channels=channels, noise=noise, resolution=resolution, duration_s=duration_s,
        sample_time_s=step_s,
    )  # fmt: skip
    if parameters:
        secret.visibility["parameters"] = bench.seen(plain, bench.quiet(nominal))
    if kind == "unknown":
        return _with_unknown(stream, secret, bench, plain)
    if kind in ("single", "several"):
        return _with_effects(rng, stream, secret, bench, plain, chosen)
    return secret


def _parameters(rng: Generator, rig: Rig, kind: str) -> dict[str, float]:
    """True values of the parameters that are off."""
    known = {name: p for name, p in rig.config.parameters.items() if p.tolerance > 0.0}
    slight = rng.random() < 0.5
    off = {name: float(rng.uniform(-SLIGHT, SLIGHT)) for name in known if rng.random() < 0.6}
    count = min(int(rng.integers(1, 4)), len(known))
    wrong = [str(name) for name in rng.choice(list(known), count, replace=False)]
    far = {name: float(rng.choice([-1.0, 1.0]) * rng.uniform(*WRONG)) for name in wrong}
    if kind == "nothing" or (kind != "parameters" and not slight):
        return {}
    chosen = far if kind == "parameters" else off
    return {name: known[name].value * (1.0 + known[name].tolerance * by) for name, by in chosen.items()}


def _target(rng: Generator) -> float:
    return float(np.exp(rng.uniform(*np.log(VISIBILITY))))


def _with_effects(
    rng: Generator, stream: Stream, secret: Secret, bench: Bench, plain: Run, chosen: tuple[str, str] | None
) -> Secret | None:
    """Hide one effect of the catalogue, or two or three at different elements."""
    moving = sizes.motion_of(bench.rig, plain, bench.duration_s, bench.excitation["f_max_hz"])
    count = 1 if secret.kind == "single" else int(rng.integers(2, 4))
    picked = [chosen] if chosen else _pick(stream, entries(bench.rig), count)
    secret, bench = _recorded(picked, secret, bench)
    for place, name in picked:
        own = np.random.default_rng([*stream, SHAPE_STREAM, name_hash(f"{place}.{name}")])
        values = _sized(own, bench, plain, place, name, moving)
        secret.effects.append({"location": place, "effect": name, "parameters": values})
    true_rig = _hide(bench.rig, secret.effects)
    full = bench.quiet(true_rig)
    if full.diverged or bench.wild(true_rig, full):
        return None
    for hidden in secret.effects:
        others = [e for e in secret.effects if e is not hidden]
        without = bench.quiet(_hide(bench.rig, others)) if others else plain
        secret.visibility[f"{hidden['location']}.{hidden['effect']}"] = bench.seen(full, without)
    return secret if all(math.isfinite(v) for v in secret.visibility.values()) else None


def name_hash(name: str) -> int:
    """A number that only the name decides, the same everywhere."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")


def _in_lot(stream: Stream, known: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """The entries in a random order that another entry does not change: each draws its own lot."""

    def lot(entry: tuple[str, str]) -> float:
        return float(np.random.default_rng([*stream, PICK_STREAM, name_hash(".".join(entry))]).random())

    return sorted(known, key=lot)


def _pick(stream: Stream, known: list[tuple[str, str]], count: int) -> list[tuple[str, str]]:
    """Different effects at different elements, each entry equally likely."""
    picked: list[tuple[str, str]] = []
    excluded: set[str] = set()
    for place, name in _in_lot(stream, known):
        if len(picked) < count and place not in [p for p, _ in picked] and name not in excluded:
            picked.append((place, name))
            excluded |= {other for (_, n), effect in CATALOGUE.items() if n == name for other in effect.excludes}
    return picked


def _recorded(picked: list[tuple[str, str]], secret: Secret, bench: Bench) -> tuple[Secret, Bench]:
    """An error of a sensor can only be hidden where the sensor is recorded."""
    needed = {p.removeprefix(SENSOR_PREFIX) for p, _ in picked if p.startswith(SENSOR_PREFIX)}
    if needed <= set(secret.channels):
        return secret, bench
    channels = list(bench.rig.sensors)
    return replace(secret, instruments="rich", channels=channels), replace(bench, channels=channels)


def _hide(rig: Rig, effects: list[dict[str, Any]]) -> Rig:
    for effect in effects:
        rig = rig.with_effect(effect["location"], effect["effect"], effect["parameters"])
    return rig


def _sized(rng: Generator, bench: Bench, plain: Run, place: str, name: str, moving: sizes.Motion) -> dict[str, float]:
    """The parameters of an effect that is as visible as drawn."""
    effect = effects_of(bench.rig.kind_at(place))[name]
    shape = effect.draw_shape(rng, moving.at(place))

    def visibility(strength: float) -> float:
        return bench.seen(bench.quiet(bench.rig.with_effect(place, name, shape.values(strength))), plain)

    return shape.values(sizes.strength_for(visibility, _target(rng), shape.guess, shape.most))


def _with_unknown(stream: Stream, secret: Secret, bench: Bench, plain: Run) -> Secret | None:
    """Hide physics that the catalogue does not have."""
    moving = sizes.motion_of(bench.rig, plain, bench.duration_s, bench.excitation["f_max_hz"])
    place, name = _in_lot(stream, unknown_entries(bench.rig))[0]
    rng = np.random.default_rng([*stream, SHAPE_STREAM, name_hash(f"{place}.{name}")])
    scale, guess, most = unknown_range(rng, bench.rig, place, name, moving)

    def visibility(strength: float) -> float:
        hidden = Unknown(place, name, strength, scale)
        return bench.seen(bench.quiet(bench.rig, hidden), plain)

    size = sizes.strength_for(visibility, _target(rng), guess, most)
    hidden = Unknown(place, name, size, scale)
    run = bench.quiet(bench.rig, hidden)
    seen = bench.seen(run, plain)
    if not math.isfinite(seen) or bench.wild(bench.rig, run, hidden):
        return None
    description = f"{DESCRIPTIONS[name]} ({place})"
    unknown = {"location": place, "name": name, "description": description, "size": size, "scale": scale}
    secret.visibility[f"{place}.{name}"] = seen
    return replace(secret, unknown=unknown)


def record(secret: Secret, nominal: Rig) -> tuple[Loop, Run]:
    """Make the recording of a secret: the rig as it truly is, its sensors with noise and counts."""
    unknown = None
    if secret.unknown is not None:
        u = secret.unknown
        unknown = Unknown(u["location"], u["name"], u["size"], u["scale"])
    bench = Bench(
        nominal, secret.excitation, secret.channels, secret.duration_s, secret.sample_time_s, secret.noise,
        secret.resolution,
    )  # fmt: skip
    loop = bench.loop(unknown)
    shape = len(loop.reference), len(nominal.sensors)
    draws: Floats = np.random.default_rng(stream_of(secret.seed, NOISE_STREAM, nominal)).standard_normal(shape)
    errors = Errors(bench.noise, bench.resolution, draws)
    return loop, simulate_other(secret.true_rig(nominal), loop, secret.sample_time_s, errors, unknown)
