"""Formulas for a law that was found as a table: which family comes nearest, and that one of them takes its place."""

from types import SimpleNamespace

import numpy as np
import pytest
from nominal import nominal_rig
from reference import rigs

from dtbacklash.diagnosis.engine.formula_families import FAMILIES, Near, near
from dtbacklash.diagnosis.engine.formula_fit import TRIED, Table, Trial, _chosen, margin, modelled
from dtbacklash.diagnosis.engine.selection import StepwiseSelection
from dtbacklash.errors import UserError
from dtbacklash.physics import catalogue
from dtbacklash.physics.effects.formula import SHORT
from dtbacklash.physics.effects.table import KNOTS, table_values, weights

from .conftest import command, recorded, segments_of

KNOTS_AT = np.sort(np.concatenate([np.linspace(-2.0, 2.0, KNOTS // 2), np.linspace(-0.7, 0.8, KNOTS // 2)]))
#: family -> a law of it over a state from -2 to 2
LAWS = {
    "a constant": lambda s: 3.0 + 0.0 * s,
    "a line": lambda s: 1.0 - 2.0 * s,
    "a power": lambda s: -0.7 * np.sign(s) * np.abs(s) ** 1.9,
    "an even power": lambda s: 0.2 + 0.5 * np.abs(s) ** 1.2,
    "a cubic polynomial": lambda s: 0.5 - s + 0.4 * s**2 + 0.8 * s**3,
    "Stribeck friction": lambda s: -(1.0 + 0.8 * np.exp(-((s / 0.4) ** 2))) * np.tanh(s / 0.04) - 0.1 * s,
    "a tanh": lambda s: 2.0 * np.tanh(s / 0.6),
    "a saturation": lambda s: 2.0 * np.clip(s / 0.9, -1.0, 1.0),
    "a dead zone": lambda s: 2.0 * (np.maximum(s - 0.5, 0.0) + np.minimum(s + 0.5, 0.0)),
    "an exponential": lambda s: 0.3 + 0.2 * np.exp(1.5 * s),
    "a sine": lambda s: 1.3 * np.sin(3.0 * s + 0.4),
}


@pytest.mark.parametrize("family", LAWS)
def test_the_true_family_comes_nearest_or_nearly_so(family):
    grid, scatter = np.linspace(-2.0, 2.0, 401), 0.01
    nearest = np.linalg.lstsq(weights(grid, KNOTS_AT), LAWS[family](grid))[0]
    efforts = nearest + scatter * np.random.default_rng(4).standard_normal(KNOTS)
    ranked = near(KNOTS_AT, efforts, scatter**2 * np.eye(KNOTS))
    scores = {one.family.words: one.score for one in ranked}
    assert scores[family] < min(scores.values()) + 4.0
    assert list(scores.values()) == sorted(scores.values())


def test_the_exponent_and_its_error_are_those_of_the_law():
    efforts = LAWS["a power"](KNOTS_AT) + 0.01 * np.random.default_rng(5).standard_normal(KNOTS)
    best = next(one for one in near(KNOTS_AT, efforts, 1e-4 * np.eye(KNOTS)) if one.family.words == "a power")
    assert best.values["n"] == pytest.approx(1.9, abs=3.0 * best.errors["n"])
    assert 0.0 < best.errors["n"] < 0.1


def test_what_the_recording_does_not_tell_costs_a_family_nothing():
    """A stiffness that is not known hides how far a table of the stretch leans: a power that leans fits as well."""
    blind = 1e4 * np.outer(KNOTS_AT, KNOTS_AT)
    efforts = LAWS["a power"](KNOTS_AT) + 5.0 * KNOTS_AT + 0.01 * np.random.default_rng(6).standard_normal(KNOTS)
    assert near(KNOTS_AT, efforts, 1e-4 * np.eye(KNOTS) + blind)[0].family.words in ("a power", "a cubic polynomial")
    assert near(KNOTS_AT, efforts, 1e-4 * np.eye(KNOTS))[0].family.words != "a power"


#: each kind of table once, and each family at the last one
TABLES = [
    ("motor_bearing", "position_damping_table"), ("link_1", "stretch_table"), ("link_1", "rate_stiffness_table"),
    ("amplifier", "command_table"), ("motor_bearing", "speed_table"),
]  # fmt: skip
IN_TABLES = [(FAMILIES[-1], *table) for table in TABLES] + [(one, *TABLES[-1]) for one in FAMILIES[:-1]]


@pytest.mark.parametrize(("family", "place", "table"), IN_TABLES)
def test_each_family_is_a_law_of_ones_own(family, place, table):
    assert not {*family.parameters} & {*SHORT, *SHORT.values()}
    rig = rigs.lead_screw().with_effect(place, table, table_values(KNOTS_AT, KNOTS_AT**2, 1.0))
    found = Table(rig, (place, table))
    one = Near(family, dict.fromkeys(family.parameters, 0.5), {}, 0.0)
    name = TRIED.format(0)
    try:
        catalogue.declare({name: found.declaration(one)}, "found", foreign=False)
        assert catalogue.is_found(catalogue.find(rig.kind_at(place), name, "rig"))  # no other recording is asked for it
        with_it = rig.with_effect(place, name, one.values)
        assert with_it.effect(place, name) == pytest.approx(one.values)
    finally:
        catalogue.withdraw([name])
    with pytest.raises(UserError, match=name):
        catalogue.find(rig.kind_at(place), name, "rig")


@pytest.fixture(scope="module")
def root_drag():
    """A search on a pendulum whose drag is 0.05 N m times the square root of its speed, and what came of its table."""
    before = dict(catalogue.CATALOGUE)
    law = {"acts_on": "rotor", "law": "-drag*sign(v)*sqrt(abs(v))", "parameters": {"drag": {"start": 0.1}}}
    catalogue.declare({"root_drag": law}, "test", foreign=False)
    rig, u = nominal_rig("pendulum"), command(20.0, 3.0)
    y = recorded(rig.with_effect("disk", "root_drag", {"drag": 0.05}), u)
    catalogue.withdraw(["root_drag"])  # a law that the catalogue does not have
    try:
        search = StepwiseSelection(segments_of(rig, u, y))
        table = search.run()
        yield search, table, *modelled(search, table, ("disk", "speed_table"), (("disk", "viscous_friction"),))
    finally:
        for key in set(catalogue.CATALOGUE) - set(before):
            del catalogue.CATALOGUE[key]


@pytest.mark.check
def test_a_square_root_is_found_as_a_table_and_named_as_a_power(root_drag):
    search, table, model, said = root_drag
    assert table.keys == (("disk", "speed_table"),)
    assert model.keys == (("disk", said.effect),)
    assert said.effect.startswith("found_")
    assert model.score < table.score
    assert search.unknown(model) < 0.01 * search.unknown(search.nothing)
    found = model.rig.effects["disk"][said.effect]
    assert found["n"] == pytest.approx(0.5, abs=0.005)
    # torques are known as well as the drive's constant: all of them may grow alike
    alike = model.rig.config.parameters["K_t"].value / search.segments.nominal.config.parameters["K_t"].value
    assert found["a"] == pytest.approx(-0.05 * alike, rel=0.01)


@pytest.mark.check
def test_what_is_said_of_a_square_root(root_drag):
    _, _, model, said = root_drag
    best = said.formulas[0]
    assert (best.family, best.chosen, best.tied, best.left < 1.0) == ("a power", True, True, True)
    assert sum(one.chosen for one in said.formulas) == 1
    assert [one.left for one in said.formulas] == sorted(one.left for one in said.formulas)
    low, high = best.parameters["n"][1:]
    assert low < 0.5 < high < low + 0.02
    assert (said.location, said.state, said.state_unit, said.times, said.unit) == ("disk", "speed", "rad/s", "", "N m")
    assert said.instead_of == (("disk", "viscous_friction"),)
    states, efforts, errors = np.array(said.points).T
    apart = (efforts + 0.05 * np.sign(states) * np.sqrt(np.abs(states)))[np.abs(states) < 10.0]
    # between the knots about the rest a table cannot be as steep
    assert np.abs(apart).max() < 0.01
    assert np.all(errors > 0.0)
    # the rig is ready to be the next nominal one
    assert 0.0 < said.rig.tolerances["disk"][said.effect]["n"] < 0.05
    assert said.rig.effects == model.rig.effects


@pytest.mark.check
def test_laws_that_were_only_tried_are_forgotten(root_drag):
    search, _, _, said = root_drag
    names = {name for _, name in catalogue.CATALOGUE}
    assert said.effect in names
    assert not [name for name in names if name.startswith(TRIED.format(""))]
    assert not [keys for keys in search.tried if any(name.startswith(TRIED.format("")) for _, name in keys)]


def trial(parameters: int, score: float, at_end: bool = False) -> Trial:
    """A family with so many parameters in the place of a table."""
    one = Near(FAMILIES[0], dict.fromkeys(map(str, range(parameters)), 1.0), {}, 0.0)
    return Trial(one, "", SimpleNamespace(score=score, at_end=at_end))


@pytest.mark.parametrize(("scores", "chosen"), [
    ([(3, 0.0), (2, 15.0), (1, 25.0)], 1),  # the simplest that is tied, whatever another does
    ([(2, -80.0), (1, -50.0)], 0),  # better than the table, yet not tied with the best
    ([(2, 19.0)], 0),  # no worse than the table
    ([(2, 21.0)], None), ([], None),
    ([(3, 0.0, True), (2, 1.0)], 1),  # a value that the data did not choose
])  # fmt: skip
def test_the_simplest_formula_that_is_tied_takes_the_tables_place(scores, chosen):
    search = SimpleNamespace(
        segments=SimpleNamespace(count=10_000), rules=SimpleNamespace(tie_ratio=0.1, min_gain=0.02)
    )
    assert margin(search) == pytest.approx(20.0)
    trials = [trial(*one) for one in scores]
    assert _chosen(search, SimpleNamespace(score=0.0), trials) is (None if chosen is None else trials[chosen])


def test_on_a_short_recording_two_parameters_are_a_tie():
    search = SimpleNamespace(segments=SimpleNamespace(count=1000), rules=SimpleNamespace(tie_ratio=0.1, min_gain=0.02))
    assert margin(search) == pytest.approx(2.0 * np.log(1000))
