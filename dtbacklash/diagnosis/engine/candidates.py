"""Every hypothesis is a column: what whitened innovations change by when a small amount of it is put into the rig.

Nominal parameters and the laws that are there are projected out; what is left of each column and of the innovations is
compared on one Gram matrix, singles and pairs, in milliseconds. A law whose effect does not grow as its size does
counts as it is; a table is held back in how it bends as far as the evidence says.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.attempts import attempt
from dtbacklash.diagnosis.engine.columns import ColumnMaker, by_delay
from dtbacklash.diagnosis.engine.fit import FitProblem, FittedModel
from dtbacklash.diagnosis.engine.hypotheses import Hypothesis, hypotheses
from dtbacklash.diagnosis.engine.motion import motion_of
from dtbacklash.diagnosis.engine.parameters import Key
from dtbacklash.diagnosis.engine.segments import NoiseLevels, Segments
from dtbacklash.diagnosis.parallel import spread
from dtbacklash.physics.effects.table import STATES, bends
from dtbacklash.physics.rig import Rig

#: what is left of a column beside the others (share of its square) below which it says nothing of its own
OWN = 1e-6
#: weights of a table's bends that are tried, relative to its columns
SMOOTHING = 10.0 ** np.arange(-6, 3)
#: a signal is looked at no later once so many columns in a row explain less than one that is less late
FALLS = 2
#: stretches over which the scatter of what is left is looked at
STRETCHES = 12


@dataclass(frozen=True)
class Proposal:
    """Hypotheses together: the fall of -2 log likelihood that they promise less what they cost, and their sizes.

    smooth, errors : of a table, what holds back how it bends, and the standard errors of its values.
    """

    gain: float
    parts: tuple[tuple[Hypothesis, Floats | None], ...]
    smooth: Floats | None = None
    errors: Floats | None = None

    @property
    def keys(self) -> tuple[Key, ...]:
        """In order of their names."""
        return tuple(sorted(h.key for h, _ in self.parts))

    def put(self, rig: Rig) -> Rig:
        """The rig with all of them; UserError where it cannot have them."""
        for h, size in self.parts:
            rig = h.put(rig, size)
        return rig


class CandidateSensitivities:
    """Columns around a fitted rig at given noise levels.

    ranked : the best of each name, best first. alone : nothing is projected out, as all else stays as it is.
    bounded : only those that :meth:`bounds` takes; a law that a small one bounds is not looked at as it is. every :
    those with a later signal as well, where a less late one explains more. only : no other names.
    """

    def __init__(
        self, segments: Segments, model: FittedModel, noise_levels: NoiseLevels, without: tuple[Key, ...] = (),
        tables: bool = False, alone: bool = False, bounded: bool = False, every: bool = False,
        only: Collection[Key] | None = None,
    ) -> None:  # fmt: skip
        self.segments, self.rig, self.log_n = segments, model.rig, float(np.log(segments.count))
        gains = segments.gains(model.rig, noise_levels)
        motion = self.motion = motion_of(segments, model.rig, gains)
        problem = FitProblem(segments, model.rig, model.keys, motion, model.stiff, model.smooth)
        x = problem.start()
        base = problem.residuals(x, gains)
        assert base is not None
        data = problem.innovation_rows
        rough, rows = problem.coarsely(x, gains, base)
        jacobian = np.zeros((len(base), 0)) if alone else rough.jacobian(x, gains, rows)
        self.hypotheses: list[tuple[Hypothesis, slice]] = []
        self._set_base(base, jacobian[:, np.einsum("ij,ij->j", jacobian, jacobian) > 1e-12], data)
        make = ColumnMaker(rough.segments, problem.rig(x), gains, motion, rows[:data])
        asked = list(hypotheses(segments, model.rig, motion, without, tables))
        asked = [h for h in asked if not (bounded and h.as_it_is and h.effect.size.neutral == 0.0)]
        asked = [h for h in asked if only is None or h.key in only]
        falls = len(asked) if bounded or every else FALLS
        starts = np.cumsum([0, *(h.columns for h in asked)])
        columns = np.empty((starts[-1], data))  # rows that nothing is written to take no memory
        places = {h: columns[a:b] for h, (a, b) in zip(asked, pairwise(starts), strict=True)}
        made = spread(lambda those: self._in_order(those, make, falls, places), by_delay(asked))
        counts, first = dict(chain.from_iterable(made)), 0
        for h in asked:
            if count := counts.get(h, 0):
                columns[first : first + count] = places[h][:count]
                self.hypotheses.append((h, slice(first, first + count)))
                first += count
        self._project(columns[:first])
        self.ranked = self._ranked()

    def _in_order(
        self, those: Sequence[Hypothesis], make: ColumnMaker, falls: int, places: dict[Hypothesis, Floats]
    ) -> list[tuple[Hypothesis, int]]:
        """Fill in the columns of a signal that is later and later, until so many in a row explain less than one before.

        Returns how many columns each hypothesis has: 0 where the rig cannot have it, or it shows nowhere.
        """
        made, best, fell = [], 0.0, 0
        for h in those:
            columns = attempt(make.columns, h) or []
            for row, column in zip(places[h][: len(columns)], columns, strict=True):
                row[:] = column
            made.append((h, len(columns)))
            if len(those) == 1:  # nothing that is later follows
                break
            gain = self._gain(columns[0]) if columns else -np.inf
            fell, best = (fell + 1, best) if gain < best else (0, gain)
            if fell == falls:
                break
        return made

    def _gain(self, column: Floats) -> float:
        """By how much -2 log likelihood falls with a law as it is, what the base can do taken out."""
        J, gram, side, e0 = self._base
        cross = column @ J
        by = np.linalg.solve(gram, cross)
        return float(-2.0 * (column @ e0 - by @ side) - (column @ column - by @ cross))

    def _set_base(self, base: Floats, jacobian: Floats, data: int) -> None:
        """Innovations with priors (rows,), and what the base can do about them (rows, free); data : innovations."""
        J = jacobian / np.sqrt(np.einsum("ij,ij->j", jacobian, jacobian))
        self._base = J[:data], J.T @ J + 1e-10 * np.eye(J.shape[1]), J.T @ base, base[:data]

    def _project(self, columns: Floats) -> None:
        """Products of columns and innovations, with what the base can do taken out of both."""
        J, gram, side, e0 = self._base
        data = len(e0)
        scale = np.sqrt(np.einsum("ij,ij->i", columns, columns))
        self.scale = np.maximum(scale, 1e-150)
        columns /= self.scale[:, None]
        self._T, self._cross = columns, columns @ J
        self._by = np.linalg.solve(gram, self._cross.T).T
        self._r = columns @ e0 - self._by @ side
        self._blocks = {h: self._products(at, at) for h, at in self.hypotheses}
        # errors are systematic: how much a column's product with them scatters, beside what white ones would
        left = e0 - J @ np.linalg.solve(gram, side)
        ends = np.linspace(0, data, STRETCHES + 1).astype(int)
        sums = np.array([
            columns[:, a:b] @ left[a:b] - self._by @ (J[a:b].T @ left[a:b]) for a, b in pairwise(ends)
        ])  # fmt: skip
        own = np.concatenate([np.diag(self._blocks[h]) for h, _ in self.hypotheses]) if self.hypotheses else np.zeros(0)
        white = np.maximum(own * float(left @ left) / max(data, 1), 1e-300)
        spread = ((sums - sums.mean(axis=0)) ** 2).sum(axis=0) * STRETCHES / (STRETCHES - 1)
        self.wider = np.sqrt(np.maximum(spread / white, 1.0))
        self.scatter = float(np.median(self.wider)) if len(self.wider) else 1.0

    def _products(self, a: slice, b: slice) -> Floats:
        """Products of columns with one another, the base taken out."""
        found: Floats = self._T[a] @ self._T[b].T - self._by[a] @ self._cross[b].T
        return found

    def angles(self) -> tuple[list[Hypothesis], Floats, Floats]:
        """Hypotheses of which something is left beside the base, and how far they are apart.

        Returns
        -------
        the hypotheses; (h,) how many standard errors each is as it begins, at its worst phase; (h, h) sines of the
        smallest angles between them, 1 at right angles, 0 where one can stand for the other.
        """
        kept = [(h, at) for h, at in self.hypotheses if not (np.diag(self._blocks[h]) < OWN).any()]
        turned, errors = np.zeros((len(kept), 2, len(self.scale))), np.zeros(len(kept))
        for k, (h, at) in enumerate(kept):
            scale = self.scale[at]
            sizes, directions = np.linalg.eigh(self._blocks[h])
            turned[k, : len(sizes), at] = (directions / np.sqrt(np.maximum(sizes, OWN))).T
            least = np.linalg.eigvalsh(self._blocks[h] * np.outer(scale, scale))[0]
            errors[k] = np.sqrt(max(float(least), 0.0)) * (1.0 if h.as_it_is else abs(h.values[h.effect.size.name]))
        flat = turned.reshape(-1, len(self.scale))
        cosines = (flat @ self._products(slice(None), slice(None)) @ flat.T).reshape(len(kept), 2, len(kept), 2)
        squares = (cosines**2).sum(axis=(1, 3))
        crossed = cosines[:, 0, :, 0] * cosines[:, 1, :, 1] - cosines[:, 0, :, 1] * cosines[:, 1, :, 0]
        nearest = 0.5 * (squares + np.sqrt(np.maximum(squares**2 - 4.0 * crossed**2, 0.0)))
        return [h for h, _ in kept], errors, np.sqrt(np.clip(1.0 - nearest, 0.0, 1.0))

    def bounds(self, errors: float) -> Iterator[tuple[Hypothesis, float | None]]:
        """Each law with the largest size that its column allows, by so many standard errors; None: it is not bounded.

        Of a law that does more the smaller its size is, whether its values are excluded (a number) or not.
        """
        for h, at in self.hypotheses:
            js, g, r = at, self._blocks[h], self._r[at]
            if (np.diag(g) < OWN).any():
                yield h, None
                continue
            error = self.wider[js] / np.sqrt(np.diag(g)) / self.scale[js]
            if h.as_it_is:
                share = -float(r[0]) / float(g[0, 0]) / float(self.scale[at][0])
                yield h, (h.values[h.effect.size.name] if share + errors * float(error[0]) < 1.0 else None)
                continue
            size = -np.linalg.solve(g + 1e-12 * np.eye(len(r)), r) / self.scale[js]
            both = h.effect.size.low < 0.0 or bool(h.angle)
            most = float(np.linalg.norm(size)) if both else max(float(size[0]), 0.0)
            yield h, most + errors * float(error.max())

    def _each(self, a: slice, b: slice | None = None) -> tuple[Floats, Floats]:
        """Products of columns, those of each recording for themselves, with others (as they are None: themselves).

        Returns
        -------
        (recordings, a, recordings, b) products; (recordings, a) those with the innovations.
        """
        b = b or a
        J, gram, side, e0 = self._base
        count, n, m, first = len(self.segments.recordings), a.stop - a.start, b.stop - b.start, 0
        own, r = np.zeros((count, n, count, m)), np.zeros((count, n))
        cross = {(at.start, at.stop): np.zeros((count, at.stop - at.start, J.shape[1])) for at in (a, b)}
        for p in self.segments.predictors:
            k, rows = self.segments.recordings.index(p.readings.recording), slice(first, first + p.readings.y.size)
            first, T = rows.stop, self._T[a, rows]
            own[k, :, k] += T @ self._T[b, rows].T
            for (start, stop), products in cross.items():
                products[k] += self._T[start:stop, rows] @ J[rows]
            r[k] += T @ e0[rows]
        of_a, of_b = (cross[at.start, at.stop].reshape(count * (at.stop - at.start), -1) for at in (a, b))
        by = np.linalg.solve(gram, of_a.T).T
        taken = by @ of_b.T
        return own - taken.reshape(own.shape), r - (by @ side).reshape(r.shape)

    def _of(self, h: Hypothesis, at: slice) -> tuple[Floats, Floats]:
        """Products of a hypothesis' columns and with innovations, of each recording where its phase is free in each."""
        if not h.recordings:
            return self._blocks[h], self._r[at]
        g, r = self._each(at)
        return g.reshape(r.size, -1), r.ravel()

    def _between(self, a: tuple[Hypothesis, slice], b: tuple[Hypothesis, slice]) -> Floats:
        """Products of the columns of one hypothesis with those of another, as :meth:`_of` has them."""
        g, _ = self._each(a[1], b[1])
        for axis, (h, _) in ((0, a), (2, b)):
            g = g if h.recordings else g.sum(axis=axis, keepdims=True)
        found: Floats = g.reshape(g.shape[0] * g.shape[1], -1)
        return found

    def differing(self) -> list[tuple[float, Hypothesis, Floats]]:
        """What each name would explain, had it a size in each recording, beside what it explains with one for all.

        Best of each name first: the fall of -2 log likelihood less its cost, the hypothesis as it is best put in,
        (recordings,) its size in each.
        """
        best: dict[Key, tuple[float, Hypothesis, Floats]] = {}
        for h, at in self.hypotheses:
            if h.effect.is_table or (np.diag(self._blocks[h]) < OWN).any():
                continue
            own, with_each = self._each(at)
            r = with_each.ravel()
            g = own.reshape(r.size, -1)
            theta = np.linalg.lstsq(g, -r, rcond=OWN)[0]
            each = theta.reshape(-1, at.stop - at.start) / self.scale[at]
            if h.recordings:  # one size, at the phase of each
                alike = (each / (np.linalg.norm(each, axis=1, keepdims=True) + 1e-300) * self.scale[at]).ravel()
                one, counts = float(alike @ r) ** 2 / float(alike @ g @ alike), len(each) - 1
            else:
                shared = np.linalg.lstsq(self._blocks[h], -self._r[at], rcond=OWN)[0]
                one, counts = -float(self._r[at] @ shared), len(theta) - len(shared)
            gain = -float(r @ theta) - one - self.log_n * counts
            if h.key not in best or gain > best[h.key][0]:
                best[h.key] = gain, *_put(h, each)
        return sorted(best.values(), key=lambda row: -row[0])

    def single(self, h: Hypothesis, at: slice, g: Floats, r: Floats) -> Proposal | None:
        """What a hypothesis promises; None where its size is not one, or nothing of it is left.

        g, r : products of its columns, or of those of each recording, with one another and with the innovations.
        """
        if h.effect.is_table:
            return self._table(h, at, g, r)
        if (np.diag(g) < OWN).any():
            return None
        cost = self.log_n * h.counts
        if h.as_it_is:
            t = float(self.scale[at][0])
            return Proposal(float(-(2.0 * t * r[0] + t * t * g[0, 0])) - cost, ((h, None),))
        theta = -np.linalg.solve(g + 1e-12 * np.eye(len(r)), r)
        size = theta / np.resize(self.scale[at], len(r))
        if len(r) > at.stop - at.start:  # a phase more for each recording but one
            cost += self.log_n * (len(h.recordings) - 1)
        if not h.angle and not h.effect.size.low <= size[0] <= h.effect.size.high:
            return None
        return Proposal(float(-(r @ theta)) - cost, ((h, size),))

    def _table(self, h: Hypothesis, at: slice, g: Floats, r: Floats) -> Proposal | None:
        """The likeliest table, with the smoothing that the evidence chooses."""
        scale = self.scale[at]
        g, r = g * np.outer(scale, scale), r * scale
        D = bends(np.array([h.values[n] for n in STATES]))
        weight = float(np.trace(g) / np.trace(D.T @ D))
        if not weight > 0.0:
            return None
        best: Proposal | None = None
        for share in SMOOTHING * weight:
            M = g + share * D.T @ D + 1e-9 * np.trace(g) / len(r) * np.eye(len(r))
            theta = -np.linalg.solve(M, r)
            counts = float(np.trace(np.linalg.solve(M, g)))
            bent = share * float(np.sum((D @ theta) ** 2))
            gain = -float(2.0 * r @ theta + theta @ g @ theta) - bent - self.log_n * counts
            if best is None or gain > best.gain:
                errors = np.sqrt(np.maximum(np.diag(np.linalg.inv(M)), 0.0)) * self.scatter
                best = Proposal(gain, ((h, theta),), np.sqrt(share) * D, errors)
        return best

    def _ranked(self, beside: tuple[Hypothesis, slice] | None = None) -> list[Proposal]:
        """The best of each name, best first; beside a first hypothesis where one is given."""
        best: dict[Key, Proposal] = {}
        if beside is not None:
            first, shared = beside[0], self._products(slice(None), beside[1])
            g1, r1 = self._of(*beside)
        for h, at in self.hypotheses:
            if beside is not None and h.key == first.key:
                continue
            g, r = self._of(h, at)
            if beside is not None:
                turned = h.recordings or first.recordings
                c = self._between((h, at), beside) if turned else shared[at]
                if first.as_it_is:
                    r = r + c[:, 0] * self.scale[beside[1]][0]
                else:
                    taken = np.linalg.solve(g1 + 1e-12 * np.eye(len(g1)), np.column_stack([c.T, r1]))
                    g, r = g - c @ taken[:, :-1], r - c @ taken[:, -1]
            found = self.single(h, at, g, r)
            if found is not None and (h.key not in best or found.gain > best[h.key].gain):
                best[h.key] = found
        return sorted(best.values(), key=lambda p: -p.gain)

    def pairs(self, firsts: Sequence[Proposal], partners: int = 3) -> list[Proposal]:
        """Each of some proposals with the best beside it, best first."""
        best: dict[tuple[Key, ...], Proposal] = {}
        slices = dict(self.hypotheses)
        for first in firsts:
            ((h, _),) = first.parts
            for second in self._ranked((h, slices[h]))[:partners]:
                both = Proposal(first.gain + second.gain, (*first.parts, *second.parts))
                if both.keys not in best or both.gain > best[both.keys].gain:
                    best[both.keys] = both
        return sorted(best.values(), key=lambda p: -p.gain)


def _put(h: Hypothesis, each: Floats) -> tuple[Hypothesis, Floats]:
    """A hypothesis with the phase at which it is largest, and its sizes. each : (recordings, columns) amounts."""
    name = h.effect.size.name
    if h.as_it_is:
        return h, each[:, 0] * h.values[name]
    if not h.angle:
        return h, each[:, 0]
    if h.recordings:
        sizes, phases = np.linalg.norm(each, axis=1), np.arctan2(each[:, 1], each[:, 0])
        values = {**h.values, h.angle: float(phases[np.argmax(sizes)])}
        own = tuple(zip(h.recordings, phases.tolist(), strict=True))
        return replace(h, values=values, angle="", recordings=(), own=own), sizes
    largest = each[np.argmax((each**2).sum(axis=1))]
    phase = float(np.arctan2(largest[1], largest[0]))
    return replace(h, values={**h.values, h.angle: phase}, angle=""), each @ [np.cos(phase), np.sin(phase)]
