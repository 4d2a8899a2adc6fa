"""The state in which a recording begins, where it does not begin at rest.

It is not recorded, so it is a parameter of every recording (or stretch of one) and every block: the plant's state
(current, positions, speeds, memories) and the side on which a play stands. For each rig that is compared it is found
anew by least squares on the beginning, until what the state adds has died out (variable projection: Golub & Pereyra,
SIAM J. Numer. Anal. 10 (1973) 413); so no parameter can be mistaken for it, and nothing has to be thrown away.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.settings import settings
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.plant import Plant, State, new_state

#: samples of a channel's beginning that are looked at
WINDOWS = (6, 8, 12, 24, 48, 96)
#: of one at rest, whose picture has a known slope
STANDING = (*WINDOWS, 192, 384, 768)
#: powers of time that picture a beginning: in motion, and at rest
MOVING, RESTING = (0, 1, 2, 3), (0, 2, 3, 4)

#: steps of Gauss and Newton, and how often a step is shortened
STEPS, SHORTER = 6, 4
#: a step that promises less is the last one: in squares of the noise's standard deviation, and of all that is left
ENOUGH, ENOUGH_SHARE = 1e-4, 1e-10
#: a column is a difference over this share of the state's usual size
DIFFERENCE = 1e-3


@dataclass(frozen=True)
class Beginning:
    """That a recording begins in motion, and what its first state is found with.

    noise : channel -> standard deviation of its noise, SI. window : channel -> samples over which it is smooth.
    sizes : body -> how far it usually is from its middle, and how fast it moves, SI.
    """

    noise: dict[str, float]
    window: dict[str, int]
    sizes: dict[str, tuple[float, float]]


def local(values: Floats, step_s: float) -> tuple[float, float]:
    """Value and slope at the first sample, by a cubic through all of them."""
    found, _ = _pictured(values, MOVING)
    return float(found[0]), float(found[1]) / (step_s * (len(values) - 1))


def _pictured(values: Floats, powers: tuple[int, ...]) -> tuple[Floats, float]:
    """Coefficients of powers of time, which runs from 0 to 1, and the sum of squares that they leave."""
    basis = _basis(len(values), powers)
    found = np.asarray(np.linalg.lstsq(basis, values, rcond=None)[0])
    return found, float(np.sum((values - basis @ found) ** 2))


def _basis(samples: int, powers: tuple[int, ...]) -> Floats:
    basis: Floats = np.linspace(0.0, 1.0, samples)[:, None] ** np.array(powers)
    return basis


def _fair(squares: float, samples: int, noise: float) -> bool:
    rules = settings()
    free = samples - len(MOVING)
    ratio = rules.beginning_noise_ratio + rules.beginning_scatter / math.sqrt(2.0 * free)
    return squares <= free * (ratio * noise) ** 2


def window_of(values: Floats, noise: float) -> int:
    """The most samples at the beginning that a cubic pictures down to the noise, or the fewest that are looked at."""
    fair = (n for n in reversed(WINDOWS) if n <= len(values) and _fair(_pictured(values[:n], MOVING)[1], n, noise))
    return next(fair, WINDOWS[0])


def moves(values: Floats, noise: float, speed: bool) -> bool:
    """Whether a channel shows a motion at its first sample; ``speed`` : it shows the speed itself.

    The longest beginning that a smooth motion pictures down to the noise, from rest or not, decides which it is.
    """
    rules = settings()
    if speed:
        return abs(local(values[: window_of(values, noise)], 1.0)[0]) ** 2 > rules.beginning_squares * noise**2
    for n in reversed(WINDOWS):
        moving, resting = (_pictured(values[:n], powers)[1] for powers in (MOVING, RESTING))
        if _fair(min(moving, resting), n, noise):
            return _fair(moving, n, noise) and resting - moving > rules.beginning_squares * noise**2
    first = values[: WINDOWS[0]]
    return abs(local(first, 1.0)[1]) > max(
        rules.beginning_speed_share * float(np.abs(np.diff(first)).max()), math.sqrt(rules.beginning_squares) * noise
    )


def stands(values: Floats, noise: float) -> float:
    """Where a position stands at its first sample: a motion from rest pictures its beginning down to the noise.

    The first sample alone has all of its noise, and nothing brings back by itself what is free. The longest beginning
    counts whose picture agrees with those of all shorter ones, within two standard errors of each: one that is too long
    is pictured wrongly long before that shows in what it leaves (Lepski, Theory Probab. Appl. 35 (1991) 454).
    """
    found, low, high = float(values[0]), -math.inf, math.inf
    for n in (n for n in STANDING if n <= len(values)):
        picture, squares = _pictured(values[:n], RESTING)
        if not _fair(squares, n, noise):
            continue
        error = noise * _error_of_first(n)
        if not low <= picture[0] <= high:
            break
        found = float(picture[0])
        low, high = max(low, found - 2.0 * error), min(high, found + 2.0 * error)
    return found


@cache
def _error_of_first(samples: int) -> float:
    """Standard error of the first place of a motion from rest, in units of the noise's."""
    basis = _basis(samples, RESTING)
    return math.sqrt(float(np.linalg.inv(basis.T @ basis)[0, 0]))


def first_state(
    run: Callable[[Floats], Floats], measured: Floats, noise: Floats, guess: Floats, spread: Floats, reach: Floats
) -> Floats:
    """The state at the first sample that fits the beginning best (Gauss and Newton, steps shortened as needed).

    Parameters
    ----------
    run : state -> (n, channels) what is shown of it. measured : (n, channels). noise : (channels,) standard deviations.
    guess : (states,) where to begin. spread : (states,) its error, a Gaussian prior's; 0 where it is known.
    reach : (states,) the largest magnitude that is possible, or infinity.

    Returns
    -------
    (states,) the guess itself where the simulation does not stay finite.
    """
    free = np.flatnonzero(spread > 0.0)

    def rows(state: Floats) -> Floats:
        with np.errstate(over="ignore", invalid="ignore"):
            left = (measured - run(state)) / noise
            return np.concatenate([left.ravel(), (state - guess)[free] / spread[free]])

    state, here = guess, rows(guess)
    if not len(free) or not np.isfinite(here).all():
        return guess
    columns: Floats | None = None
    for _ in range(STEPS):
        fresh = columns is None
        if columns is None:
            columns = _columns(rows, state, here, free, spread, reach)
            if not np.isfinite(columns).all():
                return state
        change = np.linalg.lstsq(columns, -here, rcond=None)[0]
        left = float(here @ here)
        if left - float(np.sum((here + columns @ change) ** 2)) < ENOUGH + ENOUGH_SHARE * left:
            return _moved(state, free, change * spread[free], reach)
        found = _shortened(rows, state, here, free, change * spread[free], reach)
        if found is None and fresh:
            return state
        if found is None:
            columns = None  # they were those of a state too far away
        else:
            state, here = found
    return state


def _moved(state: Floats, free: np.ndarray, change: Floats, reach: Floats) -> Floats:
    moved = state.copy()
    moved[free] = np.clip(moved[free] + change, -reach[free], reach[free])
    return moved


def _columns(
    rows: Callable[[Floats], Floats], state: Floats, here: Floats, free: np.ndarray, spread: Floats, reach: Floats
) -> Floats:
    """(rows, free) what the rows change by per spread of each free state."""
    columns = []
    for j in free:
        step = DIFFERENCE * spread[j]
        if state[j] + step > reach[j]:
            step = -step
        moved = state.copy()
        moved[j] += step
        columns.append((rows(moved) - here) * (spread[j] / step))
    return np.column_stack(columns)


def _shortened(
    rows: Callable[[Floats], Floats], state: Floats, here: Floats, free: np.ndarray, change: Floats, reach: Floats
) -> tuple[Floats, Floats] | None:
    """The first of ever shorter steps that fits no worse, and its rows."""
    for k in range(SHORTER):
        moved = _moved(state, free, 0.5**k * change, reach)
        there = rows(moved)
        if np.isfinite(there).all() and there @ there <= here @ here:
            return moved, there
    return None


#: the motor's place in its play, as a share of it, from which it leans on a flank
ON_FLANK = 1.0 - 1e-6


@dataclass(frozen=True)
class Launch:
    """What is known of a block where its recording begins.

    Attributes
    ----------
    bodies : names in the order of the state, with the element that each is, or sits on, and the axis that it moves on.
    half_gap : of the gear, rad. angle : (n,) what is imposed, rad (V of a positioner), or nothing.
    u : (n,) command, V. command_size : its standard deviation, V.
    seen : channel -> body and (n,) what its sensor looks at, for positions and for speeds.
    measured : (n, channels) of the channels in ``columns`` of what the block shows, SI. noise : (channels,).
    skip : the first samples, which a delay keeps from being known.
    """

    plant: Plant
    bodies: dict[str, tuple[str, str]]
    half_gap: float
    angle: Floats | None
    u: Floats
    command_size: float
    positions: dict[str, tuple[str, Floats]]
    speeds: dict[str, tuple[str, Floats]]
    measured: Floats
    columns: list[int]
    noise: Floats
    begins: Beginning
    skip: int

    def fitted(self, run: Callable[[State, int], Floats]) -> State:
        """The state that fits the beginning best. ``run`` : simulates so many samples from a state, which it moves."""
        guess = self._guess()
        spread = self._spread(guess, run)
        reach = np.full(len(guess), np.inf)
        reach[-1] = self.half_gap

        def shown(vector: Floats) -> Floats:
            return run(self.state(vector), len(self.measured))[self.skip :, self.columns]

        measured = self.measured[self.skip :]
        if self.half_gap > 0.0:
            guess = min(self._sides(guess), key=lambda v: _left(shown(v), measured, self.noise))
        return self.state(first_state(shown, measured, self.noise, guess, spread, reach))

    def state(self, vector: Floats) -> State:
        """The state of a vector; a late command is taken for the first one, and contacts slip as their ends move."""
        plant, z = self.plant, float(vector[-1])
        state = new_state(plant)
        state.x[:] = vector[:-1]
        state.commands[:] = self.u[0]
        rotor = plant.position + plant.rotor
        first, rate = 0.0, 0.0
        if self.angle is not None:
            first, rate = float(self.angle[0]), float(self.angle[1] - self.angle[0]) / plant.sample_time
        elif plant.rotor >= 0:
            first, rate = float(state.x[rotor]), float(state.x[rotor + plant.n_bodies])
        if plant.has_base:
            state.gear[0] = first - z
        leans = self.half_gap == 0.0 or (abs(z) >= ON_FLANK * self.half_gap and z * rate > 0.0)
        if self.half_gap > 0.0 and not plant.imposed:
            state.mode[0] = (pl.PLUS if z > 0.0 else pl.MINUS) if leans else pl.FREE
        base_rate = plant.screw[pl.S_LEAD] * rate if leans else 0.0
        ends = {pl.GROUND: 0.0, pl.BASE: base_rate}
        for c, (a, b) in enumerate(plant.friction_ends.tolist()):
            va, vb = (ends[e] if e in ends else state.x[plant.position + plant.n_bodies + e] for e in (a, b))
            state.mode[1 + c] = int(np.sign(vb - va))
        return state

    def _guess(self) -> Floats:
        """Positions and speeds as measured, where they are; elsewhere those of what drives the body, or its like."""
        plant, step = self.plant, self.plant.sample_time
        places, rates = self._read(self.positions), self._read(self.speeds)
        at = {body: (value, slope) for body, (value, slope) in places.items()}
        for body, (value, _) in rates.items():
            at[body] = (at.get(body, (0.0, 0.0))[0], value)
        if self.angle is not None:
            first, rate = local(self.angle[: min(len(self.angle), 24)], step)
        else:
            rotor = next((b for j, b in enumerate(self.bodies) if j == plant.rotor), "")
            first, rate = at.get(rotor, (0.0, 0.0))
        vector = np.zeros(plant.A.shape[1] + 1)
        for j, (element, axis) in enumerate(self.bodies.values()):
            like = next((at[b] for b in at if self.bodies[b][1] == axis), (0.0, 0.0))
            value, slope = at.get(element, like)
            if plant.has_base and j != plant.rotor:
                value, slope = plant.screw[pl.S_LEAD] * first, plant.screw[pl.S_LEAD] * rate
            vector[plant.position + j], vector[plant.position + plant.n_bodies + j] = value, slope
        if plant.current >= 0:  # as if it had settled
            driven = vector[plant.position + plant.n_bodies + plant.driven]
            eats = plant.A[0, 0, plant.position + plant.n_bodies + plant.driven] * driven
            vector[0] = -(plant.G[0, pl.CH_V, 0] * self.u[0] + eats) / plant.A[0, 0, 0]
        vector[-1] = np.sign(rate) * self.half_gap
        return vector

    def _read(self, channels: dict[str, tuple[str, Floats]]) -> dict[str, tuple[float, float]]:
        """Body -> value and slope of its channel at the first sample."""
        step, window = self.plant.sample_time, self.begins.window
        return {body: local(v[: window[c]], step) for c, (body, v) in channels.items() if c in window}

    def _spread(self, guess: Floats, run: Callable[[State, int], Floats]) -> Floats:
        """(states + 1,) how far the guess may be off: as much as the states usually are from their middles."""
        plant = self.plant
        spread = np.zeros(len(guess))
        for j, (body, (element, _)) in enumerate(self.bodies.items()):
            more = 1.0 if body == element else settings().beginning_hidden_ratio
            size = self.begins.sizes.get(element, (0.0, 0.0))
            spread[plant.position + j], spread[plant.position + plant.n_bodies + j] = more * size[0], more * size[1]
        if plant.current >= 0:
            spread[0] = self.command_size * plant.G[0, pl.CH_V, 0] / -plant.A[0, 0, 0]
        memories = slice(plant.position + 2 * plant.n_bodies, len(guess) - 1)
        if memories.start < memories.stop:
            after = self.state(guess)
            run(after, len(self.measured))
            spread[memories] = settings().beginning_memory_ratio * np.abs(np.nan_to_num(after.x[memories]))
        # a motor that hits what it carries loses speed: there the side is chosen, and nothing between
        if plant.imposed or plant.screw[pl.S_SHARE] == 0.0:
            spread[-1] = self.half_gap
        return spread

    def _sides(self, guess: Floats) -> list[Floats]:
        """The guess with the motor on either flank, and amid its play."""
        return [np.append(guess[:-1], z) for z in (guess[-1], -guess[-1], 0.0)]


def _left(shown: Floats, measured: Floats, noise: Floats) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        left = float(np.sum(((measured - shown) / noise) ** 2))
    return left if np.isfinite(left) else np.inf
