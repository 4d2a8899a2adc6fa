"""What an FMU offers, and what is written into it."""

import math

import pytest

from dtbacklash.api.rigs import load_rig
from dtbacklash.fmu.interface import INPUT, OUTPUT, PARAMETER, base_unit, identifier, variables

BACKLASH = "rig.effects.gear.backlash.half_gap=0.2"
OFFSET = "rig.effects.sensor_q3.offset.offset=0.001"


def names(rig, causality):
    return [one.name for one in variables(rig) if one.causality == causality]


def test_inputs_outputs_and_parameters_are_those_of_the_rig():
    rig = load_rig("lead_screw", BACKLASH)
    assert names(rig, INPUT) == ["u_v", "gap_deg"]
    assert names(rig, OUTPUT) == ["theta_m_rad", "q3_mm", "i_m_a", "q2_mm", "theta_d_rad"]
    assert names(rig, PARAMETER)[-2:] == ["parameters.p", "effects.gear.backlash.half_gap"]
    by_name = {one.name: one for one in variables(rig)}
    assert by_name["parameters.J"].unit == "kg m^2"
    assert by_name["parameters.J"].description == "motor inertia"
    assert by_name["effects.gear.backlash.half_gap"].start == 0.2


def test_without_a_gear_there_is_no_gap():
    assert names(load_rig("disk"), INPUT) == ["u_v"]
    assert names(load_rig("disk"), OUTPUT) == ["th_rad"]


def test_what_a_sensor_adds_is_no_parameter_as_the_outputs_are_true():
    rig = load_rig("lead_screw", OFFSET)
    assert "sensor_q3" in rig.effects
    assert not any("sensor_q3" in name for name in names(rig, PARAMETER))


def test_bounds_are_those_of_elements_and_effects():
    by_name = {one.name: one for one in variables(load_rig("lead_screw", BACKLASH))}
    mass, damping, gap = (by_name[n] for n in ("parameters.m", "parameters.c", "effects.gear.backlash.half_gap"))
    assert (mass.least, mass.above) == (0.0, True)
    assert (damping.least, damping.above) == (0.0, False)
    assert (gap.least, gap.most) == (0.0, 6.3)
    assert (by_name["gap_deg"].least, by_name["gap_deg"].most) == (0.0, 360.0)


@pytest.mark.parametrize(
    ("unit", "base"),
    [
        ("kg m^2", {"kg": 1, "m": 2}), ("N m/A", {"kg": 1, "m": 2, "s": -2, "A": -1}),
        ("V s/rad", {"kg": 1, "m": 2, "s": -2, "A": -1, "rad": -1}), ("H", {"kg": 1, "m": 2, "s": -2, "A": -2}),
        ("mm", {"m": 1, "factor": 1e-3}), ("deg", {"rad": 1, "factor": math.pi / 180}),
        ("1/W", {"kg": -1, "m": -2, "s": 3}), ("furlong", None),
    ],
)  # fmt: skip
def test_units_are_known_by_the_base_units(unit, base):
    assert base_unit(unit) == base


def test_a_name_that_is_no_identifier_becomes_one():
    from dataclasses import replace

    rig = load_rig("disk")
    found = identifier(replace(rig, config=replace(rig.config, name="2. Antrieb (älter)")))
    assert found.isidentifier()
    assert found.isascii()
