"""How large a hidden effect may be, and the size at which it is as visible as drawn."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator

from dtbacklash.physics.catalogue import Effect
from dtbacklash.physics.plant import Floats
from dtbacklash.physics.rig import Rig
from dtbacklash.prove.excitation import turn_m
from dtbacklash.prove.other_rig import Run

DELAY_MAX_S = 6e-3
GAIN_MAX = 0.4
#: torque of this voltage at rest that friction or a load may take, V; the loop has 48
EFFORT_MAX_V = 8.0
#: trial simulations, and how near to the drawn visibility is near enough (a factor)
TRIALS, NEAR = 7, 1.2


@dataclass(frozen=True)
class Motion:
    """How the plain rig moves under the excitation; SI, names of links and bodies.

    command : largest but for a thousandth, V. current, speed : rms, A and rad/s. place, velocity : rms of each body.
    stretch, rate : rms of each link; reach : its largest stretch. force : rms force of each link, N.
    """

    command: float
    current: float
    duration_s: float
    place: dict[str, float] = field(default_factory=dict)
    velocity: dict[str, float] = field(default_factory=dict)
    stretch: dict[str, float] = field(default_factory=dict)
    rate: dict[str, float] = field(default_factory=dict)
    reach: dict[str, float] = field(default_factory=dict)
    force: dict[str, float] = field(default_factory=dict)


def motion_of(rig: Rig, run: Run, duration_s: float) -> Motion:
    """Measure how the rig moves in a run."""
    screw, nb = rig.only("screw"), len(run.bodies)
    assert screw is not None
    zero, x = np.zeros(len(run.states)), run.states
    q = {name: x[:, 2 + j] for j, name in enumerate(run.bodies)} | {"ground": zero}
    v = {name: x[:, 2 + nb + j] for j, name in enumerate(run.bodies)} | {"ground": zero}
    carried, lead = screw.neighbours["carries"], screw.values["lead"]
    if carried not in q:
        q[carried], v[carried] = lead * x[:, 1], lead * v[run.bodies[0]]
    found = Motion(float(np.quantile(np.abs(run.u), 0.999)), _rms(x[:, 0]), duration_s)
    for name in q:
        found.place[name], found.velocity[name] = _rms(q[name]), _rms(v[name])
    for link in rig.of_kind("link"):
        a, b = link.neighbours["between"]
        s, rate = q[b] - q[a], v[b] - v[a]
        found.stretch[link.name], found.rate[link.name] = _rms(s), _rms(rate)
        found.reach[link.name] = float(np.abs(s).max())
        force = link.values["stiffness"] * s + link.values.get("damping", 0.0) * rate
        found.force[link.name] = _rms(force)
    return found


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) + 1e-300


@dataclass(frozen=True)
class Shape:
    """A drawn effect but for its size: where sizes may lie, and the values that a size gives.

    most : largest strength. guess : where to begin. values : strength -> parameters of the effect.
    """

    most: float
    guess: float
    values: Callable[[float], dict[str, float]]


def draw_shape(rng: Generator, rig: Rig, location: str, effect: Effect, motion: Motion) -> Shape:
    """Draw everything of an effect but its size: sign and secondary parameters."""
    size = effect.size
    if effect.name == "saturation":
        top = motion.command

        def clipped(strength: float) -> dict[str, float]:
            return {"limit": top * (1.0 - strength)}

        return Shape(0.9, 0.3, clipped)
    most, guess = _range(rig, location, effect, motion)
    sign = float(rng.choice([-1.0, 1.0])) if size.low < 0.0 else 1.0
    if effect.name == "cubic_stiffness" and sign < 0.0:
        link = rig.elements[location]
        most = min(most, 0.3 * link.values["stiffness"] / motion.reach[location] ** 2)
    others = {p.name: _secondary(rng, rig, location, p.name, effect, motion) for p in effect.parameters[1:]}
    most = min(most, size.high, -size.low if sign < 0.0 else math.inf)
    return Shape(most, min(guess, 0.5 * most), lambda strength: {size.name: sign * strength, **others})


def _secondary(rng: Generator, rig: Rig, location: str, name: str, effect: Effect, motion: Motion) -> float:
    """A random value of a parameter that is not the size."""
    if name == "phase":
        return float(rng.uniform(-3.1, 3.1))
    if name == "periods":
        if effect.name == "pitch_error":
            return float(rng.choice([0.5, 1.0, 2.0, 3.0, 4.0]))
        return float(rng.integers(3, 25 if effect.name == "cogging" else 13))
    if name == "speed":  # of Stribeck's curve
        return motion.velocity[location] * float(rng.uniform(0.05, 0.4))
    if name == "displacement":
        return motion.stretch[location] * float(rng.uniform(0.3, 1.5))
    if name == "clearance":
        return motion.reach[location] * float(rng.uniform(0.1, 0.5))
    if name == "frequency":
        return float(rng.uniform(3.0, 25.0))
    if name == "damping_ratio":
        return float(rng.uniform(0.01, 0.12))
    if name == "time_constant":
        return motion.duration_s * float(rng.uniform(0.05, 0.4))
    return _typical(effect, name)


def _typical(effect: Effect, name: str) -> float:
    return next(p.typical for p in effect.parameters if p.name == name)


def _range(rig: Rig, location: str, effect: Effect, motion: Motion) -> tuple[float, float]:
    """Largest strength that leaves a rig that still works, and a guess of one that is seen."""
    circuit = rig.only("motor_circuit")
    assert circuit is not None
    v, name = circuit.values, effect.name
    torque = v["torque_constant"] / v["resistance"]
    speed = motion.velocity[rig.of_kind("rotor")[0].name]
    relative = {
        "delay": (DELAY_MAX_S, 5e-4), "gain_error": (GAIN_MAX, 0.02), "torque_ripple": (0.8, 0.1),
        "dead_zone": (0.8 * motion.command, 0.05), "load_reaction": (1.0, 0.3), "backlash": (math.pi, 0.02),
        "resistance_heating": (1.0 / (v["resistance"] * motion.current**2), 0.1 / motion.current**2 / v["resistance"]),
        "viscous_friction": (torque * EFFORT_MAX_V / speed, 0.05 * torque / speed),
        "asymmetric_friction": (0.5 * torque * EFFORT_MAX_V / speed, 0.05 * torque / speed),
        "stiffness_drift": (0.6 / motion.duration_s, 0.1 / motion.duration_s),
        "pitch_error": (0.25 * turn_m(rig), 0.003 * turn_m(rig)), "compliance": (1e-4, 1e-6),
        "offset": (1e3, 0.003 * turn_m(rig)),
    }  # fmt: skip
    if name in relative:
        return relative[name]
    if rig.kind_at(location) == "rotor":
        return torque * EFFORT_MAX_V, 0.1 * torque
    if rig.kind_at(location) == "link":
        force, s, rate = motion.force[location], motion.stretch[location], motion.rate[location]
        k = rig.elements[location].values["stiffness"]
        return {
            "cubic_stiffness": (5.0 * k / s**2, 0.05 * k / s**2),
            "quadratic_damping": (10.0 * force / rate**2, 0.02 * force / rate**2),
            "bumper": (20.0 * k, 0.3 * k),
        }.get(name, (3.0 * force, 0.05 * force))
    if name == "absorber":
        mass = rig.elements[location].values["mass"]
        return mass, 0.03 * mass
    force = max(motion.force.values(), default=1.0)
    return 3.0 * force, 0.05 * force


def strength_for(visibility: Callable[[float], float], target: float, guess: float, most: float) -> float:
    """The strength at which an effect is as visible as drawn, or the largest that is allowed.

    A secant search in logarithms, kept between the strengths that are known to be too small and too large. A loop that
    diverges counts as infinitely visible.
    """
    low, high = 0.0, math.inf
    strength, slope, last = min(guess, most), 1.0, None
    for _ in range(TRIALS):
        seen = visibility(strength)
        if target / NEAR <= seen <= target * NEAR or (seen < target and strength >= most):
            return strength
        low, high = (max(low, strength), high) if seen < target else (low, min(high, strength))
        if math.isinf(seen):
            strength = math.sqrt(low * high) if low > 0.0 else 0.1 * strength
            continue
        point = math.log(strength), math.log(max(seen, 1e-3))
        if last is not None and point[0] != last[0]:
            slope = min(max((point[1] - last[1]) / (point[0] - last[0]), 0.4), 3.0)
        last = point
        step = math.log(target / max(seen, 1e-3)) / slope
        strength = min(most, strength * math.exp(min(max(step, -6.0), 6.0)))
        if not low < strength < high:
            strength = math.sqrt(max(low, 1e-3 * high) * high)
    return low if low > 0.0 else strength
