"""What belongs to single recordings: how it is named, what is refused, and that a fit frees it there alone."""

import numpy as np
import pytest
from nominal import nominal_rig
from told import refused

import dtbacklash as dtb
from dtbacklash.diagnosis.per_recording_parameters import with_own
from dtbacklash.errors import UserError

MOTION = ("rig=oscillator", "controller=open_loop", "reference=multisine", "reference.f_min_hz=1",
          "reference.f_max_hz=12", "duration_s=4")  # fmt: skip
MASSES = (1.2, 1.5, 1.2)


@pytest.fixture(scope="module")
def rig():
    return nominal_rig("oscillator")


def number(key: str, wanted: str | int) -> int:
    if wanted not in ("a", "b", "c"):
        raise UserError(key, wanted, "is none of the recordings")
    return "abc".index(str(wanted))


def test_a_parameter_a_field_and_an_effect_are_named_as_in_the_rig(rig):
    for name in ("m", "mass.mass"):
        assert with_own(rig, 2, number, [name], None).own == ({"m": 1.2}, {"m": 1.2})
    found = with_own(rig, 2, number, {"b": ["spring.cubic_stiffness"]}, None).own
    assert list(found[1]) == ["spring.cubic_stiffness.k3"]
    assert found[0] == {}


def test_a_given_value_is_in_si_and_of_one_recording(rig):
    found = with_own(rig, 3, number, None, {"b": {"mass.mass": "1500 g"}})
    assert [found.of(k).config.parameters["m"].value for k in range(3)] == pytest.approx([1.2, 1.5, 1.2])
    assert found.with_parameters({"c": 3.0}).of(1).elements["mass"].values["mass"] == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("count", "own", "given", "said"),
    [
        (2, ["carriage.mass"], None, "own=carriage.mass: is no parameter or effect of this rig; its parameters"),
        (2, {"z": ["m"]}, None, "own=z: is none of the recordings"),
        (2, {"b": "m"}, None, "own.b=m: must be a list, as [carriage.mass]"),
        (2, "m", None, "own=m: must be a list"),
        (2, None, {"b": {"m": "3 mm"}}, "given.b.m=3 mm: must be in kg, as m is"),
        (2, None, {"b": {"m": "-3 kg"}}, "given.b.m=-3 kg: must be above 0 kg"),
        (2, None, {"b": {"spring.cubic_stiffness.k4": 1}}, "given.b=spring.cubic_stiffness.k4: is no parameter"),
        (2, None, {"b": 3}, "given.b=3: must be a mapping"),
        (1, ["m"], None, "own=['m']: tells recordings apart: give several"),
    ],
)  # fmt: skip
def test_mistakes_end_in_one_line(rig, count, own, given, said):
    with refused(start=said):
        with_own(rig, count, number, own, given)


@pytest.fixture(scope="module")
def recordings():
    found = []
    for seed, mass in enumerate(MASSES):
        frame = dtb.run(*MOTION, f"seed={seed}", f"rig.parameters.m.value={mass}").recording.to_frame()
        frame = frame[["t_s", "u_v", *(c for c in frame if c.startswith("x"))]]
        rng = np.random.default_rng(seed)
        frame.iloc[:, 2] += rng.normal(0.0, 1e-3 * frame.iloc[:, 2].std(), len(frame))
        found.append(frame)
    return found


@pytest.mark.check
def test_what_is_its_own_is_fitted_in_each(rig, recordings):
    found = dtb.diagnose(recordings, rig, search="none", own=["mass.mass"], trust_units=True)
    table = found.calibration
    masses = [table.loc[f"m in frame ({k})"] for k in (1, 2, 3)]
    assert [row.value for row in masses] == pytest.approx(MASSES, rel=1e-3)
    # three standard errors: of three intervals of 95 %, one misses in one of ten tries
    errors = [(row.high - row.low) / (2 * 1.96) for row in masses]
    assert all(abs(row.value - m) < 3 * error for row, m, error in zip(masses, MASSES, errors, strict=True))
    assert table.loc["k"].value == pytest.approx(1900.0, rel=1e-3)
    assert found.rig.config.parameters["m"].value == pytest.approx(MASSES[-1], rel=1e-3)
    assert found.verdict == "parameters"


@pytest.mark.check
def test_what_is_given_for_one_recording_needs_no_fit(rig, recordings):
    found = dtb.diagnose(recordings[:2], rig, search="none", given={2: {"m": "1.5 kg"}}, trust_units=True)
    assert found.verdict == "consistent"
    assert dtb.diagnose(recordings[:2], rig, search="none", trust_units=True).verdict != "consistent"
