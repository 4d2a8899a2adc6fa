"""The bank names the one thing that has changed, with its size, and says `unknown` of what no one change explains."""

import math
from functools import cache

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.config.compose import compose
from dtbacklash.control.belief import Belief, Beliefs
from dtbacklash.errors import UserError
from dtbacklash.experiment.run import run_scenario
from dtbacklash.twin.bank.bank import Buffer, diagnose_buffers

GAP_DEG, OLD_DEG = 40.0, 25.0
NOMINAL = Belief(nominal_rig())
FIRST, SECOND = 7_900, 15_900  # moves down and up
MOTOR = "rig.effects.motor_bearing"
nightly = pytest.mark.nightly


@cache
def run(*changed: str):
    return run_scenario(compose(
        "controller=nimc_fixed", f"controller.gap_hat_deg={OLD_DEG}", "controller.internal_model=inner_loop",
        "profile=constant", f"profile.start_deg={GAP_DEG}", "reference.period_s=16", "duration_s=17.5",
        "sensors=encoder", "figures=false", "seed=3", *changed,
    ), beliefs=Beliefs(NOMINAL, NOMINAL))  # fmt: skip


def buffer(*changed: str, first: int = FIRST) -> Buffer:
    """1.5 s with a move, and the rest before it."""
    u, theta_m, q3 = (run(*changed).seen[name][first : first + 1500].copy() for name in ("u", "theta_m", "q3"))
    return Buffer(u, {"theta_m": theta_m, "q3": q3}, 1e-3)


def said_of(*changed: str, belief: Belief = NOMINAL):
    return diagnose_buffers(belief, [buffer(*changed)], [math.radians(OLD_DEG)])


@pytest.mark.check
def test_a_gap_alone_is_nothing_else_and_is_known():
    said = said_of()
    assert (said.verdict, said.values, said.found) == ("nothing", (), "nothing")
    assert math.degrees(said.gap_rad) == pytest.approx(GAP_DEG, abs=0.3)
    assert said.belief.rig == NOMINAL.rig


CHANGES = [
    ("rig.parameters.k.value=8000", "k", 8000.0),
    pytest.param(f"{MOTOR}.constant_load.torque=0.02", "constant_load motor_bearing", 0.02, marks=nightly),
    pytest.param("rig.effects.amplifier.delay.time=3e-3", "delay amplifier", 3e-3, marks=nightly),
]


@pytest.mark.parametrize(("changed", "name", "value"), CHANGES)
@pytest.mark.check
def test_one_change_is_named_with_its_size(changed, name, value):
    said = said_of(changed)
    assert (said.verdict, said.names) == ("changed", (name,))
    assert said.sure
    assert said.values[0].value == pytest.approx(value, rel=0.02)
    # what it believes now is the machine: nothing is left to be said
    assert said_of(changed, belief=said.belief).verdict == "nothing"


@pytest.mark.check
def test_dry_friction_is_among_the_names_of_one_move_and_of_two():
    changed = f"{MOTOR}.coulomb_friction.torque=0.03"
    one = said_of(changed)
    assert "coulomb_friction motor_bearing" in one.names
    both = diagnose_buffers(
        NOMINAL, [buffer(changed), buffer(changed, first=SECOND)], [math.radians(GAP_DEG), math.radians(GAP_DEG)]
    )
    assert "coulomb_friction motor_bearing" in both.names


@nightly
def test_both_constants_of_a_motor_are_one_change():
    said = said_of("rig.parameters.k_T.value=0.64", "rig.parameters.k_B.value=0.08")
    assert "k_T and k_B" in said.names


@nightly
def test_two_changes_of_the_structure_name_neither_alone():
    said = said_of("rig.parameters.k.value=8000", "rig.effects.mass_3.ground_friction.force=0.2")
    assert said.verdict in ("unknown", "ambiguous")


@pytest.mark.parametrize("spoilt", [lambda y: y[:300], lambda y: np.where(np.arange(y.size) == 7, np.nan, y)])
def test_a_buffer_that_says_nothing_is_refused(spoilt):
    good = buffer()
    with pytest.raises(UserError) as refused:
        diagnose_buffers(NOMINAL, [Buffer(spoilt(good.u), good.y, 1e-3)], [0.0])
    assert refused.value.key == "twin.bank_buffer"
