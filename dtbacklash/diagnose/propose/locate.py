"""Score all candidates: a bank of signatures, and how much of the residual each explains.

A signature is what a candidate changes in the output, at a size at which it is about as large as the residual. What the
nominal parameters can explain is projected out of both (:mod:`.projection`).
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.candidates import Candidate
from dtbacklash.diagnose.data.compare import Block, Steps, places_of
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.propose.delays import delay_grid
from dtbacklash.diagnose.propose.periodic import wave_grid
from dtbacklash.diagnose.propose.projection import Projection
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.diagnose.spread import spread
from dtbacklash.errors import UserError
from dtbacklash.physics.effects.declare import Values
from dtbacklash.physics.rig import Rig

#: a size is changed by so much at once: laws are not linear in it (ratio)
SIGNATURE_GROWTH_MAX = 30.0
#: a size is brought to that of the residual so often (times)
SIGNATURE_GROWTHS = 3
#: a signature within this of the residual's size is not made again (ratio)
SIGNATURE_SIZE_BAND = 3.0
#: a size is made smaller so often where the simulation runs away (times)
SIGNATURE_SHRINKS = 6
#: and by so much (ratio)
SIGNATURE_SHRINK_RATIO = 0.1
#: twice the size is the better start of a fit if it explains so many times as much: from a play that is far too
#: small no way leads to a wide one (ratio)
SIGNATURE_GROWN_GAIN = 1.02
#: where the residual is not noise, samples count so much more towards that than their weight says (ratio)
GAIN_WEIGHT_RATIO = 20.0

#: parameters' values -> simulated signature of one candidate; None: it cannot be simulated
Made = dict[tuple[tuple[str, float], ...], Floats | None]


@dataclass(frozen=True)
class Score:
    """How well one candidate's signature fits the residual.

    values : start of a fit. gain : fall of minus twice the log-likelihood of the training part. signature : (rows,)
    projected, weighted, simulated with the values ``made_at``. whole : its norm before the projection.
    lightest : least weight of a sample in the blocks that it changes.
    """

    candidate: Candidate
    values: Values
    gain: float
    signature: Floats
    whole: float
    lightest: float
    made_at: Values


class Bank(Projection):
    """The signatures of all candidates about one fitted rig."""

    def __init__(self, evidence: Evidence, fitted: Fit) -> None:
        super().__init__(evidence, fitted)
        rough = evidence.residuals(self.rig, steps="rough")
        #: residuals and rows without the candidate
        self._before = {
            steps: (before, self.stack(before)) for steps, before in (("fine", fitted.residuals), ("rough", rough))
        }

    def signature(self, candidate: Candidate, values: Values, made: Made) -> Floats | None:
        """(rows,) the weighted change of the prediction, taken from ``made`` or added to it; None: see :data:`Made`."""
        at = tuple(values.items())
        if at not in made:
            made[at] = self._simulated(candidate, values)
        return made[at]

    def _simulated(self, candidate: Candidate, values: Values) -> Floats | None:
        place, name = candidate.key
        try:
            rig = self.rig.with_effect(place, name, values)
            # a delay is rounded to substeps
            steps: Steps = "fine" if candidate.effect.is_delay else "rough"
            base, before = self._before[steps]
            changed = self.evidence.residuals(rig, base, {place}, steps)
        except UserError:
            return None
        rows = before - self.stack(changed)
        return rows if np.isfinite(rows).all() else None

    def score(self, candidate: Candidate, made: Made) -> Score | None:
        """The best score of a candidate's grid."""
        best: Score | None = None
        for values in wave_grid(candidate, self) or delay_grid(candidate, self) or candidate.grid:
            score = self._score(candidate, values, made)
            if score and (best is None or score.gain > best.gain):
                best = score
        return best

    def _score(self, candidate: Candidate, values: Values, made: Made) -> Score | None:
        size = candidate.effect.size
        signature, values = self._tame(candidate, values, made)
        if signature is None:
            return None
        projected = self.project(signature)
        for _ in range(SIGNATURE_GROWTHS if size.neutral == 0.0 else 0):
            factor = self._wanted(projected, size.low)
            if not factor:
                return None
            value = float(np.clip(values[size.name] * factor, size.low, size.high))
            if 1.0 / SIGNATURE_SIZE_BAND < factor < SIGNATURE_SIZE_BAND or value == values[size.name]:
                break
            again, values = self._tame(candidate, {**values, size.name: value}, made)
            if again is None:
                return None
            signature, projected = again, self.project(again)
            if abs(factor) < SIGNATURE_GROWTH_MAX:
                break
        return self._grown(candidate, self._rate(candidate, values, signature, projected), made)

    def _grown(self, candidate: Candidate, score: Score | None, made: Made) -> Score | None:
        """The score with the size doubled as long as that explains more, as laws need not be linear in their size.

        A fit does not find the way from a play that is far too narrow to a wide one.
        """
        size = candidate.effect.size
        high = self.evidence.bounds(candidate.key).get(size.name, (size.low, size.high))[1]
        while score is not None and size.neutral == 0.0 and score.gain > SETTINGS.gain_min:
            values = {**score.made_at, size.name: 2.0 * score.made_at[size.name]}
            signature = self.signature(candidate, values, made) if abs(values[size.name]) < high else None
            larger = None if signature is None else self._rate(candidate, values, signature, self.project(signature))
            if larger is None or larger.gain < SIGNATURE_GROWN_GAIN * score.gain:
                break
            score = larger
        return score

    def _tame(self, candidate: Candidate, values: Values, made: Made) -> tuple[Floats | None, Values]:
        """The signature and the values, with a smaller size where the simulation diverges (a softening spring)."""
        size = candidate.effect.size
        signature = self.signature(candidate, values, made)
        for _ in range(SIGNATURE_SHRINKS if size.neutral == 0.0 else 0):
            if signature is not None and signature @ signature < 1e6 * max(self.total, 1.0):
                break
            values = {**values, size.name: SIGNATURE_SHRINK_RATIO * values[size.name]}
            signature = self.signature(candidate, values, made)
        return signature, values

    def _wanted(self, projected: Floats, low: float) -> float:
        """Factor on the size at which the signature would fit best, for sizes from ``low`` on; 0: it has no effect."""
        norm = float(projected @ projected)
        if norm < 1e-12 * max(self.total, 1.0):
            return 0.0
        factor = float(projected @ self.residual) / norm
        most = np.sqrt(self.total / norm)
        factor = np.sign(factor) * max(abs(factor), 0.1 * most)
        if factor < 0.0 <= low:
            factor = 0.1 * most  # wrong sign at this size, but perhaps not at another
        return float(np.clip(factor, -SIGNATURE_GROWTH_MAX, SIGNATURE_GROWTH_MAX))

    def _rate(self, candidate: Candidate, values: Values, signature: Floats, projected: Floats) -> Score | None:
        norm = float(projected @ projected)
        if norm < 1e-12 * max(self.total, 1.0):
            return None
        along = float(projected @ self.residual)
        share = along / norm
        size = candidate.effect.size
        if size.neutral == 0.0:
            share = max(share, 0.0) if size.low >= 0.0 else share
            share = float(np.clip(share, -3.0, 3.0))
            value = float(np.clip(values[size.name] * share, size.low, size.high)) if share else values[size.name]
            start = {**values, size.name: value if abs(share) > 0.05 else values[size.name] * 0.05}
        else:
            share, start = float(np.clip(share, 0.0, 1.0)), values
        gain = self._gain(self.residual - share * projected)
        names = blocks_touched(self.rig, self.evidence.blocks, candidate.place)
        lightest = min(float(self.weights[n].min()) for n in names)
        whole, weight = float(np.linalg.norm(signature)), min(lightest * GAIN_WEIGHT_RATIO, 1.0)
        return Score(candidate, start, gain, projected, whole, weight, values)

    def _gain(self, rest: Floats) -> float:
        """Fall of minus twice the log-likelihood, channel by channel, if ``rest`` (rows,) is what remains."""
        gain, start = 0.0, 0
        for name in self.touched:
            for weight in self.weights[name]:
                rows = slice(start, start + self.samples)
                start += self.samples
                before = float(np.sum(self.residual[rows] ** 2))
                after = float(np.sum(rest[rows] ** 2))
                noise = self.samples * weight  # no model can fall below the floor
                gain += before * np.log(max(before, noise) / max(after, noise))
        return gain


def bank(evidence: Evidence, fitted: Fit, listed: list[Candidate]) -> tuple[Bank, list[Score]]:
    """Score all candidates about a fitted rig, best first."""
    signatures = Bank(evidence, fitted)
    views = [signatures, signatures.inward()] if signatures.bound else [signatures]
    scores = spread(partial(_scores, views), listed)
    best: dict[tuple[str, str], Score] = {}
    for score in sorted((s for each in scores for s in each if s is not None), key=lambda s: -s.gain):
        best.setdefault(score.candidate.key, score)
    return signatures, list(best.values())


def _scores(views: list[Bank], candidate: Candidate) -> list[Score | None]:
    """A candidate's scores in several views, which share the simulated signatures."""
    made: Made = {}
    return [view.score(candidate, made) for view in views]


def blocks_touched(rig: Rig, blocks: list[Block], place: str) -> list[str]:
    """Names of the blocks whose prediction an effect at ``place`` can change."""
    return [b.name for b in blocks if place in places_of(rig, b)]
