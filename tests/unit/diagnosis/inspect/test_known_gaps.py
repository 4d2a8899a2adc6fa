"""Faults of sensors that the inspection should report, and does not yet (docs/diagnosis.md, Limits)."""

import numpy as np
import pytest

from dtbacklash.diagnosis.inspect import samples

T_S = 1e-3 * np.arange(8000)
COMMAND = np.sin(3.0 * T_S)


def measured() -> np.ndarray:
    """A slow motion with little noise, (8000,)."""
    return COMMAND + 1e-4 * np.random.default_rng(1).standard_normal(T_S.size)


def gap(reason: str) -> pytest.MarkDecorator:
    return pytest.mark.xfail(reason=reason, strict=True, raises=AssertionError)


@gap("a spike has at most 2 samples; a longer one could be motion")
def test_a_spike_of_three_samples_is_reported() -> None:
    values = measured()
    values[4000:4003] += 1.0
    assert samples.spikes(values, COMMAND)[4000:4003].all()


@gap("clipping shows by a signal that leaves its limit at speed; just beyond the limit a motion turns slowly")
def test_a_sensor_that_clips_only_the_turning_points_is_reported() -> None:
    values = measured()
    clipped = np.clip(values, -0.995, 0.995)
    if not (clipped != values).mean() > 0.05:
        pytest.fail("nothing is cut off")
    assert samples.at_limits(clipped).any()


@gap("only white noise and a constant count as dead; hum is coherent with nothing, but no noise")
def test_a_sensor_that_shows_hum_alone_is_dead() -> None:
    hum = np.sin(2.0 * np.pi * 50.0 * T_S) + 0.05 * np.random.default_rng(2).standard_normal(T_S.size)
    assert samples.noise_alone(hum, {"u": COMMAND}) > samples.DEAD_NOISE_SHARE


@gap("only white noise and a constant count as dead; drift is coherent with nothing, but no noise")
def test_a_sensor_that_shows_drift_alone_is_dead() -> None:
    drift = np.random.default_rng(3).standard_normal(T_S.size).cumsum()
    assert samples.noise_alone(drift, {"u": COMMAND}) > samples.DEAD_NOISE_SHARE


@gap("a hanging sensor repeats its last reading and then jumps on; zeros begin with a jump, too")
def test_a_sensor_that_shows_zeros_for_a_while_is_reported() -> None:
    values = measured()
    values[3000:3400] = 0.0
    assert samples.hung(values)[3001:3400].all()
