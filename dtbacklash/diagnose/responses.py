"""How an effort within a block reaches what the block is judged by, as a linear filter."""

import numpy as np
from scipy.signal import ss2tf

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.compare import Block
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.plant import Plant
from dtbacklash.physics.rig import Rig


def transfer(part: Rig, block: Block, plant: Plant, columns: dict[int, float], thin: int = 1) -> tuple[Floats, Floats]:
    """Numerators (channels, order + 1) and denominator from an effort to the block's innovations.

    ``plant`` : of the block's part of the rig, with a sample as long as ``thin`` of the recording's.
    ``columns`` : {input channel: sign} through which the effort acts.
    """
    contact = 0 if plant.rotor < 0 else 1
    A = plant.E[contact, 0].T
    B = sum(sign * plant.P1[contact, 0, channel] for channel, sign in columns.items())
    names = list(part.sensors)
    C = np.zeros((len(block.channels), len(A)))
    for j, c in enumerate(block.channels):
        index = int(plant.sensor[names.index(c), pl.Y_INDEX])
        if index >= 0:
            C[j, index] = 1.0
    if block.pulled:
        row = C[list(block.channels).index(block.pulled)]
        gain = np.zeros(len(A))
        where = int(np.argmax(row))
        gain[where] = thin * block.gains[0]
        if block.gains[1]:
            gain[where + plant.n_bodies] = thin * block.gains[1]
        A = A - A @ np.outer(gain, row)
    return ss2tf(A, np.asarray(B)[:, None], C, np.zeros((len(C), 1)))
