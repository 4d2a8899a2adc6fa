"""What a diagnosis says of a recording that has a fault: where, what, how to mend it, and no physics."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.resampling import noise_of
from dtbacklash.diagnosis.engine.rig_simulator import linear_of
from dtbacklash.diagnosis.inspect.inspection import CLOCK, Fault, Inspected
from dtbacklash.diagnosis.labels import all_in_words
from dtbacklash.diagnosis.plot_data import Curve, FitTable, ModelErrors, PlotData
from dtbacklash.diagnosis.records import Record
from dtbacklash.diagnosis.result import UNEXPLAINED, Diagnosis, Located
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.physics.simulate import simulate
from dtbacklash.recording.channels import filled

#: a mode that so nearly stays where it is (eigenvalue of a sample) is a position from which nothing pulls back
STAYS = 1e-6
#: a record, one of its channels, and its curve
Compared = tuple[Record, str, Curve]


def faulty(rig: Rig, found: Inspected, fault: Fault) -> Diagnosis:
    """The diagnosis of a recording whose fault forbids to name physics: ``unexplained``, located, with no findings."""
    records = found.records
    channels = tuple(n for n in rig.sensors if any(n in r.y for r in records))
    try:
        curves = [one for number, record in enumerate(records) for one in _curves(rig, number, record)]
    except (UserError, ArithmeticError, ValueError, np.linalg.LinAlgError):  # the fault itself may forbid it
        curves = []
    noise = [noise_of(v)[0] / size for r in records for v in r.y.values() if (size := _size(v)) > 0.0]
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
        shown=PlotData(evidence={fault.where: 1.0}, curves=tuple(curve for *_, curve in curves)),
        fault=fault.what,
    )


def not_finite(rig: Rig, found: Inspected, error: Exception) -> Fault:
    """What is said where the linear algebra of the comparison breaks down: that much, and no physics."""
    channels = [n for n in rig.sensors if any(n in r.y for r in found.records)]
    return Fault(
        SENSOR_PREFIX + channels[0], "The comparison of this recording with this rig does not stay finite",
        f"the nominal rig is so far from what was recorded that its fit breaks down ({str(error).rstrip('.')})",
        "Check units, signs and order of the channels and the rig's parameters, and diagnose again.",
    )  # fmt: skip


def undriven(rig: Rig, found: Inspected, likely: Sequence[tuple[str, str]], left: float) -> Fault:
    """What is said where a machine moves as nothing does that a constant command drives. left : a share."""
    channels = [n for n in rig.sensors if any(n in r.y for r in found.records)]
    best = f", the likeliest included ({all_in_words(likely)})" if likely else ""
    amplifier = rig.only("amplifier")
    return Fault(
        amplifier.name if amplifier else SENSOR_PREFIX + channels[0],
        f"{' and '.join(channels)} {'moves' if len(channels) == 1 else 'move'} while the command is constant",
        f"nothing that this rig may lack does that{best}: {'nearly all' if left > 1.0 else f'{100 * left:.0f} %'} of "
        "the force that moves it stays unknown",
        "Check that u is the command's column, and that nothing else moved the machine; diagnose again.",
    )  # fmt: skip


def mended(diagnosis: Diagnosis, found: Inspected) -> Diagnosis:
    """A diagnosis of what was mended: with the rows of the inspection and what was done.

    Its summary begins with channels that were left out, and clocks that were set right.
    """
    said = [note for note in found.notes if note.startswith((CLOCK, *found.left_out))]
    return replace(
        diagnosis, summary=" ".join([*said, diagnosis.summary]), checks=(*found.checks, *diagnosis.checks),
        notes=(*found.notes, *diagnosis.notes),
    )  # fmt: skip


def _curves(rig: Rig, number: int, record: Record) -> list[Compared]:
    """Measured and nominal of every channel of a recording: simulated from rest by its command alone.

    Where nothing pulls a machine back, its positions begin as they were measured.
    """
    channels = tuple(n for n in rig.sensors if n in record.y)
    t_s = record.sample_time_s * np.arange(record.samples, dtype=np.float64)
    held = np.flatnonzero(record.held)
    with np.errstate(over="ignore", invalid="ignore"):
        shown = simulate(rig, record.u[:-1], record.sample_time_s).sensors
    modes = np.linalg.eigvals(linear_of(rig, record.sample_time_s, channels).A[1])
    free = bool(np.abs(modes - 1.0).min() < STAYS)
    found = []
    for channel in channels:
        measured, nominal = filled(record.y[channel]), shown[channel]
        if not np.isfinite(nominal).all():
            continue
        if free and rig.sensors[channel].quantity == "position":
            nominal = nominal + measured[0] - nominal[0]
        name = channel if number == 0 else f"{channel} ({record.name or number + 1})"
        from_s = float(t_s[held[0]]) if held.size else None
        curve = Curve(name, rig.sensors[channel].unit, t_s, measured, nominal, nominal, from_s)
        found.append((record, channel, curve))
    return found


def _errors(curves: list[Compared], part: str) -> ModelErrors:
    """The nominal rig's error over all channels, relative to their standard deviations; None where there is none."""
    squares = []
    for record, channel, curve in curves:
        values = record.y[channel]
        error: Floats = (values - curve.nominal)[getattr(record, part) & np.isfinite(values)]
        if error.size and (size := _size(values)) > 0.0:
            squares.append(float(np.mean(error**2)) / size**2)
    return ModelErrors(float(np.sqrt(np.mean(squares))) if squares else None, None, None)


def _size(values: Floats) -> float:
    """The standard deviation of what was read; 0 of a constant."""
    read = values[np.isfinite(values)]
    return float(np.std(read)) if read.size and np.ptp(read) > 0.0 else 0.0
