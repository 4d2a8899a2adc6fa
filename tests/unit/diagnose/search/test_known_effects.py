"""A nominal rig that has effects already: they have tolerances, and are recalibrated like its parameters."""

import machines as m
import numpy as np
import pytest

from dtbacklash.config.rig import ParameterConfig, RigConfig
from dtbacklash.diagnose import Record, diagnose_records
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.rig_file import rig_yaml

KEY = ("carriage", "viscous_friction")


def carriage(leaf: object = 100.0, **more: object) -> Rig:
    effects = {"carriage": {"viscous_friction": {"coefficient": leaf}, **more}}
    elements = {
        "amplifier": {"kind": "amplifier", "drives": "motor"},
        "motor": {"kind": "actuator", "gain": "g", "drives": "carriage"},
        "carriage": {"kind": "carriage", "mass": "M"},
    }
    parameters = {"g": ParameterConfig(35.0, tolerance=0.01), "M": ParameterConfig(95.0)}
    sensors = {"x": {"of": "carriage", "quantity": "position"}}
    return build_rig(RigConfig("mine", parameters=parameters, elements=elements, effects=effects, sensors=sensors))


def recorded(closed: bool, seed: int = 0, **true: float) -> Record:
    t = m.times(10.0)
    loop = {"pid": (4000.0, 2000.0, 900.0), "limit": 10.0} if closed else {}
    command = m.smooth(t, m.steps(t, 0.2, 1.5, seed), 0.5) if closed else m.multisine(t, 3.0, 5.0, seed)
    x, _, u = m.record(m.Machine((95.0,), gain=35.0, **true, **loop), command, 1e-6, seed)
    train = np.arange(len(u)) < 7000
    return Record(m.STEP_S, u, {"x": np.ascontiguousarray(x[:, 0])}, train, ~train)


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.nightly
def test_a_known_effect_that_is_right_is_consistent(closed):
    found = diagnose_records(carriage(), [recorded(closed, viscous=100.0)])
    assert (found.verdict, found.findings) == ("consistent", ())


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.check
def test_a_known_effect_within_its_tolerance_is_recalibrated(closed):
    found = diagnose_records(carriage(), [recorded(closed, viscous=140.0)])
    assert (found.verdict, found.findings) == ("parameters", ())
    moved = found.recalibrated["carriage.viscous_friction.coefficient"]
    assert (moved.nominal, moved.unit) == (100.0, "N s/m")
    assert moved.value == pytest.approx(140.0, rel=0.02)
    assert found.extended.effect(*KEY)["coefficient"] == moved.value


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.nightly
def test_one_that_is_far_from_its_value_is_found_and_not_freed_silently(closed):
    found = diagnose_records(carriage({"value": 100.0, "tolerance": 0.1}), [recorded(closed, viscous=250.0)])
    assert found.verdict == "missing_physics"
    assert [(f.location, f.effect) for f in found.findings] == [KEY]
    low, high = found.findings[0].parameters["coefficient"].ci95
    assert low < 250.0 * 1.01
    assert high > 250.0 * 0.99
    assert "100" in found.findings[0].sentence


@pytest.mark.check
def test_with_what_was_found_the_recording_is_consistent():
    record = recorded(True, viscous=150.0, coulomb=20.0)
    first = diagnose_records(carriage(), [record])
    assert [(f.location, f.effect) for f in first.findings] == [("carriage", "coulomb_friction")]
    again = diagnose_records(first.extended, [record])
    assert (again.verdict, again.findings) == ("consistent", ())


def test_tolerances_survive_the_file():
    import yaml

    from dtbacklash.face.rigs import load_rig

    rig = carriage({"value": 100.0, "tolerance": 0.2}, coulomb_friction={"force": 5.0})
    again = load_rig(yaml.safe_load(rig_yaml(rig)))
    assert again.tolerances == rig.tolerances == {"carriage": {"viscous_friction": {"coefficient": 0.2}}}
    assert again.effects == rig.effects


@pytest.mark.parametrize(
    "leaf", [{"value": 1.0}, {"value": 1.0, "tolerance": 11.0}, {"value": "x", "tolerance": 0.1}, "x"]
)
def test_a_leaf_that_is_none_is_refused(leaf):
    with pytest.raises(UserError, match=r"viscous_friction\.coefficient"):
        carriage(leaf)


@pytest.mark.nightly
def test_another_formulation_of_a_friction_that_the_rig_has_is_not_missing_physics():
    """A steep tangent for the sign of the speed is the dry friction of a simulation that has no events."""
    rig = carriage(100.0, coulomb_friction={"force": 40.0})
    dt, r = m.STEP_S, m.smooth(m.times(10.0), m.steps(m.times(10.0), 0.2, 1.5, 5), 0.5)
    x, v, total, y, u = 0.0, 0.0, 0.0, np.zeros(len(r)), np.zeros(len(r))
    for k in range(len(r)):
        total += (r[k] - x) * dt
        y[k], u[k] = x, np.clip(4000.0 * (r[k] - x) + 2000.0 * total - 900.0 * v, -10.0, 10.0)
        for _ in range(10):
            v += 0.1 * dt * (35.0 * u[k] - 100.0 * v - 40.0 * np.tanh(v / 2e-4)) / 95.0
            x += 0.1 * dt * v
    y += np.random.default_rng(1).normal(0.0, 1e-7, len(y))
    train = np.arange(len(u)) < 6000
    found = diagnose_records(rig, [Record(dt, u, {"x": y}, train, ~train)])
    assert found.verdict in ("consistent", "parameters")
    assert not found.findings


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.nightly
def test_one_that_the_machine_does_not_have_is_said_not_to_be_there(closed, seed):
    rig = carriage({"value": 100.0, "tolerance": 0.1}, coulomb_friction={"force": {"value": 8.0, "tolerance": 0.2}})
    found = diagnose_records(rig, [recorded(closed, seed, viscous=100.0)])
    (finding,) = found.findings
    assert (found.verdict, finding.location, finding.effect) == ("missing_physics", "carriage", "coulomb_friction")
    assert finding.sentence.startswith("Coulomb friction at the carriage is not there")
    low, high = finding.parameters["force"].ci95
    assert low == 0.0
    assert high < 0.8
