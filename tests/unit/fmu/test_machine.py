"""A machine that is advanced from outside moves as the run's own plant does, to the last bit."""

import numpy as np
import pytest

from dtbacklash.api.rigs import load_rig
from dtbacklash.config.compose import compose
from dtbacklash.experiment.run import run_scenario
from dtbacklash.fmu.machine import LATE_SAMPLES, Machine

FRICTION = "rig.effects.motor_bearing.coulomb_friction.torque=0.02"
LATE = "rig.effects.amplifier.delay.time=0.0015"
WORDS = ("controller=nimc_fixed", "controller.internal_model=inner_loop", "reference.period_s=1", "duration_s=2")
GAP_WORDS = ("profile=ramp", "profile.t_start_s=0.2", "profile.t_end_s=1.5", "profile.end_deg=20")


def shown(machine, u, gap, step=1):
    """(N+1, sensors + 1) what it shows; the gap of a sample is the one at its end."""
    rows = [machine.y.copy()]
    for k in range(0, len(u) - 1, step):
        machine.advance(step, u[k], gap[min(k + 1, len(gap) - 1)])
        rows.append(machine.y.copy())
    return np.array(rows)


def test_with_effects_and_a_growing_gap_it_is_the_run_to_the_last_bit():
    result = run_scenario(compose(*WORDS, *GAP_WORDS, FRICTION, LATE))
    trace = result.trace
    assert trace["q3_mm"].abs().max() > 0.5
    machine = Machine(load_rig("lead_screw", FRICTION, LATE), 1e-3)
    y = shown(machine, trace["u_v"].to_numpy(), np.radians(gap_of(result.config)))
    names = list(result.rig.sensors)
    np.testing.assert_array_equal(y[:, names.index("theta_m")], trace["theta_m_rad"])
    np.testing.assert_array_equal(y[:, names.index("q3")] * 1e3, trace["q3_mm"])
    np.testing.assert_array_equal(y[:, -1], trace["theta_d_rad"])
    assert machine.t_s == pytest.approx(2.0)


def gap_of(config):
    from dtbacklash.experiment.signals import gap_profile

    return gap_profile(config.profile, np.arange(config.samples + 1) * config.sample_time_s)


def test_long_steps_are_short_ones_with_the_command_held():
    rig = load_rig("lead_screw", FRICTION)
    u = np.repeat(np.array([3.0, -2.0, 0.0, 5.0]), 25)
    gap = np.full(len(u), 0.1)
    fine = shown(Machine(rig, 1e-3, gap_rad=0.1), np.append(u, 0.0), np.append(gap, 0.1))
    coarse = shown(Machine(rig, 1e-3, gap_rad=0.1), np.append(u, 0.0), np.append(gap, 0.1), step=25)
    np.testing.assert_array_equal(coarse, fine[::25])


def test_a_gap_that_is_set_comes_within_a_sample_and_moves_nothing_by_itself():
    machine = Machine(load_rig("lead_screw"), 1e-3)
    machine.advance(10, 0.0, 0.5)
    np.testing.assert_array_equal(machine.y, 0.0)
    machine.advance(100, 6.0, 0.5)
    theta_m, theta_d = machine.y[0], machine.y[-1]
    assert theta_m - theta_d == pytest.approx(0.5)


def test_a_positioner_follows_its_command_two_samples_late():
    rig = load_rig("brfd")
    words = ("rig=brfd", "controller=open_loop", "reference.t_start_s=0.05", "reference=step", "duration_s=0.2")
    result = run_scenario(compose(*words))
    force = result.trace["force_n"].to_numpy()
    assert np.abs(force).max() > 1e3
    y = shown(Machine(rig, 1e-3), result.trace["u_v"].to_numpy(), np.zeros(201))
    np.testing.assert_array_equal(y[LATE_SAMPLES:, 0], force[:-LATE_SAMPLES])


def test_a_start_that_is_not_zero_moves_the_clock_alone():
    rig = load_rig("lead_screw")
    early, late = Machine(rig, 1e-3), Machine(rig, 1e-3, start_s=7.0)
    for one in (early, late):
        one.advance(50, 4.0, 0.0)
    np.testing.assert_array_equal(early.y, late.y)
    assert late.t_s - early.t_s == 7.0
