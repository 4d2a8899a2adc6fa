"""Effects of a spring between two bodies: a link, a coupling, a shaft."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from dtbacklash.physics.effects.body import coulomb
from dtbacklash.physics.effects.declare import (
    REST_ERROR,
    Effect,
    Parameter,
    Place,
    Role,
    Starts,
    Values,
    hardly_reached,
)
from dtbacklash.physics.effects.slots import Contact, SpringForce, SpringMemory, SpringPlay

#: a spring that softens keeps this share of its stiffness at the largest stretch
SOFTEST = 0.3
#: a stop that is touched for less than the rest of the time is not known
HIT = 0.999


def play(theta_d, theta_m, half_gap):
    """Next output of the play operator: the screw stays until the motor's tooth pushes it.

    rad -> rad; Krasnosel'skii & Pokrovskii, Systems with Hysteresis (1989). It is the paper's Eqs (16)-(17).
    """
    return min(max(theta_d, theta_m - half_gap), theta_m + half_gap)


def lost_motion(stretch, total):
    """What is left of a stretch behind a play that springs back to its middle: :func:`play` from rest. m -> m."""
    return play(0.0, stretch, 0.5 * total)


#: where a search for a play begins, shares of the largest stretch or of the way
PLAYS = (0.01, 0.03, 0.08, 0.15, 0.25, 0.4, 0.6)


def cubic_stiffness(stretch, k3):
    """Force of a hardening (k3 > 0) or softening spring: ``k3 stretch^3``. m -> N."""
    return k3 * stretch * stretch * stretch


def quadratic_damping(stretch_rate, c2):
    """Force of a turbulent damper: ``c2 |rate| rate``. m/s -> N."""
    return c2 * abs(stretch_rate) * stretch_rate


def bumper(stretch, stiffness, clearance):
    """Force of a one-sided elastic stop that touches at ``stretch = clearance``. m -> N."""
    return stiffness * (stretch - clearance) if stretch > clearance else 0.0


def stiffness_drift(stretch, time, spring_stiffness, rate):
    """Force that a linear spring gains when its stiffness drifts as ``k (1 + rate t)``. m, s -> N."""
    return spring_stiffness * rate * time * stretch


def bouc_wen_after(memory, change, displacement):
    """The dimensionless hysteretic variable z, n = 1, A = 1, beta = gamma = 1/2, after a change of the stretch.

    Bouc (1967), Wen, J. Eng. Mech. 102 (1976) 249, solved for a stretch that grows: z' = s' / displacement where
    z < 0, and z' = (1 - z) s' / displacement above; where it shrinks, with both signs turned. ``|z| <= 1``. m -> 1.
    """
    side = 1.0 if change >= 0.0 else -1.0
    z, far = side * memory, abs(change) / displacement
    free = min(far, max(-z, 0.0))
    z += free
    return side * (z + (z - 1.0) * math.expm1(free - far))


def bouc_wen_force(memory, size):
    """Force of the hysteretic variable. 1 -> N."""
    return size * memory


def _moves(place: Place) -> bool:
    return place.span > 0.0 and place.stretch_rate > 0.0 and place.values["stiffness"] > 0.0


def _starts(size: Callable[[Place], float]) -> Starts:
    """A size where the spring moves; nothing is known where it does not."""
    return lambda place: [{"size": size(place)}] if _moves(place) else [{}]


def _damping(place: Place) -> float:
    """The spring's damping, or what would damp it as strongly as the spring pulls, N s/m."""
    return place.values.get("damping", place.values["stiffness"] * place.span / place.stretch_rate)


def _hardly_touched(values: Values, place: Place) -> str:
    """Two touches of a stop, or fewer, do not show a corner: a spring that stiffens does the same."""
    if place.stretch is None:
        return ""
    return "cubic_stiffness" if hardly_reached(place.stretch > values["clearance"]) else ""


def _hysteresis_starts(place: Place) -> list[Values]:
    base = {"size": 0.1 * place.values["stiffness"] * place.span} if _moves(place) else {}
    if place.stretch is None:
        return [base]
    return [{**base, "displacement": share * place.span} for share in (0.03, 0.15, 0.6)]


def _bumper_starts(place: Place) -> list[Values]:
    base = {"size": place.values["stiffness"]} if _moves(place) else {}
    if place.stretch is None:
        return [base]
    levels = np.quantile(place.stretch, (0.03, 0.2, 0.5, 0.8, 0.93, 0.98, 0.995))
    return [{**base, "clearance": float(v)} for v in levels]


def _cubic_range(place: Place, sign: float) -> tuple[float, float]:
    k, s = place.values["stiffness"], place.span
    most = 5.0 * k / s**2
    return (min(most, SOFTEST * k / place.reach**2) if sign < 0.0 else most), 0.05 * k / s**2


def _quadratic_range(place: Place, sign: float) -> tuple[float, float]:
    return 10.0 * place.force / place.stretch_rate**2, 0.02 * place.force / place.stretch_rate**2


def _force_range(place: Place, sign: float) -> tuple[float, float]:
    return 3.0 * place.force, 0.05 * place.force


def _hysteresis_draws(rng: Generator, place: Place) -> Values:
    return {"displacement": place.span * float(rng.uniform(0.3, 1.5))}


def _bumper_draws(rng: Generator, place: Place) -> Values:
    return {"clearance": place.reach * float(rng.uniform(0.1, 0.5))}


def _spring(kind: str, force: str, length: str, names: tuple[str, ...], scale: dict[str, float]) -> list[Effect]:
    """The effects ``names`` of a spring, in N and m or in N m and rad; ``scale`` : their typical sizes."""
    moment = "torque" if length == "rad" else "force"
    listed = [
        Effect(
            "cubic_stiffness", kind,
            (Parameter("k3", f"{force}/{length}^3", -1e20, 1e20, scale["k3"], 0.0, role=Role.SIZE),),
            "k3 s^3", SpringForce(cubic_stiffness), "Duffing's spring",
            "The spring of {location} has a cubic part of {k3}.",
            conceal=_cubic_range,
            starts=_starts(lambda p: 0.1 * p.values["stiffness"] / p.span**2),
        ),
        Effect(
            "quadratic_damping", kind,
            (Parameter("c2", f"{force} s^2/{length}^2", 0.0, 1e15, scale["c2"], 0.0, role=Role.SIZE),),
            "c2 |s'| s'", SpringForce(quadratic_damping), "turbulent damper",
            "The damper of {location} has a quadratic part of {c2}.",
            conceal=_quadratic_range, starts=_starts(lambda p: 0.1 * _damping(p) / p.stretch_rate),
        ),
        Effect(
            "dry_friction", kind,
            (Parameter(moment, force, 0.0, 1e9, scale["dry"], 0.0, role=Role.SIZE),),
            f"{moment} sign(s'), |.| <= {moment} at s' = 0", Contact(coulomb), "Coulomb friction across a spring",
            f"Dry friction of {{{moment}}} acts across {{location}}.",
            conceal=_force_range,
            starts=_starts(lambda p: 0.02 * p.values["stiffness"] * p.span), formulation_error=REST_ERROR,
        ),
        Effect(
            "hysteresis", kind,
            (
                Parameter(moment, force, 0.0, 1e9, scale["hysteresis"], 0.0, role=Role.SIZE),
                Parameter("displacement", length, 1e-15, 1e3, scale["displacement"]),
            ),
            f"{moment} z, z' = (s' - |s'| z/2 - s' |z|/2)/displacement",
            SpringMemory(bouc_wen_after, bouc_wen_force, "displacement"),
            "Bouc-Wen; Wen, J. Eng. Mech. 102 (1976) 249",
            f"{{location}} yields hysteretically at {{{moment}}} within {{displacement}} (Bouc-Wen).",
            conceal=_force_range, draws=_hysteresis_draws,
            starts=_hysteresis_starts, formulation_error=REST_ERROR, becomes=("displacement", "dry_friction"),
            visible=lambda place: {"displacement": (0.0, 2.0 * place.reach)} if place.reach > 0.0 else {},
        ),
        Effect(
            "bumper", kind,
            (
                Parameter("stiffness", f"{force}/{length}", 0.0, 1e15, scale["stop"], 0.0, role=Role.SIZE),
                Parameter("clearance", length, -1e3, 1e3, scale["clearance"]),
            ),
            "stiffness (s - clearance) where s > clearance", SpringForce(bumper), "one-sided elastic stop",
            "{location} hits a stop of {stiffness} at a stretch of {clearance}.",
            conceal=lambda place, sign: (20.0 * place.values["stiffness"], 0.3 * place.values["stiffness"]),
            draws=_bumper_draws, starts=_bumper_starts, formulation_error=REST_ERROR, simpler_at=_hardly_touched,
            visible=lambda place: {} if place.stretch is None else {
                "clearance": (float(place.stretch.min()), float(np.quantile(place.stretch, HIT)))},
        ),
        Effect(
            "stiffness_drift", kind, (Parameter("rate", "1/s", -1.0, 1.0, 2e-3, 0.0, role=Role.SIZE),),
            "k rate t s", SpringForce(stiffness_drift), "linear drift",
            "The stiffness of {location} drifts by {rate}.",
            conceal=lambda place, sign: (0.6 / place.duration_s, 0.1 / place.duration_s),
        ),
        Effect(
            "backlash", kind, (Parameter("lost_motion", length, 0.0, 1e3, scale["lost"], 0.0, role=Role.SIZE),),
            "the spring's stretch is what s has beyond lost_motion/2 to either side", SpringPlay(lost_motion),
            "play operator; the paper's Eqs (16)-(17)",
            "The {location} has backlash: a lost motion of {lost_motion} at each reversal.",
            conceal=lambda place, sign: (2.0 * place.reach, 0.1 * place.span),
            starts=lambda p: [{"size": 2.0 * share * p.reach} for share in PLAYS] if p.reach > 0.0 else [{}],
            visible=lambda place: {"lost_motion": (0.0, 2.0 * place.reach)} if place.reach > 0.0 else {},
        ),
    ]  # fmt: skip
    return [effect for effect in listed if effect.name in names]


_LINEAR = {
    "k3": 1e10, "c2": 2e3, "dry": 0.2, "hysteresis": 1.0, "displacement": 5e-5, "stop": 1e4, "clearance": 1e-4,
    "lost": 1e-3,
}  # fmt: skip
_ROTARY = {
    "k3": 1e2, "c2": 1e-3, "dry": 0.02, "hysteresis": 0.05, "displacement": 0.01, "stop": 10.0, "clearance": 0.05,
    "lost": 0.02,
}  # fmt: skip
#: what a belt, the teeth of a rack or of a gearbox may have
_DRIVEN = ("backlash", "cubic_stiffness", "hysteresis")
_LINK = ("cubic_stiffness", "quadratic_damping", "dry_friction", "hysteresis", "bumper", "stiffness_drift")

EFFECTS = [
    *_spring("link", "N", "m", (*_LINK, "backlash"), _LINEAR),
    *_spring("coupling", "N", "m", ("backlash", "cubic_stiffness", "quadratic_damping", "hysteresis"), _LINEAR),
    *_spring("shaft", "N m", "rad", (*_LINK, "backlash"), _ROTARY),
    *_spring("gearbox", "N m", "rad", _DRIVEN, _ROTARY),
    *_spring("belt", "N", "m", _DRIVEN, _LINEAR),
    *_spring("rack", "N", "m", _DRIVEN, _LINEAR),
]
