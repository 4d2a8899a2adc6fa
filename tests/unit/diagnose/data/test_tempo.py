"""A recording's own scale of time: of known signals, and machines that differ in nothing but how fast they are."""

from dataclasses import replace

import numpy as np
import pytest

from dtbacklash.config.compose import compose
from dtbacklash.diagnose import Record, diagnose_records
from dtbacklash.diagnose.data import pull
from dtbacklash.diagnose.data.tempo import tempo_rad_s
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.simulate import simulate

from ..conftest import STEP_S, command

SAMPLES = 15001
#: a parameter in these units grows by this power of how much faster a machine with the same motion is
POWERS = {"N/m": 2, "N/V": 2, "N m/V": 2, "N s/m": 1}
GRAVITY = {"torque": 0.15, "phase": 0.4}


def faster(name: str, ratio: float) -> Rig:
    config = compose(f"rig={name}").rig
    scaled = {n: replace(p, value=p.value * ratio ** POWERS.get(p.unit, 0)) for n, p in config.parameters.items()}
    return build_rig(replace(config, parameters=scaled))


def one(name: str, u: np.ndarray, y: np.ndarray, step_s: float = STEP_S) -> Record:
    mask = np.ones(len(u), dtype=bool)
    return Record(step_s, u, {name: y}, mask, ~mask)


def recorded(rig: Rig, truth: Rig, ratio: float, amplitude: float) -> Record:
    """The first position, with noise of a thousandth, sampled as much faster as the machine is."""
    u, step = 0.5 * amplitude * command((SAMPLES - 1) * STEP_S, 5), STEP_S / ratio
    name = next(n for n, s in rig.sensors.items() if s.quantity == "position")
    shown = simulate(truth, u[:-1], step).sensors[name]
    y = shown + np.random.default_rng(5).normal(0.0, 1e-3 * np.std(shown), SAMPLES)
    train = np.arange(SAMPLES) < 0.6 * SAMPLES
    return Record(step, u, {name: y}, train, ~train)


def friction(ratio: float) -> tuple[Rig, list[Record]]:
    rig = faster("oscillator", ratio)
    truth = rig.with_effect("mass", "ground_friction", {"force": ratio**2})
    return rig, [recorded(rig, truth, ratio, 1.0)]


def gravity(ratio: float) -> tuple[Rig, list[Record]]:
    rig = faster("pendulum", ratio)
    truth = rig.with_effect("disk", "gravity", GRAVITY | {"torque": GRAVITY["torque"] * ratio**2})
    return rig, [recorded(rig, truth, ratio, 0.1)]


def test_the_tempo_of_sines_lies_between_that_of_the_command_and_that_of_the_speed():
    rig = faster("pendulum", 1.0)
    at = np.arange(20000) * STEP_S
    record = one("theta", np.sin(16.0 * at), 3.0 + np.sin(4.0 * at))
    assert tempo_rad_s(rig, [record]) == pytest.approx(8.0, rel=0.05)
    assert tempo_rad_s(rig, [record, record]) == pytest.approx(8.0, rel=0.05)
    speed = replace(record, y={"omega": 3.0 + np.sin(4.0 * at)})
    assert tempo_rad_s(rig, [speed]) == pytest.approx(8.0, rel=0.05)


def test_noise_does_not_make_a_motion_faster_and_what_stands_says_nothing():
    rig = faster("pendulum", 1.0)
    at = np.arange(20000) * STEP_S
    noise = np.random.default_rng(1).normal(0.0, 0.01, len(at))
    record = one("theta", np.sin(16.0 * at), np.sin(4.0 * at) + noise)
    assert tempo_rad_s(rig, [record]) == pytest.approx(8.0, rel=0.05)
    still = replace(record, u=np.full(len(at), 2.0))
    assert tempo_rad_s(rig, [still]) == pytest.approx(4.0, rel=0.05)
    nothing = replace(still, y={"theta": np.full(len(at), 0.3)})
    assert tempo_rad_s(rig, [nothing]) == pytest.approx(2.0 * np.pi / 20.0)


@pytest.mark.parametrize("counts", [65536, 4096, 500])
@pytest.mark.parametrize("hz", [0.05, 0.5])
def test_counts_do_not_make_a_constant_speed_fast(counts, hz):
    """A constant speed on an encoder is a staircase: lines at the rate of its counts."""
    at = np.arange(20000) * STEP_S
    y = 2.0 * np.abs(2.0 * (hz * at % 1.0) - 1.0)
    count = 2.0 * np.pi / counts
    exact, counted = (one("theta", np.sign(np.sin(2.0 * np.pi * hz * at)), v) for v in (y, count * np.round(y / count)))
    rig = faster("pendulum", 1.0)
    assert tempo_rad_s(rig, [counted]) == pytest.approx(tempo_rad_s(rig, [exact]), rel=0.05)


def test_the_sampling_of_a_broadband_command_does_not_matter():
    found = []
    for step in (5e-3, 1e-3, 1e-4):
        at = np.arange(round(20.0 / step)) * step
        u = np.random.default_rng(0).normal(0.0, 1.0, len(at))
        found.append(tempo_rad_s(faster("pendulum", 1.0), [one("theta", u, np.sin(4.0 * at), step)]))
    assert found == pytest.approx([found[0]] * 3, rel=0.02)


def test_a_long_recording_counts_for_more_than_a_short_one():
    slow, fast = np.sin(4e-3 * np.arange(200_000)), np.sin(40e-3 * np.arange(2000))
    records = [one("theta", v, v) for v in (slow, fast)]
    assert tempo_rad_s(faster("pendulum", 1.0), records) == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("machine", [friction, gravity])
@pytest.mark.nightly
def test_a_machine_a_hundred_times_slower_or_ten_times_faster_gets_the_same_finding(machine):
    usual = diagnose_records(*machine(1.0))
    assert usual.verdict == "missing_physics"
    for ratio in (0.01, 10.0):
        scaled = diagnose_records(*machine(ratio))
        assert scaled.verdict == usual.verdict
        assert [(f.location, f.effect) for f in scaled.findings] == [(f.location, f.effect) for f in usual.findings]
        for one, other in zip(usual.findings, scaled.findings, strict=True):
            for name, known in one.parameters.items():
                power = 0 if name == "phase" else 2
                assert other.parameters[name].value == pytest.approx(known.value * ratio**power, rel=1e-3)


@pytest.mark.nightly
def test_nothing_hinges_on_the_pull(monkeypatch):
    machine = gravity(1.0)
    for ratio in (1.0 / 3.0, 3.0):
        monkeypatch.setattr(pull, "SETTINGS", replace(SETTINGS, pull_ratio=ratio * SETTINGS.pull_ratio))
        found = diagnose_records(*machine)
        assert [(f.location, f.effect) for f in found.findings] == [("disk", "gravity")]
        for name, true in GRAVITY.items():
            low, high = found.findings[0].parameters[name].ci95
            assert low - (high - low) / 4 < true < high + (high - low) / 4
