"""What a diagnosis says of a recording that has a fault: where, what, how to mend it, and no physics."""

from dataclasses import replace

import numpy as np

from dtbacklash.diagnose.data.compare import Record, predict
from dtbacklash.diagnose.data.floor import sensor_noise
from dtbacklash.diagnose.data.pull import cut
from dtbacklash.diagnose.data.tempo import tempo_rad_s
from dtbacklash.diagnose.inspect.inspection import Fault, Inspected
from dtbacklash.diagnose.result import UNEXPLAINED, Diagnosis, Located
from dtbacklash.diagnose.shown import Curve, FitTable, ModelErrors, Shown
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig


def faulty(rig: Rig, found: Inspected, fault: Fault) -> Diagnosis:
    """The diagnosis of a recording whose fault forbids to name physics: ``unexplained``, located, with no findings."""
    records = found.records
    channels = tuple(n for n in rig.sensors if all(n in r.y for r in records))
    try:
        curves = _curves(rig, channels, records)
    except (UserError, ArithmeticError, ValueError, np.linalg.LinAlgError):  # the fault itself may forbid it
        curves = []
    noise = [sensor_noise(r.y[c])[0] / max(float(np.std(r.y[c])), 1e-300) for r in records for c in channels]
    floor = float(np.sqrt(np.mean(np.square(noise)))) if noise else 0.0
    return Diagnosis(
        verdict=UNEXPLAINED,
        summary=f"{fault.what}: {fault.why}. Nothing else was looked for.",
        findings=(),
        recalibrated={},
        fit=FitTable("nrmse", channels, _errors(curves, "train"), _errors(curves, "held"), floor),
        candidates=(),
        located=Located("recording", fault.where, 1.0),
        next_experiment=fault.mend,
        nominal=rig,
        extended=rig,
        checks=tuple(found.checks),
        notes=tuple(found.notes),
        shown=Shown(evidence={fault.where: 1.0}, curves=tuple(c for _, c in curves)),
        fault=fault.what,
    )


def not_finite(rig: Rig, found: Inspected, error: Exception) -> Fault:
    """What is said where the linear algebra of the comparison breaks down: that much, and no physics."""
    channels = [n for n in rig.sensors if n in found.records[0].y]
    return Fault(
        SENSOR_PREFIX + channels[0], "The comparison of this recording with this rig does not stay finite",
        f"the nominal rig is so far from what was recorded that its fit breaks down ({str(error).rstrip('.')})",
        "Check units, signs and order of the channels and the rig's parameters, and diagnose again.",
    )  # fmt: skip


def mended(diagnosis: Diagnosis, found: Inspected) -> Diagnosis:
    """A diagnosis of what was mended: with the rows of the inspection and what was done; a channel left out is said."""
    said = [note for note in found.notes if any(note.startswith(name) for name in found.left_out)]
    return replace(
        diagnosis, summary=" ".join([*said, diagnosis.summary]), checks=(*found.checks, *diagnosis.checks),
        notes=(*found.notes, *diagnosis.notes),
    )  # fmt: skip


def _curves(rig: Rig, channels: tuple[str, ...], records: list[Record]) -> list[tuple[Record, Curve]]:
    """Measured and nominal of every channel and recording."""
    found, tempo = [], tempo_rad_s(rig, records)
    for number, record in enumerate(records):
        t_s = np.arange(record.samples, dtype=np.float64) * record.sample_time_s
        held = np.flatnonzero(record.held)
        for block in cut(rig, channels, record.sample_time_s, tempo):
            with np.errstate(over="ignore", invalid="ignore"):
                nominal = predict(rig, block, record)
            for j, channel in enumerate(block.channels):
                if not np.isfinite(nominal[:, j]).all():
                    continue
                name = channel if number == 0 else f"{channel} (recording {number + 1})"
                curve = Curve(name, rig.sensors[channel].unit, t_s, record.y[channel], nominal[:, j], nominal[:, j],
                              float(t_s[held[0]]) if held.size else None)  # fmt: skip
                found.append((record, curve))
    return found


def _errors(curves: list[tuple[Record, Curve]], part: str) -> ModelErrors:
    """The nominal rig's error over all channels, relative to their standard deviations; None where there is none."""
    squares = []
    for record, curve in curves:
        mask, size = getattr(record, part), float(np.std(curve.measured))
        if mask.any() and size > 0.0:
            squares.append(float(np.mean((curve.measured - curve.nominal)[mask] ** 2)) / size**2)
    return ModelErrors(float(np.sqrt(np.mean(squares))) if squares else None, None, None)
