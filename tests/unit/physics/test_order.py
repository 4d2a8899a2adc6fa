"""How the error falls when the step is refined."""

from __future__ import annotations

import numpy as np
import pytest
from reference import rigs, solve

from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

SAMPLE_TIME_S = 1e-3
SUBSTEPS = (1, 2, 4, 8, 16)


def smooth_rig() -> Rig:
    rig = rigs.oscillator().with_effect("link_1", "cubic_stiffness", {"k3": 2e6})
    return rig.with_effect("link_2", "quadratic_damping", {"c2": 50.0})


def q2_errors(rig: Rig, u: np.ndarray, gap: np.ndarray | None, sensor: str) -> np.ndarray:
    truth = solve(rig, u, SAMPLE_TIME_S, gap, rtol=1e-12, atol=1e-13).sensors[sensor]
    runs = (simulate(rig, u, SAMPLE_TIME_S, gap, substeps=n).sensors[sensor] for n in SUBSTEPS)
    return np.array([np.abs(run - truth).max() for run in runs])


def test_second_order_with_smooth_forces() -> None:
    error = q2_errors(smooth_rig(), rigs.random_steps(1500, 30, 40.0), None, "q2")
    order = np.log2(error[:-1] / error[1:])
    assert error[0] > 1e-8  # far above rounding, or the ratios would mean nothing
    assert np.all(np.abs(order - 2.0) < 0.1), order


def test_second_order_with_smooth_forces_behind_a_backlash() -> None:
    rig = rigs.lead_screw().with_effect("link_1", "cubic_stiffness", {"k3": 1e10})
    rig = rig.with_effect("link_2", "quadratic_damping", {"c2": 2e3})
    gap = np.full(1501, np.radians(30.0))
    error = q2_errors(rig, rigs.random_steps(1500, 30, 4.0), gap, "q3")
    order = np.log2(error[:-1] / error[1:])
    assert np.all(order > 1.5), order
    assert 1.8 < np.log2(error[0] / error[-1]) / 4.0 < 2.2, error


def test_the_linear_rig_with_backlash_does_not_depend_on_the_substeps() -> None:
    gap = np.radians(np.linspace(20.0, 40.0, 1501))
    error = q2_errors(rigs.lead_screw(), rigs.random_steps(1500, 30, 4.0), gap, "q3")
    # a contact's place: 15 ns at 30 rad/s through the lead, 1.5e-10 m
    assert np.all(error < 1.5e-10), error


@pytest.mark.parametrize("levels", [6, 10, 14])
def test_a_contact_is_located_to_the_stated_tick(levels: int) -> None:
    """The screw's angle is wrong by at most what the motor turns in a tick."""
    rig, u = rigs.lead_screw(), rigs.random_steps(1000, 30, 6.0)
    gap = np.full(1001, 0.5)
    truth = solve(rig, u, SAMPLE_TIME_S, gap)
    got = simulate(rig, u, SAMPLE_TIME_S, gap, event_levels=levels)
    speed = np.abs(np.diff(truth.sensors["theta_m"])).max() / SAMPLE_TIME_S
    tick = SAMPLE_TIME_S / 2**levels
    lead = rig.elements["screw"].values["lead"]
    error = np.abs(got.sensors["q3"] - truth.sensors["q3"]).max()
    assert error < 2.0 * speed * tick * lead * truth.events
