"""What acts on the bodies of a rig along a motion, of which an unknown force is a share."""

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.api.rigs import load_rig
from dtbacklash.diagnosis.engine.trajectory import Trajectory

from .conftest import STEP_S, command, recorded, segments_of

GEARED = {
    "name": "geared",
    "parameters": {
        "J_m": {"value": 1e-4}, "J_l": {"value": 0.02}, "n": {"value": 20.0}, "k": {"value": 4000.0},
        "K": {"value": 0.1},
    },
    "elements": {
        "motor": {"kind": "actuator", "gain": "K", "drives": "rotor"}, "rotor": {"kind": "rotor", "inertia": "J_m"},
        "gearbox": {"kind": "gearbox", "between": ["rotor", "load"], "ratio": "n", "stiffness": "k"},
        "load": {"kind": "rotor", "inertia": "J_l"},
    },
    "effects": {"rotor": {"viscous_friction": {"coefficient": 5e-3}}},
    "sensors": {"theta": {"of": "rotor", "quantity": "position"}, "phi": {"of": "load", "quantity": "position"}},
}  # fmt: skip


def test_a_geared_drive_whose_net_force_is_a_tenth_of_what_acts():
    """Motor torque and friction cancel: the net torque on the rotor is a tenth of either."""
    rig = load_rig(GEARED)
    t = STEP_S * np.arange(8001)
    u = np.sin(2.0 * np.pi * 0.1 * t)
    (p,) = segments_of(rig, u, recorded(rig, u)).predictors
    forces = dict(zip(p.bodies, p.force, strict=True))
    drive = 0.1 * np.sqrt(np.mean(u**2))
    assert forces["rotor"] == pytest.approx(drive, rel=0.05)
    found = Trajectory(rig, p.linear, p.run(rig, p.gains(rig, p.first_noise_levels())).X, p.readings.u, STEP_S)
    net = found._net()["rotor"]
    assert net < 0.1 * forces["rotor"]
    # what is unknown is a share of the torque, so that a fiftieth of it is 2 %
    assert p.unknown(np.log([0.02, 0.02, 1.0, 1.0]))["rotor"] == pytest.approx(0.02)


@pytest.mark.parametrize("zero", [0.0, 40.0])
def test_a_spring_counts_about_its_mean_as_zeros_are_arbitrary(zero):
    rig, n = nominal_rig("rotary_drive"), 4001
    t, linear = STEP_S * np.arange(n), segments_of(rig, command(4.0, 1.0), recorded(rig, command(4.0, 1.0))).linear
    X = np.zeros((n, len(linear.states)))
    load = linear.states.index("load q")
    X[:, load] = zero + 0.01 * np.sin(2.0 * np.pi * t)
    acting = Trajectory(rig, linear, X, np.zeros(n), STEP_S).acting
    spring = rig.elements["shaft"].values["stiffness"] * 0.01 / np.sqrt(2.0)
    assert acting["load"] == pytest.approx(spring, rel=0.01)
    assert acting["motor_rotor"] == pytest.approx(spring, rel=0.01)


def test_what_a_rig_knows_of_friction_acts():
    rig = nominal_rig("pendulum")
    linear = segments_of(rig, command(4.0, 1.0), recorded(rig, command(4.0, 1.0))).linear
    X = np.zeros((2001, len(linear.states)))
    X[:, linear.speed] = 2.0
    held = rig.with_effect("disk", "coulomb_friction", {"torque": 3.0}).with_effect(
        "disk", "viscous_friction", {"coefficient": 0.5}
    )
    assert Trajectory(held, linear, X, np.zeros(2001), STEP_S).acting["disk"] == pytest.approx(4.0)
