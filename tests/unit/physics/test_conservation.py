"""Energy: kept without dampers, lost to friction, and what is at rest stays at rest."""

from __future__ import annotations

import numpy as np
import pytest
from reference import rigs

from dtbacklash.physics.assembly import state_names
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

SAMPLE_TIME_S, PUSHED = 1e-3, 50


def pulse(samples: int, volts: float = 40.0) -> np.ndarray:
    u = np.zeros(samples)
    u[:PUSHED] = volts
    return u


def energy(rig: Rig, states: np.ndarray) -> np.ndarray:
    """Kinetic energy and that of the two springs, J, at every sample."""
    names = state_names(rig)
    q = {name: states[:, j] for j, name in enumerate(names)}
    v = {name: states[:, len(names) + j] for j, name in enumerate(names)}
    k = rig.elements["link_1"].values["stiffness"]
    kinetic = sum(0.5 * rig.elements[name].values["mass"] * v[name] ** 2 for name in names)
    return kinetic + 0.5 * k * (q["mass_1"] ** 2 + (q["mass_2"] - q["mass_1"]) ** 2)


@pytest.mark.parametrize("substeps", [1, 4])
def test_an_undamped_chain_keeps_its_energy(substeps: int) -> None:
    rig = rigs.oscillator(damping=0.0)
    states = simulate(rig, pulse(20000), SAMPLE_TIME_S, substeps=substeps).states
    after = energy(rig, states)[PUSHED:]
    assert np.abs(after / after[0] - 1.0).max() < 1e-10


def test_a_constant_force_does_the_work_that_shows_as_energy() -> None:
    rig = rigs.oscillator(damping=0.0).with_effect("mass_2", "constant_force", {"force": 5.0})
    response = simulate(rig, np.zeros(3000), SAMPLE_TIME_S, substeps=1)
    work = 5.0 * response.sensors["q2"]
    gained = energy(rig, response.states)
    assert np.abs(gained - work).max() < 1e-10 * gained.max()


@pytest.mark.parametrize(
    ("place", "name"), [("mass_2", "ground_friction"), ("link_2", "dry_friction"), ("link_1", "dry_friction")]
)
def test_friction_takes_energy_and_never_gives_any(place: str, name: str) -> None:
    rig = rigs.oscillator(damping=0.0).with_effect(place, name, {"force": 1.0})
    after = energy(rig, simulate(rig, pulse(4000), SAMPLE_TIME_S).states)[PUSHED:]
    # the correction of a step is of second order: 1e-8 of the energy may come back within a sample
    assert np.all(np.diff(after) < 1e-8 * after[0])
    assert after[-1] < 0.9 * after[0]


def test_friction_ends_the_motion_and_holds_within_its_level() -> None:
    rig = rigs.oscillator(damping=20.0).with_effect("mass_2", "ground_friction", {"force": 2.0})
    response = simulate(rig, pulse(6000), SAMPLE_TIME_S)
    rest = response.sensors["q2"][-2000:]
    assert np.all(rest == rest[0])
    assert rest[0] != 0.0  # it stopped somewhere else than it began: that takes friction
    # at rest mass_1 hangs between two equal springs, half of mass_2's way: the spring pulls with k q2 / 2
    assert abs(0.5 * 2000.0 * rest[0]) <= 2.0 + 1e-9


def test_a_force_below_the_level_moves_nothing() -> None:
    rig = rigs.carriage().with_effect("carriage", "coulomb_friction", {"force": 20.0})
    u = np.full(500, 19.99 / 35.0)
    assert np.all(simulate(rig, u, SAMPLE_TIME_S).sensors["q"] == 0.0)
    assert simulate(rig, 20.1 / 35.0 * np.ones(500), SAMPLE_TIME_S).sensors["q"][-1] > 0.0


def test_the_viscous_carriage_reaches_its_speed() -> None:
    """m v' = F - c v from rest: v = F/c (1 - e^{-ct/m}), to rounding."""
    rig = rigs.carriage().with_effect("carriage", "viscous_friction", {"coefficient": 200.0})
    response = simulate(rig, np.full(2000, 2.0), SAMPLE_TIME_S)
    exact = 70.0 / 200.0 * (1.0 - np.exp(-200.0 / 95.0 * response.t_s))
    assert np.abs(response.sensors["v"] - exact).max() < 1e-12


def test_a_rig_at_rest_stays_at_rest() -> None:
    rig = rigs.lead_screw().with_effect("motor_bearing", "coulomb_friction", {"torque": 0.02})
    response = simulate(rig, np.zeros(200), SAMPLE_TIME_S, np.full(201, 0.3))
    assert not response.states.any()
    assert not response.theta_d_rad.any()


def test_the_gear_stays_within_its_gap() -> None:
    gap = np.radians(np.linspace(5.0, 60.0, 3001))
    response = simulate(rigs.lead_screw(), rigs.random_steps(3000, 30, 6.0), SAMPLE_TIME_S, gap)
    lag = response.sensors["theta_m"] - response.theta_d_rad
    assert np.all(np.abs(lag) <= gap + 1e-6)
    assert np.abs(np.abs(lag) - gap).min() < 1e-12  # and it is reached


def test_the_rigs_own_backlash_adds_to_the_profile() -> None:
    u = rigs.random_steps(1000, 30, 6.0)
    rig = rigs.lead_screw()
    own = rig.with_effect("gear", "backlash", {"half_gap": 0.25})
    together = simulate(own, u, SAMPLE_TIME_S, np.full(1001, 0.25))
    profile = simulate(rig, u, SAMPLE_TIME_S, np.full(1001, 0.5))
    assert np.array_equal(together.states, profile.states)
