import numpy as np
import pytest
import ringing
from nominal import nominal_rig

from dtbacklash.diagnose import Record
from dtbacklash.diagnose.data.command import held_equivalent
from dtbacklash.diagnose.data.compare import predict, residual, true_angle
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.data.floor import quantum, white_noise
from dtbacklash.diagnose.data.pull import cut
from dtbacklash.errors import UserError
from dtbacklash.physics.simulate import simulate

from ..conftest import COUNTS, STEP_S, TEMPO_RAD_S, command, recorded


def test_cut_at_the_measured_angle(rig):
    motor, structure = cut(rig, ("theta_m", "q3"), STEP_S, TEMPO_RAD_S)
    assert (motor.name, motor.pulled, motor.imposed) == ("motor", "theta_m", None)
    assert (structure.channels, structure.imposed, structure.pulled) == (("q3",), "theta_m", None)


def test_no_channel_of_the_rig_is_refused(rig):
    with pytest.raises(UserError):
        cut(rig, ("temperature",), STEP_S, TEMPO_RAD_S)


def test_the_truth_leaves_the_sensors_noise(rig):
    record = recorded(rig)
    motor, structure = cut(rig, ("theta_m", "q3"), STEP_S, TEMPO_RAD_S)
    assert np.std(residual(rig, motor, record)) < 1.2 * COUNTS["theta_m"] / np.sqrt(12)
    assert np.std(residual(rig, structure, record)) == pytest.approx(1.05e-6, rel=0.08)


def test_friction_shows_in_the_motor_and_not_in_the_structure(rig):
    record = recorded(rig.with_effect("motor_bearing", "coulomb_friction", {"torque": 0.02}))
    motor, structure = cut(rig, ("theta_m", "q3"), STEP_S, TEMPO_RAD_S)
    assert np.std(residual(rig, motor, record)) > 10 * COUNTS["theta_m"]
    assert np.std(residual(rig, structure, record)) < 1.3e-6


def test_a_late_angle_sensor_is_undone_where_it_drives(rig):
    record = recorded(rig)
    _, structure = cut(rig, ("theta_m", "q3"), STEP_S, TEMPO_RAD_S)
    late = rig.with_effect("sensor_theta_m", "delay", {"time": 2e-3})
    assert np.allclose(true_angle(late, structure, record)[5:-9], true_angle(rig, structure, record)[7:-7])


def test_quantum_and_white_noise():
    rng = np.random.default_rng(0)
    t = np.arange(20000) * 1e-3
    smooth = np.sin(3 * t)
    assert quantum(0.01 * np.round(smooth / 0.01)) == pytest.approx(0.01)
    assert quantum(smooth + rng.normal(0, 1e-3, len(t))) == 0.0
    assert white_noise(smooth + rng.normal(0, 1e-3, len(t))) == pytest.approx(1e-3, rel=0.1)


@pytest.mark.parametrize("samples", [400, 1200, 5000])
def test_the_level_of_white_noise_alone_is_not_taken_too_low(samples):
    """The lowest of several bands of a short recording is too low by chance, by a third and more of the power."""
    rng = np.random.default_rng(1)
    squares = [white_noise(rng.standard_normal(samples)) ** 2 for _ in range(60)]
    assert np.mean(squares) == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize("omega", [0.1, 0.7, 1.5])
def test_held_equivalent_leads_by_half_a_sample(omega):
    t = np.arange(400.0)
    x = omega / 2
    expected = np.sin(omega * (t + 0.5)) * x / np.sin(x)
    assert np.abs(held_equivalent(np.sin(omega * t)) - expected)[40:-40].max() < 2e-3


def test_a_sensor_that_is_modelled_to_read_too_much_is_pulled_no_faster():
    """Ten times the reading of a tenth of the motion is the same machine: what it leaves must not be less."""
    disk = nominal_rig("pendulum")
    rubbing = disk.with_effect("disk", "coulomb_friction", {"torque": 0.1})
    u = command(6.0, 1)
    y = {"theta": simulate(rubbing, u[:-1], STEP_S).sensors["theta"]}
    record = Record(STEP_S, u, y, np.ones(len(u), bool), np.zeros(len(u), bool))
    (block,) = cut(disk, ("theta",), STEP_S, TEMPO_RAD_S)
    assert block.pulled == "theta"
    other = disk.with_effect("sensor_theta", "gain_error", {"relative": 9.0})
    other = other.with_effect("amplifier", "gain_error", {"relative": -0.9})
    plain = residual(disk, block, record)
    assert np.abs(plain).max() > 0.01
    assert np.allclose(residual(other, block, record), plain, rtol=1e-6, atol=1e-9)


def test_hysteresis_that_reaches_less_far_than_a_step_moves_is_followed():
    """However few steps a comparison takes."""
    rig = ringing.known(ringing.blade()).with_effect("foot", "hysteresis", {"force": 0.2, "displacement": 2e-6})
    record = ringing.recorded(ringing.blade(), 41, 2000)
    evidence = Evidence.gather(ringing.known(ringing.blade()), [record])
    (block,) = evidence.blocks
    finely = simulate(rig, record.u[:-1], record.sample_time_s, substeps=256).sensors
    for steps in ("fine", "coarse", "rough"):
        seen = predict(rig, block, record, steps)
        for j, name in enumerate(block.channels):
            assert np.std(seen[:, j] - finely[name]) < 5e-3 * np.std(finely[name])
