"""Gears with a ratio, belts and racks: what they do to motion and force, each in its own unit."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from reference import rigs
from told import refused

from dtbacklash.config.rig import RigConfig
from dtbacklash.errors import UserError
from dtbacklash.physics.bodies import natural_frequencies_hz
from dtbacklash.physics.rig import build_rig
from dtbacklash.physics.simulate import simulate

from .test_rig import changed, element, put

RATIO, RADIUS = 4.0, 0.03
PAGE = Path(__file__).resolve().parents[3] / "docs" / "machine.md"
LAST = pytest.mark.parametrize("last", ["belt", "rack"])


@LAST
def test_the_modes_are_those_of_the_inertias_seen_at_the_motor(last):
    """k_1/ratio^2 and k_2 (radius/ratio)^2 between J_1, J_2/ratio^2 and M (radius/ratio)^2."""
    p = {name: one.value for name, one in rigs.geared(last).config.parameters.items()}
    inertias = np.array([p["J_1"], p["J_2"] / RATIO**2, p["M"] * (RADIUS / RATIO) ** 2])
    k_1, k_2 = p["k_1"] / RATIO**2, p["k_2"] * (RADIUS / RATIO) ** 2
    k = np.array([[k_1, -k_1, 0.0], [-k_1, k_1 + k_2, -k_2], [0.0, -k_2, k_2]])
    squares = np.linalg.eigvals(k / inertias[:, None]).real
    expected = np.sort(np.sqrt(squares[squares > 1.0])) / (2 * np.pi)
    assert natural_frequencies_hz(rigs.geared(last)) == pytest.approx(expected, rel=1e-9)


def test_a_ratio_of_the_gear_makes_the_lead_shorter():
    """Its play is seen at the rotor, before the ratio."""
    plain = rigs.lead_screw().with_effect("gear", "backlash", {"half_gap": 0.3})
    geared = build_rig(changed(element("gear", ratio=5))).with_effect("gear", "backlash", {"half_gap": 0.3})
    shorter = plain.with_parameters({"p": plain.config.parameters["p"].value / 5.0})
    u = rigs.random_steps(800, 25, 5.0)
    for name, seen in simulate(geared, u, 1e-3).sensors.items():
        assert np.array_equal(seen, simulate(shorter, u, 1e-3).sensors[name]), name
    assert geared.config.parameters["gear_ratio"].tolerance == 0.0


@pytest.mark.parametrize(("spec", "said"), [
    ({"between": ["carriage", "pulley"]}, "rig.elements.belt.between=carriage: an element of kind rotor"),
    ({"between": ["pulley", "pulley"]}, "two different bodies"),
    ({"between": ["pulley", "rotor"]}, "rig.elements.belt.between=rotor: an element of kind mass or carriage or brake"),
    ({"between": ["pulley", "ground"]}, "rig.elements.belt.between=ground: an element of kind mass"),
    ({"radius": 0}, "rig.parameters.belt_radius.value=0.0: above 0 m"),
    ({"radius": "5 deg"}, "rig.parameters.belt_radius.unit=rad: m, as rig.elements.belt.radius needs it"),
])  # fmt: skip
def test_a_belt_goes_from_a_rotor_to_what_slides(spec, said):
    config = rigs.geared().config
    with refused(said):
        build_rig(replace(config, elements={**config.elements, "belt": {**config.elements["belt"], **spec}}))


def test_a_screw_and_a_belt_do_not_go_together():
    belt = {"kind": "belt", "between": ["motor_bearing", "mass_3"], "radius": "20 mm", "stiffness": "9 N/mm"}
    with pytest.raises(UserError, match="at most one element of kind screw or belt or rack or positioner"):
        build_rig(changed(put("belt", belt)))


@pytest.mark.parametrize("last", ["belt", "rack"])
def test_the_elements_of_the_docs_are_ones(last):
    (block,) = re.findall(r"```yaml\n(gearbox.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    shown = yaml.safe_load(block)
    bodies = {name: {"kind": "rotor", "inertia": "1 kg cm^2"} for name in ("rotor", "pulley")}
    driven = {**shown[last], "between": ["pulley", "carriage"]}
    elements = {
        "motor": {"kind": "actuator", "gain": "1 N m/V", "drives": "rotor"}, **bodies, "gearbox": shown["gearbox"],
        last: driven, "carriage": {"kind": "carriage", "mass": 2},
    }  # fmt: skip
    rig = build_rig(RigConfig(elements=elements, sensors={"x": {"of": "carriage", "quantity": "position"}}))
    assert rig.elements["gearbox"].lever == pytest.approx(0.2)
    assert rig.elements[last].lever == pytest.approx({"belt": 0.02, "rack": 0.012}[last])
    worm = build_rig(changed(put("gear", shown["worm"] | {"driven_by": "motor_bearing"})))
    assert worm.elements["screw"].values["lead"] == pytest.approx(
        rigs.lead_screw().elements["screw"].values["lead"] / 5
    )
