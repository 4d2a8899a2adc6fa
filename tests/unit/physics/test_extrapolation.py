"""A run says where it leaves the states from which a table or a found law was made."""

import numpy as np
import pytest
from nominal import nominal_rig
from told import refused

from dtbacklash.config.compose import compose
from dtbacklash.experiment.run import run_scenario
from dtbacklash.physics import catalogue
from dtbacklash.physics.effects.table import table_values
from dtbacklash.physics.extrapolation import beyond
from dtbacklash.physics.simulate import simulate

DRAG = {"acts_on": ["rotor", "mass"], "law": "-drag*abs(v)*v", "parameters": {"drag": {"start": 1e-3}}}


@pytest.fixture
def drag(as_before):
    catalogue.declare({"covered_drag": DRAG | {"covers": {"v": [-0.5, 3.0]}}}, "rig.laws")
    return "covered_drag"


def test_a_law_of_ones_own_says_how_far_and_how_long(drag):
    """A disk under a constant torque, without friction: w = T t/J passes 3 rad/s at a known time."""
    rig = nominal_rig("pendulum").with_effect("disk", drag, {"drag": 1e-9})
    u = np.full(2001, 0.5)
    (one,) = beyond(rig, u, np.zeros(2001), 1e-3)
    rate = 0.5 * rig.elements["motor"].values["gain"] / rig.elements["disk"].values["inertia"]
    assert (one.location, one.effect, one.state, one.covered) == ("disk", drag, "velocity", (-0.5, 3.0))
    assert one.reached == pytest.approx((0.0, 2.0 * rate), rel=1e-6)
    assert one.share == pytest.approx(1.0 - 3.0 / (2.0 * rate), abs=1e-3)
    assert "disk.covered_drag covers a velocity from -0.5 to 3 (SI); the run went from 0 to 15, 80" in one.words


def test_what_stays_in_its_range_says_nothing(drag):
    rig = nominal_rig("pendulum").with_effect("disk", drag, {"drag": 1e-9})
    assert beyond(rig, np.full(101, 0.5), np.zeros(101), 1e-3) == []
    assert beyond(nominal_rig("pendulum"), np.full(101, 50.0), np.zeros(101), 1e-3) == []


@pytest.mark.parametrize(("lost", "leaves"), [(0.0, True), (1e-3, True), (1.0, False)])
def test_a_law_at_a_spring_with_play_sees_what_is_left_of_the_stretch(lost, leaves):
    knots = np.linspace(-1e-3, 1e-3, 16)
    rig = nominal_rig("oscillator").with_effect("spring", "stretch_table", table_values(knots, 10.0 * knots, 1.0))
    rig = rig.with_effect("spring", "backlash", {"lost_motion": lost})
    u = 0.3 * np.sin(6.0 * np.pi * 1e-3 * np.arange(2001))
    found, x = beyond(rig, u, np.zeros(2001), 1e-3), simulate(rig, u[:-1], 1e-3).sensors["x"]
    assert bool(found) == leaves
    for one in found:
        assert one.reached == pytest.approx((x.min() + 0.5 * lost, x.max() - 0.5 * lost), rel=1e-6)
        assert one.share == pytest.approx(np.mean(np.abs(x) > 1e-3 + 0.5 * lost), abs=1e-9)


def test_a_table_on_a_spring_says_it_in_a_runs_summary():
    knots = np.linspace(-1e-4, 1e-4, 16)
    values = table_values(knots, 10.0 * knots, 1.0)
    words = [f"rig.effects.spring.stretch_table.{name}={value!r}" for name, value in values.items()]
    result = run_scenario(
        compose("rig=oscillator", "controller=open_loop", "reference=multisine", "duration_s=3", *words)
    )
    (one,) = result.summary["beyond"]
    assert one["state"] == "stretch"
    assert one["reached"][1] > 1e-4
    assert (
        sum("spring.stretch_table covers a stretch from -0.0001 to 0.0001" in a for a in result.summary["advice"]) == 1
    )


@pytest.mark.parametrize(
    ("covers", "said"),
    [
        ([1, 2], "covers=[1, 2]: a mapping"),
        ({"s": [0, 1]}, "covers.s=[0, 1]: one of position, velocity"),
        ({"v": [3, -3]}, "covers.v=[3, -3]: its lowest and its highest value"),
        ({"t": [0, 1]}, "covers.t=[0, 1]: one of position, velocity"),
        ({"v": 3}, "covers.v=3: its lowest and its highest value"),
        ({"v": ["a", "b"]}, "its lowest and its highest value"),
    ],
)
def test_a_wrong_range_is_refused(covers, said, as_before):
    with refused(said):
        catalogue.declare({"bad_drag": DRAG | {"covers": covers}}, "rig.laws")
