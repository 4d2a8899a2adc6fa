"""The bank names the one thing that has changed, with its size, and says `unknown` of what it does not have."""

import math
from functools import cache

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.config.compose import compose
from dtbacklash.control.belief import Belief, Beliefs
from dtbacklash.errors import UserError
from dtbacklash.experiment.run import run_scenario
from dtbacklash.physics.rig import build_rig
from dtbacklash.twin.bank.bank import Buffer, diagnose_buffer

GAP_DEG, OLD_DEG = 40.0, 25.0
NOMINAL = Belief(nominal_rig())


@cache
def buffer(*changed: str, known: str = "", gap_deg: float = GAP_DEG, sensors: str = "encoder") -> Buffer:
    """1.5 s from a square wave's second move on, with the rest before it, through an encoder."""
    run = run_scenario(compose(
        "controller=nimc_fixed", f"controller.gap_hat_deg={OLD_DEG}", "controller.internal_model=inner_loop",
        "profile=constant", f"profile.start_deg={gap_deg}", "reference.period_s=16", "duration_s=9.5",
        f"sensors={sensors}",
        "figures=false", "seed=3", *changed, *([known] if known else []),
    ), beliefs=Beliefs(NOMINAL, NOMINAL))  # fmt: skip
    return Buffer(*(run.seen[name][7_900:9_400].copy() for name in ("u", "theta_m", "q3")), 1e-3)


def belief(known: str) -> Belief:
    return Belief(build_rig(compose(known).rig))


#: the bank works for a second; the study tries all of it on random machines
nightly = pytest.mark.nightly
FRICTION, MOTOR = "rig.effects.mass_3.ground_friction.force", "rig.effects.motor_bearing"
CHANGES = [(f"{MOTOR}.coulomb_friction.torque=0.03", "Coulomb friction", "motor_bearing", 0.03)]
MORE = [
    ("rig.parameters.k.value=8000", "stiffness", "all links", 8000.0),
    (f"{FRICTION}=0.15", "ground friction", "mass_3", 0.15),
    (f"{MOTOR}.cogging={{torque:0.03,periods:12,phase:1}}", "cogging", "motor_bearing", 0.03),
    ("rig.parameters.c.value=25", "damping", "all links", 25.0),
    ("rig.effects.screw.compliance.compliance=1e-5", "compliance", "screw", 1e-5),
    ("rig.effects.link_1.hysteresis={force:0.2,displacement:2e-5}", "hysteresis", "link_1", 0.2),
    (f"{MOTOR}.viscous_friction.coefficient=7e-4", "viscous friction", "motor_bearing", 7e-4),
    (f"{MOTOR}.constant_load.torque=-0.02", "constant load", "motor_bearing", -0.02),
    ("rig.effects.amplifier.gain_error.relative=0.1", "gain", "amplifier", 0.1),
    ("rig.effects.amplifier.delay.time=1.5e-3", "delay", "amplifier", 1.5e-3),
    ("rig.parameters.k_T.value=0.64", "torque constant", "motor_circuit", 0.64),
]
CHANGES += [pytest.param(*one, marks=nightly) for one in MORE]


@pytest.mark.parametrize(("changed", "kind", "place", "value"), CHANGES)
@pytest.mark.check
def test_one_change_is_named_with_its_size_and_the_gap(changed, kind, place, value):
    said = diagnose_buffer(NOMINAL, buffer(changed), math.radians(OLD_DEG))
    assert said.verdict == "changed"
    (change,) = said.changes
    assert (change.kind, change.place) == (kind, place)
    assert said.found.startswith(f"{kind} {place} ")
    size = change.values[0]
    assert abs(size.value - value) < max(4.0 * size.std, 0.01 * abs(value))
    assert abs(size.value - value) < 0.05 * abs(value)
    error_deg = math.degrees(said.gap_rad) - GAP_DEG
    assert abs(error_deg) < 4.0 * math.degrees(said.gap_std_rad) + 0.05
    # what it believes now is the machine: nothing is left to be said
    again = diagnose_buffer(said.belief, buffer(changed), said.gap_rad)
    assert again.verdict in ("nothing", "gap")
    assert again.belief.rig.effects == said.belief.rig.effects


@pytest.mark.parametrize(("gap_deg", "verdict"), [(GAP_DEG, "gap"), pytest.param(OLD_DEG, "nothing", marks=nightly)])
@pytest.mark.check
def test_a_gap_alone_is_a_gap_alone(gap_deg, verdict):
    said = diagnose_buffer(NOMINAL, buffer(gap_deg=gap_deg), math.radians(OLD_DEG))
    assert (said.verdict, said.changes, said.found) == (verdict, (), verdict)
    assert math.degrees(said.gap_rad) == pytest.approx(gap_deg, abs=0.1)
    assert said.belief.rig == NOMINAL.rig


UNKNOWN = [
    "rig.effects.link_1.cubic_stiffness.k3=2e12",
    *(pytest.param(changed, marks=nightly) for changed in (
        "rig.effects.motor_bearing.asymmetric_friction.viscous_difference=5e-4",
        "rig.effects.screw.pitch_error.amplitude=1e-5", "rig.effects.link_2.backlash.lost_motion=1e-5",
        "rig.parameters.m.value=4.5", "rig.effects.mass_2.absorber={mass:0.5,frequency:6}",
    )),
]  # fmt: skip


@pytest.mark.parametrize("changed", UNKNOWN)
@pytest.mark.check
def test_what_is_not_in_the_bank_is_unknown(changed):
    said = diagnose_buffer(NOMINAL, buffer(changed), math.radians(OLD_DEG))
    assert said.verdict in ("unknown", "ambiguous")
    assert not said.changes
    assert said.belief.rig == NOMINAL.rig


@pytest.mark.parametrize("delay_s", [3.3e-4, pytest.param(2e-4, marks=nightly), pytest.param(7e-4, marks=nightly)])
@pytest.mark.check
def test_a_delay_of_tenths_of_a_millisecond_is_no_weaker_motor(delay_s):
    said = diagnose_buffer(NOMINAL, buffer(f"rig.effects.amplifier.delay.time={delay_s}"), math.radians(OLD_DEG))
    assert (said.verdict, set(said.names)) == ("ambiguous", {"torque constant motor_circuit", "delay amplifier"})
    assert said.belief.rig == NOMINAL.rig


@nightly
def test_two_changes_of_the_structure_are_unknown():
    both = buffer("rig.parameters.k.value=8000", "rig.effects.mass_3.ground_friction.force=0.2")
    assert diagnose_buffer(NOMINAL, both, math.radians(OLD_DEG)).verdict == "unknown"


@nightly
def test_one_of_each_half_is_two_findings():
    both = buffer("rig.parameters.k.value=8000", "rig.effects.motor_bearing.viscous_friction.coefficient=1e-3")
    said = diagnose_buffer(NOMINAL, both, math.radians(OLD_DEG))
    assert [change.kind for change in said.changes] == ["stiffness", "viscous friction"]
    assert said.belief.rig.config.parameters["k"].value == pytest.approx(8000.0, rel=0.01)
    assert said.belief.rig.effect("motor_bearing", "viscous_friction")["coefficient"] == pytest.approx(1e-3, rel=0.02)


@pytest.mark.parametrize("known", [
    "rig.effects.motor_bearing.coulomb_friction.torque=0.02",
    pytest.param("rig.effects.mass_3.ground_friction.force=0.1", marks=nightly),
])  # fmt: skip
@nightly
def test_what_is_known_already_is_the_base(known):
    said = diagnose_buffer(belief(known), buffer("rig.parameters.k.value=8500", known=known), math.radians(OLD_DEG))
    assert [change.kind for change in said.changes] == ["stiffness"]
    assert said.changes[0].values[0].value == pytest.approx(8500.0, rel=0.01)
    ((place, there),) = belief(known).rig.effects.items()
    assert said.belief.rig.effects[place] == there


@nightly
def test_dry_friction_that_hides_the_gap_has_a_wide_interval():
    """Behind strong friction that turns round once, what the mass held at rest, its level and the gap trade."""
    said = diagnose_buffer(NOMINAL, buffer("rig.effects.mass_3.ground_friction.force=0.4"), math.radians(OLD_DEG))
    assert said.changes[0].kind == "ground friction"
    assert abs(math.degrees(said.gap_rad) - GAP_DEG) < 3.0 * math.degrees(said.gap_std_rad) + 0.05


@pytest.mark.parametrize("spoilt", [lambda y: y[:300], lambda y: np.where(np.arange(y.size) == 7, np.nan, y)])
def test_a_buffer_that_says_nothing_is_refused(spoilt):
    good = buffer()
    with pytest.raises(UserError, match="bank_buffer"):
        diagnose_buffer(NOMINAL, Buffer(*(spoilt(y) for y in (good.u, good.theta_m, good.q3)), 1e-3), 0.0)
