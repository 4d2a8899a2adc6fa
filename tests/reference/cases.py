"""What is solved independently and kept: a rig and a command for every effect of the catalogue, and some more."""

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from catalogued import IN_CLOSED_FORM, OF_A_MODEL
from nominal import nominal_rig
from numpy.typing import NDArray
from scipy.linalg import expm

from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.rig import Rig

from . import rigs

Array = NDArray[np.float64]
SAMPLE_TIME_S = 1e-3
SAMPLES = 3000
HOLD = 30  # samples between changes of the command


@dataclass(frozen=True)
class Problem:
    """A rig from rest, under a command held over each sample.

    u : (N,) V. gap : (N+1,) half-gap, rad. without : the rig without the effect that is tried. channels : which sensors
    are compared, and ``theta_d``, the screw's angle; none: all sensors. bits : a kept channel is rounded to its range
    over two to this power.
    """

    name: str
    rig: Rig
    u: Array
    gap: Array | None = None
    without: Rig | None = None
    channels: tuple[str, ...] = ()
    rtol: float = 1e-10
    atol: float = 1e-11
    bits: int = 28


@dataclass(frozen=True)
class Case:
    """Where an effect is tried, with what sizes (those not given are the catalogue's typical ones).

    grows : whether a gear's gap grows meanwhile.
    """

    places: tuple[str, ...]
    values: dict[str, float] = field(default_factory=dict)
    size_v: float = 4.0
    rig: str = "lead_screw"
    companions: dict[str, dict[str, dict[str, float]]] = field(default_factory=dict)
    grows: bool = True


SENSORS = ("sensor_q3", "sensor_theta_m")
#: a carriage without any friction would roll away: it has a viscous one wherever that is not what is tried
ROLLS = {"carriage": {"viscous_friction": {"coefficient": 200.0}}}
CARRIAGE = Case(("carriage",), size_v=3.0, rig="carriage", companions=ROLLS)

#: what turns freely would run away: it has a viscous friction
TURNS = {"rotor_1": {"viscous_friction": {"coefficient": 0.01}}}
SHAFT = Case(("shaft",), size_v=4.0, rig="two_inertias", companions=TURNS)

GEARED = Case(("belt",), size_v=6.0, rig="geared", companions={"carriage": {"viscous_friction": {"coefficient": 20.0}}})
#: commands are positions: a fourth of a radian, and 10 mm
SERVED = Case(("servo",), size_v=0.25, rig="served")
PUSHED = Case(("drive",), size_v=0.01, rig="served_carriage")
RACK = replace(GEARED, places=("rack",), rig="racked")


def each(kind: str, case: Case, *names: str, **sized: dict[str, float]) -> dict[tuple[str, str], Case]:
    """The case for several effects of a kind: those that are typical in size, and those of sizes that are given."""
    return {(kind, n): case for n in names} | {(kind, n): replace(case, values=v) for n, v in sized.items()}


DAMPER = Case(("joint",), size_v=60.0, rig="damper")
BAND, MOTOR = replace(DAMPER, places=("band",)), replace(CARRIAGE, places=("motor",))
TEETH, MASSES, SEEN = replace(GEARED, places=("teeth",)), Case(("mass_2", "mass_3")), Case(SENSORS)
CASES: dict[tuple[str, str], Case] = {
    **each("amplifier", Case(("amplifier",)), "saturation", "dead_zone", "delay", "gain_error"),
    **each("motor_circuit", Case(("motor_circuit",)), "torque_ripple", "load_friction"),
    # an unloaded motor takes 0.1 W: here it turns against a viscous friction, so that its winding gets warm
    ("motor_circuit", "resistance_heating"): Case(
        ("motor_circuit",), {"gain": 0.05, "time_constant": 0.5}, size_v=20.0, rig="loaded lead_screw"
    ),
    **each("rotor", Case(("motor_bearing",)), "coulomb_friction", "stribeck_friction", "viscous_friction",
           "asymmetric_friction", "quadratic_drag", "cogging", "constant_load", "gravity"),
    **each("shaft", SHAFT, "dry_friction", "hysteresis", "backlash", cubic_stiffness={"k3": 300.0},
           quadratic_damping={"c2": 0.01}, bumper={"stiffness": 5.0, "clearance": 0.01},
           stiffness_drift={"rate": 0.05}),
    **each("servo", SERVED, speed_limit={"speed": 4.0}, effort_limit={"effort": 1.0}, load_friction={"share": 0.3}),
    **each("linear_servo", PUSHED, speed_limit={"speed": 0.1}, effort_limit={"effort": 15.0},
           load_friction={"share": 0.3}),
    **each("actuator", MOTOR, lag={"time": 0.01}, load_friction={"share": 0.3}),
    # without load, behind a gap that grows, a motor would close and open the gear without end
    ("screw", "load_friction"): Case(("screw",), {"share": 0.5}, grows=False),
    **each("gearbox", TEETH, load_friction={"share": 0.3}, backlash={"lost_motion": 0.01}, cubic_stiffness={"k3": 1e6},
           hysteresis={"torque": 0.1, "displacement": 2e-3}),
    **{key: one for kind, case in (("belt", GEARED), ("rack", RACK)) for key, one in each(
        kind, case, load_friction={"share": 0.3}, backlash={"lost_motion": 2e-4}, cubic_stiffness={"k3": 1e11},
        hysteresis={"force": 3.0, "displacement": 1e-4}).items()},
    **each("gear", Case(("gear",)), "backlash"),
    **each("link", Case(("link_1", "link_2")), "cubic_stiffness", "quadratic_damping", "dry_friction", "hysteresis",
           "bumper", "stiffness_drift"),
    ("link", "backlash"): Case(("link_2",), {"lost_motion": 2e-5}),
    **each("screw", Case(("screw",)), "compliance", "pitch_error", "load_reaction"),
    **each("mass", MASSES, "ground_friction", "constant_force", "absorber", viscous_friction={"coefficient": 20.0},
           quadratic_drag={"coefficient": 200.0}),
    **each("sensor", SEEN, "gain_error", offset={"offset": 0.01}, low_pass={"cutoff": 20.0},
           second_order_low_pass={"cutoff": 20.0, "damping_ratio": 0.6}),
    ("sensor", "delay"): Case((*SENSORS, "sensor_i_m")),
    ("sensor", "lost_motion"): Case(("sensor_theta_m",), {"width": 0.2}),
    ("sensor", "eccentricity"): Case(("sensor_theta_m",), {"amplitude": 0.05, "phase": 0.7}),
    **each("carriage", CARRIAGE, "coulomb_friction", "stribeck_friction", "asymmetric_friction", "constant_force",
           "absorber"),
    **each("carriage", replace(CARRIAGE, companions={}), viscous_friction={"coefficient": 200.0},
           quadratic_drag={"coefficient": 500.0}),
    # more than the waves' 20 N, but not so little that the carriage hesitates on a crest: there any error grows
    ("carriage", "cogging"): replace(CARRIAGE, size_v=2.0),
    **each("coupling", DAMPER, backlash={"lost_motion": 5e-3}, cubic_stiffness={"k3": 1e8},
           quadratic_damping={"c2": 200.0}, hysteresis={"force": 2.0, "displacement": 5e-4}),
    **each("brake", BAND, stribeck_friction={"force": 1.0, "speed": 0.1}, viscous_friction={"coefficient": 10.0},
           asymmetric_friction={"viscous_difference": 10.0, "coulomb_difference": 0.5},
           quadratic_drag={"coefficient": 50.0}, constant_force={"force": 1.0}),
}  # fmt: skip

#: the same laws where an ideal force drives masses that no screw carries
FORCE_DRIVEN = [
    ("link_1", "cubic_stiffness", {"k3": 3e5}),
    ("link_1", "quadratic_damping", {"c2": 20.0}),
    ("link_1", "dry_friction", {"force": 1.0}),
    ("link_1", "hysteresis", {"force": 2.0, "displacement": 5e-3}),
    ("link_1", "bumper", {"stiffness": 2000.0, "clearance": 5e-3}),
    ("link_1", "stiffness_drift", {"rate": 0.05}),
    ("link_2", "dry_friction", {"force": 1.0}),
    ("mass_1", "ground_friction", {"force": 1.0}),
    ("mass_2", "ground_friction", {"force": 1.0}),
    ("mass_2", "absorber", {"mass": 0.2, "frequency": 5.0}),
    ("mass_1", "constant_force", {"force": 5.0}),
    ("amplifier", "delay", {"time": 2.7e-3}),
]


def growing_gap() -> Array:
    """20 to 40 degrees."""
    return np.radians(np.linspace(20.0, 40.0, SAMPLES + 1))


RIGS = {
    "carriage": rigs.carriage, "damper": rigs.damper, "two_inertias": rigs.two_inertias, "geared": rigs.geared,
    "racked": lambda: rigs.geared("rack"), "served": rigs.served, "served_carriage": rigs.served_carriage,
}  # fmt: skip


def base_rig(case: Case) -> Rig:
    rig = RIGS.get(case.rig, rigs.lead_screw)()
    if case.rig == "loaded lead_screw":
        rig = rig.with_effect("motor_bearing", "viscous_friction", {"coefficient": 0.02})
    for place, effects in case.companions.items():
        for name, values in effects.items():
            rig = rig.with_effect(place, name, values)
    return rig


#: laws of other rigs, under three tones
OTHER_RIGS = [
    ("rotary_drive", "shaft", "backlash", {"lost_motion": 0.02}),
    ("rotary_drive", "shaft", "hysteresis", {"torque": 0.02, "displacement": 0.004}),
    ("rotary_drive", "load", "gravity", {"torque": 0.02, "phase": 0.5}),
    ("rotary_drive", "motor", "torque_ripple", {"relative": 0.2, "periods": 4.0, "phase": 0.3}),
    ("pendulum", "disk", "gravity", {"torque": 0.4, "phase": 1.0}),
    ("two_mass_stage", "carriage", "cogging", {"force": 3.0, "wave_number": 200.0, "phase": 0.3}),
    ("two_mass_stage", "table", "absorber", {"mass": 0.3, "frequency": 12.0, "damping_ratio": 0.05}),
]

#: friction at the motor, on a link and on the ground, a soft screw, a warm winding, at once
TOGETHER = (
    ("amplifier", "delay", {"time": 1.3e-3}),
    ("amplifier", "dead_zone", {"half_width": 0.1}),
    ("motor_circuit", "resistance_heating", {"gain": 0.5}),
    ("motor_bearing", "coulomb_friction", {"torque": 0.01}),
    ("motor_bearing", "viscous_friction", {"coefficient": 1e-3}),
    ("motor_bearing", "cogging", {"torque": 0.005}),
    ("screw", "compliance", {"compliance": 1e-6}),
    ("screw", "pitch_error", {"amplitude": 2e-5}),
    ("link_1", "dry_friction", {"force": 0.2}),
    ("link_2", "cubic_stiffness", {"k3": 1e10}),
    ("link_2", "hysteresis", {"force": 0.5}),
    ("mass_2", "absorber", {"mass": 0.3}),
    ("mass_3", "ground_friction", {"force": 0.2}),
    ("sensor_q3", "delay", {"time": 1.3e-3}),
)


def three_tones(seconds: float) -> Array:
    """(N+1,) V, three tones that begin softly."""
    t = SAMPLE_TIME_S * np.arange(round(seconds / SAMPLE_TIME_S) + 1)
    tones = np.sin(2 * np.pi * 3 * t) + 0.7 * np.sin(2 * np.pi * 7.3 * t + 0.3) + 0.5 * np.sin(2 * np.pi * 13 * t)
    return tones * -np.expm1(-t / 0.05)


def gaps() -> dict[str, Array]:
    """Half-gaps in degrees over three seconds, with every way in which a gap can change."""
    t = np.linspace(0.0, 1.0, SAMPLES + 1)
    return {
        "none": np.zeros(SAMPLES + 1),
        "constant": np.full(SAMPLES + 1, 30.0),
        "shrinks": 60.0 - 50.0 * t,
        "opens and closes": np.interp(t, [0.0, 0.2, 0.5, 0.8, 1.0], [0.0, 0.0, 50.0, 0.0, 0.0]),
        "S-curve": 100.0 * (10.0 * t**3 - 15.0 * t**4 + 6.0 * t**5),
        "steps": np.where(t < 0.4, 10.0, 50.0),
    }


def closed_loop_voltage(gap: Array, period_s: float) -> Array:
    """A proportional loop around the motor of Table 1: 15 V/rad towards +pi, -pi, ... and across the gap. (N,) V."""
    a = np.array([[-12.0 / 1e-3, 0.0, -0.1 / 1e-3], [0.0, 0.0, 1.0], [0.8 / 5e-6, 0.0, 0.0]])
    b = np.array([1.0 / 1e-3, 0.0, 0.0])
    step = expm(SAMPLE_TIME_S * np.block([[a, b[:, None]], [np.zeros((1, 4))]]))
    x, u = np.zeros(3), np.zeros(len(gap) - 1)
    for k in range(len(u)):
        side = 1.0 if (k * SAMPLE_TIME_S / period_s) % 1.0 < 0.5 else -1.0
        u[k] = 15.0 * (side * (np.pi + gap[k]) - x[1])
        x = step[:3, :3] @ x + step[:3, 3] * u[k]
    return u


def places() -> list[tuple[str, str, str]]:
    """Every entry of the catalogue that the kernel integrates; one without a case shows up with an empty place."""
    moved = [key for key in CATALOGUE if key[0] not in OF_A_MODEL and key not in IN_CLOSED_FORM]
    return [(k, n, place) for k, n in moved for place in getattr(CASES.get((k, n)), "places", ("",))]


def _effect(kind: str, name: str, place: str) -> Problem:
    case, without = CASES[kind, name], base_rig(CASES[kind, name])
    values = {p.name: p.typical for p in CATALOGUE[kind, name].parameters} | case.values
    u, gap = (
        rigs.random_steps(SAMPLES, HOLD, case.size_v),
        growing_gap() if without.only("gear") and case.grows else None,
    )
    return Problem(f"{place} {name}", without.with_effect(place, name, values), u, gap, without)


def _smooth() -> list[Problem]:
    """Where the order of the integration is measured: references a hundred times finer."""
    fine = {"rtol": 1e-12, "atol": 1e-13, "bits": 40}
    gap = np.full(1501, np.radians(30.0))
    one = rigs.oscillator().with_effect("link_1", "cubic_stiffness", {"k3": 2e6})
    one = one.with_effect("link_2", "quadratic_damping", {"c2": 50.0})
    two = rigs.lead_screw().with_effect("link_1", "cubic_stiffness", {"k3": 1e10})
    two = two.with_effect("link_2", "quadratic_damping", {"c2": 2e3})
    grows, u = np.radians(np.linspace(20.0, 40.0, 1501)), rigs.random_steps(1500, HOLD, 4.0)
    return [
        Problem("smooth", one, rigs.random_steps(1500, HOLD, 40.0), channels=("q2",), **fine),
        Problem("smooth behind a backlash", two, u, gap, channels=("q3",), **fine),
        Problem("linear behind a backlash", rigs.lead_screw(), u, grows, channels=("q3",), **fine),
    ]


@cache
def problems() -> dict[str, Problem]:
    """By name."""
    found = [_effect(*one) for one in places() if one[2]]
    plain, u = rigs.oscillator(), rigs.random_steps(SAMPLES, HOLD, 40.0)
    for place, name, values in FORCE_DRIVEN:
        found.append(Problem(f"oscillator {place} {name}", plain.with_effect(place, name, values), u, None, plain))
    for rig, place, name, values in OTHER_RIGS:
        changed = nominal_rig(rig).with_effect(place, name, values)
        found.append(Problem(f"{rig} {place} {name}", changed, 2.0 * three_tones(0.25)[:-1], bits=36))
    screw, u = rigs.lead_screw(), rigs.random_steps(SAMPLES, HOLD, 6.0, seed=3)
    for shape, degrees in gaps().items():
        gap = np.radians(degrees).round(12)
        found.append(Problem(f"gap {shape}", screw, u, gap, channels=("q3", "theta_m", "theta_d"), bits=36))
    together = screw
    for place, name, values in TOGETHER:
        together = together.with_effect(place, name, values)
    n = SAMPLES // 2
    u, gap = rigs.random_steps(n, HOLD, 4.0), growing_gap()[: n + 1]
    found.append(Problem("together", together, u, gap, channels=("q3", "theta_m")))
    t = np.linspace(0.0, 1.0, 20001)
    gap = np.radians(100.0) * (10.0 * t**3 - 15.0 * t**4 + 6.0 * t**5)
    found.append(Problem("twenty seconds", screw, closed_loop_voltage(gap, period_s=4.0), gap, channels=("q3",)))
    found += _smooth()
    u = rigs.random_steps(1000, HOLD, 6.0)
    found.append(Problem("contact", screw, u, np.full(1001, 0.5), channels=("q3", "theta_m"), bits=36))
    return {one.name: one for one in found}
