"""Model what no law explains: the effort that is missing becomes a table in the rig, refitted with everything else.

Efforts of free form say where to begin: over each state that a table of a place may be over, of what the model leaves,
and of what it leaves without each of its names, since a name may only stand in for what the catalogue lacks. The best
of these are refitted by simulation, held back by a penalty on how far a table bends, whose weight is chosen by
cross-validation of the linearised fit (Stone, J. R. Stat. Soc. B 36 (1974) 111). What chooses is the fitted part; the
part that judges sees one table, and has to be left clearly less of by it.
"""

from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import lead, parameters_of
from dtbacklash.diagnose.fit.free import Key, all_free
from dtbacklash.diagnose.fit.intervals import ERROR_GROUPS_MIN, Linear, covariance_of
from dtbacklash.diagnose.fit.problem import Fit, Problem
from dtbacklash.diagnose.fit.refit import FULL, ON, QUICK, objective
from dtbacklash.diagnose.judge.free_form import LOCATED_SHARE, Recovered, free_forms
from dtbacklash.diagnose.search.leave_out import borne, fit_without, refit_with
from dtbacklash.diagnose.search.model import Log, Model
from dtbacklash.diagnose.spread import spread
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import effects_of, find
from dtbacklash.physics.effects.declare import Values
from dtbacklash.physics.effects.table import KNOTS, SHAPES, Shape, table_of, table_values

#: efforts of free form that are refitted as tables: of what is left, and of what is left without each name
TRIED = 2
#: how far a table may bend, in its largest value: nearly straight, to a corner at each knot
BENDS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
#: before it is chosen
BEND = 30.0
#: the groups of stretches that take turns in judging how far it may bend
FOLDS = 4


@dataclass(frozen=True)
class Tabled:
    """A table in the rig: where and which, the fit with it, and the names whose place it takes."""

    key: Key
    fitted: Fit
    instead_of: tuple[Key, ...]
    form: Recovered

    @property
    def values(self) -> Values:
        """Of the table."""
        return self.fitted.rig.effects[self.key[0]][self.key[1]]

    @property
    def units(self) -> tuple[str, str]:
        """Of its state and of its values."""
        entry = find(self.fitted.rig.kind_at(self.key[0]), self.key[1], self.key[0])
        return entry.parameters[KNOTS].unit, entry.size.unit


def tabled(model: Model, log: Log) -> Tabled | None:
    """The table that leaves least, beside what is named or instead of it; None where none clearly leaves less."""
    evidence = model.evidence
    starts = [start for base in _bases(model, log) for start in _starts(evidence, *base)]
    quick = [t for t in spread(lambda start: _quickly_fitted(evidence, *start), starts) if t is not None]
    if not quick:
        return None
    best = _held_back(evidence, min(quick, key=lambda t: price(evidence, t.fitted)))
    best = _without_idle_names(model, best)
    proven = replace(best.form, proven=True, effort_unit=best.units[1])
    return replace(best, form=proven) if lead(evidence, model.fitted, best.fitted).clear else None


def _without_idle_names(model: Model, table: Tabled) -> Tabled:
    """The table beside those names only without which the rest leaves clearly more."""
    for key in [k for k in model.keys if k not in table.instead_of and not borne(model, k)]:
        without = refit_with(model.evidence, table.fitted, [], key, ON)
        if not lead(model.evidence, without, table.fitted, part="used").clear:
            table = replace(table, fitted=without, instead_of=(*table.instead_of, key))
    return table


def _bases(model: Model, log: Log) -> list[tuple[tuple[Key, ...], Fit]]:
    """The model's fit, and those without each of its names and without all of them: (names that are gone, fit)."""
    bases: list[tuple[tuple[Key, ...], Fit]] = [((), model.fitted)]
    if len(model.keys) > 1:
        bases += [((key,), fit_without(model, log, key)) for key in model.keys if not borne(model, key)]
    return [*bases, (model.keys, model.nominal)] if model.keys else bases


def _starts(evidence: Evidence, gone: tuple[Key, ...], base: Fit) -> list[tuple[tuple[Key, ...], Fit, Recovered]]:
    """The efforts of free form that explain most of what a fit leaves, each over what a table may be over."""
    forms = [f for f in free_forms(evidence, base, tables=True) if f.share >= LOCATED_SHARE]
    new = [f for f in forms if base.rig.effect(*_key(base, f)) is None]
    return [(gone, base, form) for form in sorted(new, key=lambda f: -f.share)[:TRIED]]


def _key(base: Fit, form: Recovered) -> Key:
    """The table over the states of an effort of free form."""
    here = effects_of(base.rig.kind_at(form.place))
    names = [n for n, effect in here.items() if effect.is_table and SHAPES[n] == Shape(form.state, form.times)]
    return form.place, names[0]


def _quickly_fitted(evidence: Evidence, gone: tuple[Key, ...], base: Fit, form: Recovered) -> Tabled | None:
    """The table that begins as an effort of free form, fitted quickly; None where no rig can have it."""
    at = np.linspace(0.0, len(form.knots) - 1.0, KNOTS)
    knots = np.interp(at, np.arange(len(form.knots)), form.knots)
    efforts, key = np.interp(knots, form.knots, form.effort), _key(base, form)
    values = table_values(knots, efforts, BEND * float(np.abs(efforts).max()))
    try:
        return Tabled(key, refit_with(evidence, base, [(key, values)], rounds=QUICK), gone, form)
    except UserError:
        return None


def price(evidence: Evidence, fitted: Fit) -> float:
    """Minus twice the log-likelihood of the fitted part, with the priors, and with what parameters cost (Akaike)."""
    return objective(evidence, fitted) + 2.0 * parameters_of(evidence, fitted)


def _held_back(evidence: Evidence, table: Tabled) -> Tabled:
    """The table, fitted in full, and once more with the bend that cross-validation chooses."""
    fitted = refit_with(evidence, table.fitted, [(table.key, table.values)], rounds=FULL)
    knots, efforts = table_of(fitted.rig.effects[table.key[0]][table.key[1]])
    values = table_values(knots, efforts, _bend(evidence, fitted, table.key))
    fitted = refit_with(evidence, fitted, [(table.key, values)], rounds=ON)
    return replace(table, fitted=fitted)


def linearised(evidence: Evidence, fitted: Fit) -> Linear:
    """A fit's problem, linearised at its end by one difference for each parameter: a table is linear in its values."""
    free, x = all_free(evidence, fitted.rig)
    problem = Problem(evidence, fitted.rig, free)
    problem.weights = fitted.weights
    problem.finely()
    return Linear(problem, x, np.nan_to_num(problem.differences(x)), problem.stack(problem.residuals(x), x))


def covariance_of_values(evidence: Evidence, table: Tabled, about: Linear) -> Floats:
    """(KNOTS, KNOTS) covariance of a table's values."""
    free = about.problem.free
    here = [j for j, f in enumerate(free) if (f.place, f.effect) == table.key]
    scales = np.array([free[j].scale for j in here])
    covariance: Floats = covariance_of(evidence, about)[np.ix_(here, here)] * np.outer(scales, scales)
    return covariance


def _bend(evidence: Evidence, fitted: Fit, key: Key) -> float:
    """How far a table may bend: what leaves least of stretches that the linearised fit has not seen."""
    about = linearised(evidence, fitted)
    problem, rows, jacobian = about.problem, about.rows, about.jacobian
    data, priors = len(rows) - problem.priors, int(problem.prior.sum())
    grams, sides, squares = _by_group(evidence, jacobian[:data], rows[:data])
    values = fitted.rig.effects[key[0]][key[1]]
    size = float(np.abs(table_of(values)[1]).max())
    left = []
    for bend in BENDS:
        wide = np.ones(problem.priors)
        wide[priors:] = values["bend"] / (bend * size)
        fixed, offset = jacobian[data:] * wide[:, None], rows[data:] * wide
        total = 0.0
        for fold in range(FOLDS):
            seen = np.arange(len(grams)) % FOLDS != fold
            step = -_solved(grams[seen].sum(axis=0) + fixed.T @ fixed, sides[seen].sum(axis=0) + fixed.T @ offset)
            total += float(np.sum(squares[~seen] + 2.0 * sides[~seen] @ step + (grams[~seen] @ step) @ step))
        left.append(total)
    return size * BENDS[int(np.argmin(left))]


def _solved(gram: Floats, side: Floats) -> Floats:
    """The least solution of the normal equations, whose columns differ by many decades; 0 along what nothing shows."""
    norms = np.sqrt(np.diag(gram))
    norms = np.where(norms > 0.0, norms, 1.0)
    scaled: Floats = np.linalg.lstsq(gram / np.outer(norms, norms), side / norms, rcond=1e-12)[0]
    return scaled / norms


def _by_group(evidence: Evidence, jacobian: Floats, rows: Floats) -> tuple[Floats, Floats, Floats]:
    """Per group of stretches: (groups, free, free) J'J, (groups, free) J'r, and (groups,) r'r."""
    samples = sum(int(r.train.sum()) for r in evidence.records)
    length = max(2, samples // (FOLDS * ERROR_GROUPS_MIN))
    j, r = jacobian.reshape(-1, samples, jacobian.shape[1]), rows.reshape(-1, samples)
    grams, sides, squares = [], [], []
    for first in range(0, samples // length * length, length):
        at, left = j[:, first : first + length].reshape(-1, j.shape[2]), r[:, first : first + length].ravel()
        grams.append(at.T @ at)
        sides.append(at.T @ left)
        squares.append(left @ left)
    return np.array(grams), np.array(sides), np.array(squares)
