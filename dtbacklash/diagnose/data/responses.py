"""The linear response of a block's residuals to an effort within the block."""

import math

import numpy as np
from scipy.signal import lfilter, ss2tf

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.compare import Block, Record
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.plant import Plant
from dtbacklash.physics.rig import Rig

#: (N,) a position, (N,) a factor on the wave over it, and whether the wave's value at position 0 is subtracted
Path = tuple[Floats, Floats, bool]
#: numerators (channels, order + 1) and denominator
Response = tuple[Floats, Floats]


def transfer(part: Rig, block: Block, plant: Plant, columns: dict[int, float], thin: int = 1) -> Response:
    """Numerators (channels, order + 1) and denominator from an effort to the block's innovations.

    plant : of the block's part of the rig, with a sample as long as ``thin`` of the recording's.
    columns : {input channel of the plant: sign} of the effort.
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


def transfers(part: Rig, block: Block, records: list[Record], columns: dict[int, float]) -> list[Response]:
    """The same for each record, at its own sample time."""
    found: dict[float, Response] = {}
    for step in {r.sample_time_s for r in records}:
        plant = compile_plant(part, step, 1, 2, block.imposed is not None)
        found[step] = transfer(part, block.at(step), plant, columns)
    return [found[r.sample_time_s] for r in records]


def wave_responses(waves: Floats, shape: int, paths: list[Path], response: Response, every: int) -> Floats:
    """(channels, waves, thinned samples) responses to a sine (``shape`` 0) or a cosine (1) along the paths.

    The effort is averaged over ``every`` samples and filtered at that slower rate.
    """
    numerators, denominator = response
    shift, outputs = np.float32(0.5 * math.pi * shape), []
    for q, w, counted in paths:
        effort = np.sin(waves[:, None].astype(np.float32) * q.astype(np.float32) + shift)
        if counted:
            effort -= np.sin(shift)
        else:
            effort *= w.astype(np.float32)
        n = effort.shape[1] // every * every
        mean = effort[:, :n].reshape(len(waves), -1, every).mean(axis=2, dtype=np.float64)
        outputs.append(np.array([lfilter(row, denominator, mean) for row in numerators]))
    return np.concatenate(outputs, axis=2)
