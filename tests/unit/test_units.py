"""The one table of units."""

import math

import pytest

from dtbacklash import units
from dtbacklash.physics.element_kinds import KINDS


def test_every_unit_leads_to_an_si_unit_of_the_table():
    for name, unit in units.UNITS.items():
        assert units.UNITS[unit.si] == (unit.si, 1.0)
        assert unit.factor > 0.0
        assert units.find(name) == unit
    for quantities in (kind.quantities for kind in KINDS.values()):
        assert set(quantities.values()) <= {*units.UNITS, "1"}  # 1: a variable of an FMU has its own
    assert KINDS
    assert [units.in_signs(name) for name in ("N s^2/m^2", "ohm")] == ["N s²/m²", "Ω"]


@pytest.mark.parametrize(
    ("written", "si", "factor"),
    [("mm", "m", 1e-3), ("MM", "m", 1e-3), ("µm", "m", 1e-6), ("um", "m", 1e-6), ("°", "rad", math.pi / 180),
     ("rpm", "rad/s", math.pi / 30), ("mA", "A", 1e-3), ("Volt", "V", 1.0), ("Voltage", None, 0.0), ("", None, 0.0),
     ("rev/4", "rad", math.pi / 2), ("rev/0", None, 0.0), ("counts/2", None, 0.0), ("mm/1e3", "m", 1e-6),
     ("kip", "N", 4448.2216152605)],
)  # fmt: skip
def test_units_as_written(written, si, factor):
    found = units.find(written)
    assert found == (None if si is None else (si, factor))


def test_people_see_millimetres_with_the_bits_of_a_factor_of_a_thousand():
    assert units.shown("m") == ("mm", 1000.0)
    assert units.shown("m/s") == ("mm/s", 1000.0)
    assert units.shown("rad") == ("rad", 1.0)
    assert [units.suffix(units.shown(si)[0]) for si in ("m", "rad", "A", "m/s", "rad/s", "N")] == [
        "mm", "rad", "a", "mm_s", "rad_s", "n",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("step_mm", "mm"), ("delay_s", "s"), ("observer_pole_rad_s", "rad/s"), ("k_theta_v_per_rad", "V/rad"),
        ("seed", ""),
    ],
)  # fmt: skip
def test_the_unit_of_a_setting_by_its_name(name, unit):
    assert units.by_suffix(name) == unit


@pytest.mark.parametrize(("written", "si", "factor"), [
    ("N/mm", "N/m", 1e3), ("kg cm^2", "kg m^2", 1e-4), ("g mm^2", "kg m^2", 1e-9), ("mm/rev", "m/rad", 5e-4 / math.pi),
    ("rpm", "rad/s", math.pi / 30), ("N s/mm", "N s/m", 1e3), ("mN m/A", "N m/A", 1e-3), ("mH", "H", 1e-3),
    ("N m s/rad", "N m s/rad", 1.0), ("V s/rad", "V s/rad", 1.0), ("N m/deg", "N m/rad", 180 / math.pi),
    *((odd, None, 0.0) for odd in ("kg^²", "kg mm^999", "kg^--2", "N/", "N/s/mm", "lbs", "N/furlong", "kg^x")),
])  # fmt: skip
def test_a_unit_made_of_several_is_taken_apart_unless_a_part_is_unknown(written, si, factor):
    found = units.composed(written)
    assert found == (None if si is None else (si, pytest.approx(factor, rel=1e-12)))
