"""A law as a table: interpolation, what it refuses, and that it acts as the law that it was taken from."""

import numpy as np
import pytest
from reference import rigs

from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.drawing import drawing_of, law_curve
from dtbacklash.physics.effects.table import KNOTS, VALUES, efforts_of, interpolated, table_values, weights
from dtbacklash.physics.rig_file import rig_content, rig_of
from dtbacklash.physics.simulate import simulate

LOW, HIGH = -2.0, 4.0
STATES = np.linspace(LOW, HIGH, KNOTS)


def at(state, efforts, low=LOW, high=HIGH):
    return interpolated.py_func(state, [*efforts, low, high])


def test_a_table_passes_through_its_knots_and_is_constant_beyond():
    efforts = np.random.default_rng(1).standard_normal(KNOTS)
    assert [at(s, efforts) for s in STATES] == pytest.approx(efforts, abs=1e-12)
    for beyond, end in (
        (LOW - 1.0, efforts[0]),
        (HIGH + 1.0, efforts[-1]),
        (-np.inf, efforts[0]),
        (np.inf, efforts[-1]),
    ):
        assert at(beyond, efforts) == end
    assert at(np.nan, efforts) == efforts[0]


def test_a_table_of_a_line_is_the_line_and_of_a_parabola_nearly_the_parabola():
    fine = np.linspace(LOW, HIGH, 301)
    assert [at(s, 3.0 * STATES - 1.0) for s in fine] == pytest.approx(3.0 * fine - 1.0, abs=1e-12)
    inner = fine[(fine > STATES[1]) & (fine < STATES[-2])]
    assert [at(s, STATES**2) for s in inner] == pytest.approx(inner**2, abs=1e-9)


def test_the_weights_of_the_knots_add_up_to_the_table():
    efforts, states = np.random.default_rng(2).standard_normal(KNOTS), np.linspace(LOW - 1.0, HIGH + 1.0, 57)
    assert weights(states, LOW, HIGH) @ efforts == pytest.approx([at(s, efforts) for s in states], abs=1e-12)


def test_a_table_that_runs_backwards_is_refused():
    values = table_values(STATES, 1.0, -1.0, 0.1)
    with pytest.raises(UserError, match=r"speed_table\.high=-1\.0: above low, 1: a table runs upwards"):
        rigs.carriage().with_effect("carriage", "speed_table", values)


def test_a_table_survives_the_rigs_file():
    values = table_values(STATES**3, LOW, HIGH, 0.5)
    rig = rigs.carriage().with_effect("carriage", "speed_table", values)
    assert rig_of(rig_content(rig)).effect("carriage", "speed_table") == values
    assert efforts_of(values)[1] == pytest.approx(STATES**3)
    assert list(values)[:KNOTS] == list(VALUES)


def test_a_table_is_drawn_over_its_state():
    drawing = drawing_of(CATALOGUE["carriage", "speed_table"])
    assert drawing.state == "speed"
    state, effort = law_curve(drawing, table_values(STATES**2, LOW, HIGH, 1.0), {}, (LOW, HIGH))
    assert effort == pytest.approx(state**2, abs=0.05)


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
    tabled = table_values(law(states), -reach, reach, 1.0)
    seen = simulate(rig.with_effect(place, table, tabled), u, 1e-3).sensors["q3"]
    assert np.std(seen - true) < 0.05 * np.std(true - plain)
