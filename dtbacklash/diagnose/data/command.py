"""A command between its samples: held, as a controller's is, or smooth, as a measured signal is.

A measured input passes through its samples; held in the simulation it would come half a sample late, which looks like
a delay or a wrong damping.
"""

import numpy as np
from scipy.signal.windows import kaiser

from dtbacklash.arrays import Floats

#: taps to each side of the interpolation
REACH = 24


def held_equivalent(u: Floats) -> Floats:
    """(N,) the command that, when each value is held over its sample, acts as the smooth signal through ``u`` does.

    Half a sample ahead, and divided by the spectrum of the hold, ``sin(x)/x`` with ``x = omega h/2``: the inverse
    Fourier transform of ``exp(i x) x/sin(x)``, windowed.
    """
    omega = np.linspace(-np.pi, np.pi, 4097)
    x = 0.5 * omega
    gain = np.divide(x, np.sin(x), out=np.ones_like(x), where=np.abs(x) > 1e-9)
    n = np.arange(-REACH, REACH)
    taps = np.array([np.trapezoid(gain * np.cos(omega * (k + 0.5)), omega) / (2.0 * np.pi) for k in n])
    taps *= kaiser(2 * REACH + 1, 8.0)[:-1]
    taps /= taps.sum()
    padded = np.concatenate([np.full(REACH, u[0]), u, np.full(REACH, u[-1])])
    # value k lies between u[k] and u[k + 1]: taps n weigh u[k - n]
    return np.ascontiguousarray(np.convolve(padded, taps, "full")[2 * REACH : 2 * REACH + len(u)])
