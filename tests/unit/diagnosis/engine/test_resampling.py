"""What a predictor looks at: averages, the command between them, noise, counts, and the rate."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis.engine.predictor import Predictor
from dtbacklash.diagnosis.engine.resampling import (
    NUMERICAL,
    READINGS_MIN,
    Samples,
    band_hz,
    between,
    noise_of,
    rate_of,
    readings,
)
from dtbacklash.diagnosis.engine.rig_simulator import Simulated
from dtbacklash.physics.simulate import simulate

from .conftest import STEP_S, command, predictor_of

FINE_S = 1e-3


def test_a_recording_is_averaged_over_blocks():
    u, y = np.arange(11.0), {"x": np.arange(11.0) ** 2, "v": np.ones(11)}
    found = readings(u, y, ("v", "x"), STEP_S, 3, False)
    assert found.sample_time_s == pytest.approx(3 * STEP_S)
    assert np.allclose(found.y[:, 1], [np.mean(y["x"][k : k + 3]) for k in (0, 3, 6)])
    assert np.allclose(found.y[:, 0], 1.0)
    assert (len(found.u), found.count, found.channels, found.every) == (3, 6, ("v", "x"), 3)
    assert np.array_equal(found.recorded, u)


def test_a_block_of_which_half_is_missing_is_no_reading():
    y = np.ones(15)
    y[[0, 1, 2, 5, 6, 10]] = [np.nan, np.nan, np.nan, np.nan, 5.0, np.nan]
    found = readings(np.zeros(15), {"x": y}, ("x",), STEP_S, 5, False)
    assert np.isnan(found.y[0, 0])
    assert np.allclose(found.y[1:, 0], [(5.0 + 3.0) / 4.0, 1.0])
    assert found.count == 2


def pushed(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) position and speed of a free mass of 1 under a force that is held over each sample of 1."""
    v = np.concatenate([[0.0], np.cumsum(u)[:-1]])
    return np.concatenate([[0.0], np.cumsum(v + 0.5 * u)[:-1]]), v


@pytest.mark.parametrize("every", [3, 5, 9])
def test_a_command_between_blocks_moves_a_mean_as_it_moves_the_samples(every):
    """Means of a free mass follow from those of the block before: a speed by the mean, a position by its rise too."""
    u = np.random.default_rng(3).normal(size=every * 200) + 1.0
    x, v = (y.reshape(-1, every).mean(axis=1) for y in pushed(u))
    mean, rise = between(u, every)
    assert mean.shape == rise.shape == x.shape
    speed, position = np.diff(v) - every * mean[:-1], np.diff(x) - every * v[:-1] - 0.5 * every**2 * mean[:-1]
    # the last block's command is followed by none
    assert np.abs(speed[:-1]).max() < 1e-9
    # a rise r about a mean comes late: it moves a position by -r T^2/12
    late = position + every**2 * rise[:-1] / 12.0
    assert np.abs(late[:-1]).max() < 1e-9 * np.abs(x).max()
    assert np.abs(position[:-1]).max() > 0.1
    # half a block earlier it would move neither
    early = u.reshape(-1, every).mean(axis=1)
    assert np.abs(np.diff(v) - every * early[:-1])[:-1].max() > 1.0


def test_a_command_rises_between_blocks_as_far_as_it_does():
    held, straight = np.full(90, 2.0), np.arange(900.0)
    mean, rise = between(held, 5)
    assert np.allclose(mean, 2.0)
    assert np.allclose(rise, 0.0, atol=1e-12)
    for every in (3, 9, 15):
        mean, rise = between(straight, every)
        middles = np.arange(900 // every) * every + every - 1.0
        assert np.allclose(mean[:-2], middles[:-2])
        # in steps, each held: a little less than the line through them
        assert np.allclose(rise[:-2], every - 1.0 / every)
    u = np.random.default_rng(1).normal(size=50)
    assert np.array_equal(between(u, 1)[0], u)
    assert not between(u, 1)[1].any()


def test_a_command_that_imposes_a_position_is_averaged_as_the_readings_are():
    u = np.random.default_rng(2).normal(size=30)
    found = readings(u, {"x": u}, ("x",), STEP_S, 3, True)
    assert np.allclose(found.u, u.reshape(-1, 3).mean(axis=1))
    assert not found.rise.any()
    assert readings(u, {"x": u}, ("x",), STEP_S, 3, False).rise.any()


@pytest.mark.parametrize("name", ["oscillator", "two_mass_stage", "rotary_drive"])
@pytest.mark.parametrize("every", [3, 5])
def test_averages_are_predicted_and_half_a_sample_of_misalignment_is_seen(name, every):
    rig = nominal_rig(name)
    u = command(9.0, 1.0, step_s=FINE_S)
    y = simulate(rig, u[:-1], FINE_S).sensors
    known = predictor_of(rig, u, y, every, FINE_S)
    # next to nothing is unknown: what is left is the prediction's own error
    scale = known.readings.y.std(axis=0)
    sizes = np.concatenate([np.full(len(known.bodies), np.log(1e-6)), np.log(1e-3 * scale)])
    gains = known.gains(rig, sizes)

    n = len(known.readings.u)
    held = np.zeros(n)

    def left(**command: np.ndarray) -> np.ndarray:
        changed = {k: np.ascontiguousarray(v) for k, v in command.items()}
        other = Predictor(rig, Simulated(replace(known.readings, **changed)))
        return other.run(rig, gains).D[100:].std(axis=0) / scale

    aligned = left()
    shown = [j for j, c in enumerate(known.readings.channels) if rig.sensors[c].quantity != "current"]
    assert np.all(aligned[shown] < 5e-6)
    assert np.all(aligned < 1e-3)
    # a mean that does not rise leaves far more
    assert np.all(left(rise=held) > 20.0 * aligned)
    # and half a sample of misalignment more again
    early = left(u=u[: n * every].reshape(-1, every).mean(axis=1))
    assert np.all(early > 50.0 * aligned)
    assert np.all(early[shown] > 10.0 * left(rise=held)[shown])


def test_a_speed_that_is_driven_directly_needs_no_rise_and_a_position_does():
    """A free disk: the speed's averages follow from the command's mean to rounding."""
    rig, u = nominal_rig("pendulum"), command(9.0, 0.4, step_s=FINE_S)
    y = simulate(rig, u[:-1], FINE_S).sensors
    p = predictor_of(rig, u, y, 3, FINE_S)
    # nothing corrects it
    gains = p.gains(rig, p.first_noise_levels())
    alone = replace(gains, K=0.0 * gains.K)
    scale = p.readings.y.std(axis=0)

    def left(readings: Samples) -> np.ndarray:
        D = Predictor(rig, Simulated(readings)).run(rig, alone).D
        # the first means are no state at rest, and go on as they are
        steps = p.readings.sample_time_s * np.arange(len(D))
        line = np.column_stack([np.ones(len(D)), steps])[:-2]
        return np.abs(D[:-2] - line @ np.linalg.lstsq(line, D[:-2], rcond=None)[0]).max(axis=0) / scale

    with_rise, without = left(p.readings), left(replace(p.readings, rise=np.zeros(len(p.readings.u))))
    angle, speed = (p.readings.channels.index(c) for c in ("theta", "omega"))
    assert max(with_rise[speed], without[speed]) < 1e-9
    assert with_rise[angle] < 1e-9
    assert without[angle] > 1e-6


def channels(seconds: float, top_hz: float, step_s: float = FINE_S) -> dict[str, np.ndarray]:
    """A pendulum's readings that move up to a frequency."""
    t = step_s * np.arange(round(seconds / step_s))
    f = np.linspace(0.1, top_hz, 9)
    phase = np.random.default_rng(3).uniform(0.0, 6.0, 9)
    at = 2.0 * np.pi * f[:, None] * t + phase[:, None]
    return {"theta": (np.sin(at) / f[:, None]).sum(axis=0), "omega": (2.0 * np.pi * np.cos(at)).sum(axis=0)}


@pytest.mark.parametrize("top_hz", [0.5, 1.0, 3.0, 10.0])
@pytest.mark.parametrize("seconds", [1.0, 10.0, 40.0])
def test_a_rate_is_odd_and_leaves_enough(seconds, top_hz):
    y = channels(seconds, top_hz)
    rate = rate_of(nominal_rig("pendulum"), y, FINE_S)
    assert rate % 2 == 1
    assert rate == 1 or len(y["theta"]) // rate >= READINGS_MIN
    # twelve readings or nearly so for a period of the fastest motion, and not many more
    assert rate == 1 or 1.0 / (rate * FINE_S) > 12.0 * top_hz * 0.85
    more = rate + 2
    assert 1.0 / (more * FINE_S) < 12.0 * top_hz * 1.1 or len(y["theta"]) // more < READINGS_MIN


def test_a_slow_motion_of_a_stiff_rig_is_read_as_often_as_the_rig_swings():
    y = channels(40.0, 1.0)
    assert rate_of(nominal_rig("pendulum"), y, FINE_S) == 19
    # its spring and mass swing with 6.3 Hz: six readings in a period
    slow = {"x": channels(80.0, 0.3)["theta"]}
    assert rate_of(nominal_rig("pendulum"), {"theta": slow["x"]}, FINE_S) > 35
    assert rate_of(nominal_rig("oscillator"), slow, FINE_S) == 25


def test_noise_does_not_widen_the_band():
    y = channels(20.0, 2.0)["omega"]
    noisy = y + 0.02 * y.std() * np.random.default_rng(1).normal(size=len(y))
    assert band_hz(y, FINE_S, False) == pytest.approx(2.0, rel=0.1)
    assert band_hz(noisy, FINE_S, False) == pytest.approx(2.0, rel=0.1)
    holes = noisy.copy()
    holes[np.random.default_rng(2).uniform(size=len(y)) < 0.05] = np.nan
    assert band_hz(holes, FINE_S, False) == pytest.approx(2.0, rel=0.1)


def test_noise_is_that_of_white_noise_on_a_smooth_signal():
    t = FINE_S * np.arange(8000)
    rng = np.random.default_rng(6)
    smooth = np.sin(2.0 * np.pi * 1.5 * t)
    for size in (1e-4, 1e-3, 0.1):
        noise, counted = noise_of(smooth + size * rng.normal(size=len(t)))
        assert noise == pytest.approx(size, rel=0.05)
        assert not counted
    # where there is none, what a simulation errs by
    noise, counted = noise_of(smooth)
    assert noise == pytest.approx(NUMERICAL * smooth.std(), rel=1e-3)
    assert not counted


def test_missing_readings_do_not_count_as_noise():
    y = np.sin(FINE_S * np.arange(8000)) + 1e-3 * np.random.default_rng(7).normal(size=8000)
    y[np.random.default_rng(8).uniform(size=8000) < 0.05] = np.nan
    assert noise_of(y)[0] == pytest.approx(1e-3, rel=0.06)


def test_counts_have_the_noise_of_their_rounding():
    t = FINE_S * np.arange(8000)
    noise, counted = noise_of(0.01 * np.round(np.sin(t) / 0.01))
    assert counted
    # seldom another count: third differences are mostly 0
    assert noise == pytest.approx(0.01 / np.sqrt(12.0), rel=1e-6)
    assert noise_of(np.full(100, 3.0))[0] > 0.0
    assert not noise_of(np.full(100, 3.0))[1]


def test_averaging_takes_noise_away():
    rng = np.random.default_rng(9)
    y = {"x": np.sin(FINE_S * np.arange(20000)) + 1e-2 * rng.normal(size=20000)}
    for every in (1, 5, 9):
        found = readings(np.zeros(20000), y, ("x",), FINE_S, every, False)
        assert found.noise[0] == pytest.approx(1e-2 / np.sqrt(every), rel=0.05)
        assert found.y[:, 0].std() == pytest.approx(y["x"].std(), rel=0.01)


@pytest.mark.parametrize(("share", "expected"), [(1 / 3, 3000), (0.1, READINGS_MIN), (1.0, 9000)])
def test_a_beginning_is_a_share_of_the_readings_and_enough(share, expected):
    u = np.arange(27000.0)
    whole = readings(u, {"x": u, "v": u}, ("x", "v"), FINE_S, 3, False)
    first: Samples = whole.first(share)
    assert len(first.u) == len(first.y) == expected
    assert np.array_equal(first.y, whole.y[:expected])
    # commands as recorded reach as far as the last average does
    for found, kept in zip(between(first.recorded, 3), (first.u, first.rise), strict=True):
        assert np.allclose(found[: expected - 1], kept[: expected - 1])
    assert np.array_equal(first.rise, whole.rise[:expected])


def test_a_channel_that_is_seldom_read_is_not_averaged():
    y = channels(40.0, 1.0)
    assert rate_of(nominal_rig("pendulum"), y, FINE_S) > 1
    y["omega"][np.arange(len(y["omega"])) % 10 != 0] = np.nan
    assert rate_of(nominal_rig("pendulum"), y, FINE_S) == 1


def test_sets_of_readings_are_those_that_occur_together():
    y = {"a": np.arange(60.0), "b": np.arange(60.0) ** 2}
    y["b"][np.arange(60) % 4 != 0] = np.nan
    y["a"][30] = np.nan
    found = readings(np.zeros(60), y, ("a", "b"), STEP_S, 1, False)
    assert found.sets.tolist() == [[True, True], [True, False], [False, False]]
    assert np.allclose(found.present, [59 / 60, 15 / 60])
    opening = 8
    which = found.which(opening, found.y)
    assert which[:opening].tolist() == list(range(opening))
    for k in range(opening, 60):
        assert np.array_equal(found.sets[which[k] - opening], np.isfinite(found.y[k]))
    assert np.array_equal(found.counts(opening), [np.sum(which == opening + j) for j in range(3)])
    assert found.counts(opening).sum() == 60 - opening
    # readings that were moved in time bring a set that never was: all gains then
    moved = found.y.copy()
    moved[20] = np.nan, 1.0
    assert found.which(opening, moved)[20] == opening
    assert np.array_equal(np.delete(found.which(opening, moved), 20), np.delete(which, 20))
    whole = readings(np.zeros(60), {"a": np.arange(60.0)}, ("a",), STEP_S, 1, False)
    assert whole.sets.tolist() == [[True]]
