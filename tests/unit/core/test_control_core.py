"""A sample of every controller and the motor's equation beside the same in Python, bit for bit."""

import numpy as np
import pytest
from oracle import control as oracle

from dtbacklash.config.compose import compose
from dtbacklash.control.belief import beliefs_of, design_for, settled
from dtbacklash.control.laws import build_controller, control_step, crossing_samples, feed_forward, new_controller_state
from dtbacklash.twin.bank.equation import motor_equation, torque_record

SAMPLES = 400
CONTROLLERS = [
    *(["controller=imc", f"controller.internal_model={m}"] for m in ("bare", "measured", "exact", "inner_loop")),
    *(
        ["controller=nimc_fixed", f"controller.internal_model={m}"]
        for m in ("bare", "measured", "inner_loop", "inverse")
    ),
    ["controller=nimc_fixed", "controller.crossing=hold"],
    ["controller=nimc_fixed", "controller.limit_v=1.5"],
    ["controller=nimc_fixed", "rig.effects.motor_bearing.cogging.torque=0.02"],
    ["controller=nimc_fixed", "rig.effects.amplifier.delay.time=0.0037"],
    *([f"controller={name}"] for name in ("mpc", "lqg", "pid", "offset")),
]


def designed(words):
    asked = compose(*words)
    beliefs = beliefs_of(asked)
    config = settled(asked, beliefs)
    design = design_for(config, beliefs.design)
    return build_controller(
        config.controller, design, beliefs.design.feed_forward(config.controller.compensate)
    ), beliefs


@pytest.mark.parametrize("words", CONTROLLERS, ids=" ".join)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_controller_answers_as_its_oracle(words, seed):
    random = np.random.default_rng(seed)
    controller, _ = designed(words)
    ours, theirs = new_controller_state(controller), new_controller_state(controller)
    gap = 0.0
    for k in range(SAMPLES):
        r = 1e-3 * np.sign(np.sin(k / 60.0)) + 1e-5 * random.standard_normal()
        theta_m, q3 = 3.0 * np.sin(k / 37.0) + 0.01 * random.standard_normal(), 8e-4 * np.sin(k / 40.0)
        growth = 2e-4 if 50 < k < 200 else 0.0
        gap = random.uniform(0.0, 2.0) if k % 90 == 89 else gap + growth
        toward = float(np.sign(np.sin(k / 60.0 + 0.1))) if k % 7 == 0 else 0.0
        given = (float(r), float(theta_m), float(q3), float(gap), growth, toward)
        assert control_step(controller, ours, *given) == oracle.control_step(controller, theirs, *given)
    for mine, other in zip(ours, theirs, strict=True):
        assert np.array_equal(mine, other)
    assert crossing_samples(controller, gap) == oracle.crossing_samples(controller, gap)
    assert feed_forward(controller, ours, 0.4) == oracle.feed_forward(controller, theirs, 0.4)


def test_the_motor_equation_leaves_over_what_its_oracle_does():
    _, beliefs = designed(["controller=nimc_fixed", "rig.effects.motor_bearing.cogging.torque=0.02",
                           "rig.effects.motor_bearing.coulomb_friction.torque=0.01"])  # fmt: skip
    equation, k = motor_equation(beliefs.twin, 40.0, 1e-3), np.arange(1500)
    theta, u = 3.0 * np.sin(k / 200.0), 2.0 * np.sign(np.sin(k / 90.0))
    torque, speed = torque_record(equation, theta, u)
    past, lags = np.repeat([theta[0], u[0]], 4), np.zeros(9)
    rows = [oracle.residual_torque(equation, past, lags, a, v) for a, v in zip(theta, u, strict=True)]
    assert np.array_equal(np.column_stack([torque, speed]), np.array(rows))
