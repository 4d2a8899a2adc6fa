"""Outliers of the command: samples that stand alone, and that no sensor answers as the rig would."""

from dataclasses import replace

import numpy as np
from numpy.polynomial.legendre import legvander

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.resampling import noise_of
from dtbacklash.diagnosis.inspect import samples
from dtbacklash.diagnosis.records import Mask, Record
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate
from dtbacklash.recording.channels import filled, runs
from dtbacklash.recording.plausible import plain_rig

#: so long before and after an outlier the sensors are looked at (samples), and the polynomial beside it
BESIDE, DEGREE = 60, 5
#: what no sensor answers lies between so much of the rig's answer and as much the other way, by so many standard errors
ANSWERED, ERRORS = 0.5, 3.0


def outliers(rig: Rig, record: Record) -> Mask:
    """(N,) the samples of the command that are none; none of a simulator's model.

    What stands alone may be a pulse that was commanded: then a sensor answers it. In a window around it each channel is
    compared with the nominal rig's answers to what stands off and to the rest of the command, each of any size, and a
    polynomial in time, for all that was there before.
    """
    u, found = record.u, np.zeros(record.samples, dtype=bool)
    alone = np.zeros(len(u), dtype=bool) if rig.config.model else samples.spikes(u, np.zeros(len(u)))
    if not alone.any():
        return found
    bare = bridged(record, alone).u
    for start, stop in runs(alone):
        try:
            share, error = _answered(rig, record, u - bare, bare, start, stop)
        except UserError:  # a rig that cannot be simulated says nothing
            return found
        found[start:stop] = abs(share) + ERRORS * error < ANSWERED
    return found


def bridged(record: Record, mask: Mask) -> Record:
    """The record with what lies between their neighbours in the place of some samples of its command."""
    return replace(record, u=filled(np.where(mask, np.nan, record.u)))


def _answered(
    rig: Rig, record: Record, off: Floats, bare: Floats, start: int, stop: int
) -> tuple[float, float]:  # fmt: skip
    """The share of the rig's answer to what stands off that the channels show, and its standard error.

    off, bare : (N,) what stands off, and the rest of the command. The error is infinite where no channel tells.
    """
    first, last = max(start - BESIDE, 0), min(stop + BESIDE, record.samples)
    plain, t, step = plain_rig(rig), np.linspace(-1.0, 1.0, last - first), record.sample_time_s
    there = np.zeros(len(t))
    there[start - first : stop - first] = off[start:stop]
    commands = there, bare[first:last], 0.0 * t
    made, driven, rest = (simulate(plain, u[:-1], step).sensors for u in commands)
    powers, precision, total = legvander(t, DEGREE), 0.0, 0.0
    for name, values in record.y.items():
        y = values[first:last]
        read = np.isfinite(y)
        answers = np.column_stack([made[name] - rest[name], driven[name] - rest[name]])
        sizes = np.abs(answers).max(axis=0)
        columns = np.column_stack([answers[:, sizes > 0.0] / sizes[sizes > 0.0], powers])[read]
        if read.sum() <= 2 * columns.shape[1] or not sizes[0] > 0.0:
            continue
        fit, *_ = np.linalg.lstsq(columns, y[read])
        left = y[read] - columns @ fit
        variance = float(left @ left) / (read.sum() - columns.shape[1]) + noise_of(values)[0] ** 2
        alike = max(float(left[1:] @ left[:-1]) / max(float(left @ left), 1e-300), 0.0)
        variance *= (1.0 + alike) / max(1.0 - alike, 1e-3)  # what is like its neighbour says as much less
        error = float(np.sqrt(variance * np.linalg.pinv(columns.T @ columns)[0, 0]) / sizes[0])
        precision, total = precision + error**-2, total + float(fit[0] / sizes[0]) * error**-2
    return (total / precision, precision**-0.5) if precision > 0.0 else (1.0, np.inf)
