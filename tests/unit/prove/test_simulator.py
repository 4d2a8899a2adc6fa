"""The concealing simulator against the diagnosis' own: the same physics from other formulations, another integrator."""

import math

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.physics.catalogue import effects_of
from dtbacklash.physics.rig import build_rig
from dtbacklash.physics.simulate import simulate
from dtbacklash.prove.draw import entries
from dtbacklash.prove.simulator.given import Errors, Loop, Unlisted
from dtbacklash.prove.simulator.library import lib
from dtbacklash.prove.simulator.rig import simulate_other

STEP_S = 1e-3
#: what counts as noise of a sensor, SI
NOISE = {"theta_m": 5e-4, "q3": 1e-6, "i_m": 1e-3, "q2": 1e-6}
#: how far the two simulations may differ, as a share of what the effect itself changes: smooth knees and equal
#: equations, and laws with a rest or a contact, where the formulations differ
SHARE, SHARE_CONTACT = 2e-3, 1e-2
CONTACT = {
    "load_friction",
    "coulomb_friction",
    "stribeck_friction",
    "dry_friction",
    "ground_friction",
    "backlash",
    "resistance_heating",
}
SIZES = {
    "saturation": {"limit": 2.0}, "torque_ripple": {"relative": 0.2, "periods": 3.0, "phase": 0.3},
    "resistance_heating": {"gain": 90.0, "time_constant": 0.5}, "stribeck_friction": {"torque": 0.03, "speed": 5.0},
    "coulomb_friction": {"torque": 0.05}, "cogging": {"torque": 0.02, "periods": 7.0, "phase": 0.3},
    "backlash": {"half_gap": 0.3}, "hysteresis": {"force": 1.0, "displacement": 3e-5},
    "bumper": {"stiffness": 1e4, "clearance": 5e-5},
    "absorber": {"mass": 0.5, "frequency": 9.0, "damping_ratio": 0.05},
}  # fmt: skip
LINK_PLAY = {"lost_motion": 2e-5}
RIG = nominal_rig("lead_screw")


def open_loop(u):
    """The loop of a given command; the last sample has no command of its own."""
    none = np.zeros(len(u) + 1)
    return Loop(False, np.append(u, 0.0), none, none)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def test_without_effects_both_agree_to_a_millionth_of_the_noise(lead_screw, command):
    run, house = simulate_other(lead_screw, open_loop(command), STEP_S), simulate(lead_screw, command, STEP_S)
    for name, noise in NOISE.items():
        assert rms(run.truth[name] - house.sensors[name]) < 1e-6 * noise


@pytest.mark.parametrize(("place", "name"), entries(RIG), ids=".".join)
def test_every_effect_agrees_to_a_small_share_of_itself(place, name, command):
    effect = effects_of(RIG.kind_at(place))[name]
    values = LINK_PLAY if place.startswith("link") and name == "backlash" else SIZES.get(name)
    rig = RIG.with_effect(place, name, values or {effect.size.name: effect.size.typical})
    u = command[:2000]
    run, plain = simulate_other(rig, open_loop(u), STEP_S), simulate(RIG, u, STEP_S)
    house = simulate(rig, u, STEP_S, substeps=32)
    changed = {n: rms(house.sensors[n] - plain.sensors[n]) for n in NOISE}
    shown = max(changed, key=lambda n: changed[n] / NOISE[n])
    assert changed[shown] > 0.0
    share = SHARE_CONTACT if name in CONTACT else SHARE
    assert rms(run.truth[shown] - house.sensors[shown]) < share * changed[shown]


def test_friction_with_levels_that_differ_by_direction_agrees(command):
    """Beside dry friction that is larger, as it is meant, and beside a viscous difference."""
    directed = {"coulomb_difference": 0.02, "viscous_difference": 5e-4}
    plain = RIG.with_effect("motor_bearing", "coulomb_friction", {"torque": 0.05})
    rig = plain.with_effect("motor_bearing", "asymmetric_friction", directed)
    u = command[:2000]
    run, house = simulate_other(rig, open_loop(u), STEP_S), simulate(rig, u, STEP_S, substeps=32)
    changed = rms(house.sensors["theta_m"] - simulate(plain, u, STEP_S).sensors["theta_m"])
    assert changed > 100.0 * NOISE["theta_m"]
    assert rms(run.truth["theta_m"] - house.sensors["theta_m"]) < SHARE_CONTACT * changed


def test_several_effects_at_once_on_another_rig_with_other_values(command):
    """Four masses, stiff and soft links, other parameters, a screw that gives way."""
    config = RIG.config
    parameters = {name: vars(p) | {} for name, p in config.parameters.items()}
    for name, factor in {"k": 0.6, "m": 1.7, "J": 3.0, "R": 0.5, "p": 2.0}.items():
        parameters[name]["value"] *= factor
    link = {"kind": "link", "between": ["mass_3", "mass_4"], "stiffness": "k", "damping": "c"}
    elements = {**config.elements, "mass_4": {"kind": "mass", "mass": "m"}, "link_3": link}
    changed = type(config)(
        "longer", "", {n: type(config.parameters[n])(**v) for n, v in parameters.items()}, elements,
        {"screw": {"compliance": {"compliance": 2e-6}}, "link_2": {"cubic_stiffness": {"k3": 1e9}},
         "sensor_q4": {"delay": {"time": 0.0023}}, "amplifier": {"delay": {"time": 0.0017}}},
        {**config.sensors, "q4": {"of": "mass_4", "quantity": "position"},
         "v2": {"of": "mass_2", "quantity": "velocity"}, "q1": {"of": "mass_1", "quantity": "position"}},
    )  # fmt: skip
    rig = build_rig(changed)
    u = command[:1000]
    run, house = simulate_other(rig, open_loop(u), STEP_S), simulate(rig, u, STEP_S, substeps=32)
    for name in rig.sensors:
        assert rms(run.truth[name] - house.sensors[name]) < 1e-5 * rms(house.sensors[name])


def test_the_closed_loop_follows_and_its_recording_replays(lead_screw):
    """The house's plant, driven by the recorded command, gives the recorded signals: no half sample is lost."""
    t_s = STEP_S * np.arange(2001)
    none = np.zeros(t_s.size)
    r = 1e-3 * np.where(t_s < 0.2, 0.0, 1.0)
    loop = Loop(True, r, none, none, gain=15.0, filter_rad_s=20.0, integral=0.3)
    errors = Errors({"q3": 1e-6}, {"theta_m": 1.5e-3}, np.random.default_rng(1).standard_normal((2001, 4)))
    run = simulate_other(lead_screw, loop, STEP_S, errors)
    assert not run.diverged
    assert abs(run.truth["q3"][-200:].mean() - 1e-3) < 2e-5
    house = simulate(lead_screw, run.u[:-1], STEP_S)
    assert rms(run.truth["q3"] - house.sensors["q3"]) < 1e-11
    counts = run.seen["theta_m"] / 1.5e-3
    assert np.abs(counts - np.round(counts)).max() < 1e-6
    assert rms(run.seen["q3"] - run.truth["q3"]) == pytest.approx(1e-6, rel=0.1)


def test_an_unstable_loop_is_noticed(lead_screw):
    none = np.zeros(2001)
    loop = Loop(True, none + 1e-3, none, none, gain=1e6, filter_rad_s=50.0, limit=math.inf)
    run = simulate_other(lead_screw.with_effect("amplifier", "delay", {"time": 0.006}), loop, STEP_S)
    assert run.diverged


def test_a_mass_that_changes_with_the_position_keeps_its_energy():
    """A free body with m(q) = m (1 + a q): a constant force's work is its kinetic energy m(q) v^2/2."""
    config = RIG.config
    links = {"link_1": {"kind": "link", "between": ["mass_1", "mass_2"], "stiffness": "k"}}
    elements = {n: e for n, e in config.elements.items() if not n.startswith(("link", "mass_2"))}
    elements |= {"mass_2": {"kind": "mass", "mass": "m"}, **links}
    parameters = {**config.parameters, "k": type(config.parameters["k"])(1e-9, "N/m", 0.1)}
    effects = {"mass_3": {"constant_force": {"force": 1.0}}}
    rig = build_rig(type(config)("free", "", parameters, elements, effects, config.sensors))
    none = np.zeros(1001)
    run = simulate_other(
        rig, Loop(False, none, none, none), STEP_S, None, Unlisted("mass_3", "position_mass", 0.5, 0.1)
    )
    at = 2 + run.bodies.index("mass_3")
    q, v = run.states[:, at], run.states[:, at + len(run.bodies)]
    energy = 0.5 * config.parameters["m"].value * (1.0 + 0.5 * q / 0.1) * v**2
    assert energy[1:] == pytest.approx(1.0 * q[1:], rel=1e-6)  # the work of the constant force


def test_a_bristle_stretches_like_a_spring_and_then_slides_and_softplus_does_not_overflow():
    bristle_after = lib.dtb_bristle_after
    assert (lib.dtb_softplus(800.0), lib.dtb_softplus(-800.0)) == (800.0, 0.0)
    assert bristle_after(0.0, 1e-9, 2.0, 1e6) == pytest.approx(1e-9, rel=1e-3)
    assert bristle_after(0.0, 1e-3, 2.0, 1e6) == pytest.approx(2e-6)
    assert bristle_after(2e-6, -1e-3, 2.0, 1e6) == pytest.approx(-2e-6)
    assert bristle_after(1e-6, 1e-12, 0.0, 1e6) < 1e-300  # nothing holds it
