"""Families of formulas for a law that was found as a table, ranked by what they leave where the table was judged.

Each family is fitted to the table's values with their covariance (generalised least squares, ``curve_fit``); those that
come nearest, by the deviance and twice the number of parameters (Burnham and Anderson, Model Selection and Multimodel
Inference (2002), section 2.5), are refitted by simulation in the place of the table, as laws of one's own. The simplest
one that leaves no more than the table takes its place; what the recording cannot tell from the best one is a tie.
"""

import itertools
import re
import threading
import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import lead
from dtbacklash.diagnose.fit.free import Errors, Key, taken_out
from dtbacklash.diagnose.fit.intervals import NORMAL95, standard_errors
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import ON
from dtbacklash.diagnose.judge.tables import Tabled, price
from dtbacklash.diagnose.named import Formula
from dtbacklash.diagnose.search.leave_out import refit_with
from dtbacklash.errors import UserError
from dtbacklash.physics import catalogue, own_laws
from dtbacklash.physics.effects.declare import Values
from dtbacklash.physics.effects.formula import Formula as Checked
from dtbacklash.physics.effects.slots import plain_function
from dtbacklash.physics.effects.table import KNOTS, SHAPES, STATE, STATES, table_of, weights

#: so many of those that come nearest to a table are refitted by simulation
REFITTED = 3
#: the name of a found law, and of those that are tried: none twice in a process
FOUND, TRIED = "found_{}", "tried_{}"
_NUMBER, _NAMING = itertools.count(), threading.Lock()
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
    checked = Checked(family.written("stretch", "", STEP * reach), ["stretch"], names, "family")
    function = plain_function(checked.function())

    def at(states: Floats, *values: float) -> Floats:
        given = {**dict(zip(names, values, strict=True)), "stretch": states}
        with np.errstate(all="ignore"):
            found = np.broadcast_to(function(*(given[name] for name in checked.names)), states.shape)
        values_of_table: Floats = tabled @ np.nan_to_num(found, nan=1e30, posinf=1e30, neginf=-1e30)
        return values_of_table

    size = float(np.abs(efforts).max())
    low, high = np.array([_limits(what, reach) for what in family.parameters.values()]).T
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


def _limits(what: str, reach: float) -> tuple[float, float]:
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


@dataclass(frozen=True)
class Found:
    """A formula in the place of a table: where it acts and its name, the fit with it, and its errors."""

    key: Key
    fitted: Fit
    errors: Errors


def formulas(evidence: Evidence, table: Tabled, covariance: Floats) -> tuple[tuple[Formula, ...], Found | None]:
    """The families that come nearest to a table, the best first, and the one that takes its place, if one does.

    covariance : (KNOTS, KNOTS) of the table's values.
    """
    nearest = near(*table_of(table.values), covariance)[:REFITTED]
    names = {one: TRIED.format(next(_NUMBER)) for one in nearest}
    try:
        return _tried(evidence, table, names)
    finally:
        catalogue.withdraw(names.values())


def _tried(evidence: Evidence, table: Tabled, names: dict[Near, str]) -> tuple[tuple[Formula, ...], Found | None]:
    """The families as refitted under these names, and the one that takes the place of the table."""
    tried = [(one, _in_place(evidence, table, one, name)) for one, name in names.items()]
    made = sorted(((o, f) for o, f in tried if f is not None), key=lambda row: price(evidence, row[1]))
    behind = [lead(evidence, fitted, table.fitted) for _, fitted in made]
    tied = [one is made[0][0] or not lead(evidence, fitted, made[0][1]).clear for one, fitted in made]
    good = [row for row, far, alike in zip(made, behind, tied, strict=True) if alike and not far.clear]
    chosen = min(good, key=lambda row: len(row[0].values), default=None)
    found = _named(evidence, table, *chosen, names[chosen[0]]) if chosen else None
    rows = []
    for (one, fitted), far, alike in zip(made, behind, tied, strict=True):
        mine = found if chosen and one is chosen[0] else None
        rig, name = (mine.fitted.rig, mine.key[1]) if mine else (fitted.rig, names[one])
        rows.append(_formula(table, one, rig.effects[table.key[0]][name], mine, far.ratio, alike))
    return tuple(rows), found


def _in_place(evidence: Evidence, table: Tabled, one: Near, name: str) -> Fit | None:
    """The fit with a formula in the place of a table; None where no rig can have it."""
    place = table.key[0]
    try:
        catalogue.declare({name: declaration(table, one)}, "found", foreign=False)
        return refit_with(evidence, table.fitted, [((place, name), one.values)], table.key, ON)
    except UserError:
        return None


def declaration(table: Tabled, one: Near) -> dict[str, Any]:
    """A formula as a law of one's own, see ``docs/own_laws.md``."""
    kind, reach = table.fitted.rig.kind_at(table.key[0]), _reach(table)
    over_command = SHAPES[table.key[1]].over == "command"
    parameters: dict[str, Any] = {}
    for name, what in one.family.parameters.items():
        low, high = (float(np.clip(end, -own_laws.HIGH, own_laws.HIGH)) for end in _limits(what, reach))
        start = one.values[name] or 1e-12
        parameters[name] = {"low": low, "high": high, "start": float(np.clip(start, low, high))}
        if what.startswith("value"):
            parameters[name]["neutral"] = 0.0
        if unit := _unit(table, what):
            parameters[name]["unit"] = unit
    return {
        "acts_on": kind, "law": ("u + " if over_command else "") + _law(table, one), "parameters": parameters,
        "covers": {STATE[SHAPES[table.key[1]].over]: [table.values[STATES[0]], table.values[STATES[-1]]]},
        "source": "found in a recording", "sentence": f"{one.family.words.capitalize()} was found at the {{location}}.",
    }  # fmt: skip


def _law(table: Tabled, one: Near) -> str:
    """The formula of a family in the states of a table."""
    shape = SHAPES[table.key[1]]
    return one.family.written(STATE[shape.over], STATE.get(shape.times, ""), STEP * _reach(table))


def _reach(table: Tabled) -> float:
    """The range of a table's states."""
    return float(np.ptp(table_of(table.values)[0]))


def _unit(table: Tabled, what: str) -> str:
    """The unit of a parameter; empty for a number, and where it is a quotient with bars of its own."""
    state, value = table.units
    known = {"value": value, "state": state, "angle": "rad"}
    return known.get(what, "")


def _named(evidence: Evidence, table: Tabled, one: Near, fitted: Fit, tried: str) -> Found | None:
    """A formula under the name that it keeps, with its errors; None where the process has too many laws already."""
    said, place = declaration(table, one), table.key[0]
    with _NAMING:
        others = {n for (_, n), effect in list(catalogue.CATALOGUE.items()) if effect.declared != said}
        name = next(n for k in itertools.count(1) if (n := FOUND.format(k)) not in others)
        try:
            catalogue.declare({name: said}, "found", foreign=False)
        except UserError:
            return None
    rig = taken_out(fitted.rig, (place, tried)).with_effect(place, name, fitted.rig.effects[place][tried])
    renamed = replace(fitted, rig=rig)
    return Found((place, name), renamed, standard_errors(evidence, renamed))


def _formula(table: Tabled, one: Near, values: Values, found: Found | None, ratio: float, tied: bool) -> Formula:
    """What is said of a family: its values as refitted, with the refit's errors where it was chosen."""
    parameters = {}
    for p, value in values.items():
        error = found.errors.get((*found.key, p), np.nan) if found else one.errors[p]
        parameters[p] = value, value - NORMAL95 * error, value + NORMAL95 * error
    units = {p: unit for p, what in one.family.parameters.items() if (unit := _unit(table, what))}
    return Formula(one.family.words, _law(table, one), parameters, units, ratio, tied, found is not None)
