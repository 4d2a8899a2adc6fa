"""What an imposed motion drives: the structure behind a given motor angle, and what hangs on a positioner."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig
from reference import rigs
from told import refused

from dtbacklash.config.compose import compose
from dtbacklash.config.rig import ParameterConfig
from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.simulate import simulate

SAMPLE_TIME_S = 1e-3
#: of what an effect changes, the share by which the driven structure may miss the whole rig (measured: 4e-4 at most)
SHARE = 2e-3
PLACES = {"gear": "gear", "screw": "screw", "link": "link_1", "mass": "mass_2"}
EFFECTS = [
    (PLACES[kind], name) for kind, name in CATALOGUE
    if kind in PLACES and not CATALOGUE[kind, name].is_table
    and name not in ("load_reaction", "load_friction", "coasting")
]  # fmt: skip
# and behind another link
EFFECTS += [("link_2", "backlash"), ("mass_3", "ground_friction")]
#: at its typical size a play lets go of the masses behind it: they are then too far from what the angle says
SMALLER = {("link", "backlash"): {"lost_motion": 2e-5}}


def swing() -> np.ndarray:
    t = np.arange(4000) * SAMPLE_TIME_S
    return 3.0 * np.sin(2 * np.pi * 1.3 * t) + 2.0 * np.sin(2 * np.pi * 4.1 * t)


@pytest.mark.parametrize(("place", "name"), EFFECTS)
def test_the_structure_behind_the_motors_angle_moves_as_in_the_whole_rig(place: str, name: str) -> None:
    plain, u = rigs.lead_screw(), swing()
    kind = plain.kind_at(place)
    values = {p.name: p.typical for p in CATALOGUE[kind, name].parameters}
    rig = plain.with_effect(place, name, SMALLER.get((kind, name), values))
    whole = simulate(rig, u, SAMPLE_TIME_S).sensors
    driven = simulate(rig, u, SAMPLE_TIME_S, theta_m_rad=whole["theta_m"]).sensors["q3"]
    effect = np.std(simulate(plain, u, SAMPLE_TIME_S, theta_m_rad=whole["theta_m"]).sensors["q3"] - driven)
    # a rig without forces beside the linear ones takes whole samples, in which the angle is straight
    straight = simulate(plain, u, SAMPLE_TIME_S).sensors
    own = simulate(plain, u, SAMPLE_TIME_S, theta_m_rad=straight["theta_m"]).sensors["q3"] - straight["q3"]
    assert np.std(whole["q3"] - driven) < SHARE * effect + np.std(own)
    assert effect > 10.0 * np.std(own)


def steps() -> np.ndarray:
    """Pushes to and fro with rests between them, V."""
    u = np.zeros(8000)
    for k in range(0, 8000, 1000):
        u[k : k + 150] = 4.0 if k % 2000 else -4.0
    return u


@pytest.mark.parametrize("force", [1e-5, 1e-3, 0.1])
def test_friction_on_what_a_noisy_angle_moves_does_no_more_than_its_force_can(force: float) -> None:
    """A measured angle moves in jerks of its noise; friction that followed them would shake the structure."""
    plain, u = rigs.lead_screw(), steps()
    rig = plain.with_effect("link_1", "dry_friction", {"force": force})
    angle = simulate(plain, u, SAMPLE_TIME_S).sensors["theta_m"]
    noisy = angle + 1.4e-4 * np.random.default_rng(0).standard_normal(angle.size)
    q3 = {
        (i, j): simulate(one, u, SAMPLE_TIME_S, theta_m_rad=theta).sensors["q3"]
        for i, one in enumerate((plain, rig)) for j, theta in enumerate((angle, noisy))
    }  # fmt: skip
    noise = np.std(q3[0, 1] - q3[0, 0])
    static = force / 1e4  # by the stiffness of the links, N/m
    assert np.std(q3[1, 0] - q3[0, 0]) < 20.0 * static + noise  # measured: 7 times what the force does at rest
    assert np.std(q3[1, 1] - q3[1, 0]) < 2.0 * static + 1.1 * noise


@pytest.mark.parametrize("force", [0.1, 1.0])
@pytest.mark.parametrize("up_to_hz", [20.0, 80.0, 200.0])
def test_friction_behind_a_motor_that_is_shaken_is_that_of_the_whole_rig(up_to_hz: float, force: float) -> None:
    rng, n = np.random.default_rng(1), 8000
    hz = np.fft.rfftfreq(n, SAMPLE_TIME_S)
    u = np.fft.irfft(np.where((hz > 0.5) & (hz < up_to_hz), np.exp(2j * np.pi * rng.random(hz.size)), 0.0), n)
    u *= 3.0 / np.std(u)
    plain = rigs.lead_screw()
    rig = plain.with_effect("link_1", "dry_friction", {"force": force})
    whole = simulate(rig, u, SAMPLE_TIME_S).sensors
    driven, without = (simulate(r, u, SAMPLE_TIME_S, theta_m_rad=whole["theta_m"]).sensors["q3"] for r in (rig, plain))
    # measured: 0.1 to 2.4 %, the most where the motor turns round within a sample
    assert np.std(whole["q3"] - driven) < 0.04 * np.std(whole["q3"] - without)


def machine() -> Rig:
    return nominal_rig("brfd")


def sweep(amplitude_mm: float) -> np.ndarray:
    """Two slow swings from side to side, V (mm)."""
    t = np.arange(8001) * SAMPLE_TIME_S
    return amplitude_mm * np.sin(2 * np.pi * 0.25 * t)


def test_what_a_positioner_imposes_moves_alike_with_and_without_a_law_beside_it() -> None:
    """A force sensor sees the rate of the base: half a sample late, it would be missing physics."""
    rig, u = machine(), sweep(1.0)
    (place,) = (e.name for e in rig.elements.values() if e.kind == "coupling")
    bare = build_rig(replace(rig.config, effects={}))
    plain = simulate(bare, u, 0.01).sensors
    beside = simulate(bare.with_effect(place, "cubic_stiffness", {"k3": 1e-6}), u, 0.01).sensors
    for name, values in plain.items():
        assert np.abs(values - beside[name]).max() < 1e-9 * np.abs(values).max()


def test_a_damper_behind_a_play_has_the_loop_that_geometry_gives() -> None:
    """After a reversal the force falls to nothing within F/k, stays there for the lost motion, and rises within F/k."""
    rig = machine().with_effect("joint", "backlash", {"lost_motion": 5e-3})
    values = {name: p.value for name, p in rig.config.parameters.items()}
    u = sweep(25.0)
    force = simulate(rig, u[:-1], SAMPLE_TIME_S).sensors["force"]
    turn, half = 5000, 2000  # of the command: from +25 mm at 5 s to -25 mm at 7 s
    there = slice(turn, turn + half)
    travelled = 25.0 - u[there]
    level = values["friction"] + 30.0  # the damper's share at these speeds
    assert force[turn - 5] == pytest.approx(values["friction"], rel=2e-3)
    assert force[there][-5] == pytest.approx(-values["friction"], rel=2e-3)
    unloading = 1e3 * values["friction"] / values["k"]
    assert np.interp(0.5 * unloading, travelled, force[there]) == pytest.approx(0.5 * values["friction"], rel=0.03)
    idle = (travelled > unloading + 0.1) & (travelled < unloading + 4.9)
    assert np.abs(force[there][idle]).max() < 0.02 * level
    at_80 = travelled[np.argmax(force[there] < -0.8 * values["friction"])]
    assert at_80 == pytest.approx(unloading + 5.0 + 0.8 * unloading, abs=0.1)


def test_a_positioner_moves_what_hangs_on_it_and_starts_where_the_command_does() -> None:
    rig = machine()
    still = simulate(rig, np.full(200, 12.0), SAMPLE_TIME_S).sensors["force"]
    assert np.abs(still).max() < 1e-9 * rig.config.parameters["friction"].value


def test_a_rig_is_driven_by_one_thing() -> None:
    config = compose("rig=brfd", "controller=open_loop").rig
    config.parameters["gain"] = ParameterConfig(1.0, "N/V")
    config.elements["source"] = {"kind": "actuator", "gain": "gain", "drives": "band"}
    with refused("at most one element of kind motor_circuit or actuator or servo or linear_servo or"):
        build_rig(config)


def test_a_run_and_a_simulation_of_a_positioner_agree() -> None:
    from dtbacklash.experiment.run import run_scenario

    config = compose(
        "rig=brfd", "controller=open_loop", "reference=multisine", "reference.rms_mm=10", "duration_s=2",
        "rig.effects.joint.backlash.lost_motion=0.005",
    )  # fmt: skip
    seen = run_scenario(config).seen
    u = seen["u"]
    alone = simulate(build_rig(config.rig), u[:-1], config.sample_time_s).sensors["force"]
    assert np.ptp(alone) > 5e3
    assert np.abs(alone - seen["force"])[:-2].max() < 1e-6 * np.ptp(alone)
