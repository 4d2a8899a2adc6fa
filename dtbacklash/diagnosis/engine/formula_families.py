"""Families of formulas for a law that was found as a table: how near each of them comes to its values.

Each is fitted to the values with their covariance (generalised least squares, ``curve_fit``), and ranked by the
deviance and twice the number of parameters (Burnham and Anderson, Model Selection and Multimodel Inference (2002),
section 2.5). Nothing here simulates: :mod:`.formula_fit` puts the nearest into the rig.
"""

import itertools
import re
import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.physics.effects.declare import Values
from dtbacklash.physics.effects.formula import Formula
from dtbacklash.physics.effects.table import KNOTS, weights

#: states between two knots at which a law and its table are compared
BETWEEN = 20
#: what is steeper than this share of the range of the states is a step
STEP = 0.01


@dataclass(frozen=True)
class Family:
    """A family of laws.

    law : its formula in ``s``, the state; ``STEP`` stands for a number. parameters : name -> what it is: ``value``
    (of the table), ``state``, ``exponent``, ``waves`` (rad per unit of the state), ``angle``, or ``value/state^n``.
    """

    words: str
    law: str
    parameters: dict[str, str]

    def written(self, state: str, times: str, step: float) -> str:
        """The formula in these states."""
        law = re.sub(r"\bs\b", state, self.law.replace("STEP", f"{step:.3g}"))
        return f"({law})*{times}" if times else law


FAMILIES = (
    Family("a constant", "a", {"a": "value"}),
    Family("a line", "a + b*s", {"a": "value", "b": "value/state"}),
    Family("a power", "a*sign(s)*abs(s)**n", {"a": "value/state^n", "n": "exponent"}),
    Family("an even power", "a + b*abs(s)**n", {"a": "value", "b": "value/state^n", "n": "exponent"}),
    Family("a cubic polynomial", "a + b*s + c*s**2 + d*s**3",
           {"a": "value", "b": "value/state", "c": "value/state^2", "d": "value/state^3"}),
    Family("Coulomb and viscous friction", "a*tanh(s/STEP) + b*s", {"a": "value", "b": "value/state"}),
    Family("Stribeck friction", "(a + b*exp(-(s/w)**2))*tanh(s/STEP) + c*s",
           {"a": "value", "b": "value", "w": "state", "c": "value/state"}),
    Family("a tanh", "a*tanh(s/w)", {"a": "value", "w": "state"}),
    Family("a saturation", "a*max(-1, min(1, s/w))", {"a": "value", "w": "state"}),
    Family("a dead zone", "a*(max(s - w, 0) + min(s + w, 0))", {"a": "value/state", "w": "state"}),
    Family("an exponential", "a + b*exp(min(n*s, 50))", {"a": "value", "b": "value", "n": "waves"}),
    Family("a sine", "a*sin(w*s + p)", {"a": "value", "w": "waves", "p": "angle"}),
    Family("a sine and its second harmonic", "a*sin(w*s + p) + b*sin(2*w*s + r)",
           {"a": "value", "b": "value", "w": "waves", "p": "angle", "r": "angle"}),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Near:
    """A family as it was fitted to a table: values and standard errors, and how far from it, with its parameters."""

    family: Family
    values: Values
    errors: Values
    score: float


def near(knots: Floats, efforts: Floats, covariance: Floats) -> list[Near]:
    """The families as they come nearest to (K,) values at (K,) states, with their (K, K) covariance; the best first."""
    grid = np.interp(np.linspace(0.0, KNOTS - 1.0, BETWEEN * (KNOTS - 1) + 1), np.arange(KNOTS), knots)
    # what a table makes of a law, corners and all: its values are those that come nearest between the knots, too
    tabled = np.asarray(np.linalg.pinv(weights(grid, knots)))
    fits = [found for family in FAMILIES if (found := _fitted(family, grid, tabled, efforts, covariance)) is not None]
    # a table is no straight truth itself: what the best of the families leaves is its scatter, too
    scatter = max(1.0, min((f.score / max(len(knots) - len(f.values), 1) for f in fits), default=1.0))
    ranked = [replace(f, score=f.score / scatter + 2.0 * len(f.values)) for f in fits]
    return sorted(ranked, key=lambda f: f.score)


def _fitted(family: Family, grid: Floats, tabled: Floats, efforts: Floats, covariance: Floats) -> Near | None:
    """The best fit of a family from several starts, its score the deviance; None where none ends.

    tabled : (KNOTS, G) the table that comes nearest to a law with these (G,) efforts on the (G,) states of ``grid``.
    """
    names, reach = list(family.parameters), float(np.ptp(grid))
    from scipy.optimize import OptimizeWarning, curve_fit

    checked = Formula(family.written("stretch", "", STEP * reach), ["stretch"], names, "family")
    function = checked.function()

    def at(states: Floats, *values: float) -> Floats:
        given = {**dict(zip(names, values, strict=True)), "stretch": states}
        with np.errstate(all="ignore"):
            found = np.broadcast_to(function(*(given[name] for name in checked.names)), states.shape)
        values_of_table: Floats = tabled @ np.nan_to_num(found, nan=1e30, posinf=1e30, neginf=-1e30)
        return values_of_table

    size = float(np.abs(efforts).max())
    low, high = np.array([limits_of(what, reach) for what in family.parameters.values()]).T
    best = None
    for start in _starts(family, reach, size):
        with suppress(RuntimeError, ValueError, np.linalg.LinAlgError), warnings.catch_warnings():
            warnings.simplefilter("ignore", OptimizeWarning)
            values, cov = curve_fit(at, grid, efforts, start, covariance, True, bounds=(low, high),
                                    method="trf", x_scale="jac")  # fmt: skip
            apart = efforts - at(grid, *values)
            score = float(apart @ np.linalg.solve(covariance, apart))
            if best is None or score < best.score:
                errors = np.sqrt(np.maximum(np.diag(cov), 0.0))
                found, scatter = (dict(zip(names, map(float, row), strict=True)) for row in (values, errors))
                best = Near(family, found, scatter, score)
    return best


def limits_of(what: str, reach: float) -> tuple[float, float]:
    """Where a parameter may lie."""
    known = {"state": (1e-3 * reach, 10.0 * reach), "exponent": (0.05, 8.0), "waves": (-200.0 / reach, 200.0 / reach),
             "angle": (-10.0, 10.0)}  # fmt: skip
    return known.get(what, (-np.inf, np.inf))


def _starts(family: Family, reach: float, size: float) -> Iterator[list[float]]:
    """Where fits of a family begin: both signs, and several scales of what is not linear."""
    kinds = set(family.parameters.values())
    scales = (0.05, 0.2, 0.6) if kinds & {"state", "waves"} else (0.2,)
    for sign, scale, power in itertools.product(
        (1.0, -1.0), scales, (0.5, 1.0, 2.0) if "exponent" in kinds else (1.0,)
    ):
        known = {"value": sign * size, "state": scale * reach, "exponent": power, "angle": 0.1,
                 "waves": 1.0 / (scale * reach), "value/state^n": sign * size / (0.5 * reach) ** power}  # fmt: skip
        yield [known.get(what, sign * size / reach ** int(what[-1] if what[-1].isdigit() else 1))
               for what in family.parameters.values()]  # fmt: skip
