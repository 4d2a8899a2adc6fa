"""How a name comes to be sure: it leads every rival in every view.

A rival is the rig without the name, with each of the best other names or pairs in its place, and with a table over a
state of its place. Errors of a wrong law are systematic: it may lead at one horizon of the predictor and loses at
another. So each rival is fitted anew and compared over twelve stretches in three views: at the tuned sizes of what is
unknown, at a twentieth of them (a long horizon), and there once more whitened by what the model itself leaves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.optimize import lsq_linear
from scipy.signal import lfilter

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.engine.columns import Columns, Proposal
from dtbacklash.diagnose.engine.exact import Model, Problem
from dtbacklash.diagnose.engine.factors import Off, numbers_instead
from dtbacklash.diagnose.engine.free import Key
from dtbacklash.diagnose.engine.predictor import ASTRAY
from dtbacklash.diagnose.engine.search import Search
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Role

#: stretches over which models are compared, and unknown forces of the long horizon (share of the tuned ones)
STRETCHES, LONG = 12, 0.05
#: order of the filter that whitens what the model leaves
ORDER = 40
#: differences are clipped at so many times their median, so that one stretch does not decide
CLIPPED = 3.0
VIEWS = ("short", "long", "white")


@dataclass(frozen=True)
class Compared:
    """One model in the three views: per view (STRETCHES,) sums of squares."""

    squares: dict[str, Floats]


@dataclass(frozen=True)
class Rival:
    """What was tried in the place of a name.

    keys : what stands there instead; none where nothing does. model : with it. lead : its score less that of the model
    with the name. t : view -> lead over it in standard errors. agree : share of the stretches, in all views.
    ratio : rms that it leaves at the long horizon, over that of the model. container : whether its law holds the
    name's as a special case. beaten : whether the name leads it.
    """

    keys: tuple[Key, ...]
    model: Model = field(repr=False)
    lead: float
    t: dict[str, float]
    agree: float
    ratio: float
    container: bool
    beaten: bool

    @property
    def least(self) -> float:
        """The smallest lead, in standard errors."""
        return min(self.t.values())


@dataclass(frozen=True)
class Judged:
    """A model and what each of its names rests on.

    rivals : per name. explains : per name, the fall of -2 log likelihood beside the model without it. adds : per name,
    what the best table at its place adds beside it, a share of that. tables : per name, the table that comes nearest to
    the force that is missing without it (recovered, with its errors). sure : the names that are.
    rest : the best tables beside all names, best first. numbers : of the rig, that a wrong gain only stands for.
    """

    model: Model
    rivals: dict[Key, tuple[Rival, ...]]
    explains: dict[Key, float]
    adds: dict[Key, float]
    tables: dict[Key, tuple[Proposal, ...]]
    sure: frozenset[Key]
    rest: tuple[Proposal, ...]
    numbers: tuple[Off, ...] = ()


class Judge:
    """Judges the model at which a search has ended."""

    def __init__(self, search: Search) -> None:
        self.search, self.bench, self.rules = search, search.bench, search.rules
        self.model = search.now
        self.filters: list[list[Floats]] | None = None
        self.here = self._compared(self.model)

    def judged(self) -> Judged:
        """All names of the model."""
        model, search = self.model, self.search
        rivals: dict[Key, tuple[Rival, ...]] = {}
        explains, adds, tables = {}, {}, {}
        rest = self._tables(model, None)
        first = self.bench.of_first(model.sizes)
        sure, numbers = set(), numbers_instead(search.quick, first, model, search.motion, self.rules.worth)
        for n, key in enumerate(model.keys):
            search.tell(f"trying what else could stand for {key[1]} at {key[0]}", 0.6 + 0.3 * n / len(model.keys))
            entry = find(model.rig.kind_at(key[0]), key[1], key[0])
            if entry.is_table:
                continue
            less = search.without(model, key)
            if less is None:
                continue
            explains[key] = max(less.score - model.score, 0.0)
            tables[key] = self._tables(less, key[0])
            tried = [less, *self._others(less, key), *self._with_tables(less, tables[key])]
            rivals[key] = tuple(r for r in (self._rival(m, key, less) for m in tried) if r is not None)
            best = max((p.gain for p in rest if p.keys[0][0] == key[0]), default=0.0)
            adds[key] = max(best, 0.0) / max(explains[key], 1e-300)
            lost = sum(r.beaten for r in rivals[key]) < len(rivals[key]) or not rivals[key]
            lost = lost or not entry.is_told(search.motion(key[0]))
            # where a number of the rig does the same, only ratios show, and no size is known
            if not (lost or numbers) and adds[key] < self.rules.alike and search.unknown(model) < self.rules.left:
                sure.add(key)
        return Judged(model, rivals, explains, adds, tables, frozenset(sure), tuple(rest), tuple(numbers))

    def _others(self, less: Model, key: Key) -> list[Model]:
        """The best other names in the place of one: those of the search, and those that columns now propose."""
        search = self.search
        known = {tuple(sorted(m.keys)): m for m in search.beaten.get(key, []) if key not in m.keys}
        for m in search.in_its_place(less, key):
            known.setdefault(tuple(sorted(m.keys)), m)
        kept = [m for k, m in known.items() if set(less.keys) <= set(k)]
        return sorted(kept, key=lambda m: m.score)[:3]

    def _tables(self, model: Model, place: str | None) -> tuple[Proposal, ...]:
        """Tables that explain something beside a model, at one place or anywhere, best first."""
        found = Columns(self.bench, model, model.sizes, tables=True).ranked
        return tuple(p for p in found if place is None or p.keys[0][0] == place)

    def _with_tables(self, less: Model, tables: Sequence[Proposal]) -> list[Model]:
        """The model without a name, with the best table of its place."""
        found = [self.search.tabled(less, p) for p in tables[:1]]
        return [m for m in found if m is not None]

    def _rival(self, m: Model, key: Key, less: Model) -> Rival | None:
        """A model in the place of a name, compared; None where its law holds the name's and explains hardly more."""
        keys = tuple(k for k in m.keys if k not in less.keys)
        container = self._contains(keys, key)
        gained = less.score - self.model.score
        if container and self.model.score - m.score < self.rules.alike * max(gained, 0.0):
            return None
        there = self._compared(m)
        t, wins = {}, []
        for view in VIEWS:
            if there is None or self.here is None:  # a rival that strays at these sizes, far behind at its own, is none
                strays = self.here is not None and m.score - self.model.score > self.rules.worth * self.bench.count
                t[view] = ASTRAY if strays else 0.0
                continue
            a, b = there.squares[view], self.here.squares[view]
            t[view] = lead(a, b)
            wins.append(np.mean(a > b))
        ratio = np.nan
        if there is not None and self.here is not None:
            ratio = float(np.sqrt(there.squares["long"].sum() / self.here.squares["long"].sum()))
        # what earns no name tells none from another, either
        beaten = min(t.values()) > self.rules.lead and m.score - self.model.score > self.search.least
        agree = float(np.mean(wins)) if wins else 0.0
        return Rival(keys, m, m.score - self.model.score, t, agree, ratio, container, beaten)

    def _contains(self, keys: tuple[Key, ...], key: Key) -> bool:
        """Whether another law at the place is a table, becomes it, or has more parameters: friction, filter, wave."""
        if len(keys) != 1 or keys[0][0] != key[0]:
            return False
        kind = self.model.rig.kind_at(key[0])
        mine, other = find(kind, key[1], key[0]), find(kind, keys[0][1], key[0])
        becomes = other.becomes is not None and other.becomes[1] == mine.name
        waves = all(effect.of_role(Role.ANGLE) is not None for effect in (mine, other))
        alike = type(mine.slot) is type(other.slot) and (isinstance(mine.slot, (slots.Contact, slots.Filter)) or waves)
        return other.is_table or becomes or (alike and other.counts > mine.counts)

    def _compared(self, m: Model) -> Compared | None:
        """A model in the three views, refitted at the sizes of what the judged model leaves."""
        sizes = self.model.sizes
        problem = Problem(self.bench, m.rig, m.keys, self.search.motion, self.model.stiff, m.smooth)
        x, squares = problem.solve(sizes, problem.start(), 3)
        if not np.isfinite(squares):
            return None
        data = problem.bench_rows
        rows = problem.rows(x, self.bench.gains(m.rig, sizes))
        if rows is None:
            return None
        found = {"short": self._sums(rows[:data])}
        far = self.bench.scaled(sizes, LONG)
        x, squares = problem.solve(far, x, 3)
        if not np.isfinite(squares):
            return None
        gains = self.bench.gains(problem.base, far)
        rows = problem.rows(x, gains)
        if rows is None:
            return None
        found["long"] = self._sums(rows[:data])
        split = self._split(rows[:data])
        if self.filters is None:
            self.filters = [[_whitening(channel) for channel in e.T] for e in split]
        J = problem.jacobian(x, gains, rows)
        white = self._whitened(rows[:data])
        K = (
            np.column_stack([self._whitened(J[:data, j]) for j in range(J.shape[1])])
            if J.shape[1]
            else np.zeros((data, 0))
        )
        all_rows, all_K = np.concatenate([white, rows[data:]]), np.vstack([K, J[data:]])
        norms = np.sqrt(np.einsum("ij,ij->j", all_K, all_K)) + 1e-300
        room = [(low * n, high * n) for (low, high), n in zip(_room(problem, x), norms, strict=True)]
        step = _within(all_K / norms, all_rows, room)
        left = all_rows + (all_K / norms) @ step
        found["white"] = self._sums(left[:data])
        return Compared(found)

    def _split(self, rows: Floats) -> list[Floats]:
        """(samples, channels) of each stretch of recording."""
        found, first = [], 0
        for p in self.bench.predictors:
            found.append(rows[first : first + p.readings.y.size].reshape(p.readings.y.shape))
            first += p.readings.y.size
        return found

    def _whitened(self, rows: Floats) -> Floats:
        """Rows filtered by what whitens the model's own."""
        assert self.filters is not None
        parts = []
        for e, filters in zip(self._split(rows), self.filters, strict=True):
            parts.append(np.column_stack([lfilter(f, [1.0], c) for f, c in zip(filters, e.T, strict=True)]).ravel())
        return np.concatenate(parts)

    def _sums(self, rows: Floats) -> Floats:
        """(STRETCHES,) sums of squares of innovations; what priors cost has no scatter: it counts in the lead."""
        each = np.concatenate([(e**2).sum(axis=1) for e in self._split(rows)])
        return np.array([part.sum() for part in np.array_split(each, STRETCHES)]) + 1e-12


def lead(a: Floats, b: Floats) -> float:
    """By how many standard errors the second model leads; a, b : (stretches,) sums of squares of the two."""
    return max(_t(a - b), _t(np.log(a / b)))


def _room(problem: Problem, x: Floats) -> list[tuple[float, float]]:
    """How far each free parameter may move from x: the rig's own within their ends, others anywhere."""
    ends = [((f.low - f.centre) / f.scale, (f.high - f.centre) / f.scale) if f.prior and f.role is not Role.ANGLE else
            (-np.inf, np.inf) for f in problem.free]  # fmt: skip
    return [(low - at, high - at) for (low, high), at in zip(ends, x.tolist(), strict=True)]


def _within(K: Floats, rows: Floats, ends: list[tuple[float, float]]) -> Floats:
    """The step within its ends that leaves least of ``rows + K step``."""
    if not ends:
        return np.zeros(0)
    step = np.asarray(-np.linalg.lstsq(K, rows, rcond=1e-8)[0], dtype=float)
    low, high = np.array(ends).T
    if (step < low).any() or (step > high).any():
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
