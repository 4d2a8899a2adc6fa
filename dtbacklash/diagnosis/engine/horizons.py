"""Models compared over stretches of a recording, at a short horizon of the predictor and at a long one.

A wrong law has systematic errors: it may lead at one horizon and lose at another. So each model is fitted anew and
compared in three views: at the tuned noise levels (short); at smaller unknown forces, which correct the prediction
less (long); and there once more, whitened by what the judged model leaves (white). The long horizon is the
longest one that the judged model can follow: a free rotor drifts through whole turns if nothing corrects it, and a law
over its position has lost its phase long before.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.attempts import attempt
from dtbacklash.diagnosis.engine.fit import FitProblem, FittedModel
from dtbacklash.diagnosis.engine.motion import Motion
from dtbacklash.diagnosis.engine.predictor import Gains
from dtbacklash.diagnosis.engine.segments import NoiseLevels, Segments
from dtbacklash.physics.effects.declare import Role

VIEWS = SHORT, LONG, WHITE = ("short", "long", "white")
#: stretches over which models are compared
STRETCHES = 12
#: unknown forces of longer and longer horizons (shares of the tuned ones)
LONGER = (0.3, 0.1, 0.05)
#: a model follows a horizon where its mean square is below so many times that of the short one (ratio)
FOLLOWS = 10.0
#: steps of a fit at the short horizon, and at longer ones
STEPS, STEPS_LONGER = 3, 6
#: order of the filter that whitens what the model leaves
ORDER = 40
#: differences are clipped at so many times their median, so that one stretch does not decide
CLIPPED = 3.0

#: a fit: where it stands, its rows, and the gains of its predictors
Fit = tuple[Floats, Floats, list[Gains]]


@dataclass(frozen=True)
class Squares:
    """A model in the three views.

    views : view -> (STRETCHES,) sums of squares of whitened innovations.
    cost : all squares of the short view and what the priors cost, -2 log likelihood.
    """

    views: dict[str, Floats]
    cost: float


class Horizons:
    """Compares models with one that is judged.

    reference : that model; None where its prediction does not stay finite. shares : of the tuned
    unknown forces, from one horizon to the next, as far as the judged model follows.
    """

    def __init__(self, segments: Segments, motion: Motion, model: FittedModel) -> None:
        self.segments, self.motion, self.model = segments, motion, model
        self.shares: tuple[float, ...] = ()
        self._filters: list[list[Floats]] = []
        self.reference = attempt(self._measured, model, self._longest)

    def squares(self, m: FittedModel) -> Squares | None:
        """A model in the three views, fitted anew at the judged one's noise levels; None where it does not follow."""
        return self._measured(m, self._as_long)

    def _measured(self, m: FittedModel, lengthen: Callable[[FitProblem, Fit], Fit | None]) -> Squares | None:
        problem = FitProblem(self.segments, m.rig, m.keys, self.motion, self.model.stiff, m.smooth)
        fit = self._fitted(problem, problem.start(), 1.0, STEPS)
        if fit is None:
            return None
        far = lengthen(problem, fit)
        if far is None:
            return None
        rows = {SHORT: fit[1], LONG: far[1], WHITE: self._whitened_fit(problem, *far)}
        return Squares({view: self._sums(one) for view, one in rows.items()}, float(fit[1] @ fit[1]))

    def _fitted(self, problem: FitProblem, x: Floats, share: float, steps: int) -> Fit | None:
        noise_levels: NoiseLevels = self.segments.scaled(self.model.noise_levels, share)
        x, squares = problem.gauss_newton(noise_levels, x, steps)
        if not np.isfinite(squares):
            return None
        gains = self.segments.gains(problem.base, noise_levels)
        rows = problem.residuals(x, gains)
        return None if rows is None else (x, rows, gains)

    def _longest(self, problem: FitProblem, fit: Fit) -> Fit:
        """The fit at the longest horizon that the judged model follows."""
        data = problem.innovation_rows
        most = FOLLOWS * float(fit[1][:data] @ fit[1][:data])
        for share in LONGER:
            far = attempt(self._fitted, problem, fit[0], share, STEPS_LONGER)
            if far is None or far[1][:data] @ far[1][:data] > most:
                break
            fit, self.shares = far, (*self.shares, share)
        return fit

    def _as_long(self, problem: FitProblem, fit: Fit) -> Fit | None:
        """The fit at the same horizon as the judged model's, by way of the shorter ones."""
        for share in self.shares:
            far = self._fitted(problem, fit[0], share, STEPS_LONGER)
            if far is None:
                return None
            fit = far
        return fit

    def _whitened_fit(self, problem: FitProblem, x: Floats, rows: Floats, gains: list[Gains]) -> Floats:
        """(rows,) whitened by what the judged model leaves, after one more step of the fit to them."""
        data = problem.innovation_rows
        if not self._filters:
            self._filters = [[_whitening(channel) for channel in e.T] for e in self._split(rows)]
        J = problem.jacobian(x, gains, rows)
        K = np.column_stack([np.zeros((data, 0)), *(self._whitened(column[:data]) for column in J.T)])
        all_rows, all_K = np.concatenate([self._whitened(rows[:data]), rows[data:]]), np.vstack([K, J[data:]])
        norms = np.sqrt(np.einsum("ij,ij->j", all_K, all_K)) + 1e-300
        room = [(low * n, high * n) for (low, high), n in zip(_room(problem, x), norms, strict=True)]
        left: Floats = all_rows + (all_K / norms) @ _within(all_K / norms, all_rows, room)
        return left

    def _split(self, rows: Floats) -> list[Floats]:
        """(samples, channels) of each stretch of recording."""
        found, first = [], 0
        for p in self.segments.predictors:
            found.append(rows[first : first + p.readings.y.size].reshape(p.readings.y.shape))
            first += p.readings.y.size
        return found

    def _whitened(self, rows: Floats) -> Floats:
        parts = []
        for e, filters in zip(self._split(rows), self._filters, strict=True):
            each = [np.convolve(f, c)[: len(c)] for f, c in zip(filters, e.T, strict=True)]
            parts.append(np.column_stack(each).ravel())
        return np.concatenate(parts)

    def _sums(self, rows: Floats) -> Floats:
        """(STRETCHES,) sums of squares of innovations; what priors cost has no scatter: it counts in the cost."""
        each = np.concatenate([(e**2).sum(axis=1) for e in self._split(rows)])
        return np.array([part.sum() for part in np.array_split(each, STRETCHES)]) + 1e-12


def paired_t(a: Floats, b: Floats) -> float:
    """By how many standard errors the second model leads; a, b : (stretches,) sums of squares of the two.

    The larger of the leads by differences and by their logarithms.
    """
    return max(_t(a - b), _t(np.log(a / b)))


def _room(problem: FitProblem, x: Floats) -> list[tuple[float, float]]:
    """How far each free parameter may move from x: the rig's own within their ends, others anywhere."""
    ends = [((f.low - f.centre) / f.scale, (f.high - f.centre) / f.scale) if f.prior and f.role is not Role.ANGLE else
            (-np.inf, np.inf) for f in problem.free]  # fmt: skip
    return [(low - at, high - at) for (low, high), at in zip(ends, x.tolist(), strict=True)]


def _within(K: Floats, rows: Floats, ends: Sequence[tuple[float, float]]) -> Floats:
    """The step within its ends that leaves least of ``rows + K step``."""
    if not ends:
        return np.zeros(0)
    step = np.asarray(-np.linalg.lstsq(K, rows, rcond=1e-8)[0], dtype=float)
    low, high = np.array(ends).T
    if (step < low).any() or (step > high).any():
        from scipy.optimize import lsq_linear

        small = np.asarray(np.linalg.qr(np.column_stack([K, -rows]), mode="reduced")[1], dtype=float)
        step = np.asarray(lsq_linear(small[:, :-1], small[:, -1], (low, high), method="bvls").x, dtype=float)
    return step


def _t(d: Floats) -> float:
    """The mean of differences in standard errors; large ones are clipped, so that one stretch does not decide."""
    middle = float(np.median(d))
    d = np.minimum(d, CLIPPED * middle) if middle > 0.0 else d
    error = float(d.std(ddof=1)) / float(np.sqrt(len(d)))
    return float(d.mean()) / max(error, 1e-12 * float(np.abs(d).max()) + 1e-300)


def _whitening(e: Floats) -> Floats:
    """Coefficients of a filter that makes a signal white, by Yule and Walker's equations."""
    n = len(e)
    order = min(ORDER, n // 20)
    spectrum = np.fft.rfft(e, 2 * n)
    r = np.fft.irfft(spectrum * np.conj(spectrum))[: order + 1] / n
    if not r[0] > 0.0:
        return np.ones(1)
    r[0] *= 1.0 + 1e-9
    a = solve_toeplitz(r[:-1], r[1:])
    found: Floats = np.concatenate([[1.0], -a]) / np.sqrt(max(float(r[0] - a @ r[1:]), 1e-300))
    return found
