"""Sensors of force and torque: what a spring of any kind pulls its ends together with."""

from dataclasses import replace

import numpy as np
import pytest
from reference import rigs

from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.simulate import simulate
from dtbacklash.prove.simulator.given import Loop
from dtbacklash.prove.simulator.rig import simulate_other

STEP_S, SAMPLES = 1e-3, 1200
#: rig, spring, its ends, what it shows
SPRINGS = [
    (rigs.oscillator, "link_2", ("mass_1", "mass_2"), "force"),
    (rigs.two_inertias, "shaft", ("rotor_1", "rotor_2"), "torque"),
    (rigs.geared, "teeth", ("rotor", "pulley"), "torque"),
    (rigs.geared, "belt", ("pulley", "carriage"), "force"),
    (lambda: rigs.geared("rack"), "rack", ("pulley", "carriage"), "force"),
]
each = pytest.mark.parametrize(("base", "spring", "ends", "quantity"), SPRINGS, ids=[s[1] for s in SPRINGS])


def with_sensors(rig: Rig, spring: str, ends: tuple[str, str], quantity: str) -> Rig:
    """A rig that shows the effort of a spring, and how its ends move."""
    sensors = {"effort": {"of": spring, "quantity": quantity}}
    for end in ends:
        sensors |= {f"{end}_{q}": {"of": end, "quantity": q} for q in ("position", "velocity")}
    return build_rig(replace(rig.config, sensors=sensors))


@each
def test_it_shows_spring_and_damper(base, spring, ends, quantity):
    rig = with_sensors(base(), spring, ends, quantity)
    seen, element = simulate(rig, rigs.random_steps(SAMPLES, 30, 4.0), STEP_S).sensors, rig.elements[spring]
    a, b = ends
    lever = {"teeth": 0.25, "belt": 0.03, "rack": 0.03}.get(spring, 1.0)
    stretch, rate = (seen[f"{b}_{q}"] - lever * seen[f"{a}_{q}"] for q in ("position", "velocity"))
    expected = element.values["stiffness"] * stretch + element.values["damping"] * rate
    assert np.ptp(expected) > 0.0
    assert np.allclose(seen["effort"], expected, rtol=1e-9, atol=1e-9 * np.ptp(expected))


@each
def test_both_simulators_show_alike_what_else_is_in_it(base, spring, ends, quantity):
    plain = with_sensors(base(), spring, ends, quantity)
    values = {"k3": {"force": 1e11, "torque": 1e4}[quantity] if spring != "link_2" else 1e6}
    rig, u = plain.with_effect(spring, "cubic_stiffness", values), rigs.random_steps(SAMPLES, 30, 4.0)
    shown = simulate(rig, u[:-1], STEP_S, substeps=32).sensors["effort"]
    other = simulate_other(rig, Loop(False, u, 0.0 * u, 0.0 * u), STEP_S).truth["effort"]
    size = float(np.std(shown))
    assert float(np.std(shown - simulate(plain, u[:-1], STEP_S).sensors["effort"])) > 1e-3 * size
    assert float(np.std(shown - other)) < 1e-3 * size


def test_it_shows_a_law_of_time_at_its_time():
    rig = with_sensors(rigs.oscillator(), "link_2", ("mass_1", "mass_2"), "force")
    drifting = rig.with_effect("link_2", "stiffness_drift", {"rate": 0.5})
    response = simulate(drifting, rigs.random_steps(SAMPLES, 30, 40.0), STEP_S)
    seen, values = response.sensors, rig.elements["link_2"].values
    stretch, rate = (seen[f"mass_2_{q}"] - seen[f"mass_1_{q}"] for q in ("position", "velocity"))
    stiffness = values["stiffness"] * (1.0 + 0.5 * response.t_s)
    assert np.allclose(seen["effort"], stiffness * stretch + values["damping"] * rate, rtol=1e-9, atol=1e-9)
