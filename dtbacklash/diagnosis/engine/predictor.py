"""The rig as a Kalman predictor: laws act inside, and unknown white forces say how much is missing.

Between two samples the simulated rig advances, laws, contacts and all; at each sample its state is corrected by
``x += K (y - y^)``. ``K`` is the gain of the linear plant with an unknown white force at each body and white noise on
each sensor. Their levels are found by the likelihood of the innovations ``e`` with covariance ``S``,

    -2 log L = sum over the samples of log det S + e' S^-1 e

(Ljung, System Identification (1999), section 7.4; unknown forces as diffusion whose size points to the deficiency:
Kristensen, Madsen, Jorgensen, Automatica 40 (2004) 225). So nothing says how much the recording may come to help but
the recording itself: the unknown force is large while physics is missing, and next to nothing where it has been found.
"""

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.filter import driven, frozen, opening, riccati, update
from dtbacklash.diagnosis.engine.resampling import OPENING
from dtbacklash.diagnosis.engine.simulator import Linear, Pass, Simulator
from dtbacklash.diagnosis.engine.trajectory import Trajectory
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.slots import Filter, Slot
from dtbacklash.physics.rig import Rig

#: what laws add to the linear recursion along a pass: A, C, drive (N, n), readings, first state, and the linear part
Known = tuple[Floats, Floats, Floats, Floats, Floats, Linear]

#: where the search for the levels of unknown forces begins, and between which it looks (shares of what acts)
FORCE_START, FORCE_ENDS = 0.03, (1e-8, 30.0)
#: a sensor's noise lies between these, relative to what its readings show (ratio); ripple and counts do not average out
NOISE_ENDS = (np.exp(-1.0), np.exp(0.4))
AVERAGED_NOISE = np.exp(2.0)
#: steps of the search in logarithms, and what a step has to earn (-2 log likelihood)
STEPS, TUNED = (2.0, 0.7, 0.25), 2.0
#: an innovation that large is no prediction (standard deviations)
ASTRAY = 1e7
LOST = 1e300


@dataclass(frozen=True)
class Gains:
    """Gains and whitening for :func:`.filter.observe`, and the log determinants of all innovations.

    K (modes, g, n, m), W (modes, g, m, m) : of the first ``opening`` samples, then steady ones, of all readings and of
    each set of them that occurs.
    """

    K: Floats
    W: Floats
    opening: int
    logs: float
    states: tuple[str, ...]
    noise_levels: Floats


class Predictor:
    """One stretch of a recording, seen by a rig.

    Attributes
    ----------
    simulated : what simulates it. readings : its stretch. linear : of the nominal rig. bodies : where forces may be
    unknown. force : (bodies,) the largest of what acts on each, rms, N or N m. Noise levels are (bodies + channels,)
    logarithms: of unknown forces over these forces, and of the sensors' noises, SI.
    """

    def __init__(self, rig: Rig, simulated: Simulator) -> None:
        """Raises UserError where nothing recorded shows some body, so that no gain can hold it."""
        readings = simulated.readings
        self.readings, self.simulated = readings, simulated
        self.linear = self.simulated.linear(rig)
        self.bodies, self.count = self.linear.bodies, readings.count
        self.nominal_noise = np.log(readings.noise)
        self.spread: dict[str, float] = {}
        self._leads: dict[str, Floats] = {}
        self.force = self.linear.inertia * self._rough_speed(rig)
        noise_levels = self.first_noise_levels()
        for _ in range(2):
            gains = self.gains(rig, noise_levels)
            found = self.run(rig, gains)
            if not np.isfinite(found.X).all():
                break
            spread = found.X[:, : len(self.linear.states)].std(axis=0)
            self.spread = dict(zip(self.linear.states, spread.tolist(), strict=True))
            self.force = self._acting_force(rig, found.X)

    def first(self, share: float) -> "Predictor":
        """The same on the beginning of the stretch."""
        other = copy.copy(self)
        other.readings = self.readings.first(share)
        other.simulated = self.simulated.on(other.readings)
        other.count = other.readings.count
        return other

    def stepping(self, finely: bool) -> "Predictor":
        """The same, simulated in fine steps or not."""
        other = copy.copy(self)
        other.simulated = copy.copy(self.simulated)
        other.simulated.finely = finely
        return other

    def _rough_speed(self, rig: Rig) -> Floats:
        """An acceleration that the readings show, for a beginning: that of ten hertz."""
        speeds = []
        for c, y in zip(self.readings.channels, self.readings.y.T, strict=True):
            read, quantity = y[np.isfinite(y)], rig.sensors[c].quantity
            if quantity == "position":
                speeds.append(float(np.std(np.gradient(read, self.readings.sample_time_s))))
            elif quantity == "velocity":
                speeds.append(float(np.std(read)))
            elif quantity == "acceleration":
                speeds.append(float(np.std(read)) / (20.0 * np.pi))
        usual = float(np.median(speeds)) if speeds else float(np.nanstd(self.readings.y[:, 0]))
        return np.full(len(self.bodies), max(usual * 20.0 * np.pi, 1e-300))

    def _acting_force(self, rig: Rig, X: Floats) -> Floats:
        """(bodies,) see :attr:`.trajectory.Trajectory.acting`."""
        r = self.readings
        loads = (lambda: self.simulated.loads(rig, np.ascontiguousarray(X))) if rig.config.model else None
        acting = Trajectory(rig, self.linear, X[:, : len(self.linear.states)], r.u, r.sample_time_s, loads=loads).acting
        return np.array([acting[body] for body in self.bodies])

    def first_noise_levels(self) -> Floats:
        """Where a search for noise levels begins."""
        return np.concatenate([np.full(len(self.bodies), np.log(FORCE_START)), self.nominal_noise])

    def ends(self) -> tuple[Floats, Floats]:
        """Between which noise levels are looked for."""
        most = AVERAGED_NOISE if self.readings.every > 1 else NOISE_ENDS[1]
        low = np.concatenate(
            [np.full(len(self.bodies), np.log(FORCE_ENDS[0])), self.nominal_noise + np.log(NOISE_ENDS[0])]
        )
        high = np.concatenate([np.full(len(self.bodies), np.log(FORCE_ENDS[1])), self.nominal_noise + np.log(most)])
        return low, high

    def scaled(self, noise_levels: Floats, factor: float) -> Floats:
        """Noise levels with other unknown forces."""
        other = noise_levels.copy()
        n = len(self.bodies)
        other[:n] = np.maximum(other[:n] + np.log(factor), np.log(FORCE_ENDS[0]))
        return other

    def unknown(self, noise_levels: Floats) -> dict[str, float]:
        """Body -> its unknown force, a share of what acts there."""
        return dict(zip(self.bodies, np.exp(noise_levels[: len(self.bodies)]).tolist(), strict=True))

    def gains(self, rig: Rig, noise_levels: Floats, linear: Linear | None = None, contact: bool = False) -> Gains:
        """The gains of a rig's linear part at these noise levels; contact : those in contact only, for both modes."""
        L = linear or self.simulated.linear(rig)
        n, known = len(L.states), [L.bodies.index(b) for b in self.bodies if b in L.bodies]
        q = (
            np.array(
                [np.exp(s) * f for s, f, b in zip(noise_levels, self.force, self.bodies, strict=False) if b in L.bodies]
            )
            ** 2
        )
        R = np.diag(np.exp(2.0 * noise_levels[len(self.bodies) :]))
        r, at_once = self.readings, bool(L.D.any())
        n0 = r.opening if self.spread or r.seldom else 0
        there = self.simulated.there(rig)[:n0] if r.seldom else r.there[:n0]
        counts, Ks, Ws, logs = r.counts(n0), [], [], 0.0
        modes = (0, 1) if not contact and not np.array_equal(L.A[0], L.A[1]) else (1,)
        for mode in modes:
            A, C, B = L.A[mode], L.C[mode], L.B[mode][:, known]
            if at_once:  # the unknown force of the sample before shows in an acceleration: it becomes a state
                m = len(known)
                A = np.block([[A, np.zeros((n, m))], [np.zeros((m, n + m))]])
                C, B = np.hstack([C, L.D[:, known]]), np.vstack([B, np.eye(m)])
            A, C = np.ascontiguousarray(A), np.ascontiguousarray(C)
            Q = (B * q) @ B.T
            Q += 1e-18 * np.diag(np.diag(Q) + 1e-300)
            # a reading that is seldom there tells as much as one that is always there, and worse
            P = riccati(A, C, Q, R / r.present)
            P0 = Q.copy()
            for i, state in enumerate(L.states):
                P0[i, i] += self.spread.get(state, max(self.spread.values(), default=0.0)) ** 2
            K, W, first = opening(A, C, Q, R, P0, there)
            steady = [update(C, R, P, there) for there in r.sets]
            Ks.append(np.concatenate([K, np.array([k for k, _, _ in steady])])[:, :n])
            Ws.append(np.concatenate([W, np.array([w for _, w, _ in steady])]))
            logs = first + float(sum(count * log for count, (_, _, log) in zip(counts, steady, strict=True)))
        K, W = np.array(Ks * (3 - len(modes))), np.array(Ws * (3 - len(modes)))
        return Gains(np.ascontiguousarray(K), np.ascontiguousarray(W), n0, logs, L.states, noise_levels)

    def run(self, rig: Rig, gains: Gains) -> Pass:
        """A pass of a rig; where it has other states than the gains were made for, or filters, they are made anew.

        What a filter's states are changes with its values: corrections of the first samples would miss them.
        Innovations are scaled so that the sum of their squares compares as likelihoods do, determinants included.
        """
        given, logs = gains, 0.0
        gains = self._own_gains(rig, given)
        if gains is not given and gains.states == given.states:
            logs = (gains.logs - given.logs) / (2.0 * self.count)
        found = self.simulated.observe(rig, gains.K, gains.W, gains.opening)
        with np.errstate(over="ignore", invalid="ignore"):  # what does not stay finite is no model
            return replace(found, E=np.exp(logs) * found.E) if logs else found

    def _own_gains(self, rig: Rig, gains: Gains) -> Gains:
        """The gains, or where a rig has filters or other states than they are for, its own at the same noise levels."""
        slots_there = _slots(rig)
        if not any(slot.adds_states for slot in slots_there):
            return gains
        L = self.simulated.linear(rig)
        filtered = any(isinstance(slot, Filter) for slot in slots_there)
        return self.gains(rig, gains.noise_levels, L) if filtered or L.states != gains.states else gains

    def errors(self, rig: Rig, gains: Gains) -> Floats:
        """(N, m) innovations as they were read, NaN where there is none, infinite where they do not stay finite."""
        return self._as_read(rig, self.run(rig, gains).D)

    def _as_read(self, rig: Rig, D: Floats) -> Floats:
        return self.simulated.as_read(rig, np.where(np.isfinite(D), D, np.inf))

    def simulate(self, rig: Rig, gains: Gains, begins: Sequence[int] = ()) -> Floats:
        """A free run: (N, m) readings less what a rig shows by its command alone, as :meth:`errors`.

        It begins at rest, where the positions were read first, and nothing corrects it.

        Parameters
        ----------
        begins : samples at which it begins anew, with a state that the next ``OPENING`` readings make known by gains
            of their own; these are no part of it, and NaN.
        """
        N, n = len(self.readings.u), min(OPENING, gains.opening)
        own = self._own_gains(rig, gains) if len(begins) else gains
        begun, which = np.zeros(N, dtype=bool), np.full(N, own.K.shape[1])  # the last gains correct nothing
        for first in begins:
            last = min(first + n, N)
            which[first:last] = np.arange(last - first) + (first if self.readings.seldom else 0)
            begun[first:last] = True
        K = np.concatenate([own.K, np.zeros_like(own.K[:, :1])], axis=1)
        W = np.concatenate([own.W, own.W[:, -1:]], axis=1)
        found = self._as_read(rig, self.simulated.observe(rig, K, W, gains.opening, which).D)
        found[begun] = np.nan
        return found

    def leads(
        self, rig: Rig, moved: dict[str, tuple[Rig, float]], gains: Gains, kept: bool = True
    ) -> dict[str, Floats]:
        """Parameter -> (N m,) by which whitened innovations change per unit of it, by what it adds to each sample.

        moved : parameter -> a rig with more of it, and how much more. What it adds follows from where samples lead from
        the predicted states, and what becomes of that from the linear part. kept : it is kept for other rigs, as
        readings hold the states; else it is of this one.
        """
        n, r, L = len(self.readings.u), self.readings, self.simulated.linear(rig)
        which, led = r.which(gains.opening, r.y), self._leads if kept else {}
        if any(len(led.get(title, ())) < n for title in moved):
            found = self.run(rig, gains)
            Z = corrected(found.X, found.D, gains, which)
            base = self.simulated.onwards(rig, Z)
            for title, (other, by) in moved.items():
                led[title] = ((self.simulated.onwards(other, Z) - base) / by)[:, : len(L.states)]
        there = np.ascontiguousarray(L.A[1]), np.ascontiguousarray(L.C[1]), np.ascontiguousarray(gains.K[1]), gains.W[1]
        none = np.zeros(r.there.shape)
        return {title: driven(*there, which, led[title][:n], none, ~r.there) for title in moved}

    def tuned(
        self, rig: Rig, noise_levels: Floats | None = None, steps: tuple[float, ...] = STEPS, refresh: int = 2
    ) -> tuple[Floats, float]:
        """(noise levels that make a rig's innovations likeliest, -2 log likelihood).

        A pattern search on a linear recursion, in which what laws add along the last pass is taken as given; made anew
        at its end, and ended where that brings no more.
        """
        low, high = self.ends()
        scan = noise_levels is None
        x = self.first_noise_levels() if noise_levels is None else np.clip(noise_levels, low, high)
        best: tuple[Floats, float] | None = None
        for turn in range(refresh + 1):
            known = self._recorded(rig, x)
            if known is None:
                return (x, LOST) if best is None else best
            cost = self._cost(rig, known)
            value = cost(x)
            if best is not None and value > best[1] - 5.0:
                return best if best[1] <= value else (x, value)
            best = x.copy(), value
            if turn == refresh:
                break
            if turn == 0 and scan:
                for factor in (0.1, 0.01, 0.001):
                    z = np.maximum(self.scaled(best[0], factor), low)
                    if (v := cost(z)) < value - TUNED:
                        value, x = v, z
            x, value = _pattern(cost, x, value, low, high, steps)
        assert best is not None
        return best

    def likelihood(self, rig: Rig, gains: Gains) -> float:
        """-2 log likelihood at given gains."""
        found = self.run(rig, gains)
        value = gains.logs + float(np.sum(found.E**2))
        return value if np.isfinite(value) else LOST

    def _cost(self, rig: Rig, known: Known) -> Callable[[Floats], float]:
        A, C, drive, Y, first, L = known

        def cost(noise_levels: Floats) -> float:
            try:
                gains = self.gains(rig, noise_levels, L, contact=True)
            except np.linalg.LinAlgError:
                return LOST
            K = gains.K[1]
            which = self.readings.which(gains.opening, Y)
            value = gains.logs + frozen(A, C, np.ascontiguousarray(K), gains.W[1], which, drive, Y, first)
            return float(value) if np.isfinite(value) else LOST

        return cost

    def _recorded(self, rig: Rig, noise_levels: Floats) -> Known | None:
        """What laws add to the linear recursion along a pass: A, C, drive (N, n), readings, first state."""
        L = self.simulated.linear(rig)
        try:
            gains = self.gains(rig, noise_levels, L)
        except np.linalg.LinAlgError:
            return None
        found = self.simulated.observe(rig, gains.K, gains.W, gains.opening)
        n = len(L.states)
        if not np.isfinite(found.E).all() or np.abs(found.E).max() > ASTRAY:
            return None
        X = found.X[:, :n]
        A, C = L.A[1], L.C[1]
        Y = found.D + X @ C.T
        Y[~self.simulated.there(rig)] = np.nan
        Z = corrected(X, found.D, gains, self.readings.which(gains.opening, Y))
        drive = np.zeros_like(X)
        drive[:-1] = X[1:] - Z[:-1] @ A.T
        return (
            np.ascontiguousarray(A), np.ascontiguousarray(C), np.ascontiguousarray(drive), np.ascontiguousarray(Y),
            X[0].copy(), L,
        )  # fmt: skip


def corrected(X: Floats, D: Floats, gains: Gains, which: np.ndarray) -> Floats:
    """(N, n) states after each correction, in contact."""
    K = gains.K[1]
    Z = X.copy()
    Z[:, : K.shape[1]] += np.einsum("kir,kr->ki", K[which], D)
    return Z


def _slots(rig: Rig) -> list[Slot]:
    """The slots of a rig's effects."""
    return [find(rig.kind_at(p), n, p).slot for p, there in rig.effects.items() for n in there]


def _pattern(
    cost: Callable[[Floats], float], x: Floats, value: float, low: Floats, high: Floats, steps: Sequence[float]
) -> tuple[Floats, float]:
    """The least of a function of few variables: along each in turn, by smaller and smaller steps."""
    for step in steps:
        moved = True
        while moved:
            moved = False
            for j in range(len(x)):
                for sign in (-1.0, 1.0):
                    while True:
                        z = x.copy()
                        z[j] = np.clip(z[j] + sign * step, low[j], high[j])
                        if z[j] == x[j]:
                            break
                        v = cost(z)
                        if not v < value - TUNED:
                            break
                        value, x, moved = v, z, True
    return x, value
