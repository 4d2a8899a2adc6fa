"""The concealing simulator on rigs without a screw: against the diagnosis' own, and against the tests' reference."""

import numpy as np
import pytest
from reference import solve

from dtbacklash.physics.catalogue import effects_of
from dtbacklash.physics.simulate import simulate
from dtbacklash.prove.bench import rms
from dtbacklash.prove.conceal import nominal_rig
from dtbacklash.prove.draw import entries
from dtbacklash.prove.simulator.given import Loop
from dtbacklash.prove.simulator.laws import held_stretch
from dtbacklash.prove.simulator.rig import simulate_other
from dtbacklash.prove.sizes import motion_of

STEP_S, SECONDS = 1e-3, 1.0
RIGS = ("two_mass_stage", "rotary_drive", "pendulum", "oscillator")
#: how far two simulations may differ, as a share of what the effect changes: smooth laws, and those with a rest
SHARE, SHARE_REST = 2e-3, 4e-2
RESTS = {"coulomb_friction", "stribeck_friction", "dry_friction", "ground_friction"}
#: of the signal, where a body is held by a brake that the nominal model has
SHARE_BRAKE = 5e-3


def command(seconds=SECONDS):
    """(N+1,) V, three tones that begin softly."""
    t = STEP_S * np.arange(round(seconds / STEP_S) + 1)
    tones = np.sin(2 * np.pi * 3 * t) + 0.7 * np.sin(2 * np.pi * 7.3 * t + 0.3) + 0.5 * np.sin(2 * np.pi * 13 * t)
    return tones * -np.expm1(-t / 0.05)


def given(u):
    return Loop(False, u, np.zeros(len(u)), np.zeros(len(u)))


@pytest.fixture(scope="module")
def plain():
    """Per rig: rig, how it moves, and what its sensors show."""
    found, u = {}, command()
    for name in RIGS:
        rig = nominal_rig(name)
        run = simulate_other(rig, given(u), STEP_S)
        found[name] = rig, motion_of(rig, run, SECONDS, 13.0), simulate(rig, u[:-1], STEP_S).sensors
    return found


@pytest.mark.parametrize("name", [*RIGS, "emps", "silverbox"])
def test_without_effects_both_agree(name):
    rig, u = nominal_rig(name), command()
    run, house = simulate_other(rig, given(u), STEP_S), simulate(rig, u[:-1], STEP_S)
    for sensor in rig.sensors:
        assert rms(run.truth[sensor] - house.sensors[sensor]) < 1e-9 * rms(house.sensors[sensor])


def test_a_brake_behind_a_coupling_slips_alike():
    rig, u = nominal_rig("brfd"), 2.5 * command()
    run, house = simulate_other(rig, given(u), STEP_S), simulate(rig, u[:-1], STEP_S, substeps=32)
    assert rms(run.truth["force"] - house.sensors["force"]) < SHARE_BRAKE * rms(house.sensors["force"])


@pytest.mark.parametrize(
    ("name", "place", "effect"), [(name, *entry) for name in RIGS for entry in entries(nominal_rig(name))]
)
def test_every_effect_agrees_to_a_small_share_of_itself(name, place, effect, plain):
    rig, moving, before = plain[name]
    declared, u = effects_of(rig.kind_at(place))[effect], command()
    shape = declared.draw_shape(np.random.default_rng(1), moving.at(place))
    changed = rig.with_effect(place, effect, shape.values(shape.guess))
    run, house = simulate_other(changed, given(u), STEP_S), simulate(changed, u[:-1], STEP_S, substeps=32).sensors
    sensor = max(rig.sensors, key=lambda s: rms(house[s] - before[s]) / rms(before[s]))
    difference = rms(house[sensor] - before[sensor])
    assert difference > 1e-4 * rms(before[sensor])
    assert rms(run.truth[sensor] - house[sensor]) < (SHARE_REST if effect in RESTS else SHARE) * difference


@pytest.mark.parametrize(
    ("name", "place", "effect", "values"),
    [
        ("rotary_drive", "shaft", "backlash", {"lost_motion": 0.02}),
        ("rotary_drive", "shaft", "hysteresis", {"torque": 0.02, "displacement": 0.004}),
        ("rotary_drive", "load", "gravity", {"torque": 0.02, "phase": 0.5}),
        ("rotary_drive", "motor", "torque_ripple", {"relative": 0.2, "periods": 4.0, "phase": 0.3}),
        ("pendulum", "disk", "gravity", {"torque": 0.4, "phase": 1.0}),
        ("two_mass_stage", "carriage", "cogging", {"force": 3.0, "wave_number": 200.0, "phase": 0.3}),
        ("two_mass_stage", "table", "absorber", {"mass": 0.3, "frequency": 12.0, "damping_ratio": 0.05}),
    ],
)
def test_new_laws_agree_with_the_reference(name, place, effect, values):
    rig, u = nominal_rig(name).with_effect(place, effect, values), 2.0 * command(0.25)
    run, truth = simulate_other(rig, given(u), STEP_S).truth, solve(rig, u[:-1], STEP_S).sensors
    without = simulate_other(nominal_rig(name), given(u), STEP_S).truth
    for sensor in rig.sensors:
        assert rms(run[sensor] - truth[sensor]) < SHARE * rms(truth[sensor] - without[sensor])


def test_what_is_held_behind_a_lost_motion():
    assert held_stretch(0.3, 0.2) == pytest.approx(0.2, abs=1e-6)
    assert held_stretch(-0.3, 0.2) == pytest.approx(-0.2, abs=1e-6)
    assert held_stretch(0.05, 0.2) == pytest.approx(0.0, abs=1e-6)
