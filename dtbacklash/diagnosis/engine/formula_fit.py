"""What no name explains, as the rig has it: the table that a search has found, or a formula in its place.

The families that come nearest to the table (:mod:`.formula_families`) are put in its place as laws of one's own and
refitted by the exact predictor. All are compared with the table and with one another by the score of
:class:`.fit.FittedModel`.
"""

import itertools
import math
import threading
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dtbacklash.diagnosis.engine.fit import FittedModel
from dtbacklash.diagnosis.engine.formula_families import STEP, Near, limits_of, near
from dtbacklash.diagnosis.engine.intervals import NORMAL95, polished
from dtbacklash.diagnosis.engine.parameters import Errors, Key, taken_out, with_errors
from dtbacklash.diagnosis.engine.selection import StepwiseSelection
from dtbacklash.diagnosis.findings import Formula, Modelled
from dtbacklash.errors import UserError
from dtbacklash.physics import catalogue, user_laws
from dtbacklash.physics.effects.declare import Values
from dtbacklash.physics.effects.table import KNOTS, SHAPES, STATE, STATES, table_of
from dtbacklash.physics.rig import Rig

#: so many of those that come nearest to a table are refitted in its place
REFITTED = 3
#: a refit's shares of the sizes, and its steps at each
RUNGS, STEPS = (1.0, 0.1, 1.0), 5
#: the name of a found law, and of those that are tried: none twice in a process
FOUND, TRIED = "found_{}", "tried_{}"
_NUMBER, _NAMING = itertools.count(), threading.Lock()


@dataclass(frozen=True)
class Table:
    """A table of a rig: where and which."""

    rig: Rig
    key: Key

    @property
    def values(self) -> Values:
        """Its parameters."""
        return self.rig.effects[self.key[0]][self.key[1]]

    @property
    def units(self) -> tuple[str, str]:
        """Of its state and of its values."""
        entry = catalogue.find(self.rig.kind_at(self.key[0]), self.key[1], self.key[0])
        return entry.parameters[KNOTS].unit, entry.size.unit

    @property
    def reach(self) -> float:
        """The range of its states."""
        return float(np.ptp(table_of(self.values)[0]))

    def law(self, one: Near) -> str:
        """The formula of a family in its states."""
        shape = SHAPES[self.key[1]]
        return one.family.written(STATE[shape.over], STATE.get(shape.times, ""), STEP * self.reach)

    def unit(self, what: str) -> str:
        """The unit of a family's parameter; empty for a number, and for a quotient with bars of its own."""
        state, value = self.units
        return {"value": value, "state": state, "angle": "rad"}.get(what, "")

    def declaration(self, one: Near) -> dict[str, Any]:
        """A formula in its place as a law of one's own, see ``docs/own_laws.md``."""
        over = SHAPES[self.key[1]].over
        parameters: dict[str, Any] = {}
        for name, what in one.family.parameters.items():
            low, high = (float(np.clip(end, -user_laws.HIGH, user_laws.HIGH)) for end in limits_of(what, self.reach))
            start = one.values[name] or 1e-12
            parameters[name] = {"low": low, "high": high, "start": float(np.clip(start, low, high))}
            if what.startswith("value"):
                parameters[name]["neutral"] = 0.0
            if unit := self.unit(what):
                parameters[name]["unit"] = unit
        return {
            "acts_on": self.rig.kind_at(self.key[0]), "law": ("u + " if over == "command" else "") + self.law(one),
            "parameters": parameters, "covers": {STATE[over]: [self.values[STATES[0]], self.values[STATES[-1]]]},
            "source": "found in a recording",
            "sentence": f"{one.family.words.capitalize()} was found at the {{location}}.",
        }  # fmt: skip


@dataclass(frozen=True)
class Trial:
    """A family in the place of a table: as it came near to it, the name it was tried under, and the fit with it."""

    near: Near
    name: str
    model: FittedModel


def modelled(
    search: StepwiseSelection, model: FittedModel, table: Key, instead_of: tuple[Key, ...] = ()
) -> tuple[FittedModel, Modelled]:
    """The model with what no name explains, a table or the formula that takes its place, and what is said of it.

    instead_of : the names that the rig does without since the table leaves less. A formula takes the table's place if
    its score is within :func:`margin` of the table's and of the best formula's; of several the one with the fewest
    parameters. It is then ``found_1`` (or the next number that is free in the process) in the rig.
    """
    model, of_table = polished(search.segments, search.motion, model)
    at = Table(model.rig, table)
    knots, efforts = table_of(at.values)
    covariance = of_table.of_table(table)
    nearest = near(knots, efforts, covariance)[:REFITTED] if np.isfinite(covariance).all() else []
    names = {one: TRIED.format(next(_NUMBER)) for one in nearest}
    try:
        trials = [trial for one, name in names.items() if (trial := _in_place(search, model, at, one, name))]
        trials.sort(key=lambda trial: trial.model.score)
        chosen = _chosen(search, model, trials)
        found, errors = _named(at, chosen) if chosen else None, of_table.errors
        if found:
            found, of_formula = polished(search.segments, search.motion, found)
            errors = of_formula.errors
        formulas = tuple(
            _formula(search, model, at, t, trials[0], found if t is chosen else None, errors) for t in trials
        )
    finally:
        catalogue.withdraw(names.values())
        _forget(search, set(names.values()))
    now = found or model
    effect = next(key for key in now.keys if key not in model.keys)[1] if found else table[1]
    shape, (state_unit, unit) = SHAPES[table[1]], at.units
    points = np.column_stack([knots, efforts, np.sqrt(np.maximum(np.diag(covariance), 0.0))])
    return now, Modelled(
        table[0], effect, shape.over, state_unit, shape.times, unit, tuple((s, f, e) for s, f, e in points.tolist()),
        instead_of, formulas, "", with_errors(now.rig, errors, recording=search.segments.recordings[-1]),
    )  # fmt: skip


def margin(search: StepwiseSelection) -> float:
    """Scores that differ by less are tied: a tenth of what a name has to earn, or two parameters' cost if that is more.

    On a short recording a share of the readings comes to less than what one parameter costs, and a family with one
    more would win or lose by chance: 2 log N is a ratio of the evidence of N, which is beyond doubt for all that is
    recorded here (Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773).
    """
    count, rules = search.segments.count, search.rules
    return max(rules.tie_ratio * rules.min_gain * count, 2.0 * math.log(count))


def _in_place(search: StepwiseSelection, model: FittedModel, table: Table, one: Near, name: str) -> Trial | None:
    """A family in the place of a table, fitted with all else; None where no rig can have it, or it comes to nothing."""
    place = table.key[0]
    try:
        catalogue.declare({name: table.declaration(one)}, "found", foreign=False)
        rig = taken_out(model.rig, table.key).with_effect(place, name, one.values)
        keys = [(place, name) if key == table.key else key for key in model.keys]
        fitted = search.fitted(rig, model, keys, RUNGS, STEPS)
    except UserError:
        return None
    if fitted is None or fitted.rig.effect(place, name) is None:
        return None
    return Trial(one, name, fitted)


def _chosen(search: StepwiseSelection, model: FittedModel, trials: list[Trial]) -> Trial | None:
    """The simplest of those that are tied with the best and no worse than the table, chosen by the data throughout."""
    within = margin(search)
    good = [t for t in trials if not t.model.at_end and t.model.score <= model.score + within]
    if not good:
        return None
    tied = [t for t in good if t.model.score <= good[0].model.score + within]
    return min(tied, key=lambda t: (len(t.near.values), t.model.score))


def _named(table: Table, trial: Trial) -> FittedModel | None:
    """The model with a formula under the name that it keeps; None where the process has too many laws already."""
    said, place = table.declaration(trial.near), table.key[0]
    with _NAMING:
        others = {n for (_, n), effect in list(catalogue.CATALOGUE.items()) if effect.declared != said}
        name = next(n for k in itertools.count(1) if (n := FOUND.format(k)) not in others)
        try:
            catalogue.declare({name: said}, "found", foreign=False)
        except UserError:
            return None
    tried, model = (place, trial.name), trial.model
    rig = taken_out(model.rig, tried).with_effect(place, name, model.rig.effects[place][trial.name])
    keys = tuple((place, name) if key == tried else key for key in model.keys)
    free = tuple(replace(f, effect=name) if f.key == tried else f for f in model.free)
    return replace(model, rig=rig, keys=keys, free=free)


def _formula(
    search: StepwiseSelection,
    model: FittedModel,
    table: Table,
    trial: Trial,
    best: Trial,
    found: FittedModel | None,
    errors: Errors,
) -> Formula:
    """What is said of a family: its values as refitted, with the errors of the refit where it was chosen.

    ``left`` is the ratio of the rms of predicted innovations that would make the difference of the two scores alone,
    exp((score - the table's) / 2 N): 1 is as good as the table, and a hundredth more is 2 % of N in the score.
    """
    place, name = table.key[0], trial.name
    new = next(key for key in found.keys if key not in model.keys)[1] if found else ""
    parameters = {}
    refitted = found.rig.effects[place][new] if found else trial.model.rig.effects[place][name]
    for p, value in refitted.items():
        error = errors.get((place, new, p), math.nan) if found else trial.near.errors[p]
        parameters[p] = value, value - NORMAL95 * error, value + NORMAL95 * error
    kinds = trial.near.family.parameters
    units = {p: unit for p, what in kinds.items() if (unit := table.unit(what))}
    left = math.exp(min((trial.model.score - model.score) / (2.0 * search.segments.count), 50.0))
    tied = bool(trial.model.score <= best.model.score + margin(search))
    return Formula(trial.near.family.words, table.law(trial.near), parameters, units, left, tied, found is not None)


def _forget(search: StepwiseSelection, names: set[str]) -> None:
    """Scores of laws that were only tried: there is no rig with them any more."""
    for keys in [keys for keys in search.tried if any(effect in names for _, effect in keys)]:
        del search.tried[keys]
