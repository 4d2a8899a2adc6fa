"""Starts: the state in which a recording begins, where it does not begin at rest.

It is not recorded, so it is a parameter of every recording (or stretch of one) and every block: positions, speeds, the
current, memories, the side on which a play stands. For each rig that is compared it is found anew by least squares on
the beginning, until what the state adds has died out (variable projection: Golub & Pereyra, SIAM J. Numer. Anal. 10
(1973) 413); so no parameter can be mistaken for it, and nothing has to be thrown away.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.settings import settings

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
