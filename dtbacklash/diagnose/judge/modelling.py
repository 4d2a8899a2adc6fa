"""What no name explains, as the rig has it: a table, or the formula that leaves no more than it, with their errors."""

from dataclasses import dataclass

import numpy as np

from dtbacklash.diagnose.fit.comparison import TOLD, lead
from dtbacklash.diagnose.fit.free import Key, with_errors
from dtbacklash.diagnose.fit.intervals import standard_errors
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.judge.families import formulas
from dtbacklash.diagnose.judge.stands import FORM
from dtbacklash.diagnose.judge.tables import Tabled, covariance_of_values, linearised, tabled
from dtbacklash.diagnose.named import Modelled
from dtbacklash.diagnose.search.model import Log, Model
from dtbacklash.diagnose.search.wrong_value import believed
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.drawing import drawing_of
from dtbacklash.physics.effects.table import SHAPES, table_of


@dataclass(frozen=True)
class Beyond:
    """A table that the model lacks, and the fit with it or with the formula in its place; what is said of it."""

    table: Tabled
    fitted: Fit
    said: Modelled


def beyond_names(model: Model, log: Log) -> Beyond | None:
    """What the names of a model do not explain, as a table or formula; None where none clearly leaves less."""
    evidence, table = model.evidence, tabled(model, log)
    if table is None:
        return None
    about = linearised(evidence, table.fitted)
    covariance = covariance_of_values(evidence, table, about)
    families, found = formulas(evidence, table, covariance)
    errors = found.errors if found else standard_errors(evidence, table.fitted, about)
    (place, name), fitted = (found.key, found.fitted) if found else (table.key, table.fitted)
    shape, (state_unit, unit) = SHAPES[table.key[1]], table.units
    columns = *table_of(table.values), np.sqrt(np.diag(covariance))
    points = tuple((float(s), float(f), float(e)) for s, f, e in zip(*columns, strict=True))
    said = Modelled(
        place, name, shape.over, state_unit, shape.times, unit, points,
        table.instead_of, families, "", with_errors(believed(fitted.rig, model.wrong_value), errors),
    )  # fmt: skip
    return Beyond(table, fitted, said)


def stood_in(model: Model, beyond: Beyond) -> list[Key]:
    """The names in whose place a table clearly leaves less: they only stood in for what the catalogue lacks.

    A name whose law has the table's form stays: such a table says no more than that the law is not the whole of it.
    """
    table = beyond.table
    if not lead(model.evidence, model.fitted, table.fitted, TOLD).clear:
        return []
    return [key for key in table.instead_of if not _has_its_form(model, table, key)]


def _has_its_form(model: Model, table: Tabled, key: Key) -> bool:
    """Whether the law of a name is the table's, but for a small part."""
    rig, shape = model.fitted.rig, SHAPES[table.key[1]]
    drawing, values = drawing_of(find(rig.kind_at(key[0]), key[1], key[0])), rig.effect(*key)
    if drawing is None or values is None or key[0] != table.key[0] or drawing.shape == "loop":
        return False
    if (drawing.state, drawing.times) != (shape.over, shape.times):
        return False
    knots, efforts = table_of(table.values)
    apart = drawing.effort(values, rig.elements[key[0]].values, knots) - efforts
    return float(apart @ apart) <= (1.0 - FORM) * float(efforts @ efforts)
