"""Diagnosis: where a recording and the simulation differ, what physics is missing, and whether it fits better."""

from collections.abc import Callable

import numpy as np

from dtbacklash.diagnose.compare import Record
from dtbacklash.diagnose.verdict import Diagnosis, diagnose_records
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.model import Recording

__all__ = ["Diagnosis", "Record", "diagnose", "diagnose_records", "record_of"]

#: the last share of a recording is held out where no other recording judges
HELD_OUT = 0.3


def record_of(recording: Recording, rig: Rig, train: bool, held: bool, share: float = HELD_OUT) -> Record:
    """A recording with its masks: all of it for one purpose, or the last ``share`` to judge and the rest to fit."""
    n = recording.samples
    cut = n - round(share * n) if train and held else n * train
    mask = np.arange(n) < cut
    found = {c: np.ascontiguousarray(v, dtype=float) for c, v in recording.channels.items()}
    measured = {c: v for c, v in found.items() if c in rig.sensors}
    return Record(recording.sample_time_s, found["u"], measured, mask, ~mask)


def diagnose(
    recording: Recording,
    rig: Rig,
    validation: Recording | None = None,
    held_out: float = HELD_OUT,
    progress: Callable[[str, float], None] | None = None,
    jobs: int | None = None,
) -> Diagnosis:
    """Diagnose a recording on a rig.

    Parameters
    ----------
    recording, validation : to fit, and to judge on; without the second the last share ``held_out`` of the first judges.
    rig : the nominal rig. progress : called with what is being done and a share, 0 to 1.
    jobs : threads that share the work; None leaves what ``joblib.parallel_config`` says, else one.

    Raises
    ------
    UserError : no channel of the rig was recorded, an integrating part not measured, or nothing was commanded.
    """
    if validation is None:
        return diagnose_records(rig, [record_of(recording, rig, True, True, held_out)], progress, jobs)
    return diagnose_records(
        rig, [record_of(recording, rig, True, False), record_of(validation, rig, False, True)], progress, jobs
    )
