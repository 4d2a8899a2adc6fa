"""What the command does between two samples: a controller holds it, a generator's filter makes it smooth.

Or there was none: the machine was pushed or let go, and its first state is all that moves it.
"""

from __future__ import annotations

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.choices import COMMANDS

HELD, BAND_LIMITED, NONE = COMMANDS


def stepped(u: Floats, command: str, parts: int = 4) -> tuple[Floats, int]:
    """Return a command in steps that may be held, and how many of them make a sample.

    A held command is itself, with one step a sample. A band-limited one is interpolated (Kaiser window) and cut into
    ``parts`` steps a sample, each with the value at its middle: the error is of second order in the step. The
    sensors are then every ``parts``-th row of the simulation.

    Parameters
    ----------
    u : (N,) the command at the samples, V. command : one of COMMANDS.

    Returns
    -------
    ((N - 1) * steps,) command, and the steps a sample.
    """
    if command != BAND_LIMITED:
        return u[:-1], 1
    from scipy.signal import resample_poly

    fine = resample_poly(u, 2 * parts, 1, window=("kaiser", 8.0))
    return np.ascontiguousarray(fine[1 : 2 * parts * (len(u) - 1) : 2]), parts
