"""How fast a machine moves in its recordings: the scale of time by which the pull and what integrates are chosen.

A scale that is fixed in seconds holds for the machines that it was found on. The recording's own lies between how fast
the command changes and how fast the speed answers, on whose effort the laws act.
"""

import numpy as np
from scipy.signal import detrend, periodogram

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.compare import Record
from dtbacklash.diagnose.floor import channel_noise
from dtbacklash.physics.rig import Rig

#: power below so many times that of the white noise is not looked at: of ten million lines of noise none has more
ABOVE_NOISE = 30.0
#: what changes by less than this share of its size is constant
CONSTANT = 1e-9
#: a speed's power is that of a quantity times so many times its frequency
POWER = {"position": 2, "velocity": 0}


def tempo_rad_s(rig: Rig, records: list[Record]) -> float:
    """Geometric mean of the frequencies below which half the power of the command lies and half that of the speeds.

    rig : tells which of the recorded channels are positions and speeds; of several, the geometric mean counts.
    """
    step = records[0].sample_time_s
    noise, speeds = channel_noise(records), []
    for name, sensor in rig.sensors.items():
        if sensor.quantity in POWER and all(name in r.y for r in records):
            speeds.append(_median([r.y[name] for r in records], step, noise[name][0], POWER[sensor.quantity]))
    commanded = _median([r.u for r in records], step, 0.0, 0)
    return _mean([commanded, _mean(speeds)]) or 2.0 * np.pi / (step * max(r.samples for r in records))


def _mean(rates: list[float]) -> float:
    """The geometric mean of what is known; 0 where nothing is."""
    known = [rate for rate in rates if rate > 0.0]
    return float(np.exp(np.mean(np.log(known)))) if known else 0.0


def _median(signals: list[Floats], step_s: float, noise: float, power: int) -> float:
    """Frequency below which half the power of signals lies, weighed by a power of it, rad/s; 0 without any."""
    rates, weights = [], []
    for values in signals:
        swing = detrend(values)
        if len(values) < 2 or np.std(swing) <= CONSTANT * np.max(np.abs(values), initial=0.0):
            continue
        hz, density = periodogram(swing, 1.0 / step_s, "hann", detrend=False)
        omega = 2.0 * np.pi * hz[1:]
        seen = np.where(density[1:] > ABOVE_NOISE * 2.0 * step_s * noise**2, density[1:], 0.0)
        rates.append(omega)
        weights.append(seen * omega**power * omega[0])
    if not rates:
        return 0.0
    omega, weight = np.concatenate(rates), np.concatenate(weights)
    order = np.argsort(omega)
    share = np.cumsum(weight[order])
    return float(omega[order][np.searchsorted(share, 0.5 * share[-1])]) if share[-1] > 0.0 else 0.0
