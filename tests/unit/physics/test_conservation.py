"""Energy that nothing takes is kept, and what is at rest stays at rest."""

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


def test_friction_ends_the_motion_and_holds_within_its_level() -> None:
    rig = rigs.oscillator(damping=20.0).with_effect("mass_2", "ground_friction", {"force": 2.0})
    response = simulate(rig, pulse(6000), SAMPLE_TIME_S)
    rest = response.sensors["q2"][-2000:]
    assert np.all(rest == rest[0])
    assert rest[0] != 0.0  # it stopped somewhere else than it began: that takes friction
    # at rest mass_1 hangs between two equal springs, half of mass_2's way: the spring pulls with k q2 / 2
    assert abs(0.5 * 2000.0 * rest[0]) <= 2.0 + 1e-9


def test_a_rig_at_rest_stays_at_rest() -> None:
    rig = rigs.lead_screw().with_effect("motor_bearing", "coulomb_friction", {"torque": 0.02})
    response = simulate(rig, np.zeros(200), SAMPLE_TIME_S, np.full(201, 0.3))
    assert not response.states.any()
    assert not response.theta_d_rad.any()
