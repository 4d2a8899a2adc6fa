"""The first state of a recording that does not begin at rest.

It is a parameter of each recording (or stretch of one) and each block: the plant's state (current, positions, speeds,
memories) and the position of the motor in its play. For each rig that is compared it is fitted anew to the beginning of
the recording, until its influence has decayed (variable projection: Golub & Pereyra, SIAM J. Numer. Anal. 10 (1973)
413).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.plant import Plant, State, new_state

#: a smooth curve pictures a beginning where it leaves so much noise at most (ratio)
BEGINNING_NOISE_RATIO = 1.1
#: and the scatter of what it leaves, of which few samples have much (standard errors)
BEGINNING_SCATTER = 2.0
#: where no curve is fair, a first speed is one from this share of the fastest (share)
BEGINNING_SPEED_SHARE = 0.5
#: a hidden body near its resonance moves so much further than its host: its first state's prior (ratio)
BEGINNING_HIDDEN_RATIO = 10.0
#: a memory's first value lies within so much of what it comes to: its prior (ratio)
BEGINNING_MEMORY_RATIO = 10.0

#: numbers of samples of a channel's beginning to which a polynomial is fitted
WINDOWS = (6, 8, 12, 24, 48, 96)
#: the same for a beginning at rest
STANDING = (*WINDOWS, 192, 384, 768)
#: powers of time of the polynomial: in motion, and at rest
MOVING, RESTING = (0, 1, 2, 3), (0, 2, 3, 4)

#: Gauss-Newton steps, and how often a step is shortened
STEPS, SHORTER = 6, 4
#: the last step is one that promises a smaller fall of the sum of squares: absolute, and relative
ENOUGH, ENOUGH_SHARE = 1e-4, 1e-10
#: step of a finite difference, relative to the state's spread
DIFFERENCE = 1e-3


@dataclass(frozen=True)
class Beginning:
    """Of a recording that begins in motion: the data with which its first state is fitted.

    noise : channel -> standard deviation of its noise, SI. window : channel -> samples over which it is a cubic.
    sizes : body -> standard deviations of its position and its speed, SI.
    """

    noise: dict[str, float]
    window: dict[str, int]
    sizes: dict[str, tuple[float, float]]


def local(values: Floats, step_s: float) -> tuple[float, float]:
    """Value and slope at the first sample, of a cubic fitted to all values."""
    coefficients, _ = _polynomial(values, MOVING)
    return float(coefficients[0]), float(coefficients[1]) / (step_s * (len(values) - 1))


def _polynomial(values: Floats, powers: tuple[int, ...]) -> tuple[Floats, float]:
    """Fitted coefficients of powers of time, which runs from 0 to 1, and the sum of squared residuals."""
    basis = _basis(len(values), powers)
    coefficients = np.asarray(np.linalg.lstsq(basis, values, rcond=None)[0])
    return coefficients, float(np.sum((values - basis @ coefficients) ** 2))


def _basis(samples: int, powers: tuple[int, ...]) -> Floats:
    basis: Floats = np.linspace(0.0, 1.0, samples)[:, None] ** np.array(powers)
    return basis


def _fits(squares: float, samples: int, noise: float) -> bool:
    """Whether a polynomial leaves only noise."""
    free = samples - len(MOVING)
    ratio = BEGINNING_NOISE_RATIO + BEGINNING_SCATTER / math.sqrt(2.0 * free)
    return squares <= free * (ratio * noise) ** 2


def window_of(values: Floats, noise: float) -> int:
    """The most samples of the beginning that a cubic fits down to the noise, or the fewest of WINDOWS."""
    fits = (n for n in reversed(WINDOWS) if n <= len(values) and _fits(_polynomial(values[:n], MOVING)[1], n, noise))
    return next(fits, WINDOWS[0])


def moves(values: Floats, noise: float, speed: bool) -> bool:
    """Whether a channel moves at its first sample; ``speed`` : the channel is a speed.

    The longest beginning that a polynomial fits down to the noise decides, whether the polynomial starts at rest.
    """
    if speed:
        return abs(local(values[: window_of(values, noise)], 1.0)[0]) ** 2 > SETTINGS.beginning_squares * noise**2
    for n in reversed(WINDOWS):
        moving, resting = (_polynomial(values[:n], powers)[1] for powers in (MOVING, RESTING))
        if _fits(min(moving, resting), n, noise):
            return _fits(moving, n, noise) and resting - moving > SETTINGS.beginning_squares * noise**2
    first = values[: WINDOWS[0]]
    return abs(local(first, 1.0)[1]) > max(
        BEGINNING_SPEED_SHARE * float(np.abs(np.diff(first)).max()), math.sqrt(SETTINGS.beginning_squares) * noise
    )


def stands(values: Floats, noise: float) -> float:
    """Position at the first sample of a recording that begins at rest, with the noise averaged out.

    By a polynomial that starts at rest, fitted to the longest beginning whose result agrees with those of all shorter
    ones within two standard errors of each (Lepski, Theory Probab. Appl. 35 (1991) 454).
    """
    first, low, high = float(values[0]), -math.inf, math.inf
    for n in (n for n in STANDING if n <= len(values)):
        coefficients, squares = _polynomial(values[:n], RESTING)
        if not _fits(squares, n, noise):
            continue
        error = noise * _error_of_first(n)
        if not low <= coefficients[0] <= high:
            break
        first = float(coefficients[0])
        low, high = max(low, first - 2.0 * error), min(high, first + 2.0 * error)
    return first


@cache
def _error_of_first(samples: int) -> float:
    """Standard error of the first position of a motion from rest, in units of the noise."""
    basis = _basis(samples, RESTING)
    return math.sqrt(float(np.linalg.inv(basis.T @ basis)[0, 0]))


def first_state(
    run: Callable[[Floats], Floats], measured: Floats, noise: Floats, guess: Floats, spread: Floats, reach: Floats
) -> Floats:
    """(states,) the first state that fits the beginning best; the guess where the simulation diverges.

    Parameters
    ----------
    run : state -> (n, channels) prediction. measured : (n, channels). noise : (channels,) standard deviations.
    guess : (states,) start. spread : (states,) standard deviation of its Gaussian prior; 0: the state is known.
    reach : (states,) largest possible magnitude, or infinity.
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
        better = _shortened(rows, state, here, free, change * spread[free], reach)
        if better is not None:
            state, here = better
        elif fresh:
            return state
        else:
            columns = None  # the columns belong to a state too far away
    return state


def _moved(state: Floats, free: np.ndarray, change: Floats, reach: Floats) -> Floats:
    moved = state.copy()
    moved[free] = np.clip(moved[free] + change, -reach[free], reach[free])
    return moved


def _columns(
    rows: Callable[[Floats], Floats], state: Floats, here: Floats, free: np.ndarray, spread: Floats, reach: Floats
) -> Floats:
    """(rows, free) derivatives of the rows by each free state, per its spread."""
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
    """State and rows after the first of ever shorter steps that fits no worse; None if none does."""
    for k in range(SHORTER):
        moved = _moved(state, free, 0.5**k * change, reach)
        there = rows(moved)
        if np.isfinite(there).all() and there @ there <= here @ here:
            return moved, there
    return None


#: position of the motor in its play, as a share of the half gap, from which it touches a flank
ON_FLANK = 1.0 - 1e-6


@dataclass(frozen=True)
class Launch:
    """The data of a block at the beginning of its recording, to which its first state is fitted.

    Attributes
    ----------
    bodies : names in the order of the state -> the element that each is, or sits on, and its axis of motion.
    half_gap : of the gear, rad. angle : (n,) imposed angle, rad (V of a positioner), or None.
    u : (n,) command, V. command_size : its standard deviation, V.
    positions, speeds : channel -> body and (n,) its measured position or speed.
    measured : (n, channels) of the block's channels ``columns``, SI. noise : (channels,).
    skip : number of first samples that depend on what was before them, because of a delay.
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
        """The state that fits the beginning best. run : (state, n) -> (n, channels); changes the state."""
        guess = self._guess()
        spread = self._spread(guess, run)
        reach = np.full(len(guess), np.inf)
        reach[-1] = self.half_gap

        def shown(vector: Floats) -> Floats:
            return run(self.state(vector), len(self.measured))[self.skip :, self.columns]

        measured = self.measured[self.skip :]
        if self.half_gap > 0.0:
            sides = [np.append(guess[:-1], z) for z in (guess[-1], -guess[-1], 0.0)]
            guess = min(sides, key=lambda v: _sum_of_squares(shown(v), measured, self.noise))
        return self.state(first_state(shown, measured, self.noise, guess, spread, reach))

    def state(self, vector: Floats) -> State:
        """The state of a vector; the command before it is the first one, and contacts slip as their ends move."""
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
        """Positions and speeds: measured, or those of the screw's output, or of a measured body on the same axis."""
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
        """(states + 1,) standard deviations of the guess: those of the states in the recording."""
        plant = self.plant
        spread = np.zeros(len(guess))
        for j, (body, (element, _)) in enumerate(self.bodies.items()):
            more = 1.0 if body == element else BEGINNING_HIDDEN_RATIO
            size = self.begins.sizes.get(element, (0.0, 0.0))
            spread[plant.position + j], spread[plant.position + plant.n_bodies + j] = more * size[0], more * size[1]
        if plant.current >= 0:
            spread[0] = self.command_size * plant.G[0, pl.CH_V, 0] / -plant.A[0, 0, 0]
        memories = slice(plant.position + 2 * plant.n_bodies, len(guess) - 1)
        if memories.start < memories.stop:
            after = self.state(guess)
            run(after, len(self.measured))
            spread[memories] = BEGINNING_MEMORY_RATIO * np.abs(np.nan_to_num(after.x[memories]))
        # where the load acts back on the motor, its position in the play is one of the three in `fitted`
        if plant.imposed or plant.screw[pl.S_SHARE] == 0.0:
            spread[-1] = self.half_gap
        return spread


def _sum_of_squares(shown: Floats, measured: Floats, noise: Floats) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        squares = float(np.sum(((measured - shown) / noise) ** 2))
    return squares if np.isfinite(squares) else np.inf
