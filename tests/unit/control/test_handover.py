"""A controller for another model takes over at rest without a jump of the voltage."""

from functools import cache

import numpy as np
import pytest

from dtbacklash.config.compose import compose
from dtbacklash.control.belief import Belief, Beliefs, design_for, settled
from dtbacklash.control.handover import Rest, handed_over
from dtbacklash.control.laws import build_controller, control_step, new_controller_state
from dtbacklash.physics.rig import build_rig

FORMS = ("bare", "measured", "inner_loop", "inverse")


@cache
def controller(form: str, *changed: str):
    config = compose("controller=nimc_twin", f"controller.internal_model={form}", *changed)
    belief = Belief(build_rig(config.rig))
    config = settled(config, Beliefs(belief, belief))
    forward = belief.feed_forward(tuple(config.controller.compensate))
    return build_controller(config.controller, design_for(config, belief), forward)


@cache
def at_rest(form: str, gap=0.5, target=1e-3):
    """A loop on an ideal motor and structure, whose angle and output follow: its controller's states and signals."""
    C = controller(form)
    X, theta_m, q3, u = new_controller_state(C), 0.0, 0.0, 0.0
    screw = 0.0
    for _ in range(12_000):
        u, _ = control_step(C, X, target, theta_m, q3, gap)
        theta_m += 1e-3 * u / 0.1
        screw = min(max(screw, theta_m - gap), theta_m + gap)
        q3 += 0.02 * (3.183098861837907e-4 * screw - q3)
    return X, theta_m, q3, u


@pytest.mark.parametrize("after", FORMS)
@pytest.mark.parametrize("before", ["bare", "inner_loop", "inverse"])
def test_the_voltage_does_not_jump(before, after):
    old, (X, theta_m, q3, u) = controller(before), at_rest(before)
    assert abs(u) < 0.01
    assert q3 == pytest.approx(1e-3, abs=2e-5)
    new = controller(after, "rig.parameters.k.value=8000", "rig.effects.motor_bearing.cogging.torque=0.02")
    Y = handed_over(old, X, new, Rest(1e-3, theta_m, q3, u, 0.5, 0.6))
    first = [control_step(new, Y, 1e-3, theta_m, q3, 0.6)[0] for _ in range(3)]
    # the inverse of the backlash moves by its millisecond, as in any sample
    assert first[0] == pytest.approx(u, abs=3e-4 if after == "inverse" else 1e-6)
    assert np.ptp(first) < 0.02  # and it does not move off: a count of an encoder at 15 V/rad is as much


def test_a_voltage_that_holds_against_friction_stays():
    old, new = controller("inner_loop"), controller("inner_loop", "rig.parameters.k.value=8000")
    X, theta_m, q3, _ = at_rest("inner_loop")
    Y = handed_over(old, X, new, Rest(1e-3, theta_m, q3, 0.3, 0.5, 0.5))
    assert control_step(new, Y, 1e-3, theta_m, q3, 0.5)[0] == pytest.approx(0.3, abs=1e-6)


def test_the_motor_lies_in_the_new_gap_where_it_lay_in_the_old_one():
    C = controller("inner_loop")
    X, theta_m, q3, u = at_rest("inner_loop")
    side = (theta_m - X.theta_d[1]) / 0.5
    Y = handed_over(C, X, C, Rest(1e-3, theta_m, q3, u, 0.5, 0.7))
    assert (theta_m - Y.theta_d[1]) / 0.7 == pytest.approx(side)


def test_only_a_controller_with_a_gap_is_reconfigured():
    C = controller("inner_loop")
    X, theta_m, q3, u = at_rest("inner_loop")
    with pytest.raises(ValueError, match="gap"):
        handed_over(C, X, C._replace(structure=0), Rest(1e-3, theta_m, q3, u, 0.5, 0.5))
