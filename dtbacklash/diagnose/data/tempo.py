"""The tempo: how fast a machine moves in its recordings, the time scale of the pull and of what counts as integrating.

It lies between how fast the command changes and how fast the speed does, so that it holds for machines of any size.
"""

import numpy as np
from scipy.signal import detrend, periodogram

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.compare import Record
from dtbacklash.diagnose.data.floor import channel_noise
from dtbacklash.physics.rig import Rig

#: a position is differenced over so many samples that it moves by this many times its noise
FAR = 20.0
#: those samples are at most this fraction of a record, or the channel does not move
PIECES = 16
#: spectral power of a measured speed below so many times its white noise does not count
ABOVE_NOISE = 30.0
#: the command's frequency is limited to so many times, or a part of, the speed's
FOLLOWED = 10.0
#: a signal that changes by less than this share of its size is constant
CONSTANT = 1e-9


def tempo_rad_s(rig: Rig, records: list[Record]) -> float:
    """Geometric mean of the command's and the speeds' median frequencies; of several speeds, their geometric mean."""
    steps, noise = [r.sample_time_s for r in records], channel_noise(records)
    moving = []
    for name, sensor in rig.sensors.items():
        if sensor.quantity in ("position", "velocity") and all(name in r.y for r in records):
            seen, sigma = [r.y[name] for r in records], noise[name][0]
            shown = (_speeds(seen, sigma, steps), 0.0) if sensor.quantity == "position" else (seen, sigma)
            moving.append(_median(*shown, steps))
    speed, command = _mean(moving), _median([r.u for r in records], 0.0, steps)
    if speed and command:
        command = float(np.clip(command, speed / FOLLOWED, speed * FOLLOWED))
    return _mean([command, speed]) or 2.0 * np.pi / max(r.sample_time_s * r.samples for r in records)


def _mean(rates: list[float]) -> float:
    """Geometric mean of the positive rates; 0 without any."""
    known = [rate for rate in rates if rate > 0.0]
    return float(np.exp(np.mean(np.log(known)))) if known else 0.0


def _speeds(positions: list[Floats], noise: float, steps_s: list[float]) -> list[Floats]:
    """Differences of positions over the shortest time that shows a motion; empty where there is only noise.

    The time is a number of the longest samples: of shorter ones it takes more. A position that is shorter is empty.
    """
    width, longest = 1, max(steps_s)
    while width <= max(map(len, positions)) // PIECES:
        widths = [round(width * longest / step) for step in steps_s]
        steps = [p[w:] - p[:-w] for p, w in zip(positions, widths, strict=True)]
        if np.mean(np.concatenate(steps) ** 2) >= (FAR * noise) ** 2:
            return steps
        width *= 2
    return []


def is_constant(values: Floats) -> bool:
    """Whether a signal is a constant with its rounding."""
    return bool(np.std(values) <= CONSTANT * np.max(np.abs(values)))


def _median(signals: list[Floats], noise: float, steps_s: list[float]) -> float:
    """Frequency below which half the power of the signals without their noise lies, rad/s; 0 without any."""
    rates, weights = [], []
    for values, step_s in zip(signals, steps_s[: len(signals)], strict=True):
        if len(values) < 2 or is_constant(values):
            continue
        hz, density = periodogram(detrend(values), 1.0 / step_s, "hann", detrend=False)
        rates.append(2.0 * np.pi * hz[1:])
        # times the samples over the lines' spacing: a long record counts for more
        weights.append(np.where(density[1:] > ABOVE_NOISE * 2.0 * step_s * noise**2, density[1:], 0.0))
    if not rates:
        return 0.0
    omega, weight = np.concatenate(rates), np.concatenate(weights)
    order = np.argsort(omega)
    share = np.cumsum(weight[order])
    return float(omega[order][np.searchsorted(share, 0.5 * share[-1])]) if share[-1] > 0.0 else 0.0
