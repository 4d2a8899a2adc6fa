"""The structural half of the bank: the gap, and what else may have changed behind the gear, from one buffer.

Each hypothesis is a rig (:mod:`.hypotheses`), whose structure is simulated from the measured motor angle through the
play operator. Fitted are the gap in the middle of the buffer, where the screw rested in it at the beginning, the gap's
growth (with a prior), and the hypothesis's own parameters. At rest dry friction and hysteresis hold a force that nobody
measures: the output's position at rest gives it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from dtbacklash.arrays import Floats
from dtbacklash.control.belief import bending
from dtbacklash.errors import UserError
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.bodies import Bodies, Parts, take_apart
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.kernel import dispatch
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.forces import base_motion
from dtbacklash.physics.kernel.plant import Plant, new_state
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig, Sensor
from dtbacklash.twin.bank.hypotheses import Hypothesis
from dtbacklash.twin.bank.whitened import (
    BLOCK,
    FAR,
    Fit,
    Residual,
    best_fitted,
    blocks,
    count_of,
    fitted,
    inverse,
    noise_of,
    without_counts,
)
from dtbacklash.twin.gap.simulated import follow

#: by what the fit's variables are measured: gap and start rad, growth rad/s
GAP, START, GROWTH = 0.02, 0.01, 0.02
#: for how long a count stays the same, s
STAYS_S = 0.05
#: growth of the gap, one standard deviation of its prior, rad/s (1 deg/s)
GROWTH_STD = 0.0175
#: variables of every structural fit: gap, start, growth
COMMON = 3
#: steps a sample with effects beside the linear plant, and halvings to where friction turns round
SUBSTEPS, EVENT_LEVELS = 4, 5
#: what the simulation itself errs by, m: interpolation of the angle between samples
MODEL_M = 2e-8
#: what any model errs by, of the output's range, for STAYS_S at a time: a change that does no more is nobody's concern
MODEL_SHARE = 1e-4
#: the motor is at rest while its angle stays this close to where it began, rad
STILL_RAD = 0.02
#: variables of a held force's share where a search may begin (0.89 of its level either way)
SHARES = (-2.0, 0.0, 2.0)
FINE_SHARES = (-8.0, -4.0, -2.5, -1.5, -1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0, 1.5, 2.5, 4.0, 8.0)
#: standard deviations of what is known before a buffer: gap, start, growth (measured as above), others, held shares
WIDE_COMMON, WIDE, SHARE_STD = (200.0, 200.0, 200.0), 3.0, 0.58
#: effects that act beside the linear plant: their parameters change no matrix of it
BESIDE = ("ground_friction", "hysteresis")
LEAST_STILL, MOST_STILL = 20, 200


@dataclass(frozen=True)
class Held:
    """What can hold the structure off its balance: a direction (bodies,), a level N, its memory in x or -1."""

    direction: Floats
    level: float
    memory: int


@dataclass(frozen=True)
class Driven:
    """A structure compiled for a given motor angle."""

    plant: Plant
    index: int
    parts: Parts
    output: int
    held: tuple[Held, ...]

    @classmethod
    def of(cls, rig: Rig, sensor: Sensor, sample_time_s: float) -> Driven:
        """From a rig; its backlash is what is looked for, and its sensors are taken to be right."""
        gear = rig.only("gear")
        for place, name in [(p, n) for p, there in rig.effects.items() for n in there]:
            if (gear and place == gear.name) or place.startswith(SENSOR_PREFIX):
                rig = rig.with_effect(place, name, None)
        plant = compile_plant(rig, sample_time_s, SUBSTEPS if bending(rig) else 1, EVENT_LEVELS, imposed=True)
        parts = take_apart(rig, imposed=True)
        index = list(rig.sensors).index(sensor.name)
        return cls(plant, index, parts, parts.bodies.names.index(sensor.of), tuple(_held(plant)))

    @property
    def bodies(self) -> Bodies:
        """The masses that move, with stiffness and damping between them."""
        return self.parts.bodies

    def with_law(self, place: str, effect: str, values: tuple[float, ...]) -> Driven:
        """The same with other parameters of an effect that it has, one of BESIDE."""
        plant = self.plant
        code = dispatch.code_of(find(self.parts.rig.kind_at(place), effect, place))
        if effect == "hysteresis":
            spring = [e.name for e in self.parts.springs].index(place)
            at = plant.slot[pl.LINK] + pl.PER_LINK * spring + pl.MEMORIES
        else:
            contacts = [c.ends for c in self.parts.contacts]
            at = plant.slot[pl.FRICTION] + contacts.index((pl.GROUND, self.bodies.names.index(place)))
        law_p = plant.law_p.copy()
        for e in range(plant.first[at], plant.first[at + 1]):
            if plant.law[e, 0] == code:
                law_p[e, : len(values)] = values
        changed = plant._replace(law_p=law_p)
        return replace(self, plant=changed, held=tuple(_held(changed)))

    def rest(self, q3: float, shares: Floats, offset: float) -> tuple[float, Floats, Floats]:
        """At rest with the output at ``q3``, m: theta_d, rad, the positions (bodies,) m, and the held forces, N.

        shares : (held,) of its level what holds each; offset : of the screw beside the balance, rad.
        """
        give = np.linalg.inv(self.bodies.K)
        by_base = give @ self.bodies.base_k
        forces = np.array([held.level for held in self.held]) * shares
        held = sum((give @ h.direction * f for h, f in zip(self.held, forces, strict=True)), np.zeros(by_base.size))
        base, angle = (q3 - held[self.output]) / by_base[self.output], 0.0
        for _ in range(1 + 3 * self.bent):  # the lead's error is small beside the lead
            angle += (base - self._base(angle)) / self.plant.screw[pl.S_LEAD]
        angle += offset
        return angle, by_base * self._base(angle) + held, forces

    def looks_like_a_gap(self) -> list[float]:
        """What dry friction that holds the output short of its end adds to a gap that is taken for it, rad; and 0."""
        give = np.linalg.inv(self.bodies.K)
        short = sum((abs(float((give @ h.direction)[self.output])) * h.level for h in self.held if h.memory < 0), 0.0)
        return [0.0, short / float(self.plant.screw[pl.S_LEAD])] if short else [0.0]

    @property
    def bent(self) -> bool:
        """Whether the screw's lead errs."""
        place = self.plant.slot[pl.LEAD]
        return bool(self.plant.first[place + 1] > self.plant.first[place])

    def _base(self, theta_d: float) -> float:
        return float(base_motion(self.plant, np.zeros(self.plant.A.shape[1]), 0, theta_d, 0.0)[0])

    def position(self, theta_m: Floats, half_gap: Floats, q3: float, shares: Floats, offset: float) -> Floats:
        """(N,) position of the output, m, from rest (:meth:`rest`); theta_m, half_gap : (N,) rad."""
        plant, state = self.plant, new_state(self.plant)
        angle, q, forces = self.rest(q3, shares, offset)
        state.gear[0] = min(max(angle, theta_m[0] - half_gap[0]), theta_m[0] + half_gap[0])
        if state.gear[0] != angle:  # the gap does not let the screw be there
            q = q + np.linalg.solve(self.bodies.K, self.bodies.base_k) * (self._base(state.gear[0]) - self._base(angle))
        state.x[plant.position : plant.position + plant.n_bodies] = q
        for held, force in zip(self.held, forces, strict=True):
            if held.memory >= 0 and held.level > 0.0:
                state.x[held.memory] = force / held.level
        out = np.empty_like(theta_m)
        follow(plant, state, theta_m, half_gap, self.index, np.zeros(len(plant.sensor)), out)
        return out


def _held(plant: Plant) -> list[Held]:
    """Contacts of dry friction, and springs with a memory."""
    n, found = plant.n_bodies, []

    def direction(a: int, b: int, lever: float = 1.0) -> Floats:
        d = np.zeros(n)
        if b >= 0:
            d[b] += 1.0
        if a >= 0:
            d[a] -= lever
        return d

    for c, (a, b) in enumerate(plant.friction_ends):
        place = plant.slot[pl.FRICTION] + c
        there = slice(plant.first[place], plant.first[place + 1])
        level = float(plant.law_p[there, 0][plant.law[there, 1] == pl.NOTHING].sum())
        found.append(Held(direction(a, b), level, -1))
    for j, (a, b) in enumerate(plant.link_ends):
        place = plant.slot[pl.LINK] + pl.PER_LINK * j + pl.MEMORIES
        for e in range(plant.first[place], plant.first[place + 1]):
            found.append(
                Held(-direction(a, b, plant.link[j, pl.L_LEVER]), float(plant.law_p[e, 0]), int(plant.law[e, 1]))
            )
    return found


class StructureBuffer:
    """One buffer of measured angle and output, and how it is explained.

    theta_m, q3 : (N,) rad, m. rig : what is believed. sensor : of the output. The machine is at rest when the buffer
    begins, or nearly: what it still swings by is taken as part of the noise.
    """

    def __init__(self, theta_m: Floats, q3: Floats, rig: Rig, sensor: Sensor, sample_time_s: float) -> None:
        count = theta_m.size // BLOCK * BLOCK
        shown, self.q3 = np.ascontiguousarray(theta_m[:count]), np.ascontiguousarray(q3[:count])
        self.count, self.theta_m = count_of(shown), without_counts(shown)
        self.rig, self.sensor, self.sample_time_s = rig, sensor, sample_time_s
        self.time_s = (np.arange(count) - 0.5 * (count - 1)) * sample_time_s
        self.driven = Driven.of(rig, sensor, sample_time_s)
        self.lead = float(base_motion(self.driven.plant, np.zeros(self.driven.plant.A.shape[1]), 0, 1.0, 0.0)[0])
        moved = np.flatnonzero(np.abs(self.theta_m - self.theta_m[0]) > STILL_RAD + 3.0 * self.count)
        self.still = int(min(max(moved[0] if moved.size else count, LEAST_STILL), MOST_STILL))
        self.q3_0 = float(np.mean(self.q3[: self.still]))
        self.measured = blocks(self.q3)
        self.factor = self._whitener()

    def _whitener(self) -> Floats:
        """Cholesky factor of the covariance of the blocks' means: noise, counts, and how the structure still swings."""
        noise, count = noise_of(self.q3), count_of(self.q3)
        # counts beside a larger noise are noise, else they stay the same for long, as those of the angle do
        held = count / math.sqrt(12.0) if noise < 0.6 * count else 0.0
        angle = self.lead * self.count / math.sqrt(12.0)
        apart_s = np.abs(np.subtract.outer(np.arange(self.measured.size), np.arange(self.measured.size))) * (
            BLOCK * self.sample_time_s
        )
        variance = noise**2 / BLOCK + MODEL_M**2
        start = blocks(self.q3[: self.still]) if self.still >= 2 * BLOCK else self.measured[:2]
        swings = math.sqrt(max(float(np.var(start)) - noise**2 / BLOCK, 0.0)) + 0.5 * math.sqrt(variance / BLOCK)
        free = self._free() * swings
        errs = MODEL_SHARE * float(np.ptp(self.q3))
        stays = (held**2 + angle**2 + errs**2) * np.exp(-apart_s / STAYS_S)
        covariance = variance * np.eye(self.measured.size) + stays + free @ free.T
        return np.asarray(linalg.cholesky(covariance, lower=True))

    def _free(self) -> Floats:
        """(blocks, 2 bodies) output, by blocks, of the believed linear structure let go from each of its states."""
        b = self.driven.bodies
        n = len(b.names)
        rates = np.sqrt(np.diag(b.K) / b.inertia)
        system = np.zeros((2 * n, 2 * n))
        system[:n, n:] = np.eye(n)
        system[n:, :n], system[n:, n:] = -b.K / b.inertia[:, None], -b.C / b.inertia[:, None]
        step = linalg.expm(system * self.sample_time_s * BLOCK)
        state, rows = np.diag([*np.ones(n), *rates]), []
        for _ in range(self.measured.size):
            rows.append(state[self.driven.output])
            state = step @ state
        return np.array(rows)

    def fit(self, hypothesis: Hypothesis | None, gap_rad: float, known: Floats | None = None) -> Fit:
        """The best fit of a hypothesis (None: the gap alone), in the fit's variables.

        These are gap, start and growth, the hypothesis's own, and of each held force its share of its level (through
        :func:`_within`); where any is, the start is theirs. The search begins where a coarse grid about ``gap_rad`` is
        best. known : (held,) these variables of the believed structure's held forces, from the fit of the gap alone.
        """
        longest = np.array([*[np.inf] * COMMON, *(hypothesis.longest() if hypothesis else ())])
        spare = longest.size
        base = self._changed(hypothesis, hypothesis.to_fit(hypothesis.starts[0])) if hypothesis else self.driven
        cache: dict[tuple[float, ...], Driven | None] = {}

        def residual(x: Floats) -> Floats:
            own = tuple(x[COMMON:spare])
            if own not in cache:
                cache.clear()
                cache[own] = self._changed(hypothesis, own, base)
            structure = cache[own]
            if structure is None:
                return np.full(self.measured.size + 1, 1e6)
            simulated = blocks(self._simulated(structure, x, x[spare:]))
            left = linalg.solve_triangular(self.factor, self.measured - simulated, lower=True, check_finite=False)
            return np.append(left, x[2] * GROWTH / GROWTH_STD)

        grid = self._grid(hypothesis, gap_rad, known)
        longest = np.append(longest, np.full(grid[0].size - spare, 1.0))
        fit = best_fitted(residual, grid, priors=1, longest=longest)
        for i in range(spare, fit.x.size):
            fit = self._scanned(residual, fit, i, longest)
        return _with_priors(fit, spare)

    def _scanned(self, residual: Residual, fit: Fit, i: int, longest: Floats) -> Fit:
        """The fit with variable i, a held share, sought on a line as well: what it decides is when friction lets go."""
        line = [np.where(np.arange(fit.x.size) == i, share, fit.x) for share in FINE_SHARES]
        left = [float(np.sum(np.clip(residual(x), -FAR, FAR) ** 2)) for x in line]
        if min(left) > fit.chi2:
            return fit
        return fitted(residual, line[int(np.argmin(left))], priors=1, longest=longest)

    def _changed(
        self, hypothesis: Hypothesis | None, own: tuple[float, ...], base: Driven | None = None
    ) -> Driven | None:
        """The structure with a hypothesis's variables; None for a value out of all bounds, far from any minimum.

        base : the structure with other variables of the same hypothesis.
        """
        if hypothesis is None:
            return self.driven
        if base is not None and hypothesis.effect in BESIDE:
            return base.with_law(hypothesis.place, hypothesis.effect, hypothesis.from_fit(own))
        try:
            return Driven.of(hypothesis.changed(self.rig, own), self.sensor, self.sample_time_s)
        except UserError:
            return None

    def _simulated(self, structure: Driven, x: Floats, held: Floats) -> Floats:
        gap = np.maximum(abs(x[0]) * GAP + x[2] * GROWTH * self.time_s, 0.0)
        offset = 0.0 if held.size else x[1] * START
        return structure.position(self.theta_m, gap, self.q3_0, _within(held), offset)

    def _grid(self, hypothesis: Hypothesis | None, gap_rad: float, known: Floats | None) -> list[Floats]:
        """Where a fit may begin: the hypothesis's starts, and what may be held at rest."""
        starts = [hypothesis.to_fit(start) for start in hypothesis.starts] if hypothesis else [()]
        found = []
        for own in starts:
            structure = self._changed(hypothesis, own)
            if structure is None:
                continue
            choices = [self._shares_of(held, known) for held in structure.held]
            new = any(len(choice) > 1 for choice in choices)
            for less in structure.looks_like_a_gap() if new else [0.0]:
                for shares in itertools.product(*choices):
                    found.append(np.array([max(gap_rad - less, 0.0) / GAP, 0.0, 0.0, *own, *shares]))
        return found

    def _shares_of(self, held: Held, known: Floats | None) -> tuple[float, ...]:
        """Where the search for a held force's share begins: at what it is known to be of what was believed before."""
        for i, before in enumerate(self.driven.held):
            same = (before.memory < 0) == (held.memory < 0) and np.array_equal(before.direction, held.direction)
            if same and known is not None:
                return (float(known[i]),)
        return SHARES

    def gap_at_the_end(self) -> float:
        """The half-gap if the structure is at rest at the buffer's end, rad."""
        return abs(float(self.theta_m[-1]) - float(np.mean(self.q3[-BLOCK:])) / self.lead)


def _with_priors(fit: Fit, spare: int) -> Fit:
    """The fit with what is known of its variables beforehand in their covariance: held shares lie between -1 and 1.

    Friction that turns round once in a buffer hardly tells its level from what it held at rest, and both from the gap:
    then it is their bounds alone that keep the gap's standard error finite.
    """
    free = np.array([*WIDE_COMMON, *[WIDE] * (spare - COMMON), *[0.0] * (fit.x.size - spare)])
    free[spare:] = SHARE_STD * (1.0 + fit.x[spare:] ** 2) ** 1.5
    normal = fit.jacobian.T @ fit.jacobian + np.diag(1.0 / free**2)
    return replace(fit, covariance=inverse(normal))


def _within(x: Floats) -> Floats:
    """Shares between -1 and 1 of variables without bounds."""
    return np.asarray(x / np.sqrt(1.0 + x * x))
