"""The last fit, under a slower pull where the pull moves position and speed.

The search pulls fast, so that laws are evaluated along the measured motion. Once the laws are known, a slow pull gives
weight to slow drift, so that the parameters predict the recording without any pull.
"""

from dataclasses import replace

from dtbacklash.diagnose.data.compare import Block
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.data.floor import noise_floor
from dtbacklash.diagnose.data.pull import observer_gains
from dtbacklash.diagnose.fit.comparison import lead_of
from dtbacklash.diagnose.fit.intervals import Linear, polished
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import ON
from dtbacklash.diagnose.search.leave_out import refit_with
from dtbacklash.diagnose.search.model import Model, seen_by

#: bandwidth of the last fit where the pull moves position and speed: prediction lives at low frequencies (tempos)
PULL_SLOW_RATIO = 0.05


def slow_evidence(evidence: Evidence) -> Evidence:
    """The same recordings with the last fit's pull where that moves position and speed; else itself."""
    blocks = [
        replace(b, gains=observer_gains(PULL_SLOW_RATIO * b.tempo / b.step_s, b.step_s)) if b.gains[1] > 0.0 else b
        for b in evidence.blocks
    ]
    return _pulled_by(evidence, blocks)


def slower(evidence: Evidence, times: float) -> Evidence:
    """The same recordings, pulled so many times slower; itself where nothing is pulled."""
    return _pulled_by(
        evidence, [replace(b, gains=(b.gains[0] / times, b.gains[1] / times**2)) for b in evidence.blocks]
    )


def _pulled_by(evidence: Evidence, blocks: list[Block]) -> Evidence:
    if blocks == evidence.blocks:
        return evidence
    return replace(
        evidence, blocks=blocks, floor=noise_floor(evidence.nominal, blocks, evidence.records, evidence.noise)
    )


def refit_slowly(model: Model) -> tuple[Model, Evidence, Fit, Linear]:
    """Refit what was found with the slow pull, and polish it; the model takes over its parameters.

    Returns
    -------
    The model; the evidence and the fit from which the intervals are taken, and what that is about where it ended. The
    model's own evidence and fit where its fit by what drifts slowly leaves more: what is said is said of the fit that
    was compared. A body that friction holds stops elsewhere after the smallest error, and nothing brings it back.
    """
    evidence = model.evidence
    slow = slow_evidence(evidence)
    if slow is not evidence and model.named:
        start = seen_by(slow, model.fitted)
        effects = [(key, start.effects[key]) for key in model.keys]
        fitted, about = polished(slow, refit_with(slow, start, effects, rounds=ON))
        seen = seen_by(evidence, fitted)
        if not lead_of(evidence, seen.residuals, model.fitted.residuals).clear:
            return replace(model, fitted=seen), slow, fitted, about
    fitted, about = polished(evidence, model.fitted)
    return replace(model, fitted=fitted), evidence, fitted, about
