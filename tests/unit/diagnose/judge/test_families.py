"""Formulas for a law that was found as a table: which family comes nearest, and that each is a law of one's own."""

from types import SimpleNamespace

import numpy as np
import pytest
from reference import rigs

from dtbacklash.diagnose.judge.families import FAMILIES, TRIED, Near, declaration, near
from dtbacklash.diagnose.judge.tables import Tabled
from dtbacklash.errors import UserError
from dtbacklash.physics import catalogue
from dtbacklash.physics.effects.formula import SHORT
from dtbacklash.physics.effects.table import KNOTS, table_values, weights

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


@pytest.mark.parametrize("family", FAMILIES, ids=lambda one: one.words)
def test_no_parameter_of_a_family_hides_a_state(family):
    assert not {*family.parameters} & {*SHORT, *SHORT.values()}


@pytest.mark.parametrize("family", FAMILIES, ids=lambda one: one.words)
@pytest.mark.parametrize(("place", "table"), [
    ("motor_bearing", "speed_table"), ("motor_bearing", "position_damping_table"), ("link_1", "stretch_table"),
    ("link_1", "rate_stiffness_table"), ("amplifier", "command_table"),
])  # fmt: skip
def test_each_family_is_a_law_of_ones_own(family, place, table):
    rig = rigs.lead_screw().with_effect(place, table, table_values(KNOTS_AT, KNOTS_AT**2, 1.0))
    found = Tabled((place, table), SimpleNamespace(rig=rig), (), None)
    one = Near(family, dict.fromkeys(family.parameters, 0.5), {}, 0.0)
    name = TRIED.format(0)
    try:
        catalogue.declare({name: declaration(found, one)}, "found", foreign=False)
        assert catalogue.is_found(catalogue.find(rig.kind_at(place), name, "rig"))  # no other recording is asked for it
        with_it = rig.with_effect(place, name, one.values)
        assert with_it.effect(place, name) == pytest.approx(one.values)
    finally:
        catalogue.withdraw([name])
    with pytest.raises(UserError, match=name):
        catalogue.find(rig.kind_at(place), name, "rig")
