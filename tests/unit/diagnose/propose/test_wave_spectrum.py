"""Wave numbers of a long travel: those that a spectrum over the position calls likely hold the right one."""

import numpy as np
import pytest
from nominal import nominal_rig
from scipy.signal import lfilter

from dtbacklash.diagnose import Record, diagnose_records
from dtbacklash.diagnose.propose.wave_spectrum import Passage, likely_waves
from dtbacklash.physics.simulate import simulate

from ..conftest import STEP_S

#: a mode of 0.2 rad a sample, hardly damped, and what pulls a position back
RESPONSE = (np.array([[0.0, 1e-3, 0.0], [0.0, 0.0, 2e-3]]), np.array([1.0, -1.94, 0.98]))


@pytest.mark.parametrize("waves_true", [9.3, 171.0, 2203.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_right_wave_number_is_among_few_of_thousands_beside_a_slow_mismatch(waves_true, seed):
    """Along a chirp to and fro, in two channels, of which what is left otherwise is slow and twenty times as large."""
    rng, every = np.random.default_rng(seed), 5
    t = np.arange(20_000) * 1e-3
    q = 0.5 * np.sin(2.0 * np.pi * (0.05 + 0.02 * t) * t) + 0.05 * t
    force = np.sin(waves_true * q + 0.7).reshape(-1, every).mean(axis=1)
    rows = np.array([lfilter(b, RESPONSE[1], force) for b in RESPONSE[0]])
    drift = np.cumsum(rng.standard_normal((2, rows.shape[1])), axis=1)
    rows += 20.0 * np.std(rows) * drift / np.std(drift) + 0.1 * np.std(rows) * rng.standard_normal(rows.shape)
    rows[:, 1500:2000] = 0.0  # held out
    waves = np.arange(3.0, 2500.0, 0.5 * np.pi / np.ptp(q))
    found = likely_waves(waves, [Passage((q, np.ones(len(q)), False), rows)], RESPONSE, every, 60)
    assert len(found) <= 60 < len(waves) // 10
    assert np.abs(found - waves_true).min() <= waves[1] - waves[0]


@pytest.mark.parametrize("highest", [2500.0, 25_000.0])
def test_of_noise_as_large_no_short_wave_makes_more(highest):
    """The shorter a wave, the less it does: what is weighed against that has to be known for all of them."""
    rng, every = np.random.default_rng(1), 5
    t = np.arange(20_000) * 1e-3
    q = 0.5 * np.sin(2.0 * np.pi * (0.05 + 0.02 * t) * t) + 0.05 * t
    force = np.sin(171.0 * q).reshape(-1, every).mean(axis=1)
    rows = np.array([lfilter(b, RESPONSE[1], force) for b in RESPONSE[0]])
    rows += np.std(rows) * rng.standard_normal(rows.shape)
    waves = np.arange(3.0, highest, 0.5 * np.pi / np.ptp(q))
    found = likely_waves(waves, [Passage((q, np.ones(len(q)), False), rows)], RESPONSE, every, 60)
    assert np.abs(found - 171.0).min() <= waves[1] - waves[0]


@pytest.mark.nightly
def test_cogs_along_a_long_travel_are_found_on_a_free_carriage():
    """Its grid of wave numbers was too wide for the travel: an effect of any size was found by luck."""
    stage, rng = nominal_rig("two_mass_stage"), np.random.default_rng(4)
    t = np.arange(16_001) * STEP_S
    u = 1.5 * np.sin(2.0 * np.pi * (0.8 + 0.3 * t) * t) * np.minimum(t, 1.0)
    cogs = {"force": 0.4, "wave_number": 23.7, "phase": 0.4}
    shown = simulate(stage.with_effect("carriage", "cogging", cogs), u[:-1], STEP_S).sensors
    y = {"x_c": shown["x_c"] + rng.normal(0.0, 1e-5, len(u))}
    train = np.arange(len(u)) < 0.6 * len(u)
    found = diagnose_records(stage, [Record(STEP_S, u, y, train, ~train)])
    assert [(f.location, f.effect) for f in found.findings] == [("carriage", "cogging")]
    assert found.findings[0].parameters["wave_number"].value == pytest.approx(23.7, rel=0.01)
