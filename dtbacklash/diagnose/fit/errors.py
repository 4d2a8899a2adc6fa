"""Errors of the nominal, recalibrated and extended rig: with the pull towards the measurement, and without it."""

from dataclasses import replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.compare import Block, residual
from dtbacklash.diagnose.data.evidence import Evidence, Residuals, by_recording
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.shown import FitTable, FreeRunning, ModelErrors, RecordingUsed
from dtbacklash.physics.rig import Rig


def fit_table(evidence: Evidence, nominal: Fit, fitted: Fit, modelled: Fit | None = None) -> FitTable:
    """Normalised errors of the nominal, the recalibrated, the extended and the modelled rig, over all channels."""
    fits = [evidence.residuals(evidence.nominal), nominal.residuals, fitted.residuals]
    fits += [modelled.residuals] if modelled else []
    scale = {b.name: evidence.floor[b.name] / _sizes(evidence, b) for b in evidence.blocks}
    parts = {}
    for part in ("train", "held"):
        errors = []
        for residuals in fits:
            squares = evidence.mean_square(residuals, part)
            each = np.concatenate([squares[b] * scale[b] ** 2 for b in squares])
            errors.append(float(np.sqrt(np.mean(each))))
        parts[part] = ModelErrors(*errors)
    floor = float(np.sqrt(np.mean(np.concatenate(list(scale.values())) ** 2)))
    return FitTable("nrmse", tuple(_channels(evidence)), parts["train"], parts["held"], floor)


def each_recording(evidence: Evidence, nominal: Fit, fitted: Fit) -> tuple[RecordingUsed, ...]:
    """What was used of each of several recordings, and the held-out errors there; empty for one and its validation."""
    if not any(r.own_zero for r in evidence.records):
        return ()
    fits = (evidence.residuals(evidence.nominal), nominal.residuals, fitted.residuals)
    found = []
    for own in by_recording(evidence.records):
        judged, number = sum(int(r.held.sum()) for r in own), own[0].recording
        errors = ModelErrors(*(_held_error(evidence, e, number) for e in fits)) if judged else None
        found.append(RecordingUsed(
            str(number + 1), sum(r.samples for r in own), own[0].sample_time_s,
            sum(int(r.train.sum()) for r in own), judged, errors,
            {c: {"value": v, "unit": evidence.nominal.sensors[c].unit} for c, v in own[0].zero.items()},
        ))  # fmt: skip
    return tuple(found)


def _held_error(evidence: Evidence, residuals: Residuals, number: int) -> float:
    """Normalised rms over the channels of what judges in one recording."""
    own, squares = [k for k, r in enumerate(evidence.records) if r.recording == number], []
    for block in evidence.blocks:
        left = np.concatenate([residuals[block.name][k][evidence.records[k].held] for k in own])
        moved = [np.concatenate([evidence.records[k].y[c] for k in own]) for c in block.channels]
        sizes = np.maximum([np.std(values) for values in moved], 1e-300)
        squares.append(np.mean((left * evidence.floor[block.name] / sizes) ** 2, axis=0))
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def in_floors(evidence: Evidence, nominal: Fit, fitted: Fit) -> dict[str, ModelErrors]:
    """Channel -> held-out rms error of the three rigs, in units of its noise floor."""
    fits = (evidence.residuals(evidence.nominal), nominal.residuals, fitted.residuals)
    squares = [evidence.mean_square(residuals, "held") for residuals in fits]
    return {
        channel: ModelErrors(*(float(np.sqrt(s[b.name][j])) for s in squares))
        for b in evidence.blocks for j, channel in enumerate(b.channels)
    }  # fmt: skip


def free_running(evidence: Evidence, nominal: Fit, fitted: Fit, modelled: Fit | None = None) -> FreeRunning:
    """Normalised errors of the rigs, simulated as a whole from their first states by the commands alone."""
    rigs = [evidence.nominal, nominal.rig, fitted.rig, *([modelled.rig] if modelled else [])]
    squares = [free_squares(evidence, rig) for rig in rigs]
    train, held = ([_error(s[part]) for s in squares] for part in ("train", "held"))
    return FreeRunning(ModelErrors(*train), ModelErrors(*held))


def free_errors(evidence: Evidence, rig: Rig) -> list[Floats]:
    """Per record, (N, channels) measured minus simulated freely from its first state, SI."""
    block = _whole(evidence)
    with np.errstate(over="ignore", invalid="ignore"):
        return [residual(rig, block, r) for r in evidence.records]


def free_squares(evidence: Evidence, rig: Rig) -> dict[str, Floats]:
    """Per part, (channels,) mean square of the free simulation's error, relative to the signal's variance."""
    sizes = _sizes(evidence, _whole(evidence))
    with np.errstate(over="ignore", invalid="ignore"):
        errors = [e / sizes for e in free_errors(evidence, rig)]
        parts = {
            part: [e[getattr(r, part)] for e, r in zip(errors, evidence.records, strict=True)]
            for part in ("train", "held")
        }
        return {part: np.mean(np.concatenate(each) ** 2, axis=0) for part, each in parts.items()}


def _error(squares: Floats) -> float | None:
    """Root mean square over the channels; None where a simulation diverged."""
    error = float(np.sqrt(np.mean(squares))) if np.isfinite(squares).all() else np.inf
    return error if np.isfinite(error) else None


def _whole(evidence: Evidence) -> Block:
    """The rig in one block with all channels; it begins where the measurement does and is not pulled."""
    begins = next((b.imposed or b.pulled for b in evidence.blocks if b.imposed or b.pulled), None)
    channels = tuple(_channels(evidence))
    return replace(evidence.blocks[0], name="rig", channels=channels, imposed=None, pulled=begins, gains=(0.0, 0.0))


def _channels(evidence: Evidence) -> list[str]:
    return [c for b in evidence.blocks for c in b.channels]


def _sizes(evidence: Evidence, block: Block) -> Floats:
    """(channels,) standard deviation of each signal in the first recording."""
    return np.array([max(np.std(evidence.records[0].y[c]), 1e-300) for c in block.channels])
