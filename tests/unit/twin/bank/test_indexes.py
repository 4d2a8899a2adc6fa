"""The novelty indexes beside the mode's amplitude: what each sees, and what it does not."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.config.compose import compose
from dtbacklash.control.belief import Belief, Beliefs
from dtbacklash.experiment.run import RunResult, run_scenario
from dtbacklash.physics.rig import build_rig
from dtbacklash.twin.bank.equation import motor_equation, torque_record

ALL = "twin.indexes=[frequency,motor,structure]"
BASE = ("figures=false", "profile=constant", "profile.start_deg=0", "duration_s=30", "sensors=encoder")
NOMINAL = Belief(nominal_rig())


def watched(*overrides: str, believed: Belief = NOMINAL) -> RunResult:
    """A run whose controller and twin believe in ``believed``; the twin is never called."""
    quiet = ("controller=nimc_fixed", "controller.gap_hat_deg=0")
    given = dict(word.split("=", 1) for word in (*BASE, ALL, *quiet, *overrides))
    config = compose(*(f"{key}={value}" for key, value in given.items()))
    return run_scenario(config, beliefs=Beliefs(believed, believed))


def of(result: RunResult) -> set[str]:
    return {alarm["subsystem"] for alarm in result.summary["alarms"]}


def test_indexes_change_nothing_else_and_cost_no_column_when_off() -> None:
    config = compose(*BASE[:-2], "duration_s=5")
    plain, more = run_scenario(config), run_scenario(replace(config, twin=replace(config.twin, indexes=["motor"])))
    assert list(more.trace)[len(list(plain.trace)) :] == ["motor_torque_n_m"]
    assert plain.trace.equals(more.trace[list(plain.trace)])
    assert "alarms" not in plain.summary
    assert more.summary["alarms"] == []
    assert "subsystem" not in plain.estimates


@pytest.mark.parametrize(("k", "low", "high"), [(8000.0, 0.86, 0.91), (12000.0, 1.06, 1.12)])
def test_a_spring_shows_in_the_frequency(k: float, low: float, high: float) -> None:
    """sqrt(0.8) = 0.894 and sqrt(1.2) = 1.095."""
    result = watched(f"rig.parameters.k.value={k}")
    assert low < np.nanmedian(result.trace["frequency_ratio"]) < high
    assert "structure" in of(result)
    assert "motor" not in of(result)
    assert result.trace["motor_torque_n_m"].max() < 2e-4


def test_the_frequency_is_not_told_where_the_mode_does_not_swing() -> None:
    assert watched().trace["frequency_ratio"].isna().all()


def test_a_gap_leaves_frequency_and_motor_alone() -> None:
    result = watched("profile.start_deg=20")
    assert of(result) == {"gap or structure"}
    assert abs(np.nanmedian(result.trace["frequency_ratio"]) - 1.0) < 0.03


@pytest.mark.parametrize(
    ("effect", "least"),
    [("coulomb_friction.torque=0.03", 0.029), ("constant_load.torque=0.02", 0.019), ("cogging.torque=0.03", 0.008)],
)
def test_a_motor_that_rubs_shows_in_its_torque_alone(effect: str, least: float) -> None:
    result = watched(f"rig.effects.motor_bearing.{effect}", "controller.internal_model=inner_loop")
    assert of(result) == {"motor"}
    assert least < result.trace["motor_torque_n_m"].max() < 0.031
    assert result.trace["structure_mm"].max() < 2e-3


def test_what_is_believed_of_the_motor_raises_no_alarm() -> None:
    laws = ("coulomb_friction.torque=0.03", "constant_load.torque=0.01", "viscous_friction.coefficient=0.0005",
            "cogging.torque=0.01")  # fmt: skip
    there = [f"rig.effects.motor_bearing.{law}" for law in laws]
    result = watched(*there, believed=Belief(build_rig(compose(*there).rig)))
    assert result.summary["alarms"] == []


def test_an_index_rises_again_only_after_it_has_fallen() -> None:
    """20 s of a square wave with friction: the torque never falls below the hysteresis while the motor holds."""
    friction = ("rig.effects.motor_bearing.constant_load.torque=0.02", "controller.internal_model=inner_loop")
    once = [a for a in watched(*friction).summary["alarms"] if a["index"] == "motor"]
    assert len(once) == 1


def test_the_motors_equation_is_exact_without_sensors() -> None:
    """Held voltages on the simulated motor: the sampled equation leaves rounding over; a load, itself."""
    loaded = watched("sensors=ideal", "rig.effects.motor_bearing.constant_load.torque=0.02", "profile.start_deg=30",
                     "controller.internal_model=inner_loop")  # fmt: skip
    torque, _ = torque_record(motor_equation(NOMINAL, 40.0, 1e-3), loaded.seen["theta_m"], loaded.seen["u"])
    assert np.allclose(torque[1000:], 0.02, atol=1e-9)
