"""A rig's description: what is refused, in which words, and how copies are made."""

import copy
import math
import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference import rigs
from told import refused

from dtbacklash.config.rig import ParameterConfig, RigConfig
from dtbacklash.diagnosis.engine.parameters import nominal_free
from dtbacklash.errors import UserError
from dtbacklash.physics.assembly import compile_plant, state_names
from dtbacklash.physics.catalogue import CATALOGUE, find
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.rig_file import rig_content, rig_of

Change = Callable[[RigConfig], Any]


def changed(change: Change) -> RigConfig:
    config = copy.deepcopy(rigs.lead_screw().config)
    change(config)
    return replace(config)  # the schema looks at it again


def element(name: str, **fields: Any) -> Change:
    return lambda c: c.elements[name].update(fields)


def drop(name: str, key: str) -> Change:
    return lambda c: c.elements[name].pop(key)


def parameter(name: str, **fields: Any) -> Change:
    return lambda c: c.parameters.__setitem__(name, ParameterConfig(**({"value": 1.0} | fields)))


def sensor(**fields: Any) -> Change:
    return lambda c: c.sensors["q3"].update(fields)


def put(name: str, spec: Any) -> Change:
    return lambda c: c.elements.__setitem__(name, spec)


REFUSED: list[tuple[Change, str, str]] = [
    (element("motor_circuit", drives="link_1"), "rig.elements.motor_circuit.drives=link_1", "of kind rotor"),
    (element("motor_circuit", drives=["motor_bearing"]), "rig.elements.motor_circuit.drives=", "of kind rotor"),
    (element("amplifier", drives="motor_bearing"), "rig.elements.amplifier.drives=motor_bearing", "motor_circuit"),
    (element("gear", driven_by="mass_1"), "rig.elements.gear.driven_by=mass_1", "of kind rotor"),
    (element("screw", driven_by="motor_bearing"), "rig.elements.screw.driven_by=motor_bearing", "of kind gear"),
    (element("link_1", between=[{"a": 1}, "mass_2"]), "rig.elements.link_1.between=", "of kind mass"),
    (element("gear", kind=["gear"]), "rig.elements.gear.kind=", "choose one of"),
    (element("link_1", kind="spring"), "rig.elements.link_1.kind=spring", "link"),
    (element("link_1", stifness="k"), "rig.elements.link_1.stifness=k", "stiffness"),
    (element("link_1", damp="k"), "rig.elements.link_1.damp=k", "; a link has stiffness"),
    (element("amplifier", gain="k"), "rig.elements.amplifier.gain=k", "; an amplifier has drives"),
    (element("link_1", stiffness="kk"), "rig.elements.link_1.stiffness=kk", "the name of one of the rig's parameters"),
    (element("link_1", stiffness=-1.0), "rig.parameters.link_1_stiffness.value=-1.0", "above 0 N/m"),
    (element("link_1", stiffness="-1 N/mm"), "rig.parameters.link_1_stiffness.value=-1000.0", "above 0 N/m"),
    (element("link_1", stiffness="5 N"), "rig.parameters.link_1_stiffness.unit=N", "N/m, as rig.elements.link_1"),
    (element("link_1", stiffness="5 lbs"), "rig.parameters.link_1_stiffness.value=5 lbs", "the unit lbs is unknown"),
    (drop("link_1", "stiffness"), "rig.elements.link_1.stiffness=(missing)", "N/m"),
    (drop("link_1", "between"), "rig.elements.link_1.between=(missing)", "another element"),
    (drop("motor_circuit", "drives"), "rig.elements.motor_circuit.drives=(missing)", "another element"),
    (element("link_1", between=["mass_1"]), "rig.elements.link_1.between", "two different bodies"),
    (element("link_1", between=["mass_1", "mass_1"]), "rig.elements.link_1.between", "two different bodies"),
    (element("link_1", between="mass_1"), "rig.elements.link_1.between=mass_1", "two different bodies"),
    (element("link_1", between=["mass_1", "mass_9"]), "rig.elements.link_1.between=mass_9", "mass_3"),
    (element("link_1", between=["mass_1", "gear"]), "rig.elements.link_1.between=gear", "of kind mass"),
    (element("screw", carries="link_1"), "rig.elements.screw.carries=link_1", "of kind mass"),
    (element("gear", driven_by="motor"), "rig.elements.gear.driven_by=motor", "motor_bearing"),
    (put("ground", {"kind": "mass", "mass": "m"}), "rig.elements.ground", "a name other than `ground`"),
    (put("sensor_x", {"kind": "mass", "mass": "m"}), "rig.elements.sensor_x", "not beginning with `sensor_`"),
    (put("second", {"kind": "rotor", "inertia": "J"}), "rig.elements.second=second", "a shaft reaches"),
    (parameter("m", value=0.0, unit="kg"), "rig.parameters.m.value=0.0", "above 0 kg"),
    (parameter("m", value=-5.2, unit="kg"), "rig.parameters.m.value=-5.2", "above 0 kg"),
    (parameter("k", value=-1.0, unit="N/m"), "rig.parameters.k.value=-1.0", "above 0 N/m"),
    (parameter("m", value=5.2, unit="mm"), "rig.parameters.m.unit=m", "kg, as rig.elements.mass_1.mass needs it"),
    (parameter("m", value="5.2 kg", unit="kg"), "rig.parameters.m.value=5.2 kg", "gives its unit twice"),
    (parameter("R", value=12.0, unit="rpm"), "rig.parameters.R.unit=rad/s", "ohm"),
    (sensor(of="mass_7"), "rig.sensors.q3.of=mass_7", "mass_3"),
    (sensor(of="gear"), "rig.sensors.q3.of=gear", "mass_3"),
    (sensor(recorded_in="deg"), "rig.sensors.q3.recorded_in=deg", "a unit of m: m, cm, mm"),
    (sensor(recorded_in=3), "rig.sensors.q3.recorded_in=3", "a unit of m"),
    (sensor(scale=3), "rig.sensors.q3.scale=3", "`of`, `quantity`, `recorded_in`"),
    (sensor(low_pass={"cutoff": 50}), "rig.sensors.q3.low_pass", "write it as rig.effects.sensor_q3.low_pass"),
    (
        sensor(quantity="velocity", recorded_in="m/s", absolute=True),
        "rig.sensors.q3.absolute=True",
        "only a position has a zero",
    ),
    (sensor(quantity="current"), "rig.sensors.q3.quantity=current", "position, velocity"),
    (sensor(of="motor_circuit"), "rig.sensors.q3.quantity=position", "current"),
]


@pytest.mark.parametrize(("change", "key", "allowed"), REFUSED, ids=[key for _, key, _ in REFUSED])
def test_what_a_description_may_not_say(change: Change, key: str, allowed: str) -> None:
    with refused(allowed, start=key):
        build_rig(changed(change))


SCHEMA: list[tuple[dict[str, Any], str]] = [
    ({"elements": {"x": 3}}, "rig.elements.x=3"),
    ({"elements": {"x": {"mass": "m"}}}, "rig.elements.x="),
    ({"sensors": {"q": {"of": "mass_1"}}}, "rig.sensors.q="),
    ({"sensors": {"q": "mass_1"}}, "rig.sensors.q=mass_1"),
    ({"parameters": {"m": ParameterConfig(math.nan)}}, "rig.parameters.m.value=nan"),
    ({"parameters": {"m": ParameterConfig(math.inf)}}, "rig.parameters.m.value=inf"),
    ({"parameters": {"m": ParameterConfig("five kg")}}, "rig.parameters.m.value=five"),
    ({"parameters": {"m": ParameterConfig(1.0, tolerance=10.5)}}, "rig.parameters.m.tolerance=10.5"),
    ({"parameters": {"m": ParameterConfig(1.0, tolerance=-0.1)}}, "rig.parameters.m.tolerance=-0.1"),
    ({"effects": {"gear": 3}}, "rig.effects.gear=3"),
    ({"effects": {"gear": {"backlash": 0.3}}}, "rig.effects.gear.backlash=0.3"),
    ({"effects": {"gear": {"backlash": {"half_gap": math.nan}}}}, "rig.effects.gear.backlash.half_gap=nan"),
    ({"effects": {"gear": {"backlash": {"half_gap": "wide"}}}}, "rig.effects.gear.backlash.half_gap=wide"),
    ({"effects": {"gear": {"backlash": {"half_gap": True}}}}, "rig.effects.gear.backlash.half_gap=True"),
]


@pytest.mark.parametrize(("fields", "key"), SCHEMA, ids=[key for _, key in SCHEMA])
def test_what_the_schema_refuses(fields: dict[str, Any], key: str) -> None:
    with refused(start=key):
        RigConfig(**fields)


EFFECTS: list[tuple[str, str, dict[str, float], str, str]] = [
    ("mass_9", "ground_friction", {"force": 1.0}, "rig.effects.mass_9", "unknown location; known: amplifier"),
    ("sensor_q9", "offset", {"offset": 1.0}, "rig.effects.sensor_q9", "sensor_q3"),
    ("q3", "offset", {"offset": 1.0}, "rig.effects.q3", "sensor_q3"),
    (
        "sensor_q3",
        "eccentricity",
        {"amplitude": 0.01},
        "rig.effects.sensor_q3.eccentricity",
        "a sensor whose unit is rad",
    ),
    ("gear", "slop", {"half_gap": 1.0}, "rig.effects.gear.slop=slop", "`gear` takes backlash"),
    ("gear", "cubic_stiffness", {"k3": 1.0}, "rig.effects.gear.cubic_stiffness", "`gear` takes backlash"),
    ("gear", "backlash", {"gap": 0.3}, "rig.effects.gear.backlash.gap=0.3", "unknown parameter; known: half_gap"),
    ("gear", "backlash", {}, "rig.effects.gear.backlash", "`half_gap` [rad] must be given"),
    ("gear", "backlash", {"half_gap": -0.1}, "rig.effects.gear.backlash.half_gap=-0.1", "from 0 to 6.3 rad"),
    ("gear", "backlash", {"half_gap": 50.0}, "rig.effects.gear.backlash.half_gap=50.0", "from 0 to 6.3 rad"),
    ("gear", "backlash", {"half_gap": math.nan}, "rig.effects.gear.backlash.half_gap=nan", "a number"),
    ("screw", "pitch_error", {"periods": 2.0}, "rig.effects.screw.pitch_error", "`amplitude` [m] must be given"),
]


@pytest.mark.parametrize(("place", "name", "values", "key", "allowed"), EFFECTS, ids=[e[3] for e in EFFECTS])
def test_effects_that_do_not_fit(place: str, name: str, values: dict[str, float], key: str, allowed: str) -> None:
    with refused(allowed, start=key):
        rigs.lead_screw().with_effect(place, name, values)


@pytest.mark.parametrize("name", ["ground_friction", "constant_force"])
def test_no_force_on_a_mass_that_a_rigid_screw_carries(name: str) -> None:
    rig = rigs.lead_screw().with_effect("mass_1", name, {"force": 1.0})
    with pytest.raises(UserError, match=r"rig\.effects\.mass_1\..*compliance"):
        compile_plant(rig, 1e-3)
    soft = rig.with_effect("screw", "compliance", {"compliance": 1e-6})
    assert "mass_1" in state_names(soft)
    compile_plant(soft, 1e-3)


def test_a_soft_screw_must_carry_something() -> None:
    config = changed(drop("screw", "carries"))
    rig = build_rig(config).with_effect("screw", "compliance", {"compliance": 1e-6})
    with pytest.raises(UserError, match=r"rig\.effects\.screw\.compliance.*carries a mass"):
        compile_plant(rig, 1e-3)


def test_with_effect_leaves_the_original_alone() -> None:
    rig = rigs.lead_screw()
    more = rig.with_effect("link_1", "cubic_stiffness", {"k3": 1e9})
    assert rig.effects == {}
    assert rig.config.effects == {}
    assert more.effect("link_1", "cubic_stiffness") == {"k3": 1e9}
    assert more.effect("link_2", "cubic_stiffness") is None
    both = more.with_effect("link_1", "quadratic_damping", {"c2": 10.0})
    assert set(both.effects["link_1"]) == {"cubic_stiffness", "quadratic_damping"}
    back = both.with_effect("link_1", "quadratic_damping", None).with_effect("link_1", "cubic_stiffness", None)
    assert back.effects == {}
    assert back.config.effects == {}


def test_with_effect_replaces_a_former_size() -> None:
    rig = rigs.lead_screw().with_effect("gear", "backlash", {"half_gap": 0.3})
    assert rig.with_effect("gear", "backlash", {"half_gap": 0.1}).effect("gear", "backlash") == {"half_gap": 0.1}


def test_missing_parameters_of_an_effect_get_their_typical_values() -> None:
    rig = rigs.lead_screw().with_effect("motor_bearing", "cogging", {"torque": 0.01})
    typical = {p.name: p.typical for p in CATALOGUE["rotor", "cogging"].parameters}
    assert rig.effect("motor_bearing", "cogging") == typical | {"torque": 0.01}


def test_with_parameters() -> None:
    rig = rigs.lead_screw()
    other = rig.with_parameters({"k": 9000.0, "R": 13.0})
    assert other.elements["link_2"].values["stiffness"] == other.elements["link_1"].values["stiffness"] == 9000.0
    assert other.elements["motor_circuit"].values["resistance"] == 13.0
    assert rig.elements["link_1"].values["stiffness"] == 1e4
    assert other.config.parameters["k"].tolerance == rig.config.parameters["k"].tolerance
    with pytest.raises(UserError, match=r"rig\.parameters\.kk=1\.0: unknown parameter; known: m, k"):
        rig.with_parameters({"kk": 1.0})
    for value in (-1.0, 0.0, math.nan, math.inf):
        with pytest.raises(UserError, match=r"rig\.parameters\.m"):
            rig.with_parameters({"m": value})


def test_find_names_what_an_element_takes() -> None:
    assert find("gear", "backlash", "k").name == "backlash"
    with pytest.raises(UserError, match="takes no effect"):
        find("positioner", "backlash", "rig.effects.machine.backlash")


bodies = st.integers(1, 5)


@given(bodies, st.floats(0.1, 100.0), st.floats(1e2, 1e5), st.floats(0.0, 50.0))
def test_a_chain_of_any_length_hangs_statically_as_springs_in_series(n: int, m: float, k: float, c: float) -> None:
    """A constant force at the end of n springs stretches each by F/k: the plant's equilibrium."""
    plant = compile_plant(chain(n, m, k, c), 1e-3)
    A, B = plant.A[0], plant.G[0].T
    at_rest = -np.linalg.solve(A, B[:, 0])
    assert at_rest[:n] == pytest.approx(np.arange(1, n + 1) / k, rel=1e-6)
    assert at_rest[n:] == pytest.approx(np.zeros(n), abs=1e-9 / k)
    assert np.linalg.eigvals(A).real.max() < 1e-6 * math.sqrt(k / m)


def chain(n: int, m: float, k: float, c: float) -> Rig:
    elements: dict[str, Any] = {
        "amplifier": {"kind": "amplifier", "drives": "source"},
        "source": {"kind": "actuator", "gain": "gain", "drives": f"mass_{n}"},
    }
    for j in range(1, n + 1):
        before = f"mass_{j - 1}" if j > 1 else "ground"
        elements[f"mass_{j}"] = {"kind": "mass", "mass": "m"}
        ends = [before, f"mass_{j}"]
        elements[f"link_{j}"] = {"kind": "link", "between": ends, "stiffness": "k", "damping": "c"}
    numbers = {"m": (m, "kg"), "k": (k, "N/m"), "c": (c, "N s/m"), "gain": (1.0, "N/V")}
    return build_rig(
        RigConfig(
            parameters={name: ParameterConfig(*value) for name, value in numbers.items()},
            elements=elements,
            sensors={"q": {"of": f"mass_{n}", "quantity": "position"}},
        )
    )


def test_numbers_and_units_may_stand_in_the_elements() -> None:
    config = rigs.lead_screw().config
    elements = {name: dict(spec) for name, spec in config.elements.items()}
    elements["mass_2"]["mass"] = 2.5
    elements["link_1"]["stiffness"] = "0.5 N/mm"
    parameters = {**config.parameters, "J": replace(config.parameters["J"], value="0.05 kg cm^2", unit="")}
    rig = build_rig(replace(config, elements=elements, parameters=parameters))
    assert rig.elements["mass_2"].values["mass"] == 2.5
    assert rig.elements["link_1"].values["stiffness"] == 500.0
    assert rig.elements["motor_bearing"].values["inertia"] == pytest.approx(5e-6)
    assert rig.config.parameters["link_1_stiffness"].unit == "N/m"
    assert elements["mass_2"]["mass"] == 2.5  # what was given stays as it was
    assert build_rig(rig.config).elements == rig.elements


#: an effect of the lead screw as it may be written -> the values that it means, SI
WRITTEN = {
    ("motor_bearing", "coulomb_friction"): ({"torque": "20 mN m"}, {"torque": 0.02}),
    ("gear", "backlash"): ({"half_gap": {"value": "1 deg", "tolerance": "30 %"}}, {"half_gap": math.radians(1.0)}),
    ("motor_bearing", "cogging"): (
        {"torque": {"value": "0.002 Nm"}, "periods": 24, "phase": "270 deg"},
        {"torque": 0.002, "periods": 24.0, "phase": -math.pi / 2.0},
    ),
    ("sensor_q3", "offset"): ({"offset": {"value": "0.2 mm"}}, {"offset": 2e-4}),
    ("sensor_q3", "delay"): ({"time": "2 ms"}, {"time": 2e-3}),
    ("sensor_q3", "gain_error"): ({"relative": "2 %"}, {"relative": 0.02}),
}


@pytest.mark.parametrize("where", WRITTEN)
def test_the_values_of_an_effect_may_have_their_units(where) -> None:
    leaves, meant = WRITTEN[where]
    place, name = where
    rig = rigs.lead_screw().with_effect(place, name, leaves)
    assert rig.effects[place][name] == pytest.approx({**rig.effects[place][name], **meant})
    again = pickle.loads(pickle.dumps(rig)).with_parameters({"m": 6.0})  # built anew from its description
    assert again.effects == rig.effects
    assert rig_of(rig_content(rig)).effects == rig.effects
    assert rig.tolerances.get(place, {}).get(name, {}) == ({"half_gap": 0.3} if name == "backlash" else {})


@pytest.mark.parametrize(("place", "name", "leaves", "said"), [
    ("motor_bearing", "coulomb_friction", {"torque": "1.2 mm"}, "torque=1.2 mm: must be in N m"),
    ("motor_bearing", "coulomb_friction", {"torque": {"value": "1.2 N"}}, "torque=1.2 N: must be in N m"),
    ("motor_bearing", "coulomb_friction", {"torque": "2 kg"}, "torque=2 kg: must be in N m"),
    ("motor_bearing", "coulomb_friction", {"torque": "2 pound"}, "torque=2 pound: the unit pound is unknown"),
    ("motor_bearing", "coulomb_friction", {"torque": "much"}, "torque=much: must be a finite number, SI, or with its"),
    ("sensor_q3", "offset", {"offset": "2 deg"}, "offset=2 deg: must be in m"),
    ("sensor_theta_m", "gain_error", {"relative": "2 mm"}, "relative=2 mm: has no unit"),
    ("motor_bearing", "gravity", {"torque": "-1 N m"},
     "from 0 to 1e+09 N m; a mass that hangs down at the angle 0 has phase: 180 deg"),
    ("motor_bearing", "cogging", {"torque": -1.0}, "the same with the other sign has phase: 180 deg"),
])  # fmt: skip
def test_a_unit_of_another_kind_and_a_sign_that_is_a_phase_are_refused(place, name, leaves, said) -> None:
    with refused(said):
        rigs.lead_screw().with_effect(place, name, leaves)


def held(**parameters: dict[str, Any]) -> RigConfig:
    """The lead screw with other parameters k, and k2 at its second link."""
    config = copy.deepcopy(rigs.lead_screw().config)
    known = {**config.parameters, **{n: ParameterConfig(**one) for n, one in parameters.items()}}
    elements = {**config.elements, "link_2": {**config.elements["link_2"], "stiffness": "k2"}}
    return replace(config, parameters=known, elements=elements)


def test_a_parameter_may_be_held_bounded_and_tied() -> None:
    rig = build_rig(held(
        k={"value": "8 N/mm", "tolerance": "20 %", "min": "7 N/mm", "max": 9000.0}, k2={"value": "= k"},
        m={"value": 5.2, "unit": "kg", "fixed": True},
    ))  # fmt: skip
    assert rig.elements["link_2"].values["stiffness"] == 8000.0
    softer = rig.with_parameters({"k": 7500.0})
    assert [softer.elements[f"link_{n}"].values["stiffness"] for n in (1, 2)] == [7500.0, 7500.0]
    free = {f.name: f for f in nominal_free(rig)}
    assert not {"k2", "m"} & set(free)
    assert (free["k"].low, free["k"].high, free["k"].scale) == (7000.0, 9000.0, 1600.0)
    assert nominal_free(rig_of(rig_content(rig))) == nominal_free(rig)
    assert "max" not in rig_content(rigs.lead_screw())["parameters"]["k"]
    at_0 = build_rig(held(k={"value": 8000.0, "min": 0.0}, k2={"value": "= k"}))
    assert rig_content(at_0)["parameters"]["k"]["min"] == 0.0


@pytest.mark.parametrize(("parameters", "said"), [
    ({"k2": {"value": "= kk"}}, "rig.parameters.k2.value== kk: must be one of "),
    ({"k2": {"value": "= k2"}}, "rig.parameters.k2.value== k2: must be one of "),
    ({"k2": {"value": 8000.0, "min": "7 N"}}, "rig.parameters.k2.min=7 N: must be in SI"),
    ({"k2": {"value": "8 N/mm", "max": "7 kg"}}, "rig.parameters.k2.max=7 kg: must be in N/m"),
    ({"k2": {"value": "8 N/mm", "max": "7 N/mm"}}, "rig.parameters.k2.value=8000.0: must lie between its min and max"),
    ({"k2": {"value": 8.0, "tolerance": "much"}}, "rig.parameters.k2.tolerance=much: a relative tolerance"),
])  # fmt: skip
def test_a_bound_or_a_tie_that_makes_no_sense_is_refused(parameters, said) -> None:
    with refused(start=said):
        held(**parameters)
