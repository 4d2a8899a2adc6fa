"""PID, LQG and offset controller: their laws beside python-control's, and what they do with and without a gap."""

import json
import math

import control
import numpy as np
import pytest
from told import refused

from dtbacklash.config.compose import compose
from dtbacklash.control import observer, rivals
from dtbacklash.control.belief import Belief, beliefs_of, design_for
from dtbacklash.control.chain import motor_tf, structure_tf
from dtbacklash.errors import Diverged
from dtbacklash.experiment.run import run_scenario
from dtbacklash.physics.rig import build_rig

BELIEF = beliefs_of(compose("controller=imc")).design
LINEAR = BELIEF.linear()
K_THETA, TAU_R, STEP = 15.0, 1 / 6, 1e-3
SYSTEM = observer.plant(LINEAR.motor, LINEAR.structure, STEP)
MAIN = ("sensors=encoder", "controller.limit_v=12")


def law_of(*words):
    return design_for(compose(*words), BELIEF).law


def free(law):
    """The law within its limit: u from (r, theta_m, q3), as a system of python-control."""
    return control.ss(law.A + np.outer(law.E, law.C), law.B + np.outer(law.E, law.D), law.C[None], law.D[None], STEP)


def loop_poles(law):
    a, b, c = SYSTEM
    own = free(law)
    into = np.asarray(own.B)[:, 1:] @ c
    return np.linalg.eigvals(np.block([[a + np.outer(b, law.D[1:] @ c), np.outer(b, law.C)], [into, own.A]]))


def test_the_pid_is_the_sampled_controller_of_its_gains_and_as_damped_as_its_sensitivity_allows():
    design = design_for(compose("controller=pid"), BELIEF)
    direct, slow, fast, kept = rivals.pid_parts(design, SYSTEM, 1.0 / LINEAR.structure.pitch_m_per_rad)
    tf = -STEP / math.log(kept)
    s = control.tf("s")
    own = control.c2d(direct + slow / s + fast / (tf * s + 1), STEP, "zoh")
    z = np.exp(1j * np.geomspace(0.1, 1000, 50) * STEP)
    found = control.frequency_response(free(design.law), np.geomspace(0.1, 1000, 50)).complex
    assert found[0, 1] == pytest.approx(np.full(50, -K_THETA), rel=1e-9)
    assert found[0, 2] == pytest.approx(-K_THETA * own(z), rel=1e-6)
    servo = control.feedback(K_THETA * motor_tf(LINEAR.motor), 1)
    omega = np.geomspace(1, 500, 2000)
    loop = control.frequency_response(
        servo * structure_tf(LINEAR.structure) * (direct + slow / s + fast / (tf * s + 1)), omega
    ).complex
    assert np.max(1 / np.abs(1 + loop)) == pytest.approx(rivals.SENSITIVITY, rel=0.03)
    leading = np.abs(loop_poles(design.law))  # but for the prefilter and the motion that it leads, which are open
    assert np.max(leading) < 1.0


def test_the_lqg_has_the_poles_of_its_feedback_and_of_its_filter():
    law, (a, b, c) = law_of("controller=lqg"), SYSTEM
    n = b.size
    wide = np.block([[a, np.zeros((n, 1))], [-STEP * c[1:], np.ones((1, 1))]])
    cost = np.zeros((n + 1, n + 1))
    cost[:n, :n] = np.outer(c[1], c[1]) / rivals.ERROR_M**2
    cost[n, n] = 1 / (rivals.ERROR_M * TAU_R) ** 2
    _, _, poles = control.dlqr(wide, np.append(b, 0.0)[:, None], cost, [[1 / rivals.EFFORT_V**2]])
    noise = np.diag([observer.ANGLE_RAD**2, observer.OUTPUT_M**2])
    _, _, filtering = control.dlqe(a, b[:, None], c, [[observer.DISTURBING_V**2]], noise)
    found = loop_poles(law)
    assert np.abs(found).max() < 1.0
    for pole in (*poles, *filtering):
        assert np.abs(found - pole).min() < 1e-5


def test_the_offset_controller_follows_the_prefilter_and_needs_no_feedback_where_the_model_is_right():
    law, (a, b, c) = law_of("controller=offset"), SYSTEM
    x, state, out = np.zeros(b.size), np.zeros(law.C.size), []
    for _ in range(3000):
        y = np.array([1e-3, *c @ x])
        u = law.C @ state + law.D @ y
        state = law.A @ state + law.B @ y + law.E * u
        x = a @ x + b * u
        out.append(y[2])
    assert state[: b.size] == pytest.approx(x, abs=1e-9)  # the observer has nothing to correct
    assert state[b.size : b.size + 2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert out[-1] == pytest.approx(1e-3, rel=1e-4)
    assert max(out) < 1.001e-3


@pytest.mark.parametrize(("bound", "most_pct", "settles_s"), [(1.0, 0.2, 0.92), (None, 0.1, 0.8)])
def test_the_offset_controller_in_the_main_scenario(bound, most_pct, settles_s):
    bound = "null" if bound is None else bound
    found = run_scenario(compose("controller=offset", f"controller.robust={bound}", *MAIN)).summary
    assert found["overshoot_pct_max"] < most_pct
    assert found["settling_time_s_max"] < settles_s
    assert found["peak_voltage_v"] < 8.0
    assert found["margins"]["ms"] < 1.1
    assert bound == "null" or found["margins"]["small_gain"] <= 1.0


def test_a_bound_below_what_the_motor_alone_gives_is_refused():
    with refused(key="controller.robust"):
        law_of("controller=offset", "controller.robust=0.01")


@pytest.mark.parametrize("name", ["lqg", "mpc", "offset"])
def test_the_filter_takes_its_noise_from_the_sensors(name):
    """At 50 um of noise the voltage at rest is quiet; with what the filter was told before it is not."""
    words = ("profile=constant", "profile.start_deg=0", "reference=step", "reference.amplitude_mm=0", "duration_s=5",
             "+sensors.noise.q3_mm=0.05", f"controller={name}")  # fmt: skip
    told = run_scenario(compose(*words)).seen["u"]
    assert np.std(told[1000:]) < 0.1
    rig = build_rig(compose(*words).rig)
    assert Belief(rig).noise(compose(*words).sensors) == pytest.approx((0.0, 5e-5))
    assert Belief(rig).noise(compose("sensors=encoder").sensors) == pytest.approx(
        (observer.ANGLE_RAD, math.hypot(1e-6, 5e-7 / math.sqrt(12))), rel=1e-6
    )


@pytest.mark.parametrize(
    ("name", "limit_v", "gap_deg", "most_pct", "settles_s"),
    [("pid", 12, 0, 0.3, 0.85), ("pid", 12, 100, 0.3, 0.95), ("pid", 6, 0, 2, 1.2), ("lqg", 12, 0, 2, 0.9),
     ("lqg", 1.5, 0, 2, 1.2), ("offset", 12, 100, 0.3, 0.95), ("offset", 1.5, 0, 3, 1.3)],
)  # fmt: skip
def test_they_settle_also_at_a_limit_that_they_reach(name, limit_v, gap_deg, most_pct, settles_s):
    words = ("profile=constant", f"profile.start_deg={gap_deg}", "reference.period_s=6", "duration_s=6")
    result = run_scenario(compose(f"controller={name}", f"controller.limit_v={limit_v}", *words))
    assert result.summary["overshoot_pct_max"] < most_pct
    assert result.summary["settling_time_s_max"] < settles_s
    assert result.summary["peak_voltage_v"] <= limit_v


@pytest.mark.parametrize(
    "words", [("controller=nimc_fixed", "controller.gap_hat_deg=60"), ("controller=offset",), ("controller=pid",)]
)
def test_a_trajectory_over_a_gap_ends_without_overshoot(words):
    """Without the plan, the motor crossing when the load should move, NIMC overshoots by 1.4 % and settles in 2 s."""
    run = ("profile=constant", "profile.start_deg=60", "reference=trajectory", "reference.period_s=8", "duration_s=8")
    found = run_scenario(compose(*words, *run, *MAIN)).moves
    assert list(found["to_mm"]) == pytest.approx([1.0, -1.0])
    assert found["overshoot_pct"].max() < 0.1
    assert found["settling_time_s"].max() < 1.45
    assert found["peak_voltage_v"].max() <= 12.0


LAW = {"A": [[1.0]], "B": [[0.001, 0.0, -0.001]], "C": [6e4], "D": [0.0, -15.0, 0.0]}


@pytest.mark.parametrize(("changed", "said"), [
    ({"D": None}, "must have the matrices A, B, C, D"),
    ({"F": [1.0]}, "and nothing else"),
    ({"A": [[1.0, 2.0]]}, "A must have the shape (1, 1), as C has 1 states"),
    ({"D": [1.0, 2.0]}, "D must have the shape (3,)"),
    ({"B": [["a", 0.0, 0.0]]}, "B must have the shape (1, 3)"),
    ({"A": [[math.nan]]}, "A must be of finite numbers"),
    ("A: [", ""), ("x", "must have the matrices"), (None, "can be read"),
])  # fmt: skip
def test_a_law_that_is_none_is_refused(tmp_path, changed, said):
    path = tmp_path / "law.yaml"
    if isinstance(changed, dict):
        changed = json.dumps({k: v for k, v in (LAW | changed).items() if v is not None}).replace("NaN", ".nan")
    if changed:
        path.write_text(changed)
    for given, line in ((path, said), (tmp_path, "can be read"), ("null", "give a YAML file")):
        with refused(line, key="controller.file", start=f"controller.file={given}: "):
            law_of("controller=state_space", f"controller.file={given}")


def test_a_law_from_a_file_gives_the_voltages_of_the_controller_that_it_was_taken_from(tmp_path):
    words = ("sensors=encoder", "controller.limit_v=1", "duration_s=4", "reference.period_s=2")
    law = design_for(compose("controller=lqg", *words), beliefs_of(compose("controller=lqg", *words)).design).law
    path = tmp_path / "law.yaml"
    path.write_text(json.dumps({name: getattr(law, name).tolist() for name in "ABCDE"}))
    own = run_scenario(compose("controller=state_space", f"controller.file={path}", "controller.compensate=[]", *words))
    runs = [run_scenario(compose("controller=lqg", *words)).seen["u"], own.seen["u"]]
    assert own.summary["margins"]["ms"] < 1.2
    assert np.abs(runs[0]).max() == pytest.approx(1.0)
    assert np.array_equal(*runs)


def test_of_an_unstable_law_it_is_said_before_the_machine_is_blamed(tmp_path):
    path = tmp_path / "law.yaml"
    path.write_text(json.dumps(LAW | {"D": [0.0, 150.0, 0.0]}))  # a wrong sign
    with pytest.raises(Diverged, match=r"law\.yaml is unstable: a pole at a distance of 2\.0"):
        run_scenario(compose("controller=state_space", f"controller.file={path}", "duration_s=1"))
    # beside a stable one there is no such word, though the machine is another and diverges
    path.write_text(json.dumps(LAW))
    with pytest.raises(Diverged) as diverged:
        run_scenario(compose("controller=state_space", f"controller.file={path}", "duration_s=20", "model=lead_screw",
                             "rig.parameters.k_B.value=1e-4", "rig.parameters.k_T.value=80"))  # fmt: skip
    assert "unstable" not in str(diverged.value)
