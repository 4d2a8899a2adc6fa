"""The twin's bank: which one thing has changed, from the last buffers of what the controller records.

It is the diagnosis on little data. What is believed is known well, so that one thing at a time is looked for beside the
gap: a law of the catalogue, or a parameter that has moved. The engine of the diagnosis ranks laws by columns, fits them
to the predictor's innovations, and compares all by one score.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.control.belief import Belief
from dtbacklash.diagnosis.engine.candidates import CandidateSensitivities
from dtbacklash.diagnosis.engine.fit import FitProblem, FittedModel
from dtbacklash.diagnosis.engine.motion import Motion, motion_of
from dtbacklash.diagnosis.engine.parameters import Key
from dtbacklash.diagnosis.engine.predictor import Predictor
from dtbacklash.diagnosis.engine.proposals import STRICT
from dtbacklash.diagnosis.engine.resampling import readings
from dtbacklash.diagnosis.engine.rig_simulator import Simulated
from dtbacklash.diagnosis.engine.segments import NoiseLevels, Segments
from dtbacklash.diagnosis.engine.selection import LEAST
from dtbacklash.diagnosis.settings import SETTINGS
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects import slots
from dtbacklash.physics.rig import Rig, build_rig

#: a parameter that may have changed, and the gap, are known to so much before (share; share, rad)
CHANGED, GAP, LEAST_GAP = 0.5, 0.3, 0.01
#: laws of each ranking that are fitted; and how many of all are fitted to the end
LAWS, FITTED = 5, 3
#: share of its size by which a change's standard error may be uncertain for the change to be believed in
UNSURE = 0.3


@dataclass(frozen=True)
class Buffer:
    """What the controller has recorded: u (N,) command; y, sensor -> (N,) readings, SI."""

    u: Floats
    y: dict[str, Floats]
    sample_time_s: float


@dataclass(frozen=True)
class Value:
    """A parameter as fitted, SI, its standard error, what was believed of it; 0: nothing."""

    name: str
    value: float
    std: float
    believed: float = 0.0

    def __str__(self) -> str:
        if self.believed:
            return f"{self.name} {100.0 * (self.value / self.believed - 1.0):+.3g} %"
        return f"{self.name} {self.value:.3g}"


@dataclass(frozen=True)
class Diagnosis:
    """What the bank says of its buffers.

    verdict : `nothing` but the gap, `changed`, `ambiguous` (``names`` explain them equally well) or `unknown` (no
    single change explains them). names : of changes, best first. values : of the first. gap_rad : half-gap that goes
    with it. belief : the changed one; that of before where nothing is named. sure : whether the size of the change is
    known well enough to be believed in. is_law : whether a law is among the names, and not
    parameters alone. cpu_s : processor time.
    """

    verdict: str
    names: tuple[str, ...]
    values: tuple[Value, ...]
    gap_rad: float
    belief: Belief
    sure: bool
    is_law: bool
    cpu_s: float

    @property
    def found(self) -> str:
        """A few words, for a table."""
        if self.verdict == "ambiguous":
            return "ambiguous: " + " or ".join(self.names)
        if self.verdict == "changed":
            return f"{self.names[0]}: {', '.join(map(str, self.values))}" + ("" if self.sure else " (not sure)")
        return self.verdict


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A change to be tried.

    rig : with it. moved : parameters that it moves. key : of the law that it adds; altered : of one that was there.
    """

    name: str
    rig: Rig
    moved: tuple[str, ...] = ()
    key: Key | None = None
    altered: Key | None = None


@dataclass(frozen=True, eq=False)
class _Tried:
    """A candidate after its fit. score : -2 log likelihood with log N for each of its parameters."""

    candidate: _Candidate
    problem: FitProblem
    model: FittedModel
    score: float

    @property
    def counts(self) -> int:
        """Parameters of the change."""
        return len(self.candidate.moved) + round(self.model.counts)


def diagnose_buffers(belief: Belief, buffers: Sequence[Buffer], gaps_rad: Sequence[float]) -> Diagnosis:
    """What has changed.

    Parameters
    ----------
    belief : what is believed of the machine. buffers : each begins at rest and holds a move; the same change is looked
    for in all. gaps_rad : half-gap in force in each; that of the last one is free, and how it grew is taken as known.

    Raises
    ------
    UserError : a buffer that is too short or not finite; nothing recorded shows some part of the rig.
    """
    began = time.process_time()
    for buffer in buffers:
        columns = (buffer.u, *buffer.y.values())
        if len({c.shape for c in columns}) != 1 or buffer.u.ndim != 1 or buffer.u.size < 500:
            raise UserError("twin.bank_buffer", [c.shape for c in columns], "equal columns of at least 500 samples")
        if not all(np.all(np.isfinite(c)) for c in columns):
            raise UserError("twin.bank_buffer", "nan", "finite measurements only")
    said = _Bank(belief, buffers, gaps_rad).said()
    return replace(said, cpu_s=time.process_time() - began)


def warm_up(belief: Belief, sensors: Sequence[str], sample_time_s: float) -> None:
    """Load what a diagnosis needs."""
    u = np.sin(0.1 * np.arange(500))
    _Bank(belief, [Buffer(u, dict.fromkeys(sensors, 0.001 * u), sample_time_s)], [0.0]).said()


class _Bank:
    """One diagnosis of buffers."""

    def __init__(self, belief: Belief, buffers: Sequence[Buffer], gaps_rad: Sequence[float]) -> None:
        self.belief = belief
        self.rig = _with_gap(_exact(belief.rig), gaps_rad[-1])
        found = []
        for k, (buffer, gap) in enumerate(zip(buffers, gaps_rad, strict=True)):
            channels = tuple(c for c in self.rig.sensors if c in buffer.y)
            r = readings(buffer.u, buffer.y, channels, buffer.sample_time_s, 1, False, None, k)
            found.append(Predictor(self.rig, Simulated(replace(r, opened=gap - gaps_rad[-1]))))
        self.segments = Segments(self.rig, tuple(found))
        noise_levels, _ = self.segments.tuned(self.rig)
        self.motion: Motion = motion_of(self.segments, self.rig, self.segments.gains(self.rig, noise_levels))
        base = self._fitted(_Candidate("nothing", self.rig), noise_levels)
        if base is None:
            raise UserError("model", belief.rig.config.name, "one that follows the buffer: its simulation does not")
        self.base = base

    def said(self) -> Diagnosis:
        """The verdict, by the diagnosis's own bars."""
        tried = self._tried()
        if not tried or self.base.score - tried[0].score < LEAST:
            return self._as("nothing" if self._explains(self.base, SETTINGS.unexplained_attention) else "unknown", ())
        rivals = [t for t in tried if t.score - tried[0].score < LEAST]
        # of those that are alike the ones with the fewest parameters
        fewest = min(t.counts for t in rivals)
        rivals = [t for t in rivals if t.counts == fewest]
        earned = self.base.score - rivals[0].score
        if (
            not self._explains(rivals[0], SETTINGS.max_unexplained)
            or self._table_beside(rivals[0]) > SETTINGS.tie_ratio * earned
        ):
            return self._as("unknown", ())
        return self._as("ambiguous" if len(rivals) > 1 else "changed", tuple(rivals))

    def _explains(self, tried: _Tried, most: float) -> bool:
        """Whether no more unknown force than that, a share of the motion, is needed beside it."""
        clipped = tuple(
            np.concatenate([np.minimum(s[: len(p.bodies)], math.log(most)), s[len(p.bodies) :]])
            for s, p in zip(tried.model.noise_levels, self.segments.predictors, strict=True)
        )
        rig = tried.model.rig
        return self._likelihood(rig, clipped) - self._likelihood(rig, tried.model.noise_levels) < LEAST

    def _table_beside(self, tried: _Tried) -> float:
        """What the best law free of form would earn beside a change."""
        ranked = CandidateSensitivities(
            self.segments, replace(tried.model, keys=()), tried.model.noise_levels, tables=True
        ).ranked
        return ranked[0].gain if ranked else 0.0

    def _tried(self) -> list[_Tried]:
        """The likeliest changes, fitted, best first."""
        strict = self.segments.scaled(self.base.model.noise_levels, STRICT[0])
        rough = []
        for candidate in [*_parameters(self.rig), *self._laws()]:
            problem = self._problem(candidate)
            x, squares = problem.gauss_newton(strict, problem.better_start(strict), 3)
            if np.isfinite(squares):
                rough.append((squares, replace(candidate, rig=problem.rig(x))))
        rough.sort(key=lambda r: r[0])
        fitted: dict[str, _Tried] = {}
        for _, candidate in rough:
            if candidate.name not in fitted and len(fitted) < FITTED:
                done = self._fitted(candidate, strict)
                if done is not None and not done.model.at_end:
                    fitted[candidate.name] = done
        return sorted(fitted.values(), key=lambda t: t.score)

    def _laws(self) -> Iterator[_Candidate]:
        """The best laws by their columns, where little is forgiven."""
        model = self.base.model
        for p in CandidateSensitivities(
            self.segments, model, self.segments.scaled(model.noise_levels, STRICT[-1])
        ).ranked[:LAWS]:
            place, name = p.keys[0]
            try:
                yield _Candidate(f"{name} {place}", p.put(model.rig), (), p.keys[0])
            except UserError:
                continue

    def _problem(self, candidate: _Candidate) -> FitProblem:
        """Free are the gap and what the candidate changes."""
        nominal = _freed(self.rig, candidate)
        keys = () if candidate.key is None else (candidate.key,)
        return FitProblem(Segments(nominal, self.segments.predictors), candidate.rig, keys, self.motion, 1.0)

    def _fitted(self, candidate: _Candidate, noise_levels: NoiseLevels) -> _Tried | None:
        """Values at smaller and smaller noise levels, then the likeliest noise levels, and values at these."""
        problem = self._problem(candidate)
        x, squares = problem.start(), math.inf
        for share in (1.0, *STRICT):
            x, squares = problem.gauss_newton(self.segments.scaled(noise_levels, share), x, 4)
        if not np.isfinite(squares):
            return None
        own, _ = self.segments.tuned(problem.rig(x))
        x, _ = problem.gauss_newton(own, x, 4)
        model = problem.model(x, own, self._likelihood(problem.rig(x), own))
        return _Tried(candidate, problem, model, model.score + math.log(self.segments.count) * len(candidate.moved))

    def _likelihood(self, rig: Rig, noise_levels: NoiseLevels) -> float:
        return sum(
            p.likelihood(rig, p.gains(rig, s)) for p, s in zip(self.segments.predictors, noise_levels, strict=True)
        )

    def _as(self, verdict: str, about: tuple[_Tried, ...]) -> Diagnosis:
        names = tuple(t.candidate.name for t in about)
        best = about[0] if about else self.base
        gap = best.model.rig.amount(_gear(self.rig), slots.GearPlay, "half_gap") if _gear(self.rig) else 0.0
        law = any(t.candidate.key or t.candidate.altered for t in about)
        if verdict != "changed":
            return Diagnosis(verdict, names, (), gap, self.belief, False, law, 0.0)
        values = tuple(self._values(best))
        sure = values[0].std < UNSURE * abs(values[0].value - values[0].believed)
        return Diagnosis(verdict, names, values, gap, Belief(self._believed(best)), sure, law, 0.0)

    def _values(self, tried: _Tried) -> Iterator[Value]:
        """What a change moved, with standard errors."""
        problem, model, change = tried.problem, tried.model, tried.candidate
        gains = self.segments.gains(model.rig, model.noise_levels)
        rows = problem.residuals(model.x, gains)
        assert rows is not None
        J = problem.jacobian(model.x, gains, rows)
        errors = np.sqrt(np.maximum(np.diag(np.linalg.pinv(J.T @ J)), 0.0))
        for f, x, error in zip(model.free, model.x, errors, strict=True):
            if f.key in (change.key, change.altered) or (not f.effect and f.name in change.moved):
                yield Value(f.name, f.value(x), abs(f.per_x(x)) * float(error), f.centre if f.prior else 0.0)

    def _believed(self, tried: _Tried) -> Rig:
        """The believed rig with a change; gap and tolerances stay as they were."""
        rig, found, change = self.belief.rig, tried.model.rig, tried.candidate
        key = change.key or change.altered
        if key is not None:
            return rig.with_effect(*key, found.effects[key[0]][key[1]])
        return rig.with_parameters({name: found.config.parameters[name].value for name in change.moved})


def _exact(rig: Rig) -> Rig:
    """The rig with nothing that may move."""
    config = rig.config
    exact = build_rig(replace(config, parameters={n: replace(p, tolerance=0.0) for n, p in config.parameters.items()}))
    for place, there in rig.effects.items():
        for name, values in there.items():
            exact = exact.with_effect(place, name, {p: {"value": v, "tolerance": 0.0} for p, v in values.items()})
    return exact


def _gear(rig: Rig) -> str:
    gear = rig.only("gear")
    return gear.name if gear else ""


def _with_gap(rig: Rig, gap_rad: float) -> Rig:
    """The rig with a gap that is free; where the rig has no gear, as it is."""
    if not _gear(rig):
        return rig
    gap = max(gap_rad, LEAST_GAP)
    leaf = {"value": gap, "tolerance": max(GAP, 2.0 * LEAST_GAP / gap)}
    return rig.with_effect(_gear(rig), "backlash", {"half_gap": leaf})


def _freed(rig: Rig, candidate: _Candidate) -> Rig:
    """The nominal rig of a candidate, in which what it moves is free about what was believed."""
    parameters = {
        name: replace(p, tolerance=CHANGED if name in candidate.moved else 0.0)
        for name, p in rig.config.parameters.items()
    }
    freed = build_rig(replace(rig.config, parameters=parameters))
    if candidate.altered is None:
        return freed
    place, name = candidate.altered
    size = find(rig.kind_at(place), name, place).size.name
    leaves = {p: {"value": v, "tolerance": CHANGED if p == size else 0.0} for p, v in rig.effects[place][name].items()}
    return freed.with_effect(place, name, leaves)


def _parameters(rig: Rig) -> Iterator[_Candidate]:
    """What the rig has and may have moved: its parameters, those of its effects, both constants of a motor."""
    config = rig.config
    for name in config.used:
        yield _Candidate(name, rig, (name,))
    motor = rig.only("motor_circuit")
    if motor is not None:  # one magnet makes both
        pair = tuple(str(config.elements[motor.name][f]) for f in ("torque_constant", "emf_constant"))
        yield _Candidate(" and ".join(pair), rig, pair)
    for place, there in rig.effects.items():
        for name in there:
            if place != _gear(rig):
                yield _Candidate(f"{name} {place}", rig, altered=(place, name))
