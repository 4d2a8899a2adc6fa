"""Sensors of acceleration, against the sum of all forces in the independent reference."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig
from reference import machines, newton, rigs, solve
from told import refused

from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.simulate import simulate
from dtbacklash.prove.simulator.given import Loop
from dtbacklash.prove.simulator.rig import simulate_other

STEP_S, SAMPLES = 1e-3, 600
#: rig, body, effects, size of the command, share by which the two simulations may miss the reference: rms
CASES = {
    "linear": (rigs.oscillator, "mass_2", (), 40.0, 1e-8, 1e-6),
    "spring": (rigs.oscillator, "mass_1", (("link_1", "cubic_stiffness", {"k3": 2e6}),), 40.0, 1e-4, 1e-3),
    "friction": (rigs.oscillator, "mass_1", (("mass_1", "ground_friction", {"force": 2.0}),), 30.0, 2e-3, 3e-2),
    "friction beside": (rigs.oscillator, "mass_2", (("mass_1", "ground_friction", {"force": 2.0}),), 30.0, 2e-3, 3e-2),
    "across a spring": (rigs.oscillator, "mass_2", (("link_2", "dry_friction", {"force": 4.0}),), 40.0, 5e-3, 5e-2),
    "servo": (rigs.served, "rotor", (("servo", "effort_limit", {"effort": 1.0}),), 0.25, 1e-4, 1e-3),
    "teeth": (rigs.geared, "carriage", (("teeth", "load_friction", {"share": 0.3}),), 6.0, 5e-3, 5e-2),
    "motor": (rigs.lead_screw, "motor_bearing", (("motor_bearing", "viscous_friction", {"coefficient": 1e-3}),), 4.0,
              1e-6, 1e-5),
}  # fmt: skip


def accelerating(rig: Rig, body: str, effects: tuple) -> Rig:
    """The rig with a sensor of the acceleration of a body beside its own, and with effects."""
    sensors = dict(rig.config.sensors) | {"a": {"of": body, "quantity": "acceleration"}}
    rig = build_rig(replace(rig.config, sensors=sensors))
    for place, name, values in effects:
        rig = rig.with_effect(place, name, values)
    return rig


def reference(plain: Rig, body: str, u: np.ndarray) -> np.ndarray:
    """(N+1,) from the reference's states at the samples, under the command of the sample just passed."""
    found, it = solve(plain, u, STEP_S), machines.machine(plain)
    out = np.zeros(len(u) + 1)
    it.gear = newton.RIGID if it.screw else newton.FREE
    for k in range(1, len(u) + 1):
        it.drive, x = it.amplify(float(u[k - 1])), found.states[k].tolist()
        for contact in it.contacts:
            slip = it.slip(k * STEP_S, x, contact)
            contact.mode = int(np.sign(slip)) if abs(slip) > 1e-9 else 0
        out[k] = it.rates(k * STEP_S, x)[it.bodies[body].v]
    return out


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("name", CASES)
def test_it_shows_what_all_forces_make(name):
    base, body, effects, size, share, other_share = CASES[name]
    rig, u = accelerating(base(), body, effects), rigs.random_steps(SAMPLES, 30, size)
    plain = base()
    for one in effects:
        plain = plain.with_effect(*one)
    truth = reference(plain, body, u)
    shown = simulate(rig, u, STEP_S, substeps=32).sensors["a"]
    others = simulate_other(rig, Loop(False, np.append(u, 0.0), np.zeros(SAMPLES + 1), np.zeros(SAMPLES + 1)), STEP_S)
    assert rms(truth) > 0.0
    assert rms(shown[1:] - truth[1:]) < share * rms(truth)
    assert rms(others.truth["a"][1:] - truth[1:]) < other_share * rms(truth)


def test_it_is_zero_where_friction_holds():
    rig = accelerating(rigs.oscillator(), "mass_2", (("mass_2", "ground_friction", {"force": 1e4}),))
    assert np.all(simulate(rig, rigs.random_steps(300, 30, 20.0), STEP_S).sensors["a"] == 0.0)


def test_it_may_look_late():
    rig = accelerating(rigs.oscillator(), "mass_2", ())
    late = rig.with_effect("sensor_a", "delay", {"time": 2.0 * STEP_S})
    u = rigs.random_steps(300, 30, 20.0)
    assert np.allclose(simulate(late, u, STEP_S).sensors["a"][2:], simulate(rig, u, STEP_S).sensors["a"][:-2])
    between = rig.with_effect("sensor_a", "delay", {"time": 1.5 * STEP_S})
    middle = simulate(between, u, STEP_S).sensors["a"]
    fine = simulate(rig, np.repeat(u, 2), 0.5 * STEP_S).sensors["a"]
    assert np.allclose(middle[2:], fine[1:-3:2], rtol=1e-9, atol=1e-9)


def test_other_sensors_do_not_feel_it():
    rig, plain, u = accelerating(rigs.geared(), "carriage", ()), rigs.geared(), rigs.random_steps(300, 30, 6.0)
    for name in plain.sensors:
        assert np.array_equal(simulate(rig, u, STEP_S).sensors[name], simulate(plain, u, STEP_S).sensors[name])


def test_a_mass_on_a_rigid_screw_has_none():
    with refused("sensors.a.of=mass_1: the acceleration of a mass that no rigid screw carries"):
        simulate(accelerating(nominal_rig("lead_screw"), "mass_1", ()), np.zeros(10), STEP_S)
