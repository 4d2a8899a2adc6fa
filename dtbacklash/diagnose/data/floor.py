"""The noise floor, from the recording itself: counts, white noise, and the noise of what drives a block."""

import numpy as np
from scipy.signal import welch

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.compare import Block, Record, residual
from dtbacklash.diagnose.data.first_state import stands
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

#: relative variance of a band's level, times its bins and segments: 1/(ln 2)^2 for a median of periodograms, twice as
#: much because the window correlates neighbouring bins
MEDIAN_OF_PERIODOGRAMS = 2.0 / np.log(2.0) ** 2
#: bands within so many standard errors have the same level
SAME_LEVEL_ERRORS = 2.0
#: per channel (standard deviation, size of a count), in its unit
Noise = dict[str, tuple[float, float]]


def quantum(values: Floats) -> float:
    """Size of a count, in the channel's unit; 0 if the channel is not counted."""
    levels = np.unique(values)
    if len(levels) < 3 or len(levels) > SETTINGS.counted_share * len(values):
        return 0.0
    steps = np.diff(levels)
    step = float(np.quantile(steps, 0.1))
    counts = np.diff(levels) / step
    regular = np.abs(counts - np.round(counts)) < 0.05
    return step if regular[counts < 20].mean() > 0.95 else 0.0


def white_noise(values: Floats) -> float:
    """Standard deviation of the white noise: the lowest level of the spectrum, at all frequencies.

    The signal is differenced before the spectrum is taken, so that its slow parts do not leak. The lowest band alone
    would be too low by chance (minimum statistics: Martin, IEEE Trans. Speech Audio Process. 9 (2001) 504): so the mean
    of all bands that are as low within their errors counts.
    """
    steps = np.diff(values)
    length = int(min(1024, len(steps) // 4))
    frequency, density = welch(steps, 1.0, "blackmanharris", length, detrend=False, average="median")
    density = density[1:] / (2.0 * np.sin(np.pi * frequency[1:])) ** 2
    width = max(4, len(density) // 8)
    bands = density[: len(density) // width * width].reshape(-1, width).mean(axis=1)
    levels = np.sort(bands[len(bands) // 4 :])
    error = np.sqrt(MEDIAN_OF_PERIODOGRAMS / ((2 * len(steps) // length - 1) * width))
    alike = 1
    while alike < len(levels):
        most = 1.0 + SAME_LEVEL_ERRORS * error * np.sqrt(1.0 + 1.0 / alike)
        if levels[alike] > most * levels[:alike].mean():
            break
        alike += 1
    return float(np.sqrt(levels[:alike].mean() * 0.5))


def sensor_noise(values: Floats) -> tuple[float, float]:
    """(standard deviation, size of a count) of a channel's noise, in its unit."""
    count = quantum(values)
    least = max(count / np.sqrt(12.0), SETTINGS.numerical_error_share * float(np.std(values)))
    return max(white_noise(values), least), count


def channel_noise(records: list[Record], residuals: dict[str, list[Floats]] | None = None) -> Noise:
    """Per channel (standard deviation, size of a count) of its noise, in its unit.

    residuals : per channel and record, a model's residual in the channel's unit: a rough signal (a current that follows
    a stepping voltage) shows its noise only there.
    """
    noise: Noise = {}
    for name in records[0].y:
        each = [sensor_noise(r.y[name]) for r in records]
        sigma, count = (float(np.sqrt(np.mean([s**2 for s, _ in each]))), max(c for _, c in each))
        if residuals and name in residuals:
            left = float(np.sqrt(np.mean([white_noise(e) ** 2 for e in residuals[name]])))
            size = float(np.mean([np.std(r.y[name]) for r in records]))
            sigma = min(sigma, max(left, count / np.sqrt(12.0), SETTINGS.numerical_error_share * size))
        noise[name] = sigma, count
    return noise


def synthetic(rig: Rig, record: Record, noise: Noise, rng: np.random.Generator) -> Record:
    """The recording that the rig would give with the same commands, noise and counts."""
    response = simulate(rig, record.u[:-1], record.sample_time_s).sensors
    y, rest = {}, {}
    for name in record.y:
        sigma, count = noise[name]
        spread = np.sqrt(max(sigma**2 - count**2 / 12.0, 0.0)) if sigma > 1.5 * count / np.sqrt(12.0) else 0.0
        shown = response[name] + rng.normal(0.0, 1.0, record.samples) * spread
        y[name] = count * np.round(shown / count) if count else shown
        if rig.sensors[name].quantity == "position":
            rest[name] = stands(y[name], sigma)
    return Record(record.sample_time_s, record.u, y, record.train, record.held, stands=rest)


def noise_floor(rig: Rig, blocks: list[Block], records: list[Record], noise: Noise, seed: int = 0) -> dict[str, Floats]:
    """Per block, (channels,) the rms residual that a true model leaves, SI.

    Measured on simulated recordings of the nominal rig, so that it contains the effect of the encoder's counts on the
    structure, and the method's error.
    """
    rng = np.random.default_rng(seed)
    floors = {}
    for block in blocks:
        sensors = np.array([noise[c][0] for c in block.channels])
        squares = [np.maximum(_of_true_model(rig, block, r, noise, rng), sensors) ** 2 for r in records]
        floors[block.name] = np.sqrt(np.mean(squares, axis=0))
    return floors


def _of_true_model(rig: Rig, block: Block, record: Record, noise: Noise, rng: np.random.Generator) -> Floats:
    made = synthetic(rig, record, noise, rng)
    if not all(np.isfinite(v).all() for v in made.y.values()):
        return np.zeros(len(block.channels))
    rms: Floats = np.sqrt(np.mean(residual(rig, block, made) ** 2, axis=0))
    return rms
