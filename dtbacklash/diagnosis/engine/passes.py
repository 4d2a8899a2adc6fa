"""The rig along a stretch of a recording, by the core: corrected at each reading, or led on from given states."""

import numpy as np

from dtbacklash.arrays import Floats, Ints
from dtbacklash.core.library import buffer, copied, ffi, lib
from dtbacklash.diagnosis.engine.resampling import OPENING
from dtbacklash.physics.kernel.plant import Plant, State
from dtbacklash.physics.kernel.structs import plant_struct, state_struct


def observe(
    P: Plant, S: State, u: Floats, rise: Floats, ramp: Floats, gap: float, theta: Floats, Y: Floats, K: Floats,
    W: Floats, which: Ints, chan: Ints, E: Floats, X: Floats, D: Floats,
) -> None:  # fmt: skip
    """Predict each sample, compare it with what was read, and correct the state by it.

    Parameters
    ----------
    u (N,), gap, theta : as for the simulation. rise (N,), ramp (n,) : by how much the command rises within a sample,
    and what a rise of 1 about its mean adds to the state. Y : (N, m) readings, NaN where one is missing, which corrects
    nothing.
    K (modes, g, n, m), W (modes, g, m, m) : gains and whitening, which (N,) : those of each sample; mode 1 while the
    gear is in contact, or where there is none. chan : (m,) sensors of the readings.
    E, D (N, m), X (N, n) : filled with whitened innovations, innovations, and states before each correction.
    """
    N, n, m, g, y = len(u), len(S.x), len(chan), K.shape[1], np.zeros(len(P.sensor))
    by = ffi.new("Correction *", {"samples": N, "readings": m, "gains": g, "opening": OPENING})
    arrays = copied(K, 2, g, n, m), copied(W, 2, g, m, m), copied(Y, N, m), buffer(which, N), buffer(chan, m)
    by.K, by.W, by.Y, by.which, by.chan = arrays
    lib.dtb_observe(
        plant_struct(P), state_struct(S), by, buffer(u, N), buffer(rise, N), buffer(ramp, n), gap, buffer(theta),
        len(theta), buffer(E, N, m), buffer(X, N, n), buffer(D, N, m), buffer(y),
    )  # fmt: skip


def onwards(P: Plant, S: State, u: Floats, gap: float, theta: Floats, Z: Floats, X: Floats) -> None:
    """Where one sample leads from each of the states Z (N, n), into X (N, n); its last row stays."""
    N, width = Z.shape
    lib.dtb_onwards(
        plant_struct(P), state_struct(S), N, buffer(u, N), gap, buffer(theta), len(theta), width, copied(Z),
        buffer(X, N, width),
    )  # fmt: skip


def shown(P: Plant, S: State, gap: float, Z: Floats, Y: Floats) -> None:
    """What sensors that are not late show of the states Z (N, n), into Y (N, sensors)."""
    N, width = Z.shape
    lib.dtb_shown(plant_struct(P), state_struct(S), N, gap, width, copied(Z), buffer(Y, N, len(P.sensor)))
