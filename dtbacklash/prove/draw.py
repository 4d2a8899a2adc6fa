"""Draw what a recording conceals, all of it from one seed, and make the recording."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import Generator

from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import effects_of
from dtbacklash.physics.plant import Floats
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.prove import excitation, sizes
from dtbacklash.prove.other_rig import Errors, Loop, Run, Unknown, check_concealable, loop_sensors, simulate_other
from dtbacklash.prove.secret import INSTRUMENTS, KINDS, Secret

#: how often each kind is drawn
SHARES = {"nothing": 0.10, "parameters": 0.12, "single": 0.43, "several": 0.20, "unknown": 0.15}
#: an effect is as visible as a draw from this range, even in logarithms, in units of the noise
VISIBILITY = (1.0, 300.0)
#: a parameter that is the matter is off by this many tolerances; one that is not, by less than one
WRONG, SLIGHT = (0.7, 2.0), 1.0
SAMPLE_TIME_S = 1e-3
DURATION_S = (20, 30)
#: what is hidden is drawn anew, this often, if it cannot be seen on this rig (the warming of a motor that runs light)
#: or the loop does not stay finite
LEAST_VISIBLE, ATTEMPTS = 0.5, 40
#: a seed's stream is [seed, attempt]; that of its sensors' noise and that of its kind end with these
NOISE_STREAM, KIND_STREAM = 10**6, 2 * 10**6
#: bandwidth of the weak loop that keeps two runs together whose voltage is given, when they are compared, rad/s
WEAK_RAD_S = 15.0

DESCRIPTIONS = {
    "position_damping": "damping against the ground that grows with the square of the position",
    "disturbance": "an unmeasured disturbance with a course of its own",
    "directional_torque": "a torque constant that differs by the direction of motion",
    "root_spring": "a part of the spring's force that grows with the square root of the stretch",
    "speed_stiffening": "a spring that stiffens with the rate of its stretch",
    "angular_play": "a play that depends on the angle of the screw",
    "position_mass": "a mass that changes with the position",
}


@dataclass(frozen=True)
class _Bench:
    """The rig as it truly is but for what is hidden, and what is done with it."""

    rig: Rig
    excitation: dict[str, Any]
    channels: list[str]
    noise: dict[str, float]
    resolution: dict[str, float]
    duration_s: float
    plain: Run | None = None

    def loop(self, unknown: Unknown | None = None) -> Loop:
        force = None
        if unknown is not None and unknown.name == "disturbance":
            force = excitation.disturbance(self.excitation["seed"], self.duration_s, SAMPLE_TIME_S)
        return excitation.loop_of(self.excitation, self.duration_s, SAMPLE_TIME_S, force)

    def quiet(self, rig: Rig, unknown: Unknown | None = None) -> Run:
        """A run without noise and counts; beside a plain run in open loop, held to its motion by a weak loop."""
        loop = self.loop(unknown)
        if self.plain is not None and not loop.closed:
            screw, circuit = rig.only("screw"), rig.only("motor_circuit")
            assert screw is not None
            assert circuit is not None
            angle = self.plain.states[:, 2] * screw.values["lead"]
            gain = WEAK_RAD_S * circuit.values["emf_constant"]
            loop = replace(loop, closed=True, reference=angle, dither=loop.reference, gain=gain,
                           filter_rad_s=math.inf, limit=math.inf)  # fmt: skip
        return simulate_other(rig, loop, SAMPLE_TIME_S, None, unknown)

    def seen(self, changed: Run, plain: Run) -> float:
        """How much two runs differ in the channel that shows it most, in units of its noise."""
        if changed.diverged or plain.diverged:
            return math.inf
        return max(
            float(np.sqrt(np.mean((changed.truth[c] - plain.truth[c]) ** 2)))
            / math.hypot(self.noise[c], self.resolution[c] / math.sqrt(12.0))
            for c in self.channels
        )


def entries(rig: Rig) -> list[tuple[str, str]]:
    """(location, effect) of the catalogue wherever the rig takes it and does not have it yet."""
    screw = rig.only("screw")
    carried = screw.neighbours.get("carries") if screw else None
    places = [name for name in rig.elements if name != carried] + [SENSOR_PREFIX + name for name in rig.sensors]
    return [(p, e) for p in places for e in effects_of(rig.kind_at(p)) if rig.effect(p, e) is None]


def unknown_entries(rig: Rig) -> list[tuple[str, str]]:
    """(location, name) of the physics beyond the catalogue, wherever the rig takes it."""
    screw = rig.only("screw")
    carried = screw.neighbours.get("carries") if screw else None
    by_kind = {
        "motor_circuit": ["directional_torque"], "rotor": ["disturbance"], "gear": ["angular_play"],
        "link": ["root_spring", "speed_stiffening"], "mass": ["position_damping", "disturbance", "position_mass"],
    }  # fmt: skip
    places = [e for e in rig.elements.values() if e.name != carried]
    return [(e.name, name) for e in places for name in by_kind.get(e.kind, [])]


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
    hidden = wanted[0] or draw_kind(seed)
    for attempt in range(ATTEMPTS):
        secret = _draw(np.random.default_rng([seed, attempt]), seed, rig, hidden, *wanted[1:])
        if secret is not None and (wanted[1] is not None or _is_seen(secret)):
            return secret
    allowed = f"nothing of `{effect or hidden}` could be hidden in it so that it shows and the loop is stable"
    raise UserError("rig", rig.config.name, allowed)


def draw_kind(seed: int) -> str:
    """What a recording with this seed hides, by SHARES."""
    return str(np.random.default_rng([seed, KIND_STREAM]).choice(list(SHARES), p=list(SHARES.values())))


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
    if place.startswith(SENSOR_PREFIX) and place.removeprefix(SENSOR_PREFIX) not in loop_sensors(rig):
        if instruments == "minimal":
            raise UserError("instruments", instruments, f"rich, or {place} is not recorded")
        instruments = "rich"
    return "single", (place, name), instruments


def _draw(
    rng: Generator, seed: int, nominal: Rig, kind: str, chosen: tuple[str, str] | None, instruments: str | None
) -> Secret | None:
    """One attempt; None if the loop did not stay finite."""
    drawn = str(rng.choice(INSTRUMENTS))  # drawn in any case, so that a choice does not change the rest
    instruments = instruments or drawn
    duration_s = float(rng.integers(DURATION_S[0], DURATION_S[1] + 1))
    move = excitation.draw_excitation(rng, nominal)
    noise, resolution = _sensor_errors(rng, nominal)
    parameters = _parameters(rng, nominal, kind)
    channels = loop_sensors(nominal) if instruments == "minimal" else list(nominal.sensors)
    rig = nominal.with_parameters(parameters) if parameters else nominal
    bench = _Bench(rig, move, channels, noise, resolution, duration_s)
    plain = bench.quiet(rig)
    if plain.diverged:
        return None
    bench = replace(bench, plain=plain)
    secret = Secret(
        seed=seed, rig=nominal.config.name, kind=kind, parameters=parameters, excitation=move,
        controller="open_loop" if move["form"].startswith("voltage") else "cascade", instruments=instruments,
        channels=channels, noise=noise, resolution=resolution, duration_s=duration_s, sample_time_s=SAMPLE_TIME_S,
    )  # fmt: skip
    if parameters:
        secret.visibility["parameters"] = bench.seen(plain, bench.quiet(nominal))
    if kind == "unknown":
        return _with_unknown(rng, secret, bench, plain)
    if kind in ("single", "several"):
        return _with_effects(rng, secret, bench, plain, chosen)
    return secret


def _sensor_errors(rng: Generator, rig: Rig) -> tuple[dict[str, float], dict[str, float]]:
    """Noise and counts of every sensor: around a 4096-count encoder and 1 um, in proportion to the rig's lead."""
    turn, circuit = excitation.turn_m(rig) / excitation.PAPER_TURN_M, rig.only("motor_circuit")
    assert circuit is not None
    ampere = 1.0 / circuit.values["resistance"]
    noise, resolution = {}, {}
    for name, sensor in rig.sensors.items():
        spread = float(np.exp(rng.uniform(math.log(0.3), math.log(3.0))))
        counts = float(rng.choice([2048.0, 4096.0, 8192.0]))
        part = float(rng.choice([0.1, 0.2, 0.5]))
        if sensor.unit == "rad":
            resolution[name] = 2.0 * math.pi / counts
            noise[name] = 0.1 * spread * resolution[name]
            continue
        unit = {"m": 1e-6 * turn, "A": 8e-3 * ampere, "m/s": 2e-5 * turn, "rad/s": 0.05}[sensor.unit]
        noise[name], resolution[name] = unit * spread, unit * part
    return noise, resolution


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
    rng: Generator, secret: Secret, bench: _Bench, plain: Run, chosen: tuple[str, str] | None
) -> Secret | None:
    """Hide one effect of the catalogue, or two or three at different elements."""
    motion = sizes.motion_of(bench.rig, plain, bench.duration_s)
    count = 1 if secret.kind == "single" else int(rng.integers(2, 4))
    places = entries(bench.rig)
    picked = [chosen] if chosen else _pick(rng, places, count)
    secret, bench = _recorded(picked, secret, bench)
    for place, name in picked:
        values = _sized(rng, bench, plain, place, name, motion)
        secret.effects.append({"location": place, "effect": name, "parameters": values})
    full = bench.quiet(_hide(bench.rig, secret.effects))
    if full.diverged:
        return None
    for hidden in secret.effects:
        others = [e for e in secret.effects if e is not hidden]
        without = bench.quiet(_hide(bench.rig, others)) if others else plain
        secret.visibility[f"{hidden['location']}.{hidden['effect']}"] = bench.seen(full, without)
    return secret if all(math.isfinite(v) for v in secret.visibility.values()) else None


def _pick(rng: Generator, known: list[tuple[str, str]], count: int) -> list[tuple[str, str]]:
    """Different effects at different elements, each entry equally likely."""
    picked: list[tuple[str, str]] = []
    while len(picked) < count:
        place, name = known[int(rng.integers(len(known)))]
        clash = {"backlash", "load_reaction"} <= {name, *(e for _, e in picked)}
        if place not in [p for p, _ in picked] and not clash:
            picked.append((place, name))
    return picked


def _recorded(picked: list[tuple[str, str]], secret: Secret, bench: _Bench) -> tuple[Secret, _Bench]:
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


def _sized(rng: Generator, bench: _Bench, plain: Run, place: str, name: str, motion: sizes.Motion) -> dict[str, float]:
    """The parameters of an effect that is as visible as drawn."""
    effect = effects_of(bench.rig.kind_at(place))[name]
    shape = sizes.draw_shape(rng, bench.rig, place, effect, motion)

    def visibility(strength: float) -> float:
        return bench.seen(bench.quiet(bench.rig.with_effect(place, name, shape.values(strength))), plain)

    return shape.values(sizes.strength_for(visibility, _target(rng), shape.guess, shape.most))


def _with_unknown(rng: Generator, secret: Secret, bench: _Bench, plain: Run) -> Secret | None:
    """Hide physics that the catalogue does not have."""
    motion = sizes.motion_of(bench.rig, plain, bench.duration_s)
    known = unknown_entries(bench.rig)
    place, name = known[int(rng.integers(len(known)))]
    scale, guess, most = _unknown_range(rng, bench.rig, place, name, motion)

    def visibility(strength: float) -> float:
        hidden = Unknown(place, name, strength, scale)
        return bench.seen(bench.quiet(bench.rig, hidden), plain)

    size = sizes.strength_for(visibility, _target(rng), guess, most)
    seen = visibility(size)
    if not math.isfinite(seen):
        return None
    description = f"{DESCRIPTIONS[name]} ({place})"
    unknown = {"location": place, "name": name, "description": description, "size": size, "scale": scale}
    secret.visibility[f"{place}.{name}"] = seen
    return replace(secret, unknown=unknown)


def _unknown_range(rng: Generator, rig: Rig, place: str, name: str, motion: sizes.Motion) -> tuple[float, float, float]:
    """(scale of the state, first guess of the size, largest size) of physics beyond the catalogue."""
    circuit = rig.only("motor_circuit")
    assert circuit is not None
    rotor = rig.of_kind("rotor")[0].name
    torque = circuit.values["torque_constant"] / circuit.values["resistance"]
    force = max(motion.force.values(), default=1.0)
    if name == "disturbance":
        return 1.0, *((0.1 * torque, sizes.EFFORT_MAX_V * torque) if place == rotor else (0.05 * force, 3.0 * force))
    if name == "angular_play":
        return float(rng.uniform(0.4, 2.0)), 0.03, 1.0
    if name == "directional_torque":
        return 0.02 * motion.velocity[rotor], 0.1, 0.9
    if name == "root_spring":
        return motion.stretch[place], 0.05, 3.0
    if name == "speed_stiffening":
        return motion.rate[place], 0.05, 3.0
    if name == "position_mass":
        return motion.place[place], 0.05, 0.4
    return motion.place[place], 0.05 * force / motion.velocity[place], 3.0 * force / motion.velocity[place]


def record(secret: Secret, nominal: Rig) -> tuple[Loop, Run]:
    """Make the recording of a secret: the rig as it truly is, its sensors with noise and counts."""
    unknown = None
    if secret.unknown is not None:
        u = secret.unknown
        unknown = Unknown(u["location"], u["name"], u["size"], u["scale"])
    bench = _Bench(nominal, secret.excitation, secret.channels, secret.noise, secret.resolution, secret.duration_s)
    loop = bench.loop(unknown)
    shape = len(loop.reference), len(nominal.sensors)
    draws: Floats = np.random.default_rng([secret.seed, NOISE_STREAM]).standard_normal(shape)
    errors = Errors(secret.noise, secret.resolution, draws)
    return loop, simulate_other(secret.true_rig(nominal), loop, secret.sample_time_s, errors, unknown)
