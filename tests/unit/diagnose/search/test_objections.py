"""What a name has to stand, on machines of an independent simulator: bounds and free simulation."""

from dataclasses import replace

import machines as m
import numpy as np
import pytest
from machine_cases import rig as rig_of

from dtbacklash.diagnose import Record, diagnose_records
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.search.objections import hands_back, raises_the_error
from dtbacklash.diagnose.search.parts import divided, for_judgement, marked
from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.effects.declare import Place

STAGE = {
    "amplifier": {"kind": "amplifier", "drives": "motor"},
    "motor": {"kind": "actuator", "gain": "g", "drives": "mass_1"},
    "mass_1": {"kind": "mass", "mass": "m"},
    "link_1": {"kind": "link", "between": ["mass_1", "mass_2"], "stiffness": "k", "damping": "c"},
    "mass_2": {"kind": "mass", "mass": "m", "ground_stiffness": "kg", "ground_damping": "cg"},
}
ENDS = {"x1": {"of": "mass_1", "quantity": "position"}, "x2": {"of": "mass_2", "quantity": "position"}}


def record(x: np.ndarray, u: np.ndarray, *names: str, share: float = 0.6) -> Record:
    train = np.arange(len(u)) < round(share * len(u))
    return Record(m.STEP_S, u, {n: np.ascontiguousarray(x[:, j]) for j, n in enumerate(names)}, train, ~train)


@pytest.fixture(scope="module")
def dry(carriage) -> Record:
    """A carriage with dry friction that takes most of its drive."""
    u = m.multisine(m.times(10.0), 1.0, 5.0, 3)
    x, _, _ = m.record(m.Machine((95.0,), gain=35.0, coulomb=25.0), u, 1e-6, 3)
    return record(x, u, "x")


def test_a_dead_zone_wider_than_the_commands_is_out_of_sight(carriage, dry):
    evidence = Evidence.gather(carriage, divided([dry]))
    key, widest = ("amplifier", "dead_zone"), np.quantile(np.abs(dry.u), 0.98)
    assert evidence.bounds(key)["half_width"] == (0.0, pytest.approx(widest))


def test_a_limit_below_nearly_all_commands_is_out_of_sight(carriage, dry):
    evidence = Evidence.gather(carriage, [dry])
    key, lowest = ("amplifier", "saturation"), np.quantile(np.abs(dry.u[dry.u != 0.0]), 0.02)
    assert evidence.bounds(key)["limit"] == pytest.approx((lowest, np.abs(dry.u).max()))


def test_of_a_square_wave_a_limit_is_seen_down_to_half_of_it(carriage, dry):
    square = replace(dry, u=2.0 * np.sign(dry.u))
    assert Evidence.gather(carriage, [square]).bounds(("amplifier", "saturation"))["limit"] == (1.0, 2.0)


def test_an_effect_that_raises_the_error_is_the_one_to_go(carriage, dry):
    """Friction is there and what else is named is not: without that, less is left."""
    evidence = Evidence.gather(carriage, divided([dry]))
    rubbing = carriage.with_effect("carriage", "coulomb_friction", {"force": 25.0})
    pushed = rubbing.with_effect("carriage", "constant_force", {"force": 5.0})
    nominal, right, both = (fit(evidence, rig, []) for rig in (carriage, rubbing, pushed))
    order = (("carriage", "coulomb_friction"), ("carriage", "constant_force"))
    assert raises_the_error(evidence, nominal, right, order[:1]) is None
    assert raises_the_error(evidence, nominal, both, order) == order[1]
    assert raises_the_error(evidence, right, nominal, order[:1]) == order[0], "worse than with none of them"


def test_what_a_command_drives_has_no_error_of_the_method(carriage):
    """A sensor of next to no noise then says all that it resolves; only an angle that is imposed is known roughly."""
    u = m.multisine(m.times(10.0), 1.0, 5.0, 3)
    x, _, _ = m.record(m.Machine((95.0,), gain=35.0), u, 0.0, 3)
    evidence = Evidence.gather(carriage, divided([record(x, u, "x")]))
    assert evidence.least()["rig"].tolist() == [1.0]


def test_a_drive_that_is_switched_off_hands_the_measurement_back(carriage):
    u = m.multisine(m.times(10.0), 1.0, 5.0, 3)
    x, _, _ = m.record(m.Machine((95.0,), gain=35.0, viscous=60.0), u, 1e-6, 3)
    evidence = Evidence.gather(carriage, divided([record(x, u, "x")]))
    key = ("amplifier", "dead_zone")
    right = fit(evidence, carriage.with_effect("carriage", "viscous_friction", {"coefficient": 60.0}), [])
    off = fit(evidence, right.rig.with_effect(*key, {"half_width": 1e2}), [])
    both = [("carriage", "viscous_friction"), key]
    assert hands_back(evidence, right, off, both) == key
    nominal = fit(evidence, carriage, nominal_free(carriage))
    assert hands_back(evidence, nominal, right, both[:1]) is None


@pytest.mark.check
def test_friction_that_takes_most_of_the_drive_is_no_dead_zone(carriage, dry):
    found = diagnose_records(carriage, [dry])
    assert [(f.location, f.effect) for f in found.findings] == [("carriage", "coulomb_friction")]
    assert found.findings[0].parameters["force"].value == pytest.approx(25.0, rel=0.02)
    assert found.findings[0].confidence == "sure"


@pytest.mark.parametrize("heavier", ["mass_1", "mass_2"])
@pytest.mark.nightly
def test_one_heavier_mass_of_two_that_share_a_parameter_is_no_absorber(heavier):
    rig = rig_of(STAGE, ENDS, g=10.0, m=3.0, k=4000.0, c=4.0, kg=500.0, cg=3.0)
    inertia = (3.24, 3.0) if heavier == "mass_1" else (3.0, 3.24)
    u = m.multisine(m.times(10.0), 1.0, 15.0, 4)
    machine = m.Machine(inertia, gain=10.0, ground=500.0, ground_damping=3.0, link=4000.0, link_damping=4.0)
    x, _, _ = m.record(machine, u, 4e-5, 4)  # the integrator of the machine errs by some 5e-6
    found = diagnose_records(rig, [record(x, u, "x1", "x2")])
    assert (found.verdict, found.findings) == ("parameters", ())
    own = found.recalibrated[f"m_{heavier}"]
    assert own.nominal == 3.0
    # all masses, springs and forces may grow alike, which no position shows
    assert own.value / found.extended.config.parameters["m"].value == pytest.approx(1.08, rel=2e-3)


def test_what_is_periodic_is_seen_within_what_is_recorded():
    place = Place(duration_s=10.0, sample_time_s=1e-3, speed=50.0, speed_slow=20.0, way=1.2)
    low, high = CATALOGUE["mass", "absorber"].bounds_at(place)["frequency"]
    assert (low, high) == (pytest.approx(0.2), pytest.approx(250.0))
    low, high = CATALOGUE["rotor", "cogging"].bounds_at(place)["periods"]
    assert low == pytest.approx(np.pi / 1.2)
    assert high == pytest.approx(2 * np.pi * 250.0 / 20.0)


def test_cogs_that_are_passed_too_fast_always_are_no_candidate():
    """A rotor that never turns slowly: less than four samples for the longest wave that the law may have."""
    cogging = CATALOGUE["rotor", "cogging"]
    place = Place(duration_s=10.0, sample_time_s=0.1, speed=70.0, speed_slow=20.0, way=500.0)
    assert not cogging.is_shown(place)
    assert cogging.is_shown(replace(place, speed_slow=2.0))
    assert not cogging.is_shown(replace(place, speed_slow=0.0, way=1e-3)), "half of its shortest wave is longer"


def test_a_rest_is_not_a_slow_motion(rig):
    """Half of the time it stands, elsewhere it turns at one speed: a wave has four samples there, or none has."""
    t = np.arange(4001) * 1e-3
    angle = 60.0 * np.abs((t + 1.0) % 4.0 - 2.0).clip(0.5, 1.5)
    record = Record(1e-3, np.sign(t - 2.0), {"theta_m": angle, "q3": np.zeros(len(t))}, t < 3.0, t >= 3.0)
    evidence = Evidence.gather(rig, [record])
    assert evidence.moving("motor_bearing").speed_slow == pytest.approx(60.0, rel=0.02)


def test_what_judges_neither_fits_nor_chooses(carriage, dry):
    (split,) = divided([dry])
    assert not np.any(split.judge & (split.held | split.train))
    assert not np.any(split.held & split.train)
    assert np.all(split.judge | split.held | split.train)
    assert split.judge.sum() + split.held.sum() == pytest.approx(dry.held.sum(), abs=4)
    assert split.judge.sum() == round(0.375 * dry.held.sum())
    assert np.array_equal(marked([dry])[0].held, dry.held)
    (last,) = for_judgement(Evidence.gather(carriage, [split])).records
    assert np.array_equal(last.held, split.judge)
    assert np.array_equal(last.train, ~split.judge)


@pytest.mark.parametrize("place", ["amplifier", "sensor_x"])
def test_a_gain_that_is_off_by_a_factor_of_ten_is_no_gain_error(carriage, dry, place):
    assert Evidence.gather(carriage, [dry]).bounds((place, "gain_error"))["relative"] == (-0.9, 9.0)
