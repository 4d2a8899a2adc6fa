"""Laws of one's own in the simulation: as the same law of the package would act, and as the equations say."""

import math
import pickle

import numpy as np
import pytest
from nominal import nominal_rig
from reference import rigs
from scipy.integrate import solve_ivp

from dtbacklash.physics import catalogue
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.kernel import dispatch
from dtbacklash.physics.rig_file import rig_content, rig_of
from dtbacklash.physics.simulate import simulate, simulate_plant

STEP_S = 1e-3


pytestmark = pytest.mark.usefixtures("as_before")


def declared(kind, law, parameters, **more):
    units = {name: {"unit": unit, "low": 0, "high": 1e12, "start": start} for name, (unit, start) in parameters.items()}
    return {"acts_on": kind, "law": law, "parameters": units, **more}


#: location -> kind, law of one's own, its parameters, the effect of the package that it is, its values
SAME = {
    "motor_bearing": ("rotor", "torque*sin(q + phase)", {"torque": ("N m", 0.03), "phase": ("1", 0.7)}, "gravity"),
    "link_1": ("link", "k3*s**3", {"k3": ("N/m^3", 1e10)}, "cubic_stiffness"),
    "amplifier": (
        "amplifier", "max(u - half_width, 0) + min(u + half_width, 0)", {"half_width": ("V", 0.5)}, "dead_zone",
    ),
    "motor_circuit": (
        "motor_circuit", "torque_constant*i*relative*sin(periods*q + phase)",
        {"relative": ("1", 0.1), "periods": ("1", 5.0), "phase": ("1", 0.2)}, "torque_ripple",
    ),
    "mass_3": ("mass", "force*direction**2", {"force": ("N", 0.3)}, "ground_friction"),
}  # fmt: skip


@pytest.mark.parametrize("place", SAME)
def test_a_law_at_an_address_acts_as_the_same_law_of_the_package(place):
    kind, law, parameters, shipped = SAME[place]
    catalogue.declare({"mine": declared(kind, law, parameters)}, "rig.laws")
    values = {name: start for name, (_, start) in parameters.items()}
    rig, u = rigs.lead_screw(), rigs.random_steps(600, 30, 4.0)
    plain = simulate(rig, u, STEP_S).sensors["q3"]
    theirs = simulate(rig.with_effect(place, shipped, values), u, STEP_S).sensors["q3"]
    mine = simulate(rig.with_effect(place, "mine", values), u, STEP_S).sensors["q3"]
    assert np.abs(mine - theirs).max() <= 1e-12 * np.abs(theirs).max()
    assert np.abs(theirs - plain).max() > 1e-7


def test_a_plant_that_another_process_gets_finds_its_laws_there():
    law = declared("rotor", "torque*sin(3*q)", {"torque": ("N m", 0.03)})
    rig = rig_of(rig_content(rigs.lead_screw()) | {"laws": {"mine": law}}).with_effect(
        "motor_bearing", "mine", {"torque": 0.03}
    )
    plant, u = compile_plant(rig, STEP_S), rigs.random_steps(300, 30, 4.0)
    here = simulate_plant(plant, u, np.zeros(301), np.zeros(301))[0]
    sent = pickle.dumps(plant)
    known = len(dispatch.OTHERS)
    del CATALOGUE["rotor", "mine"]
    there = pickle.loads(sent)
    assert (there.law[:, 0] == -1 - known).any()
    assert np.array_equal(simulate_plant(there, u, np.zeros(301), np.zeros(301))[0], here)
    assert type(there) is type(plant)


def with_law(name, place, law, values):
    """A rig of the package with a law of one's own, or with one of the package that it asks for."""
    catalogue.declare({place[1]: law}, "rig.laws")
    return nominal_rig(name).with_effect(*place, values)


def integrated(derivative, states, u, shown):
    """(N+1,) what is shown of the states, by an independent integrator: y' = derivative(y, u) from rest."""
    y, found = [0.0] * states, [0.0]
    for volts in u:
        y = solve_ivp(lambda t, y, v: derivative(y, v), (0.0, STEP_S), y, args=(volts,), rtol=1e-9, atol=1e-13).y[:, -1]
        found.append(y[shown])
    return np.array(found)


def values_of(rig):
    return {name: one.value for name, one in rig.config.parameters.items()}


def swinging(rig, effort, rate=lambda v, z: 0.0, beside=lambda q, v: 0.0):
    """A force-driven mass on a spring: m q'' = gain u - k q - c q' + effort(v, z) + beside(q, v), z' = rate(v, z)."""
    p = values_of(rig)

    def derivative(y, volts):
        q, v, z = y
        pushed = p["gain"] * volts - p["k"] * q - p["c"] * v + effort(v, z) + beside(q, v)
        return [v, pushed / p["m"], rate(v, z)]

    return derivative, 3, 0


def spinning(rig, torque):
    """A disk on a torque motor, and a torque that depends on its angle."""
    p = values_of(rig)

    def derivative(y, volts):
        q, v = y
        return [v, (p["K_t"] * volts + torque(q)) / p["J"]]

    return derivative, 2, 0


def turning(rig, share):
    """A motor, a shaft and a load; ``share`` : of the motor's constant that is there at an angle."""
    p = values_of(rig)

    def derivative(y, volts):
        i, q, v, ql, vl = y
        shaft = p["k"] * (q - ql) + p["c"] * (v - vl)
        return [
            (volts - p["R"] * i - p["k_m"] * v) / p["L"], v, (p["k_m"] * i * share(q) - shaft) / p["J_m"],
            vl, shaft / p["J_l"],
        ]  # fmt: skip

    return derivative, 5, 1


LAG = declared("mass", "-k*z", {"k": ("N s/m", 8.0), "tau": ("s", 1.0)}, **{"z'": "(v - z)/tau"})
#: a law with an effect of its own at a place of a rig, and the equations with it
TRUE = {
    "lag": ("oscillator", ("mass", "mine"), LAG, {"k": 8.0, "tau": 0.02},
            lambda rig: swinging(rig, lambda v, z: -8.0 * z, lambda v, z: (v - z) / 0.02)),
    "dahl_friction": ("oscillator", ("mass", "dahl_friction"), "packaged", {"level": 1.5, "reach": 1e-3},
                      lambda rig: swinging(rig, lambda v, z: -1.5 * z, lambda v, z: (v - abs(v) * z) / 1e-3)),
    "contact_damping": (
        "oscillator", ("spring", "contact_damping"), "packaged", {"share": 0.8, "reach": 2e-3},
        lambda rig: swinging(
            rig, lambda v, z: 0.0, beside=lambda q, v: 0.8 * values_of(rig)["c"] * v * max(1.0 - abs(q) / 2e-3, 0.0)
        ),
    ),
    "cogging_harmonics": (
        "pendulum", ("disk", "cogging_harmonics"), "packaged",
        {"first": 0.05, "waves": 7.0, "phase": 0.3, "share": 0.4, "second_phase": -1.0},
        lambda rig: spinning(rig, lambda q: 0.05 * math.sin(7.0 * q + 0.3) + 0.02 * math.sin(14.0 * q - 1.0)),
    ),
    "directional_stribeck": (
        "oscillator", ("mass", "directional_stribeck"), "packaged", {"rise": 0.05, "share": -0.6, "speed": 0.02},
        lambda rig: swinging(
            rig, lambda v, z: -0.05 * (np.sign(v) - 0.6) * math.exp(-((v / 0.02) ** 2)) * (v != 0.0)
        ),
    ),
    "coil_ends": ("rotary_drive", ("motor", "coil_ends"), "packaged", {"fall": 0.5, "middle": 0.2},
                  lambda rig: turning(rig, lambda q: 1.0 - 0.5 * (q - 0.2) ** 2)),
}  # fmt: skip


@pytest.mark.parametrize("name", TRUE)
def test_a_law_acts_as_its_equations_say(name):
    rig_name, place, law, values, equations = TRUE[name]
    rig = with_law(rig_name, place, law, values)
    u = 1.5 * np.sin(2.0 * math.pi * 4.0 * STEP_S * np.arange(400))
    truth = integrated(*equations(rig)[:2], u, equations(rig)[2])
    shown = next(iter(rig.sensors))
    found = simulate(rig, u, STEP_S).sensors[shown]
    without = simulate(rig.with_effect(*place, None), u, STEP_S).sensors[shown]
    assert np.abs(found - truth).max() < 1e-3 * np.abs(truth - without).max()


def test_a_memory_that_falls_at_once_is_no_memory():
    """However fast it falls beside a step: the lag of a nanosecond is a viscous friction."""
    u = rigs.random_steps(400, 30, 1.0)
    rig = with_law("oscillator", ("mass", "mine"), LAG, {"k": 8.0, "tau": 1e-9})
    viscous = rig.with_effect("mass", "mine", None).with_effect("mass", "viscous_friction", {"coefficient": 8.0})
    shown = simulate(viscous, u, STEP_S).sensors["x"]
    assert np.abs(simulate(rig, u, STEP_S).sensors["x"] - shown).max() < 1e-4 * np.abs(shown).max()
