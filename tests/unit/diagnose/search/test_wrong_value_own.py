"""A parameter that several elements share, and that one of them has differently."""

import numpy as np
import pytest

from dtbacklash.config.rig import ParameterConfig, RigConfig
from dtbacklash.diagnose import Record, diagnose_records
from dtbacklash.diagnose.say.findings import recalibrated
from dtbacklash.diagnose.search.model import WrongValue
from dtbacklash.diagnose.search.wrong_value import split
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.simulate import simulate

from ..conftest import STEP_S, command

MASSES = ("m1", "m2", "m3")


@pytest.fixture(scope="module")
def chain() -> Rig:
    ends = zip(("ground", *MASSES), MASSES, strict=False)
    elements = {
        "amplifier": {"kind": "amplifier", "drives": "shaker"},
        "shaker": {"kind": "actuator", "gain": "g", "drives": "m1"},
        **{name: {"kind": "mass", "mass": "m"} for name in MASSES},
        **{
            f"l{j}": {"kind": "link", "between": [a, b], "stiffness": "k", "damping": "c"}
            for j, (a, b) in enumerate(ends, 1)
        },
    }
    parameters = {
        "g": ParameterConfig(5.0, tolerance=0.02), "m": ParameterConfig(1.5, tolerance=0.05),
        "k": ParameterConfig(2e4, tolerance=0.1), "c": ParameterConfig(8.0, tolerance=0.3),
    }  # fmt: skip
    sensors = {f"x{j}": {"of": name, "quantity": "position"} for j, name in enumerate(MASSES, 1)}
    return build_rig(RigConfig("chain", parameters=parameters, elements=elements, sensors=sensors))


def recorded(rig: Rig, noise: float) -> Record:
    u = command(12.0, 3)
    shown, rng = simulate(rig, u[:-1], STEP_S).sensors, np.random.default_rng(1)
    train = np.arange(len(u)) < 0.6 * len(u)
    y = {f"x{j}": shown[f"x{j}"] + rng.normal(0.0, noise, len(u)) for j in (1, 2, 3)}
    return Record(STEP_S, u, y, train, ~train)


@pytest.mark.parametrize("noise", [1e-5, 1e-7])
@pytest.mark.nightly
def test_one_heavier_mass_of_three_is_a_parameter_however_quiet_the_sensors_are(chain, noise):
    """The regression that chooses it is linear: with quiet sensors it leaves far more than noise."""
    heavier = split(chain, "m", "m2", "mass").with_parameters({"m_m2": 1.077 * 1.5})
    found = diagnose_records(chain, [recorded(heavier, noise)])
    assert (found.verdict, found.findings) == ("parameters", ())
    # all forces, masses and springs may be larger by the same factor, but for their tolerances: the ratio shows
    low, high = found.recalibrated["m_m2"].ci95
    assert low < 1.077 * 1.5 < high
    parameters = found.extended.config.parameters
    assert parameters["m_m2"].value / parameters["m"].value == pytest.approx(1.077, rel=0.001)


@pytest.mark.nightly
def test_beside_an_effect_it_is_a_parameter_too(chain):
    heavier = split(chain, "m", "m2", "mass").with_parameters({"m_m2": 1.077 * 1.5})
    rubbing = heavier.with_effect("m3", "ground_friction", {"force": 0.5})
    found = diagnose_records(chain, [recorded(rubbing, 1e-6)])
    assert found.verdict == "missing_physics"
    assert [(f.location, f.effect) for f in found.findings] == [("m3", "ground_friction")]
    parameters = found.extended.config.parameters
    assert parameters["m_m2"].value / parameters["m"].value == pytest.approx(1.077, rel=0.003)


@pytest.mark.nightly
def test_what_an_own_value_takes_the_place_of_is_said(chain):
    swinging = chain.with_effect("m2", "absorber", {"mass": 0.15, "frequency": 40.0, "damping_ratio": 0.1})
    found = diagnose_records(chain, [recorded(swinging, 3e-5)])
    assert found.verdict == "parameters"
    assert found.summary.startswith("No physics need be missing")
    assert "would explain no less than `m_m2`." in found.summary
    assert "To tell `m_m2` from" in found.next_experiment


@pytest.mark.nightly
def test_an_effect_that_earns_more_than_an_own_value_is_named(chain):
    """An own value that left noise nearly, and something in it, took the place of what leaves noise alone."""
    swinging = chain.with_effect("m2", "absorber", {"mass": 0.15, "frequency": 40.0, "damping_ratio": 0.1})
    found = diagnose_records(chain, [recorded(swinging, 2e-6)])
    assert found.verdict == "missing_physics"
    assert [(f.location, f.effect) for f in found.findings] == [("m2", "absorber")]


@pytest.mark.parametrize(("element", "factor"), [("m2", 1.3), ("m3", 0.7), ("m1", 2.0)])
@pytest.mark.nightly
def test_it_may_lie_far_beyond_the_tolerance(chain, element, factor):
    """A mass 30 % heavier than the others, of which 5 % are known, was absorbers, and what nothing explains."""
    other = split(chain, "m", element, "mass").with_parameters({f"m_{element}": factor * 1.5})
    found = diagnose_records(chain, [recorded(other, 1e-6)])
    assert (found.verdict, found.findings) == ("parameters", ())
    parameters = found.extended.config.parameters
    assert parameters[f"m_{element}"].value / parameters["m"].value == pytest.approx(factor, rel=0.005)
    assert f"`m_{element}` is" in found.summary
    # what is written as the next nominal rig has the tolerance that was given
    assert parameters[f"m_{element}"].tolerance == chain.config.parameters["m"].tolerance


def test_a_parameter_says_what_it_took_the_place_of(chain):
    own = split(chain, "m", "m2", "mass")
    gone = (("m2", "absorber"), ("l2", "cubic_stiffness"))
    beyond = WrongValue("m_m2", 0.05, evidence=None, fitted=None, instead_of=gone)
    rows = recalibrated(own, {"m_m2": (1.6, 0.01), "k": (2.1e4, 10.0)}, beyond)
    assert [(a.location, a.effect) for a in rows["m_m2"].also_fits] == list(gone)
    assert rows["m_m2"].also_fits[0].reason == "with cubic stiffness at the l2"  # together only
    assert rows["m_m2"].to_json()["also_fits"][1]["effect"] == "cubic_stiffness"
    assert "also_fits" not in rows["k"].to_json()
    assert recalibrated(own, {"m_m2": (1.6, 0.01)}, None)["m_m2"].also_fits == ()
