"""Effects of gear and screw, and the friction of whatever passes on an effort."""

import numpy as np
from numpy.random import Generator

from dtbacklash.physics.effects.declare import REST_ERROR, Effect, Parameter, Place, Role, Values
from dtbacklash.physics.effects.periodic import periodic, periodic_slope
from dtbacklash.physics.effects.slots import GearPlay, JointPlay, Lead, Passing, Reaction, Yielding

#: largest concealed half-gap, rad
GAP_MAX = 3.141592653589793
#: largest share of what it passes on that a drive may lose, as it would not move otherwise, and that a worm may
LOSS_OF_DRIVE, LOSS_OF_WORM = 0.95, 5.0
#: where the search for a loss starts, and the largest concealed one
LOSSES, LOSS_MAX = (0.05, 0.25), 0.5
#: where the search for a play of a joint begins, the least and the largest concealed one, shares of the way
PLAYS, PLAY_LEAST, PLAY_MAX = (0.003, 0.01, 0.03), 5e-4, 0.2


def pitch_error(angle, amplitude, periods, phase):
    """Displacement beyond the lead, zero at zero. rad -> m."""
    return periodic(angle, amplitude, periods, phase) - periodic(0.0, amplitude, periods, phase)


def pitch_slope(angle, amplitude, periods, phase):
    """Derivative of :func:`pitch_error` by the angle. rad -> m/rad."""
    return periodic_slope(angle, amplitude, periods, phase)


def loss(load, share):
    """Level of a dry friction that grows with the effort that is passed on."""
    return share * abs(load)


def _load_friction(kind: str, most: float) -> Effect:
    return Effect(
        "load_friction", kind, (Parameter("share", "1", 0.0, most, 0.1, 0.0, role=Role.SIZE),),
        "-share |load| sign(v), |.| <= share |load| at v = 0", Passing(loss),
        "Dohring, Lee, Newman, IEEE Int. Conf. on Robotics and Automation (1993) 430",
        "Friction takes {share} of the effort that the {location} passes on.",
        conceal=lambda place, sign: (LOSS_MAX, 0.05), starts=lambda place: [{"share": share} for share in LOSSES],
        formulation_error=REST_ERROR, excludes=("backlash",) if kind == "screw" else (),
    )  # fmt: skip


def _gaps(place: Place) -> list[Values]:
    """From a hundredth of a turn to a whole one, or of what the motor turns at all."""
    return [{"half_gap": float(g)} for g in np.geomspace(0.02, min(GAP_MAX, max(0.4 * place.way, 0.04)), 7)]


def _pitch_draws(rng: Generator, place: Place) -> Values:
    return {"periods": float(rng.choice([0.5, 1.0, 2.0, 3.0, 4.0])), "phase": float(rng.uniform(-3.1, 3.1))}


EFFECTS = [
    Effect(
        "backlash", "gear", (Parameter("half_gap", "rad", 0.0, 6.3, 0.35, 0.0, role=Role.SIZE, counted=True),),
        "theta_d = play(theta_m, half_gap)", GearPlay("half_gap"), "play operator; the paper's Eqs (16)-(17)",
        "The {location} has backlash of {half_gap} to each side.",
        conceal=lambda place, sign: (GAP_MAX, 0.02), excludes=("load_reaction",), starts=_gaps,
    ),
    Effect(
        "compliance", "screw", (Parameter("compliance", "m/N", 0.0, 1e-4, 1e-6, 0.0, role=Role.SIZE),),
        "lead theta_d - q1 = compliance * force through the screw", Yielding("compliance"), "axial spring in series",
        "The {location} gives way by {compliance}.",
        conceal=lambda place, sign: (1e-4, 1e-6),
    ),
    Effect(
        "pitch_error", "screw",
        (
            Parameter("amplitude", "m", 0.0, 1e-3, 2e-5, 0.0, role=Role.SIZE),
            Parameter("periods", "1/rev", 0.05, 50.0, 1.0, role=Role.WAVE),
            Parameter("phase", "rad", -3.2, 3.2, 0.0, role=Role.ANGLE),
        ),
        "d = lead theta_d + amplitude (sin(periods theta_d + phase) - sin(phase))", Lead(pitch_error, pitch_slope),
        "periodic lead error of a screw (ISO 3408)",
        "The lead of the {location} errs periodically by {amplitude} ({periods}).",
        conceal=lambda place, sign: (0.25 * place.travel, 0.003 * place.travel), draws=_pitch_draws,
    ),
    Effect(
        "load_reaction", "screw", (Parameter("share", "1", 0.0, 1.0, 1.0, 0.0, role=Role.SIZE),),
        "torque on the motor = -share * lead * force through the screw, while the gear is in contact",
        Reaction("share"), "power balance of the screw; the paper's first assumption lifted",
        "The structure pushes back on the motor through the {location} ({share} of the full reaction).",
        conceal=lambda place, sign: (1.0, 0.3), excludes=("backlash",),
    ),
]  # fmt: skip

#: of joints of a MuJoCo model
EFFECTS += [
    Effect(
        "backlash", kind, (Parameter("lost_motion", unit, 0.0, 1e3, typical, 0.0, role=Role.SIZE),),
        "|q - q_a| <= lost_motion/2; the actuator turns q_a, the joint's armature", JointPlay("lost_motion"),
        "a second joint with a range, as MuJoCo models have it",
        "The {location} has backlash: a lost motion of {lost_motion} between it and its actuator.",
        conceal=lambda place, sign: (PLAY_MAX * (place.way or 1.0), 0.01 * (place.way or 1.0)),
        starts=lambda place: [{"size": share * place.way} for share in PLAYS],
        visible=lambda place: {"lost_motion": (PLAY_LEAST * place.way, place.way)},
    )
    for kind, unit, typical in (("turning_joint", "rad", 0.01), ("sliding_joint", "m", 1e-3))
]  # fmt: skip

#: of whatever passes on an effort
PASSING = [
    *(_load_friction(kind, LOSS_OF_DRIVE) for kind in ("servo", "linear_servo", "actuator", "motor_circuit")),
    *(_load_friction(kind, LOSS_OF_WORM) for kind in ("gearbox", "belt", "rack", "screw")),
    _load_friction("joint_drive", LOSS_OF_DRIVE),
]
