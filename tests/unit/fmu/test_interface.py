"""What an FMU offers, and what is written into it."""

import math

import pytest

from dtbacklash.api.rigs import load_rig
from dtbacklash.config.groups import packaged_options
from dtbacklash.errors import UserError
from dtbacklash.fmu.interface import INPUT, OUTPUT, PARAMETER, Export, base_unit, changed, variables

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


@pytest.mark.parametrize("name", packaged_options("rig"))
def test_the_rig_comes_back_as_it_was_written(name):
    export = Export(load_rig(name), 5e-4, 3, 7)
    again = Export.of(export.text())
    assert again == export
    assert again.rig.elements == export.rig.elements


def test_parameters_change_the_rig_and_wrong_ones_are_refused():
    rig = load_rig("lead_screw", BACKLASH)
    other = changed(rig, {("parameters", "m"): 4.0, ("effects", "gear", "backlash", "half_gap"): 0.1})
    assert other.elements["mass_2"].values["mass"] == 4.0
    assert other.effects["gear"]["backlash"] == {"half_gap": 0.1}
    assert changed(rig, {("effects", "gear", "backlash", "half_gap"): 0.0}).effects == {}
    with pytest.raises(UserError, match=r"rig\.parameters\.m\.value"):
        changed(rig, {("parameters", "m"): -1.0})


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
    export = Export(replace(rig, config=replace(rig.config, name="2. Antrieb (älter)")))
    assert export.identifier.isidentifier()
    assert export.identifier.isascii()
