"""The concealing simulator on rigs without a screw, and what only it has: laws that the catalogue lacks."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig
from reference.cases import OTHER_RIGS, problems, three_tones
from reference.cases import RIGS as REFERENCE_RIGS
from reference.store import stored

from dtbacklash.physics.catalogue import effects_of
from dtbacklash.physics.simulate import simulate
from dtbacklash.prove.draw import entries
from dtbacklash.prove.effect_sizes import DESCRIPTIONS, motion_of, unknown_entries
from dtbacklash.prove.simulator.given import Errors, Loop, Unlisted
from dtbacklash.prove.simulator.machine import machine
from dtbacklash.prove.simulator.rig import simulate_other
from dtbacklash.prove.testbench import rms

STEP_S, SECONDS = 1e-3, 1.0
RIGS = ("two_mass_stage", "rotary_drive", "pendulum", "oscillator", "geared", "racked", "served")
#: how far two simulations may differ, as a share of what the effect changes: smooth laws, and those with a rest
SHARE, SHARE_REST = 2e-3, 4e-2
RESTS = {"load_friction", "coulomb_friction", "stribeck_friction", "dry_friction", "ground_friction"}
#: of the signal, where a body is held by a brake that the nominal model has
SHARE_BRAKE = 5e-3


def rig_of(name):
    """A shipped rig, or one of the tests' reference."""
    return REFERENCE_RIGS[name]() if name in REFERENCE_RIGS else nominal_rig(name)


def given(u):
    return Loop(False, u, np.zeros(len(u)), np.zeros(len(u)))


@pytest.fixture(scope="module")
def plain():
    """Per rig: rig, how it moves, and what its sensors show."""
    found, u = {}, three_tones(SECONDS)
    for name in RIGS:
        rig = rig_of(name)
        run = simulate_other(rig, given(u), STEP_S)
        found[name] = rig, motion_of(rig, run, SECONDS, 13.0), simulate(rig, u[:-1], STEP_S).sensors
    return found


@pytest.mark.parametrize("name", [*RIGS, "emps", "silverbox"])
def test_without_effects_both_agree(name):
    rig, u = rig_of(name), three_tones(SECONDS)
    run, house = simulate_other(rig, given(u), STEP_S), simulate(rig, u[:-1], STEP_S)
    for sensor in rig.sensors:
        assert rms(run.truth[sensor] - house.sensors[sensor]) < 1e-9 * rms(house.sensors[sensor])


def test_a_brake_behind_a_coupling_slips_alike():
    rig, u = nominal_rig("brfd"), 2.5 * three_tones(SECONDS)
    run, house = simulate_other(rig, given(u), STEP_S), simulate(rig, u[:-1], STEP_S, substeps=32)
    assert rms(run.truth["force"] - house.sensors["force"]) < SHARE_BRAKE * rms(house.sensors["force"])


@pytest.mark.parametrize(
    ("name", "place", "effect"), [(name, *entry) for name in RIGS for entry in entries(rig_of(name))]
)
def test_every_effect_agrees_to_a_small_share_of_itself(name, place, effect, plain):
    rig, moving, before = plain[name]
    declared, u = effects_of(rig.kind_at(place))[effect], three_tones(SECONDS)
    shape = declared.draw_shape(np.random.default_rng(1), moving.at(place))
    changed = rig.with_effect(place, effect, shape.values(shape.guess))
    run, house = simulate_other(changed, given(u), STEP_S), simulate(changed, u[:-1], STEP_S, substeps=32).sensors
    sensor = max(rig.sensors, key=lambda s: rms(house[s] - before[s]) / rms(before[s]))
    difference = rms(house[sensor] - before[sensor])
    assert difference > 1e-4 * rms(before[sensor])
    assert rms(run.truth[sensor] - house[sensor]) < (SHARE_REST if effect in RESTS else SHARE) * difference


@pytest.mark.parametrize(("name", "place", "effect"), [one[:3] for one in OTHER_RIGS])
def test_new_laws_agree_with_the_reference(name, place, effect):
    problem = problems()[f"{name} {place} {effect}"]
    u, truth = 2.0 * three_tones(0.25), stored(problem).channels
    run, without = (simulate_other(rig, given(u), STEP_S).truth for rig in (problem.rig, nominal_rig(name)))
    for sensor in problem.rig.sensors:
        assert rms(run[sensor] - truth[sensor]) < SHARE * rms(truth[sensor] - without[sensor])


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("lead_screw", Unlisted("motor_bearing", "disturbance", 1.0)),
        ("lead_screw", Unlisted("motor_circuit", "directional_torque", 1.0)),
        ("lead_screw", Unlisted("gear", "angular_play", 1.0)),
        ("pendulum", Unlisted("disk", "position_damping", 1.0)),
        ("two_mass_stage", Unlisted("motor", "directional_torque", 1.0)),
        ("rotary_drive", Unlisted("shaft", "root_spring", 1.0)),
        ("oscillator", Unlisted("mass", "position_mass", 1.0)),
        ("brfd", Unlisted("joint", "speed_stiffening", 1.0)),
        ("emps", Unlisted("carriage", "disturbance", 1.0)),
        ("two_mass_stage", Unlisted("motor", "position_gain", 1.0, 0.1)),
        ("two_mass_stage", Unlisted("motor", "gain_drift", 1.0)),
        ("two_mass_stage", Unlisted("table", "coloured_force", 1.0)),
        ("two_mass_stage", Unlisted("table", "wandering_friction", 1.0, 0.01)),
        ("pendulum", Unlisted("disk", "double_ripple", 1.0, 0.5, 3.0, 0.1, 20.0, 0.7)),
    ],
    ids=lambda one: one if isinstance(one, str) else f"{one.location}.{one.name}",
)
def test_physics_that_the_catalogue_lacks_acts_in_proportion_to_its_size(name, law):
    rig, u = nominal_rig(name), three_tones(SECONDS)
    assert law.name not in DESCRIPTIONS or (law.location, law.name) in unknown_entries(rig)
    course = 1.0 + 0.3 * np.sin(9.0 * STEP_S * np.arange(len(u)))
    loop = Loop(False, u, np.zeros(len(u)), course)
    plain = simulate_other(rig, loop, STEP_S)
    changed = [simulate_other(rig, loop, STEP_S, None, replace(law, size=size)) for size in (0.0, 1e-4, 2e-4)]
    none, one, two = (max(rms(run.truth[s] - plain.truth[s]) for s in rig.sensors) for run in changed)
    assert none < 1e-200
    assert one > 1e-12
    assert two / one == pytest.approx(2.0, rel=0.1)


def test_a_lag_that_a_thousandth_of_a_sample_does_not_show_costs_no_steps():
    lags = [
        nominal_rig("two_mass_stage").with_effect("motor", "lag", {"time": share * STEP_S}) for share in (5e-3, 1e-5)
    ]
    long, short, none = (machine(rig, STEP_S, Errors()) for rig in (*lags, nominal_rig("two_mass_stage")))
    assert long.substeps == 800
    assert short.substeps == none.substeps
    assert np.array_equal(short.drive, none.drive)
