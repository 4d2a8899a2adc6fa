"""Draw what a recording conceals, all of it from one seed, and make the recording."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import asdict, replace

import numpy as np
from numpy.random import Generator

from dtbacklash.arrays import Floats
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.prove import effect_sizes, excitation, nuisances, tuning
from dtbacklash.prove.effect_sizes import DESCRIPTIONS, unknown_entries, unknown_range
from dtbacklash.prove.secret import INSTRUMENTS, KINDS, MACHINES, Secret, with_effects
from dtbacklash.prove.simulator.given import Errors, Loop, Unlisted
from dtbacklash.prove.simulator.machine import carried_mass
from dtbacklash.prove.simulator.rig import EFFECTS, Trial, check_concealable, simulate_other
from dtbacklash.prove.testbench import Bench, errors_in_cascade, errors_of

#: how often each kind is drawn
SHARES = {"nothing": 0.10, "parameters": 0.12, "single": 0.43, "several": 0.20, "unknown": 0.15}
#: visibility of a hidden effect in units of the noise, drawn evenly in logarithms
VISIBILITY = (1.0, 300.0)
#: the same beside small things, and the factor within which it is reached
LIFELIKE, NEAR_LIFELIKE = (300.0, 2000.0), 1.5
#: wrong parameters are off by this many tolerances, the others by at most SLIGHT
WRONG, SLIGHT = (0.7, 2.0), 1.0
DURATION_S = (20, 30)
#: what is hidden is drawn again, at most this often, if it is less visible or the loop diverges
LEAST_VISIBLE, ATTEMPTS = 0.5, 40
#: the stream of a seed is [seed, attempt], and the hash of the rig's name except for rigs in cascade; the noise of the
#: sensors and the kind have these numbers in place of the attempt
NOISE_STREAM, KIND_STREAM = 10**6, 2 * 10**6
#: each entry of the catalogue has streams of its own, which end in one of these and the hash of its name: a new entry
#: changes only the recordings in which it is hidden
PICK_STREAM, SHAPE_STREAM = 1, 2
#: the stream of the small things of a lifelike recording ends so
BESIDE_STREAM = 3
Stream = tuple[int, ...]


def entries(rig: Rig) -> list[tuple[str, str]]:
    """(location, effect) of the catalogue wherever the rig takes it and does not have it yet."""
    carried = carried_mass(rig)
    places = [place for place in rig.places if place != carried]
    return [(p, e) for p in places for e in rig.takes(p) if e in EFFECTS and rig.effect(p, e) is None]


def draw(
    seed: int, rig: Rig, kind: str | None = None, effect: str | None = None, instruments: str | None = None,
    machine: str = MACHINES[0],
) -> Secret:  # fmt: skip
    """Draw what one recording hides; the same seed and choices give the same secret to the last bit.

    rig : the nominal rig. kind : one of KINDS. effect : ``location.effect``, which is then hidden alone.
    instruments : ``minimal`` (the loop's sensors) or ``rich`` (all). None: drawn. machine : ``lifelike`` has small
    things beside that, see :mod:`.nuisances`; but for these it moves as the ``clean`` one of the same seed.

    Raises UserError: a rig that cannot be concealed, an unknown kind, effect or instruments.
    """
    check_concealable(rig)
    wanted = check_choices(rig, kind, effect, instruments)
    hidden = wanted[0] or draw_kind(seed, rig)
    for attempt in range(ATTEMPTS):
        secret = _draw(stream_of(seed, attempt, rig), rig, hidden, *wanted[1:], machine)
        if secret is not None and (wanted[1] is not None or _is_seen(secret)):
            return secret
    allowed = f"nothing of `{effect or hidden}` could be hidden in it so that it shows and the loop is stable"
    raise UserError("rig", rig.config.name, allowed)


def stream_of(seed: int, which: int, rig: Rig) -> Stream:
    """The random stream of a seed for one rig; ``which``: the attempt, or NOISE_STREAM, or KIND_STREAM."""
    return (seed, which) if tuning.in_cascade(rig) else (seed, which, name_hash(rig.config.name))


def draw_kind(seed: int, rig: Rig) -> str:
    """What a recording with this seed hides, by SHARES."""
    rng = np.random.default_rng(stream_of(seed, KIND_STREAM, rig))
    return str(rng.choice(list(SHARES), p=list(SHARES.values())))


def _is_seen(secret: Secret) -> bool:
    """Whether all that was hidden is visible; slightly wrong parameters need not be."""
    hidden = [v for name, v in secret.visibility.items() if name != "parameters" or secret.kind == "parameters"]
    return all(v >= LEAST_VISIBLE for v in hidden)


def check_choices(
    rig: Rig, kind: str | None, effect: str | None, instruments: str | None
) -> tuple[str | None, tuple[str, str] | None, str | None]:
    """Check the user's choices; returns kind, (location, effect) and instruments, or None for what is to be drawn.

    Raises UserError: an unknown kind, effect or instruments, or choices that exclude each other.
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
    stream: Stream, nominal: Rig, kind: str, chosen: tuple[str, str] | None, instruments: str | None, machine: str
) -> Secret | None:
    """One attempt; None if the loop did not stay finite."""
    rng, cascade = np.random.default_rng(stream), tuning.in_cascade(nominal)
    drawn = str(rng.choice(INSTRUMENTS))  # drawn in any case, so that a choice does not change the rest
    instruments = instruments or drawn
    duration_s, step_s = float(rng.integers(DURATION_S[0], DURATION_S[1] + 1)), tuning.sample_time_s(nominal)
    if cascade:
        move = excitation.draw_excitation(rng, nominal)
        errors = errors_in_cascade(rng, nominal)
    else:
        move = excitation.draw_motion(rng, nominal, duration_s, step_s)
    channels = tuning.fewest_sensors(nominal) if instruments == "minimal" else list(nominal.sensors)
    secret = Secret(
        seed=stream[0], rig=nominal.config.name, kind=kind, parameters=_parameters(rng, nominal, kind),
        excitation=move, instruments=instruments, channels=channels, duration_s=duration_s, sample_time_s=step_s,
        machine=machine,
    )  # fmt: skip
    bench = Bench(secret.true_rig(nominal), secret)
    plain = bench.quiet(bench.rig)
    if plain.diverged:
        return None
    noise, resolution = errors if cascade else errors_of(rng, nominal, move, plain)
    controller = "open_loop" if not bench.loop().closed else "cascade" if cascade else "pid"
    secret = replace(secret, noise=noise, resolution=resolution, controller=controller)
    bench = replace(bench, secret=secret, plain=plain)
    if secret.parameters:
        secret.visibility["parameters"] = bench.seen(plain, bench.quiet(nominal))
    found: Secret | None = secret
    if kind == "unknown":
        found = _with_unknown(stream, bench, plain)
    elif kind in ("single", "several"):
        found = _with_hidden_effects(rng, stream, bench, plain, chosen)
    if found is None or machine == MACHINES[0]:
        return found
    listed = entries(with_effects(bench.rig, found.effects))
    return nuisances.with_small_things(np.random.default_rng([*stream, BESIDE_STREAM]), listed, bench.rig, found)


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


def _strength_for(
    rng: Generator, bench: Bench, visibility: Callable[[float], float], guess: float, most: float
) -> float:
    """The strength at which a hidden effect is as visible as is drawn."""
    clean = bench.secret.machine == MACHINES[0]
    target = float(np.exp(rng.uniform(*np.log(VISIBILITY if clean else LIFELIKE))))
    return effect_sizes.strength_for(visibility, target, guess, most, effect_sizes.NEAR if clean else NEAR_LIFELIKE)


def _with_hidden_effects(
    rng: Generator, stream: Stream, bench: Bench, plain: Trial, chosen: tuple[str, str] | None
) -> Secret | None:
    """Hide one effect of the catalogue, or two or three at different elements; None if the rig no longer works."""
    moving = _moving(bench, plain)
    count = 1 if bench.secret.kind == "single" else int(rng.integers(2, 4))
    picked = [chosen] if chosen else _pick(stream, entries(bench.rig), count)
    bench = _with_needed_sensors(picked, bench)
    secret = bench.secret
    for place, name in picked:
        values = _sized(_shape_rng(stream, place, name), bench, plain, place, name, moving)
        secret.effects.append({"location": place, "effect": name, "parameters": values})
    true_rig = with_effects(bench.rig, secret.effects)
    full = bench.quiet(true_rig)
    if full.diverged or bench.wild(true_rig, full):
        return None
    for hidden in secret.effects:
        others = [e for e in secret.effects if e is not hidden]
        without = bench.quiet(with_effects(bench.rig, others)) if others else plain
        secret.visibility[f"{hidden['location']}.{hidden['effect']}"] = bench.seen(full, without)
    return secret if all(math.isfinite(v) for v in secret.visibility.values()) else None


def _moving(bench: Bench, plain: Trial) -> effect_sizes.Moved:
    return effect_sizes.motion_of(bench.rig, plain, bench.secret.duration_s, bench.secret.excitation["f_max_hz"])


def _shape_rng(stream: Stream, place: str, name: str) -> Generator:
    return np.random.default_rng([*stream, SHAPE_STREAM, name_hash(f"{place}.{name}")])


def name_hash(name: str) -> int:
    """A number that depends on the name only, the same on every machine."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")


def _shuffled(stream: Stream, known: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """The entries in a random order; an additional entry does not change the order of the others."""

    def lot(entry: tuple[str, str]) -> float:
        return float(np.random.default_rng([*stream, PICK_STREAM, name_hash(".".join(entry))]).random())

    return sorted(known, key=lot)


def _pick(stream: Stream, known: list[tuple[str, str]], count: int) -> list[tuple[str, str]]:
    """Different effects at different elements, each entry equally likely."""
    picked: list[tuple[str, str]] = []
    excluded: set[str] = set()
    for place, name in _shuffled(stream, known):
        if len(picked) < count and place not in [p for p, _ in picked] and name not in excluded:
            picked.append((place, name))
            excluded |= {other for (_, n), effect in CATALOGUE.items() if n == name for other in effect.excludes}
    return picked


def _with_needed_sensors(picked: list[tuple[str, str]], bench: Bench) -> Bench:
    """The bench with all sensors recorded, if an error of a sensor is picked that is not recorded yet."""
    needed = {p.removeprefix(SENSOR_PREFIX) for p, _ in picked if p.startswith(SENSOR_PREFIX)}
    if needed <= set(bench.secret.channels):
        return bench
    return replace(bench, secret=replace(bench.secret, instruments="rich", channels=list(bench.rig.sensors)))


def _sized(
    rng: Generator, bench: Bench, plain: Trial, place: str, name: str, moving: effect_sizes.Moved
) -> dict[str, float]:
    """The parameters of an effect, of a size at which its visibility is the drawn one."""
    effect = bench.rig.takes(place)[name]
    shape = effect.draw_shape(rng, moving.at(place))

    def visibility(strength: float) -> float:
        return bench.seen(bench.quiet(bench.rig.with_effect(place, name, shape.values(strength))), plain)

    return shape.values(_strength_for(rng, bench, visibility, shape.guess, shape.most))


def _with_unknown(stream: Stream, bench: Bench, plain: Trial) -> Secret | None:
    """Hide physics that the catalogue does not have; None if the rig no longer works."""
    place, name = _shuffled(stream, unknown_entries(bench.rig))[0]
    rng = _shape_rng(stream, place, name)
    scale, guess, most = unknown_range(rng, bench.rig, place, name, _moving(bench, plain))

    def visibility(strength: float) -> float:
        return bench.seen(bench.quiet(bench.rig, Unlisted(place, name, strength, scale)), plain)

    hidden = Unlisted(place, name, _strength_for(rng, bench, visibility, guess, most), scale)
    run = bench.quiet(bench.rig, hidden)
    seen = bench.seen(run, plain)
    if not math.isfinite(seen) or bench.wild(bench.rig, run, hidden):
        return None
    bench.secret.visibility[f"{place}.{name}"] = seen
    return replace(bench.secret, unknown=asdict(hidden) | {"description": f"{DESCRIPTIONS[name]} ({place})"})


def record(secret: Secret, nominal: Rig) -> tuple[Loop, Trial]:
    """Make the recording of a secret: the rig as it truly is, its sensors with noise and counts."""
    loop = Bench(nominal, secret).loop(*secret.laws)
    shape = len(loop.reference), len(nominal.sensors)
    draws: Floats = np.random.default_rng(stream_of(secret.seed, NOISE_STREAM, nominal)).standard_normal(shape)
    errors = Errors(secret.noise, secret.resolution, draws)
    return loop, simulate_other(secret.true_rig(nominal), loop, secret.sample_time_s, errors, *secret.laws)
