"""Recordings without a command: their first states move the machine, and what comes after it rests says nothing."""

from dataclasses import replace

import numpy as np

from dtbacklash.diagnose.data.floor import sensor_noise
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.model import Recording
from dtbacklash.recording.refusal import SAMPLES_MIN

#: a recording is looked at in so many pieces, of so many samples at least
PIECES, PIECE_SAMPLES_MIN = 100, 20
#: a channel moves in a piece where its standard deviation there is so many times its noise (ratio)
MOVES = 2.0
#: so much rest is kept: friction holds a machine that a constant load would move on (share of the motion)
RESTS = 0.05


def while_it_moves(recording: Recording, rig: Rig) -> Recording:
    """A recording without a command up to where its machine comes to rest, with a note; else the recording itself.

    Fitted to rest, half of it, a decay would be chosen and judged by noise alone.
    """
    if np.any(recording.channels["u"]):
        return recording
    said = "Nothing was commanded (u is 0): the state in which it begins is all that moves the machine"
    end = max((_end(v) for name, v in recording.channels.items() if name in rig.sensors), default=0)
    if not SAMPLES_MIN <= end < recording.samples:
        return replace(recording, notes=[*recording.notes, f"{said}."])
    note = f"{said}. What comes after {recording.t_s[end] - recording.t_s[0]:.4g} s is left out: there it rests."
    return replace(recording.section(0, end), notes=[*recording.notes, note])


def _end(values: np.ndarray) -> int:
    """The first sample after the last piece in which a channel moves; 0 where it never does."""
    length = max(PIECE_SAMPLES_MIN, len(values) // PIECES)
    pieces = values[: len(values) // length * length].reshape(-1, length)
    moving = np.flatnonzero(pieces.std(axis=1) > MOVES * sensor_noise(values)[0])
    if not len(moving):
        return 0
    return min(len(values), round((1.0 + RESTS) * (int(moving[-1]) + 1) * length))
