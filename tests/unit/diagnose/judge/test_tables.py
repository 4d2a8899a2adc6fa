"""A table in the rig for what no name explains, on recordings with a known answer."""

import numpy as np
import pytest
from ringing import blade, known, recorded

from dtbacklash.diagnose.data.candidates import candidates
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import all_free, nominal_free, with_errors, with_priors
from dtbacklash.diagnose.fit.intervals import NORMAL95
from dtbacklash.diagnose.fit.problem import Problem
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.judge.modelling import beyond_names, stood_in
from dtbacklash.diagnose.judge.tables import covariance_of_values, linearised, tabled
from dtbacklash.diagnose.search.leave_out import refit_with
from dtbacklash.diagnose.search.model import Log, Model, Named
from dtbacklash.physics import catalogue
from dtbacklash.physics.effects.table import KNOTS, VALUES, table_of, table_values

TABLE, STAND_IN = ("tip", "position_damping_table"), ("tip", "viscous_friction")
KNOTS_AT = np.linspace(-0.02, 0.02, KNOTS)


def damping(position):
    """A damping of the tip that grows with the square of its position, as an effort by speed."""
    return -1e4 * position**2


@pytest.fixture(scope="module")
def model():
    """A search that has named a damping of the ground, which only stands in for one that depends on the position."""
    rig = known(blade())
    truth = rig.with_effect(*TABLE, table_values(KNOTS_AT, damping(KNOTS_AT), 1.0))
    evidence = Evidence.gather(rig, [recorded(truth, 1, 6000)])
    nominal = fit(evidence, rig, nominal_free(rig))
    named = refit_with(evidence, nominal, [(STAND_IN, {"coefficient": 0.5})])
    return Model(evidence, nominal, named, (Named(STAND_IN),))


@pytest.fixture(scope="module")
def beyond(model):
    found = beyond_names(model, Log())
    yield found
    catalogue.withdraw([found.said.effect])  # other tests list the laws of the process


def test_the_table_is_found_in_the_place_of_what_stood_in_for_it(model, beyond):
    assert beyond.table.key == TABLE
    assert beyond.table.instead_of == (STAND_IN,)
    assert stood_in(model, beyond) == [STAND_IN]
    left = model.evidence.mean_square(beyond.table.fitted.residuals, "held")
    assert all(np.all(squares < 1.1) for squares in left.values())


def test_its_values_are_those_of_the_law_within_their_errors(model, beyond):
    knots, values = table_of(beyond.table.values)
    about = linearised(model.evidence, beyond.table.fitted)
    errors = np.sqrt(np.diag(covariance_of_values(model.evidence, beyond.table, about)))
    assert np.abs((values - damping(knots)) / errors).max() < 4.0
    assert np.std(values - damping(knots)) < 0.1 * np.std(damping(knots))


def test_a_formula_that_does_as_well_takes_its_place(beyond):
    said = beyond.said
    chosen = next(one for one in said.formulas if one.chosen)
    assert chosen.family in ("an even power", "a cubic polynomial")
    assert said.effect.startswith("found_")
    assert beyond.fitted.rig.effect("tip", said.effect) == pytest.approx(
        {n: v for n, (v, _, _) in chosen.parameters.items()}
    )
    power = next(one for one in said.formulas if one.family == "an even power")
    value, low, high = power.parameters["n"]
    assert abs(value - 2.0) < 3.0 * (high - low) / (2.0 * NORMAL95) < 0.3


def test_what_was_found_is_no_candidate_of_another_recording_nor_of_the_same_one_again(model, beyond):
    evidence = model.evidence
    listed = candidates(evidence.nominal, evidence.blocks, evidence.moving)
    assert ("tip", "viscous_friction") in {one.key for one in listed}
    assert not {one.key[1] for one in listed} & {beyond.said.effect, TABLE[1]}
    assert not [name for _, name in catalogue.CATALOGUE if name.startswith("tried_")]


def test_where_nothing_is_left_there_is_no_table():
    rig = known(blade())
    evidence = Evidence.gather(rig, [recorded(rig, 2, 6000)])
    nominal = fit(evidence, rig, nominal_free(rig))
    assert tabled(Model(evidence, nominal, nominal), Log()) is None


def test_a_table_that_hardly_may_bend_is_held_straight(model):
    evidence = model.evidence

    def bent(bend: float) -> float:
        start = [(TABLE, table_values(KNOTS_AT, damping(KNOTS_AT), bend))]
        _, values = table_of(refit_with(evidence, model.nominal, start).rig.effect(*TABLE))
        return float(np.abs(np.diff(values, 2)).max())

    assert bent(1e-4) < 0.05 * bent(100.0)


def test_what_holds_it_straight_is_no_data(model, beyond):
    free, x = all_free(model.evidence, beyond.table.fitted.rig)
    problem = Problem(model.evidence, beyond.table.fitted.rig, free)
    problem.weights = beyond.table.fitted.weights
    assert problem.priors == sum(f.prior for f in free) + KNOTS - 2
    rows = problem.stack(problem.residuals(x), x)
    assert rows[-problem.priors :].shape == (problem.priors,)


def test_in_the_next_diagnosis_its_values_are_known_and_its_knots_given(beyond):
    errors = {(*TABLE, name): 0.01 for name in VALUES}
    rig = with_priors(with_errors(beyond.table.fitted.rig, errors))
    names = {f.name for f in nominal_free(rig) if f.effect == TABLE[1]}
    assert names == set(VALUES)
