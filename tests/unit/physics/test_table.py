"""A law as a table: interpolation, what it refuses, and that it acts as the law that it was taken from."""

from dataclasses import replace

import numpy as np
import pytest
from reference import rigs
from told import refused

from dtbacklash.config.rig import ParameterConfig
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.drawing import drawing_of, law_curve
from dtbacklash.physics.effects.table import KNOTS, SHAPES, bends, interpolated, table_of, table_values, weights
from dtbacklash.physics.rig import build_rig
from dtbacklash.physics.rig_file import rig_content, rig_of
from dtbacklash.physics.simulate import simulate

KNOTS_AT = np.array([-2.0, -1.7, -1.2, -0.6, -0.3, -0.1, 0.0, 0.1, 0.4, 0.9, 1.3, 1.8, 2.5, 2.9, 3.5, 4.0])
FINE = np.linspace(-2.0, 4.0, 301)


def at(state, efforts, knots=KNOTS_AT):
    return interpolated(state, [*efforts, *knots])


def test_a_table_passes_through_its_knots_and_is_constant_beyond():
    efforts = np.random.default_rng(1).standard_normal(KNOTS)
    assert [at(s, efforts) for s in KNOTS_AT] == pytest.approx(efforts, abs=1e-12)
    for beyond, end in ((-3.0, efforts[0]), (5.0, efforts[-1]), (-np.inf, efforts[0]), (np.inf, efforts[-1])):
        assert at(beyond, efforts) == end
    assert at(np.nan, efforts) == efforts[0]


def test_a_table_of_a_line_is_the_line_and_of_a_parabola_inside_the_parabola():
    assert [at(s, 3.0 * KNOTS_AT - 1.0) for s in FINE] == pytest.approx(3.0 * FINE - 1.0, abs=1e-12)
    inner = FINE[(KNOTS_AT[1] < FINE) & (KNOTS_AT[-2] > FINE)]
    assert [at(s, KNOTS_AT**2) for s in inner] == pytest.approx(inner**2, abs=1e-9)


def test_the_weights_of_the_knots_add_up_to_the_table():
    efforts, states = np.random.default_rng(2).standard_normal(KNOTS), np.linspace(-3.0, 5.0, 57)
    assert weights(states, KNOTS_AT) @ efforts == pytest.approx([at(s, efforts) for s in states], abs=1e-12)


def test_a_line_does_not_bend_and_a_parabola_bends_by_its_second_derivative():
    assert bends(KNOTS_AT) @ (3.0 * KNOTS_AT - 1.0) == pytest.approx(0.0, abs=1e-9)
    inner = 0.5 * (KNOTS_AT[-1] + KNOTS_AT[-2] - KNOTS_AT[0] - KNOTS_AT[1])
    assert np.sum((bends(KNOTS_AT) @ KNOTS_AT**2) ** 2) == pytest.approx(4.0 * inner * 6.0**3)


def test_a_table_that_runs_backwards_is_refused():
    values = table_values(KNOTS_AT[::-1], KNOTS_AT, 0.1)
    with pytest.raises(UserError, match=r"speed_table\.x2=3\.5: above x1, 4: a table runs upwards"):
        rigs.carriage().with_effect("carriage", "speed_table", values)


def test_a_table_without_all_its_numbers_is_refused():
    values = table_values(KNOTS_AT, KNOTS_AT, 0.1)
    del values["x4"]
    with refused("speed_table.x4=(missing): a table has f1 to f16, its values, at x1 to x16"):
        rigs.carriage().with_effect("carriage", "speed_table", values)


def test_a_table_survives_the_rigs_file():
    values = table_values(KNOTS_AT, KNOTS_AT**3, 0.5)
    rig = rigs.carriage().with_effect("carriage", "speed_table", values)
    assert rig_of(rig_content(rig)).effect("carriage", "speed_table") == values
    assert table_of(values)[1] == pytest.approx(KNOTS_AT**3)


def test_a_table_is_drawn_over_its_state():
    for effect in [one for one in CATALOGUE.values() if one.is_table]:
        drawing, shape = drawing_of(effect), SHAPES[effect.name]
        assert (drawing.state, drawing.times) == (shape.over, shape.times)
        state, effort = law_curve(drawing, table_values(KNOTS_AT, KNOTS_AT**2, 1.0), {}, (-1.0, 3.0))
        assert effort == pytest.approx(state**2, abs=0.01)


@pytest.mark.parametrize(
    ("place", "effect", "values", "table", "law", "reach"),
    [
        ("link_1", "cubic_stiffness", {"k3": 1e9}, "stretch_table", lambda s: 1e9 * s**3, 3e-4),
        ("link_1", "quadratic_damping", {"c2": 2e3}, "stretch_rate_table", lambda v: 2e3 * np.abs(v) * v, 0.02),
        ("motor_bearing", "gravity", {"torque": 0.02, "phase": 0.0}, "position_table", lambda q: 0.02 * np.sin(q), 5.0),
        ("motor_bearing", "viscous_friction", {"coefficient": 1e-3}, "speed_table", lambda v: -1e-3 * v, 60.0),
        ("amplifier", "gain_error", {"relative": 0.1}, "command_table", lambda u: 0.1 * u, 6.0),
    ],
)
def test_a_table_of_a_law_acts_as_the_law(place, effect, values, table, law, reach):
    rig, u = rigs.lead_screw(), rigs.random_steps(600, 25, 5.0)
    states = np.linspace(-reach, reach, KNOTS)
    plain = simulate(rig, u, 1e-3).sensors["q3"]
    true = simulate(rig.with_effect(place, effect, values), u, 1e-3).sensors["q3"]
    tabled = table_values(states, law(states), 1.0)
    seen = simulate(rig.with_effect(place, table, tabled), u, 1e-3).sensors["q3"]
    assert np.std(seen - true) < 0.05 * np.std(true - plain)


@pytest.mark.parametrize(
    ("place", "table", "size", "reach", "stiffness", "damping", "viscous"),
    [
        ("motor_bearing", "position_damping_table", -1e-3, 5.0, 0.0, 0.0, 1e-3),
        ("link_1", "stretch_damping_table", 2.0, 3e-4, 0.0, 2.0, 0.0),
        ("link_1", "rate_stiffness_table", 500.0, 0.02, 500.0, 0.0, 0.0),
    ],
)
def test_a_constant_table_times_a_state_is_a_damping_or_a_stiffness(
    place, table, size, reach, stiffness, damping, viscous
):
    rig, u = rigs.lead_screw(), rigs.random_steps(600, 25, 5.0)
    values = table_values(np.linspace(-reach, reach, KNOTS), np.full(KNOTS, size), 1.0)
    elements, parameters = dict(rig.config.elements), dict(rig.config.parameters)
    parameters |= {"own_k": ParameterConfig(parameters["k"].value + stiffness, "N/m"),
                   "own_c": ParameterConfig(parameters["c"].value + damping, "N s/m")}  # fmt: skip
    elements["link_1"] = {**elements["link_1"], "stiffness": "own_k", "damping": "own_c"}
    true = build_rig(replace(rig.config, elements=elements, parameters=parameters))
    true = true.with_effect("motor_bearing", "viscous_friction", {"coefficient": viscous}) if viscous else true
    plain, seen, known = (
        simulate(r, u, 1e-3).sensors["q3"] for r in (rig, rig.with_effect(place, table, values), true)
    )
    assert np.std(seen - known) < 0.02 * np.std(known - plain)
