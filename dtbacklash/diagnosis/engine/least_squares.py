"""A step of a nonlinear least squares problem: damped, within a box, and what it teaches the Jacobian."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dtbacklash.arrays import Floats

#: a step goes no further in x
STEP_MAX = 1.0
#: damping with which a fit begins (Marquardt's lambda), and how often it grows until a step brings the squares down
DAMPED, ATTEMPTS = 1e-3, 5


class DampedStep(NamedTuple):
    """A step of a fit: J'J, the step, residuals at its end (None: none fell), the promised fall, the damping."""

    gram: Floats
    step: Floats
    rows: Floats | None
    promised: float
    damping: float


def damped_step(
    residuals: Callable[[Floats], Floats | None], x: Floats, J: Floats, rows: Floats, damping: float, least: float
) -> DampedStep | None:
    """The least damped step from x that brings the sum of squares down (Marquardt, SIAM J. 11 (1963) 431).

    Parameters
    ----------
    residuals : (n,) -> (rows,), None where there are none. J : (rows, n). least : None is given where the first step
        promises a smaller fall than this.

    Raises
    ------
    LinAlgError : the Jacobian is singular.
    """
    gram, side, here = J.T @ J, J.T @ rows, float(rows @ rows)
    for attempted in range(ATTEMPTS):
        step = step_in_box(gram + damping * np.diag(np.diag(gram) + 1e-9), side)
        promised = -float(2.0 * side @ step + step @ gram @ step)
        if not attempted and promised < least:
            return None
        after = residuals(x + step)
        if after is not None and after @ after < here:
            return DampedStep(gram, step, after, promised, damping)
        damping = max(8.0 * damping, DAMPED)
    return DampedStep(gram, step, None, promised, damping)


def step_in_box(gram: Floats, side: Floats) -> Floats:
    """The least of the quadratic model where no step is longer than ``STEP_MAX``.

    Raises LinAlgError where the model is not positive.
    """
    step = np.asarray(-np.linalg.solve(gram, side), dtype=float)
    if np.abs(step).max() <= STEP_MAX:
        return step
    from scipy.optimize import lsq_linear

    root = np.linalg.cholesky(gram)
    box = -STEP_MAX, STEP_MAX
    return np.asarray(lsq_linear(root.T, -np.linalg.solve(root, side), box, method="bvls").x, dtype=float)


def secant(gram: Floats, missed: Floats, step: Floats) -> Floats:
    """What is to be added to a Jacobian that missed the change of a step by so much.

    Broyden, Math. Comp. 19 (1965) 577, with parameters in the units in which each does the same.
    """
    scaled = (np.diag(gram) + 1e-9) * step
    return np.outer(missed, scaled / float(scaled @ step))
