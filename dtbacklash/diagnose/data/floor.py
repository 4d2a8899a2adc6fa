"""The noise floor, from the recording itself: counts, white noise, and what the method's own inputs add."""

import numpy as np
from scipy.signal import welch

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.compare import Block, Record, residual
from dtbacklash.diagnose.data.first_state import stands
from dtbacklash.diagnose.settings import settings
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

#: relative variance of a band's level, times its bins and segments: of a median of periodograms 1/(ln 2)^2 instead of
#: 1, of bins that the window makes alike in pairs
MEDIAN_OF_PERIODOGRAMS = 2.0 / np.log(2.0) ** 2
#: bands that differ by less than so many standard errors show one level
SAME_LEVEL_ERRORS = 2.0
#: per channel (standard deviation, size of a count), in its unit
Noise = dict[str, tuple[float, float]]


def quantum(values: Floats) -> float:
    """Size of a count, in the channel's unit; 0 if the channel is not counted."""
    levels = np.unique(values)
    if len(levels) < 3 or len(levels) > settings().counted_share * len(values):
        return 0.0
    steps = np.diff(levels)
    step = float(np.quantile(steps, 0.1))
    counts = np.diff(levels) / step
    regular = np.abs(counts - np.round(counts)) < 0.05
    return step if regular[counts < 20].mean() > 0.95 else 0.0


def white_noise(values: Floats) -> float:
    """Standard deviation of the white noise: the lowest level that the spectrum reaches, spread over all of it.

    The signal is differenced first, so that its slow parts do not leak, and the spectrum divided by that again. The
    lowest of several bands that show nothing but noise is too low by chance, of a short recording by a third: all bands
    that are as low as it within their errors count (minimum statistics: Martin, IEEE Trans. Speech Audio Process. 9
    (2001) 504, corrects that bias).
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
    least = max(count / np.sqrt(12.0), settings().numerical_error_share * float(np.std(values)))
    return max(white_noise(values), least), count


def channel_noise(records: list[Record], residuals: dict[str, list[Floats]] | None = None) -> Noise:
    """Per channel (standard deviation, size of a count) of its noise, in its unit: the quietest that any reading says.

    ``residuals`` : per channel, of every record, what a model leaves of it: a signal that is rough by itself (a current
    that follows a stepping voltage) shows its noise only there.
    """
    found: Noise = {}
    for name in records[0].y:
        own = [sensor_noise(r.y[name]) for r in records]
        sigma, count = (float(np.sqrt(np.mean([s**2 for s, _ in own]))), max(c for _, c in own))
        if residuals and name in residuals:
            left = float(np.sqrt(np.mean([white_noise(e) ** 2 for e in residuals[name]])))
            least = max(
                count / np.sqrt(12.0),
                settings().numerical_error_share * float(np.mean([np.std(r.y[name]) for r in records])),
            )
            sigma = min(sigma, max(left, least))
        found[name] = sigma, count
    return found


def synthetic(rig: Rig, record: Record, noise: Noise, rng: np.random.Generator) -> Record:
    """What the recording would be if the rig were the truth: the same commands, noise and counts."""
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

    Measured by passing simulated recordings of the nominal rig through the same comparison: the encoder's counts
    that reach the structure are in it, and so is the error of the method.
    """
    rng = np.random.default_rng(seed)
    floors = {}
    for block in blocks:
        own = np.array([noise[c][0] for c in block.channels])
        squares = [np.maximum(_passed(rig, block, record, noise, rng), own) ** 2 for record in records]
        floors[block.name] = np.sqrt(np.mean(squares, axis=0))
    return floors


def _passed(rig: Rig, block: Block, record: Record, noise: Noise, rng: np.random.Generator) -> Floats:
    made = synthetic(rig, record, noise, rng)
    if not all(np.isfinite(v).all() for v in made.y.values()):
        return np.zeros(len(block.channels))
    passed: Floats = np.sqrt(np.mean(residual(rig, block, made) ** 2, axis=0))
    return passed
