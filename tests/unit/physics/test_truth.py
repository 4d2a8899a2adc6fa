"""The compiled simulation against the independent solution in ``tests/reference``, effect by effect."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from reference import rigs, solve
from scipy.linalg import expm

from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

Array = NDArray[np.float64]
SAMPLE_TIME_S = 1e-3
SAMPLES = 3000
HOLD = 30  # samples between changes of the command

#: The largest error of q3: 1e-4 mm. The strokes here are 2 to 3 mm, so it is 4e-5 of the stroke.
Q3_M = 1e-7
#: The same at the screw's end: 1e-7 m over the lead.
THETA_RAD = Q3_M / 3.183e-4
#: The current follows the speed within a few samples (k_B/R = 8 mA s/rad): a fourth of a degree per second of error,
#: or a friction that lets go a tick late, is 1 mA for 0.1 ms where currents are 100 mA.
CURRENT_A = 1e-3
#: Rigs without a screw: the same share of the stroke, 4e-5.
SHARE = 4e-5


@dataclass(frozen=True)
class Case:
    """Where an effect is tried, with what sizes (those not given are the catalogue's typical ones)."""

    places: tuple[str, ...]
    values: dict[str, float] = field(default_factory=dict)
    size_v: float = 4.0
    rig: str = "lead_screw"
    companions: dict[str, dict[str, dict[str, float]]] = field(default_factory=dict)


SENSORS = ("sensor_q3", "sensor_theta_m")
#: a carriage without any friction would roll away: it has a viscous one wherever that is not what is tried
ROLLS = {"carriage": {"viscous_friction": {"coefficient": 200.0}}}
CARRIAGE = Case(("carriage",), size_v=3.0, rig="carriage", companions=ROLLS)

#: what turns freely would run away: it has a viscous friction
TURNS = {"rotor_1": {"viscous_friction": {"coefficient": 0.01}}}
SHAFT = Case(("shaft",), size_v=4.0, rig="two_inertias", companions=TURNS)

CASES: dict[tuple[str, str], Case] = {
    ("amplifier", "saturation"): Case(("amplifier",)),
    ("amplifier", "dead_zone"): Case(("amplifier",)),
    ("amplifier", "delay"): Case(("amplifier",)),
    ("amplifier", "gain_error"): Case(("amplifier",)),
    # an unloaded motor takes 0.1 W: here it turns against a viscous friction, so that its winding gets warm
    ("motor_circuit", "resistance_heating"): Case(
        ("motor_circuit",), {"gain": 0.05, "time_constant": 0.5}, size_v=20.0, rig="loaded lead_screw"
    ),
    ("motor_circuit", "torque_ripple"): Case(("motor_circuit",)),
    ("rotor", "coulomb_friction"): Case(("motor_bearing",)),
    ("rotor", "stribeck_friction"): Case(("motor_bearing",)),
    ("rotor", "viscous_friction"): Case(("motor_bearing",)),
    ("rotor", "asymmetric_friction"): Case(("motor_bearing",)),
    ("rotor", "cogging"): Case(("motor_bearing",)),
    ("rotor", "constant_load"): Case(("motor_bearing",)),
    ("rotor", "gravity"): Case(("motor_bearing",)),
    ("shaft", "cubic_stiffness"): replace(SHAFT, values={"k3": 300.0}),
    ("shaft", "quadratic_damping"): replace(SHAFT, values={"c2": 0.01}),
    ("shaft", "dry_friction"): SHAFT,
    ("shaft", "hysteresis"): SHAFT,
    ("shaft", "bumper"): replace(SHAFT, values={"stiffness": 5.0, "clearance": 0.01}),
    ("shaft", "stiffness_drift"): replace(SHAFT, values={"rate": 0.05}),
    ("shaft", "backlash"): SHAFT,
    ("gear", "backlash"): Case(("gear",)),
    ("link", "backlash"): Case(("link_2",), {"lost_motion": 2e-5}),
    ("mass", "viscous_friction"): Case(("mass_2", "mass_3"), {"coefficient": 20.0}),
    ("screw", "compliance"): Case(("screw",)),
    ("screw", "pitch_error"): Case(("screw",)),
    ("screw", "load_reaction"): Case(("screw",)),
    ("link", "cubic_stiffness"): Case(("link_1", "link_2")),
    ("link", "quadratic_damping"): Case(("link_1", "link_2")),
    ("link", "dry_friction"): Case(("link_1", "link_2")),
    ("link", "hysteresis"): Case(("link_1", "link_2")),
    ("link", "bumper"): Case(("link_1", "link_2")),
    ("link", "stiffness_drift"): Case(("link_1", "link_2")),
    ("mass", "ground_friction"): Case(("mass_2", "mass_3")),
    ("mass", "constant_force"): Case(("mass_2", "mass_3")),
    ("mass", "absorber"): Case(("mass_2", "mass_3")),
    ("sensor", "delay"): Case((*SENSORS, "sensor_i_m")),
    ("sensor", "gain_error"): Case(SENSORS),
    ("sensor", "offset"): Case(SENSORS, {"offset": 0.01}),
    ("carriage", "coulomb_friction"): CARRIAGE,
    ("carriage", "stribeck_friction"): CARRIAGE,
    ("carriage", "viscous_friction"): Case(("carriage",), {"coefficient": 200.0}, size_v=3.0, rig="carriage"),
    ("carriage", "asymmetric_friction"): CARRIAGE,
    # more than the waves' 20 N, but not so little that the carriage hesitates on a crest: there any error grows
    ("carriage", "cogging"): replace(CARRIAGE, size_v=2.0),
    ("carriage", "constant_force"): CARRIAGE,
    ("carriage", "absorber"): CARRIAGE,
    ("coupling", "backlash"): Case(("joint",), {"lost_motion": 5e-3}, size_v=60.0, rig="damper"),
    ("coupling", "cubic_stiffness"): Case(("joint",), {"k3": 1e8}, size_v=60.0, rig="damper"),
    ("coupling", "quadratic_damping"): Case(("joint",), {"c2": 200.0}, size_v=60.0, rig="damper"),
    ("coupling", "hysteresis"): Case(("joint",), {"force": 2.0, "displacement": 5e-4}, size_v=60.0, rig="damper"),
    ("brake", "stribeck_friction"): Case(("band",), {"force": 1.0, "speed": 0.1}, size_v=60.0, rig="damper"),
    ("brake", "viscous_friction"): Case(("band",), {"coefficient": 10.0}, size_v=60.0, rig="damper"),
    ("brake", "asymmetric_friction"): Case(
        ("band",), {"viscous_difference": 10.0, "coulomb_difference": 0.5}, size_v=60.0, rig="damper"
    ),
    ("brake", "constant_force"): Case(("band",), {"force": 1.0}, size_v=60.0, rig="damper"),
}

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


RIGS = {"carriage": rigs.carriage, "damper": rigs.damper, "two_inertias": rigs.two_inertias}


def base_rig(case: Case) -> Rig:
    rig = RIGS.get(case.rig, rigs.lead_screw)()
    if case.rig == "loaded lead_screw":
        rig = rig.with_effect("motor_bearing", "viscous_friction", {"coefficient": 0.02})
    for place, effects in case.companions.items():
        for name, values in effects.items():
            rig = rig.with_effect(place, name, values)
    return rig


def bounds(rig: Rig, truth: dict[str, Array]) -> dict[str, float]:
    """The largest error allowed, by sensor."""
    known = {"q3": Q3_M, "q2": Q3_M, "theta_m": THETA_RAD, "i_m": CURRENT_A}
    return {name: known.get(name, SHARE * float(np.ptp(truth[name]))) for name in rig.sensors}


def errors(got: dict[str, Array], truth: dict[str, Array]) -> dict[str, float]:
    return {name: float(np.abs(got[name] - truth[name]).max()) for name in truth}


def too_large(found: dict[str, float], allowed: dict[str, float]) -> dict[str, str]:
    return {n: f"{e:.1e} > {allowed[n]:.1e}" for n, e in found.items() if not e < allowed[n]}


def places() -> list[tuple[str, str, str]]:
    """Every entry of the catalogue; one without a case shows up with an empty place and fails."""
    return [(k, n, place) for k, n in CATALOGUE for place in getattr(CASES.get((k, n)), "places", ("",))]


@pytest.mark.parametrize(("kind", "name", "place"), places())
def test_every_effect_is_simulated_as_newton_would(kind: str, name: str, place: str) -> None:
    assert place, f"{kind}.{name} has no case here"
    case, effect = CASES[kind, name], CATALOGUE[kind, name]
    without = base_rig(case)
    values = {p.name: p.typical for p in effect.parameters} | case.values
    rig = without.with_effect(place, name, values)
    u = rigs.random_steps(SAMPLES, HOLD, case.size_v)
    gap = growing_gap() if rig.only("gear") else None
    truth = solve(rig, u, SAMPLE_TIME_S, gap).sensors
    got = simulate(rig, u, SAMPLE_TIME_S, gap).sensors
    allowed = bounds(rig, truth)
    plain = errors(simulate(without, u, SAMPLE_TIME_S, gap).sensors, truth)
    assert any(plain[s] > 10.0 * allowed[s] for s in rig.sensors), f"nothing to see: {plain}"
    found = errors(got, truth)
    assert not too_large(found, allowed), too_large(found, allowed)


@pytest.mark.parametrize(("place", "name", "values"), FORCE_DRIVEN)
def test_effects_of_a_force_driven_oscillator(place: str, name: str, values: dict[str, float]) -> None:
    without = rigs.oscillator()
    rig = without.with_effect(place, name, values)
    u = rigs.random_steps(SAMPLES, HOLD, 40.0)
    truth = solve(rig, u, SAMPLE_TIME_S).sensors
    allowed = bounds(rig, truth)
    plain = errors(simulate(without, u, SAMPLE_TIME_S).sensors, truth)
    assert any(plain[s] > 10.0 * allowed[s] for s in rig.sensors), plain
    found = errors(simulate(rig, u, SAMPLE_TIME_S).sensors, truth)
    assert not too_large(found, allowed), too_large(found, allowed)


def _gaps() -> dict[str, Array]:
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


@pytest.mark.parametrize("shape", _gaps())
def test_the_linear_rig_is_exact_however_the_gap_changes(shape: str) -> None:
    rig, gap = rigs.lead_screw(), np.radians(_gaps()[shape]).round(12)
    u = rigs.random_steps(SAMPLES, HOLD, 6.0, seed=3)
    truth = solve(rig, u, SAMPLE_TIME_S, gap)
    got = simulate(rig, u, SAMPLE_TIME_S, gap)
    # what is left is the contact's place: Ts/2^16 = 15 ns at 30 rad/s is 5e-7 rad, 1.5e-10 m
    assert errors(got.sensors, truth.sensors)["q3"] < 1e-9
    assert errors(got.sensors, truth.sensors)["theta_m"] < 1e-8
    assert np.abs(got.theta_d_rad - truth.theta_d_rad).max() < 1e-6


def test_effects_together() -> None:
    """Friction at the motor, on a link and on the ground, a soft screw, a warm winding, at once."""
    rig = rigs.lead_screw()
    for place, name, values in (
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
    ):
        rig = rig.with_effect(place, name, values)
    u = rigs.random_steps(SAMPLES // 2, HOLD, 4.0)
    gap = growing_gap()[: SAMPLES // 2 + 1]
    truth = solve(rig, u, SAMPLE_TIME_S, gap).sensors
    found = errors(simulate(rig, u, SAMPLE_TIME_S, gap).sensors, truth)
    assert found["q3"] < Q3_M
    assert found["theta_m"] < THETA_RAD


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


def test_twenty_seconds_of_the_papers_rig_in_closed_loop() -> None:
    """Voltages up to 146 V that change every millisecond, a gap that grows from 0 to 100 degrees."""
    t = np.linspace(0.0, 1.0, 20001)
    gap = np.radians(100.0) * (10.0 * t**3 - 15.0 * t**4 + 6.0 * t**5)
    u = closed_loop_voltage(gap, period_s=4.0)
    rig = rigs.lead_screw()
    truth = solve(rig, u, SAMPLE_TIME_S, gap)
    got = simulate(rig, u, SAMPLE_TIME_S, gap)
    assert truth.events >= 8
    assert np.ptp(truth.sensors["q3"]) > 2e-3
    assert errors(got.sensors, truth.sensors)["q3"] < Q3_M


def test_the_reference_has_converged() -> None:
    """Two tolerances, a hundredfold apart, agree a thousand times better than what is asked of the simulation."""
    rig = rigs.lead_screw().with_effect("motor_bearing", "coulomb_friction", {"torque": 0.02})
    rig = rig.with_effect("link_1", "dry_friction", {"force": 0.2})
    u, gap = rigs.random_steps(1000, HOLD, 4.0), growing_gap()[:1001]
    coarse = solve(rig, u, SAMPLE_TIME_S, gap).sensors
    fine = solve(rig, u, SAMPLE_TIME_S, gap, rtol=1e-12, atol=1e-13).sensors
    assert errors(coarse, fine)["q3"] < 1e-3 * Q3_M


def test_the_reference_against_a_closed_form() -> None:
    """A mass on a spring under a constant force: q = F/k (1 - e^{-zwt}(cos wd t + ...))."""
    rig = rigs.oscillator(damping=0.0).with_effect("mass_2", "ground_friction", {"force": 1e5})
    n, k, m, force = 1000, 4000.0, 1.0, 10.0  # both springs act on mass_1: mass_2 is held
    truth = solve(rig, np.full(n, force), SAMPLE_TIME_S)
    exact = force / k * (1.0 - np.cos(np.sqrt(k / m) * truth.t_s))
    assert np.abs(truth.sensors["q1"] - exact).max() < 1e-11
