"""How much is explained, what is left, and what the user calls enough."""

from types import SimpleNamespace

import numpy as np
import pytest

from dtbacklash.diagnose.judge.explained import explained, read_enough
from dtbacklash.diagnose.shown import FitTable, FreeRunning, ModelErrors
from dtbacklash.errors import UserError

SIZE, FLOOR = 1e-3, 0.05


@pytest.mark.parametrize(
    ("channel", "given", "read"),
    [
        ("q3", "0.05 mm", (5e-5, False)), ("q3", "2e-6 m", (2e-6, False)), ("theta_m", "1 deg", (np.pi / 180, False)),
        ("q3", "2 %", (0.02, True)), ("q3", "2%", (0.02, True)),
        ("q3", "0.05mm", (5e-5, False)), ("q3", 0.02, (0.02, True)), ("q3", " 0.02 ", (0.02, True)),
    ],
)  # fmt: skip
def test_enough_is_read_in_its_unit_or_as_a_share(rig, channel, given, read):
    assert read_enough({channel: given}, rig) == {channel: (pytest.approx(read[0]), read[1])}


@pytest.mark.parametrize(
    ("channel", "given", "allowed"),
    [
        ("q9", "1 mm", "no such channel; choose one of "), ("q3", "1 rad", "a number above 0 with a unit of m (m, "),
        ("q3", "1 parsec", "with a unit of m"), ("q3", "-1 mm", "above 0"), ("q3", "nan", "above 0"),
        ("q3", "inf mm", "above 0"), ("theta_m", "much", "a share like 2 %"), ("q3", "", "a share like 2 %"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_said_in_one_line(rig, channel, given, allowed):
    with pytest.raises(UserError) as caught:
        read_enough({channel: given}, rig)
    said = str(caught.value)
    assert said.startswith(f"enough.{channel}=")
    assert allowed in said
    assert "\n" not in said


def much(enough=None, compared=(1.0, 0.5, 0.1), free=(20.0, 2.0, 0.2)):
    """Of two channels that move by ``SIZE`` each: two floors of a hundredth of it are left, and three of a tenth."""
    motion = SIZE * np.array([1.0, -1.0] * 50)
    evidence = SimpleNamespace(
        blocks=[SimpleNamespace(name="rig", channels=("x", "y"))],
        mean_square=lambda residuals, part: {"rig": np.array([4.0, 9.0])},
        floor={"rig": SIZE * np.array([0.01, 0.1])},
        records=[SimpleNamespace(y={"x": motion, "y": motion}, held=np.arange(100) >= 60)],
        nominal=SimpleNamespace(sensors={c: SimpleNamespace(unit="m") for c in "xy"}),
    )
    held, freely = ModelErrors(*compared), ModelErrors(*free)
    table, running = FitTable("nrmse", ("x", "y"), held, held, FLOOR), FreeRunning(freely, freely)
    return explained(evidence, SimpleNamespace(residuals={}), table, running, enough or {})


def test_shares_are_of_the_mean_square_above_the_floor():
    found = much()
    assert found.compared == pytest.approx(1.0 - (0.1**2 - FLOOR**2) / (1.0 - FLOOR**2))
    assert found.free_running == pytest.approx(1.0 - (0.2**2 - FLOOR**2) / (20.0**2 - FLOOR**2))
    assert much(compared=(FLOOR, None, FLOOR)).compared is None, "nothing was missing"
    assert much(compared=(1.0, 1.0, 0.5 * FLOOR)).compared == 1.0
    assert much(free=(3.0, 3.0, None)).free_running is None
    assert much(free=(3.0, 3.0, 6.0)).free_running < 0.0


def test_what_is_left_is_said_in_units_of_the_motion_and_in_floors():
    left = much().left
    assert (left["x"].rms, left["x"].of_motion, left["x"].floors) == pytest.approx((0.02 * SIZE, 0.02, 2.0))
    assert (left["y"].rms, left["y"].of_motion, left["y"].floors) == pytest.approx((0.3 * SIZE, 0.3, 3.0))
    assert left["x"].unit == "m"
    assert "beats_a_constant" not in much().to_json()


@pytest.mark.parametrize(
    ("enough", "met"),
    [
        ({}, None), ({"x": (0.03 * SIZE, False)}, True), ({"x": (0.01 * SIZE, False)}, False),
        ({"x": (0.03, True), "y": (0.4, True)}, True), ({"x": (0.03, True), "y": (0.2, True)}, False),
        ({"not compared": (0.1, True)}, None),
    ],
)  # fmt: skip
def test_enough_is_asked_of_the_channels_that_it_names(enough, met):
    assert much(enough).enough is met


@pytest.mark.parametrize(
    ("compared", "free", "beats"), [(0.1, 5.0, True), (2.0, 0.9, True), (2.0, 5.0, False), (2.0, None, False)]
)
def test_a_rig_that_is_no_better_than_a_constant_is_noted(compared, free, beats):
    assert much(compared=(3.0, 3.0, compared), free=(3.0, 3.0, free)).beats_a_constant == beats
