"""Values of a proposed rig: nominal parameters with priors, laws' sizes and shapes, and noise levels.

Gauss and Newton's method, damped (Marquardt, SIAM J. 11 (1963) 431), on the whitened innovations of the exact predictor
at given noise levels, then the noise levels by likelihood. At those that a wrong rig needs the predictor forgives so
much that a fit stops beside the optimum: so values are fitted first at smaller ones, and what is likelier is kept.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.least_squares import DAMPED, STEP_MAX, damped_step, secant
from dtbacklash.diagnosis.engine.motion import Motion
from dtbacklash.diagnosis.engine.parameters import (
    FreeParameter,
    Key,
    apply,
    effect_free,
    nominal_free,
    standing,
    taken_out,
    zeros_free,
)
from dtbacklash.diagnosis.engine.predictor import Gains
from dtbacklash.diagnosis.engine.segments import NoiseLevels, Segments
from dtbacklash.diagnosis.parallel import spread
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.table import VALUES
from dtbacklash.physics.rig import Rig

#: priors of nominal parameters are so much stiffer until the last fit, or an inertia takes a law's place
STIFF = 10.0
#: rungs of the ladder: shares of the noise levels
LADDER = (0.1, 0.1, 0.1, 1.0)
#: laws that are efforts over states of a body or a spring
EFFORTS = (slots.BodyEffort, slots.BodyDamping, slots.Contact, slots.SpringForce)
#: a fit ends where a step brings less (share of the sum of squares; sum of squares), or promises a share of that
ENOUGH, CONVERGED = (1e-4, 20.0), 1e-3
#: a Jacobian serves on by its secants while falls are as promised, within this share
TRUSTED = 0.5


@dataclass(frozen=True)
class FittedModel:
    """A fitted rig.

    Attributes
    ----------
    keys : (place, effect) of what was added to the nominal rig. noise_levels : of unknown forces and noises.
    loss : -2 log likelihood with priors. counts : degrees of freedom of what was added and of what is
    each recording's own. score : loss + log N counts,
    by which all models are compared (Schwarz, Ann. Statist. 6 (1978) 461). at_end : whether some law's value was not
    chosen by the data. x, free : of the fit. smooth : table -> (KNOTS - 2, KNOTS) what holds back how it bends.
    """

    rig: Rig
    keys: tuple[Key, ...]
    noise_levels: NoiseLevels
    loss: float
    counts: float
    score: float
    at_end: bool
    free: tuple[FreeParameter, ...] = field(repr=False, default=())
    x: Floats = field(repr=False, default_factory=lambda: np.zeros(0))
    smooth: dict[Key, Floats] = field(repr=False, default_factory=dict)
    stiff: float = STIFF

    @property
    def ends(self) -> set[Key]:
        """The names with a value that the data did not choose: it stands at an end of its range."""
        return {f.key for f, x in zip(self.free, self.x, strict=True) if f.at_end(x)}


class FitProblem:
    """The values of one proposed rig on some segments.

    keys : of what it has beside the nominal rig. held : whether what the nominal rig says stays as it is in the rig.
    """

    def __init__(
        self, segments: Segments, rig: Rig, keys: Sequence[Key], motion: Motion, stiff: float = STIFF,
        smooth: dict[Key, Floats] | None = None, held: bool = False,
    ) -> None:  # fmt: skip
        self.segments, self.base, self.keys, self.stiff = segments, rig, tuple(keys), stiff
        self.smooth = {key: root for key, root in (smooth or {}).items() if key in self.keys}
        self.motion = motion
        self.free = [] if held else nominal_free(segments.nominal, rig, segments.recordings)
        self.free += zeros_free(segments.nominal, segments.spreads)
        self.priors = len(self.free)
        for key in self.keys:
            self.free += effect_free(rig, key, motion(key[0]), segments.recordings)
        # what belongs to one recording takes no law's place in the others
        self.weights = np.array([stiff if f.recording is None else 1.0 for f in self.free[: self.priors]])

    def hold(self, j: int) -> None:
        """Fit a parameter no more: it stays where the base rig has it."""
        if self.free.pop(j).prior:
            self.priors, self.weights = self.priors - 1, np.delete(self.weights, j)

    @property
    def counts(self) -> int:
        """Free parameters of what was added, and of what is each recording's own."""
        own = sum(f.recording is not None and not f.is_zero for f in self.free[: self.priors])
        return len(self.free) - self.priors + own

    def start(self) -> Floats:
        """(free,) where the base rig stands."""
        return np.array([standing(f, self.base) if f.prior else 0.0 for f in self.free])

    def better_start(self, noise_levels: NoiseLevels) -> Floats:
        """The same, or with parameters as they were given: a wrong rig has moved them."""
        here, given = self.start(), np.zeros(len(self.free))
        if not here.any():
            return here
        try:
            gains = self.segments.gains(self.base, noise_levels)
        except (UserError, np.linalg.LinAlgError):
            return here
        costs = [np.inf if rows is None else rows @ rows for rows in (self.residuals(x, gains) for x in (here, given))]
        return given if costs[1] < costs[0] else here

    def rig(self, x: Floats) -> Rig:
        """The rig at x."""
        return apply(self.base, self.free, x)

    def prior_residuals(self, x: Floats) -> Floats:
        """(rows,) of priors, and of how tables bend."""
        rows = [self.weights * x[: self.priors]]
        for key, root in self.smooth.items():
            values = [f.value(xi) for f, xi in zip(self.free, x, strict=True) if f.key == key and f.name in VALUES]
            rows.append(root @ np.array(values))
        return np.concatenate(rows)

    def residuals(
        self, x: Floats, gains: Sequence[Gains], recording: int | None = None, others: Floats | None = None
    ) -> Floats | None:
        """Whitened innovations, then :meth:`prior_residuals`; None where the rig cannot be, or does not stay finite.

        recording, others : see :meth:`.Segments.residuals`.
        """
        try:
            found = self.segments.residuals(self.rig(x), gains, recording, others)
        except (UserError, np.linalg.LinAlgError):
            return None
        return None if found is None else np.concatenate([found, self.prior_residuals(x)])

    def sensitivity(self, j: int, x: Floats, gains: Sequence[Gains], rows: Floats) -> Floats:
        """(rows,) derivative by one parameter; 0 where it cannot be moved."""
        for step in (self.free[j].step, -self.free[j].step):
            z = x.copy()
            z[j] += step
            there = self.residuals(z, gains, self.free[j].recording, rows)
            if there is not None:
                return (there - rows) / step
        return np.zeros_like(rows)

    def jacobian(
        self, x: Floats, gains: Sequence[Gains], rows: Floats, near: dict[str, Floats] | None = None
    ) -> Floats:
        """(rows, free). near : nominal columns of another rig nearby, by title, without the rows beside."""
        J = np.zeros((len(rows), len(self.free)))
        data, asked = self.innovation_rows, []
        if near is None and self.dear:
            near = self.leads(x, gains)
        for j, f in enumerate(self.free):
            if f.prior and near is not None and (f.title in near or not self.dear):
                if f.title in near:
                    J[:data, j] = near[f.title]
                J[data + j, j] = self.weights[j]
                continue
            asked.append(j)
        some = spread if self.dear else map
        for j, column in zip(asked, some(lambda j: self.sensitivity(j, x, gains, rows), asked), strict=True):
            J[:, j] = column
        return J

    def coarsely(self, x: Floats, gains: Sequence[Gains], rows: Floats) -> tuple["FitProblem", Floats]:
        """The problem in coarse steps, for differences: they err alike at both ends; and its residuals.

        Itself where it is so, or where coarse steps do not stay finite.
        """
        coarse = self.segments.coarse
        if coarse is self.segments:
            return self, rows
        rough = copy.copy(self)
        rough.segments = coarse
        own = rough.residuals(x, gains)
        return (self, rows) if own is None else (rough, own)

    def step_jacobian(
        self, x: Floats, gains: Sequence[Gains], rows: Floats, near: dict[str, Floats] | None = None
    ) -> Floats:
        """The Jacobian of a step, by coarse steps."""
        rough, rows = self.coarsely(x, gains, rows)
        return rough.jacobian(x, gains, rows, near)

    @property
    def dear(self) -> bool:
        """Whether passes are those of a simulator's model, and what it shows is its state."""
        shown = {self.base.sensors[c].quantity for p in self.segments.predictors for c in p.readings.channels}
        return bool(self.base.config.model) and shown <= {"position", "velocity"}

    def leads(self, x: Floats, gains: Sequence[Gains], kept: bool = True) -> dict[str, Floats]:
        """Columns of the rig's parameters by what they add to each sample, by title.

        kept : see :meth:`.Predictor.leads`; else of the laws that are efforts over states as well.
        """
        rig, moved, per = self.rig(x), {}, {}
        for j, f in enumerate(self.free):
            law = f.effect and (kept or rig.effect(*f.key) is None or not isinstance(
                find(rig.kind_at(f.place), f.effect, f.place).slot, EFFORTS))  # fmt: skip
            if f.recording is not None or f.is_zero or law:
                continue
            for step in (f.step, -f.step):
                z = x.copy()
                z[j] += step
                by = f.value(z[j]) - f.value(x[j])
                if by:
                    moved[f.title], per[f.title] = (self.rig(z), by), f.per_x(x[j])
                    break
        found = self.segments.leads(rig, moved, gains, kept) if moved else {}
        return {title: per[title] * column for title, column in found.items()}

    @property
    def innovation_rows(self) -> int:
        """Rows that are innovations."""
        return self.segments.innovations

    def gauss_newton(
        self, noise_levels: NoiseLevels, x: Floats, steps: int, near: dict[str, Floats] | None = None
    ) -> tuple[Floats, float]:
        """(values at given noise levels, sum of squares); infinite where the start does not stay finite."""
        try:
            gains = self.segments.gains(self.base, noise_levels)
        except (UserError, np.linalg.LinAlgError):
            return x, np.inf
        rows, damping = self.residuals(x, gains), DAMPED
        if rows is None:
            return x, np.inf
        if not self.free:
            return x, float(rows @ rows)
        J, fresh = self.step_jacobian(x, gains, rows, near), near is None
        turn, cut, own = 0, 0, [f.prior and f.recording is not None and not f.is_zero for f in self.free]
        while turn - cut < steps:
            here = float(rows @ rows)
            least = min(ENOUGH[0] * here, ENOUGH[1])
            try:
                tried = damped_step(lambda z: self.residuals(z, gains), x, J, rows, damping, CONVERGED * least)
            except np.linalg.LinAlgError:
                return x, here
            if tried is None:
                return x, here
            damping, trusted = tried.damping, False
            if tried.rows is None and fresh:
                break
            if tried.rows is not None:
                # what is one recording's own is hardly known: a step of it that is cut short is on its way still
                cut += cut < steps and bool((np.abs(tried.step)[own] >= STEP_MAX).any())
                turn += 1
                fall = here - float(tried.rows @ tried.rows)
                missed = tried.rows - rows - J @ tried.step
                x, rows, damping = x + tried.step, tried.rows, damping / 8.0
                if fresh and fall < least:
                    break
                trusted, fresh = abs(fall - tried.promised) <= TRUSTED * tried.promised, False
            if trusted:
                J += secant(tried.gram, missed, tried.step)
            elif turn - cut < steps:
                J, fresh, damping = self.step_jacobian(x, gains, rows), True, min(damping, DAMPED)
        return x, float(rows @ rows)

    def solved(
        self, noise_levels: NoiseLevels, steps: int, near: dict[str, Floats] | None = None
    ) -> tuple[Floats, float]:
        """The same from the better start; from both where a parameter has left its tolerance.

        What is missing moves a parameter that is hardly known far away, and few steps do not bring it back.
        """
        both = (self.start(), np.zeros(len(self.free))) if np.abs(self.start()).max(initial=0.0) > 1.0 else (
            self.better_start(noise_levels),)  # fmt: skip
        return min((self.gauss_newton(noise_levels, x, steps, near) for x in both), key=lambda found: found[1])

    def model(self, x: Floats, noise_levels: NoiseLevels, likelihood: float) -> FittedModel:
        """What came of a fit."""
        rig, beside = self.rig(x), self.prior_residuals(x)
        loss = likelihood + float(beside @ beside)
        gone = any(rig.effect(*key) is None for key in self.keys)
        at_end = gone or any(f.at_end(xi) for f, xi in zip(self.free, x, strict=True))
        counts = self.degrees(x, noise_levels) if self.smooth else float(self.counts)
        score = loss + np.log(self.segments.count) * counts
        return FittedModel(
            rig, self.keys, noise_levels, loss, counts, score, at_end, tuple(self.free), x, self.smooth, self.stiff
        )

    def degrees(self, x: Floats, noise_levels: NoiseLevels) -> float:
        """Degrees of freedom of what was added: of a table held back, the trace of what its values answer for."""
        total = float(sum(f.recording is not None and not f.is_zero for f in self.free[: self.priors]))
        gains = self.segments.gains(self.base, noise_levels)
        rows = self.residuals(x, gains)
        for key in self.keys:
            there = [j for j, f in enumerate(self.free) if f.key == key]
            if key not in self.smooth or rows is None:
                total += len(there)
                continue
            J = np.column_stack([self.sensitivity(j, x, gains, rows) for j in there])
            data = J[: self.innovation_rows]
            total += float(np.trace(np.linalg.lstsq(J.T @ J, data.T @ data, rcond=1e-12)[0]))
        return total

    def homotopy_fit(
        self, noise_levels: NoiseLevels, x: Floats | None = None, rungs: Sequence[float] = LADDER, steps: int = 5
    ) -> FittedModel | None:
        """Values at smaller noise levels first, then noise levels; None where nothing stays finite."""
        x = self.start() if x is None else x
        best: tuple[float, Floats, NoiseLevels, float] | None = None
        better = True
        for turn, share in enumerate(rungs):
            if turn and share < 1.0 and not better:
                continue
            at = self.segments.scaled(noise_levels, share)
            found, squares = self.gauss_newton(at, x, steps)
            better = False
            if not np.isfinite(squares):
                continue
            rig = self.rig(found)
            tuned, likelihood = self.segments.tuned(
                rig, at, steps=(2.0, 0.7) if share < 1.0 else (0.7, 0.25), refresh=1
            )
            beside = self.prior_residuals(found)
            loss = likelihood + float(beside @ beside)
            if best is None or loss < best[0]:
                better, best, x, noise_levels = True, (loss, found, tuned, likelihood), found, tuned
        return None if best is None else self.model(*best[1:])


def without_name(segments: Segments, model: FittedModel, key: Key) -> FittedModel:
    """A model without one of its names, all else as it is, at the noise levels that it then needs."""
    rig = taken_out(model.rig, key)
    keys = tuple(k for k in model.keys if rig.effect(*k) is not None)
    return replace(
        model, rig=rig, keys=keys, noise_levels=segments.tuned(rig, model.noise_levels, steps=(2.0, 0.7), refresh=1)[0]
    )


def as_given(segments: Segments, motion: Motion, model: FittedModel) -> FittedModel | None:
    """A model with the parameters that the nominal rig gives, its names fitted anew; None where it is not finite."""
    known = nominal_free(segments.nominal, model.rig, segments.recordings)
    rig = apply(model.rig, known, np.zeros(len(known)))
    problem = FitProblem(segments, rig, model.keys, motion, model.stiff, model.smooth, held=True)
    found = [
        problem.homotopy_fit(noise_levels, None, (1.0, 0.1, 1.0))
        for noise_levels in (model.noise_levels, segments.tuned(rig)[0])
    ]
    return min((m for m in found if m is not None), key=lambda m: m.loss, default=None)


def as_it_stands(segments: Segments, motion: Motion, model: FittedModel) -> FittedModel:
    """A model at the values of its rig and the likeliest noise levels, with priors as where names are compared."""
    problem = FitProblem(segments, model.rig, model.keys, motion, STIFF, model.smooth)
    return problem.model(problem.start(), *segments.tuned(model.rig, model.noise_levels))
