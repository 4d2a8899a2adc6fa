"""Every rig that a diagnosis takes is concealed: moved in its own scales, measured relative to its motion."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.config.groups import options
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import build_rig
from dtbacklash.prove import draw as drawing
from dtbacklash.prove import excitation, tuning
from dtbacklash.prove.draw import draw, entries, record
from dtbacklash.prove.effect_sizes import unknown_entries
from dtbacklash.prove.simulator.rig import check_concealable, simulate_other
from dtbacklash.prove.testbench import rms

STEP_S = 1e-3
OTHERS = (
    "two_mass_stage", "rotary_drive", "pendulum", "oscillator", "emps", "silverbox", "brfd", "disk", "anticogging",
    "servo_arm", "belt_stage",
)  # fmt: skip


def test_every_rig_that_ships_is_taken():
    assert set(options("rig")) == {"lead_screw", *OTHERS}
    for name in options("rig"):
        rig = nominal_rig(name)
        check_concealable(rig)
        assert tuning.fewest_sensors(rig)
        assert unknown_entries(rig)
        assert tuning.in_cascade(rig) == (name == "lead_screw")


@pytest.mark.parametrize("kind", ["nothing", "single", "unknown"])
@pytest.mark.parametrize("name", OTHERS)
def test_what_is_hidden_can_be_seen_and_the_rig_stays_at_work(name, kind, short):
    rig = nominal_rig(name)
    secret = draw(3, rig, kind=kind)
    loop, run = record(secret, rig)
    assert not run.diverged
    assert loop.closed == (secret.controller == "pid")
    assert set(secret.channels) in ({*tuning.fewest_sensors(rig)}, {*rig.sensors})
    hidden = [v for n, v in secret.visibility.items() if n != "parameters"]
    assert len(hidden) == (kind != "nothing")
    assert all(0.5 <= v < 1e4 for v in hidden)
    for sensor in rig.sensors:
        assert rms(run.seen[sensor] - run.truth[sensor]) < 0.02 * np.ptp(run.truth[sensor])
    if kind == "nothing":
        assert secret == draw(3, rig, kind=kind)


@pytest.mark.parametrize("name", ["two_mass_stage", "rotary_drive", "pendulum", "oscillator"])
def test_rigs_are_recorded_in_open_and_in_closed_loop(name):
    rig = nominal_rig(name)
    moves = [excitation.draw_motion(np.random.default_rng(seed), rig, 1.0, STEP_S) for seed in range(20)]
    assert 3 <= sum(bool(move["pid"]) for move in moves) <= 19
    assert {move["pid"] for move in moves} == {"", tuning.plant_of(rig).sensor}


def test_each_rig_draws_from_streams_of_its_own(short):
    rigs = [nominal_rig(name) for name in ("oscillator", "pendulum", "lead_screw")]
    kinds = [[drawing.draw_kind(seed, rig) for seed in range(40)] for rig in rigs]
    assert len({tuple(k) for k in kinds}) == 3
    one, two = (record(draw(3, rig, kind="nothing"), rig)[1] for rig in rigs[:2])
    assert not np.allclose(one.u[:100], two.u[:100])


@pytest.mark.parametrize("name", ["two_mass_stage", "rotary_drive", "pendulum", "oscillator"])
def test_the_command_is_as_large_as_drawn_and_the_loop_follows(name):
    rig = nominal_rig(name)
    rng = np.random.default_rng(4)
    move = next(m for m in (excitation.draw_motion(rng, rig, 6.0, STEP_S) for _ in range(20)) if m["pid"])
    t_s = excitation.times(6.0, STEP_S)
    run = simulate_other(rig, excitation.loop_of_motion(move, t_s, np.zeros(len(t_s))), STEP_S)
    assert rms(run.u) == pytest.approx(move["rms_v"], rel=0.15)
    step = np.full(len(t_s), move["amplitude"])
    held = replace(excitation.loop_of_motion(move, t_s, np.zeros(len(t_s))), reference=step, dither=np.zeros(len(t_s)))
    at = simulate_other(rig, held, STEP_S).truth[move["pid"]]
    assert at[-500:] == pytest.approx(step[-500:], rel=0.05)


def test_the_rule_of_the_pid_crosses_where_it_says():
    """The loop around an inertia has gain 1 at omega, and a phase margin of 45 to 60 degrees."""
    plant, omega = tuning.plant_of(nominal_rig("pendulum")), 30.0
    gains, s = tuning.pid(plant, omega), 1j * omega
    lead = gains["gain"] + gains["rate"] * s / (s + gains["corner_rad_s"])
    integral = gains["integral"] / s
    loop = (lead + integral) * plant.per_volt / (plant.inertia * s**2)
    assert abs(loop) == pytest.approx(1.0, rel=0.04)
    assert 40.0 < np.degrees(np.angle(loop)) + 180.0 < 60.0


def test_the_plant_is_read_off_the_rig():
    stage, drive = tuning.plant_of(nominal_rig("two_mass_stage")), tuning.plant_of(nominal_rig("rotary_drive"))
    assert (stage.driven, stage.sensor, stage.per_volt, stage.inertia) == ("carriage", "x_c", 12.0, 6.5)
    assert stage.drifts
    assert not drive.drifts
    assert drive.per_volt == pytest.approx(0.06 / 1.2)
    assert tuning.plant_of(nominal_rig("oscillator")).grounded
    assert tuning.plant_of(nominal_rig("brfd")).driven == ""


def test_a_free_mass_does_not_drift_away_in_open_loop():
    rig, rng = nominal_rig("two_mass_stage"), np.random.default_rng(0)
    move = next(m for m in (excitation.draw_motion(rng, rig, 8.0, STEP_S) for _ in range(40)) if not m["pid"])
    t_s = excitation.times(8.0, STEP_S)
    loop = excitation.loop_of_motion(move, t_s, np.zeros(len(t_s)))
    drifting = excitation.loop_of_motion({**move, "drifts": False}, t_s, np.zeros(len(t_s)))
    still, away = (simulate_other(rig, one, STEP_S).truth["x_c"] for one in (loop, drifting))
    assert abs(still[2000:].mean()) < 1e-2 * np.std(still)
    assert abs(away[2000:].mean()) > np.std(still)


def test_noise_goes_with_the_motion(short):
    rig = nominal_rig("two_mass_stage")
    larger = rig.with_parameters({"K_f": 120.0})
    one, two = draw(3, rig, kind="nothing"), draw(3, larger, kind="nothing")
    if one.excitation["pid"]:
        assert two.noise["x_c"] == pytest.approx(10.0 * one.noise["x_c"], rel=0.01)
    assert one.excitation["rms_v"] == two.excitation["rms_v"]


def test_a_fast_rig_is_sampled_faster():
    rig = nominal_rig("oscillator")
    assert tuning.sample_time_s(rig) == 1e-3
    assert tuning.sample_time_s(rig.with_parameters({"k": 1900.0 * 40.0**2})) == 0.25e-3


def test_a_rig_that_nothing_moves_or_shows_is_refused_by_name():
    config = nominal_rig("oscillator").config
    alone = {n: e for n, e in config.elements.items() if n in ("mass", "spring")}
    with pytest.raises(
        UserError, match="rig=oscillator: to conceal, a rig that a motor, an actuator, a servo or a positioner"
    ):
        check_concealable(build_rig(replace(config, elements=alone)))
    with pytest.raises(UserError, match=r"rig.sensors=\(none\): to conceal, at least one sensor"):
        check_concealable(build_rig(replace(config, sensors={})))


def test_an_effect_that_only_the_diagnosis_knows_is_not_concealed(monkeypatch):
    rig = nominal_rig("pendulum")
    assert ("disk", "gravity") in entries(rig)
    known = drawing.EFFECTS - {"gravity"}
    monkeypatch.setattr(drawing, "EFFECTS", known)
    monkeypatch.setattr("dtbacklash.prove.simulator.rig.EFFECTS", known)
    assert ("disk", "gravity") not in entries(rig)
    with pytest.raises(UserError, match=r"rig.effects.disk.gravity=.*only effects that the second simulator has"):
        check_concealable(rig.with_effect("disk", "gravity", {"torque": 0.1}))
