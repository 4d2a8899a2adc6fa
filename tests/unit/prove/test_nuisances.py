"""The small things of a lifelike recording: as large together as they may be, and the clean recording without them."""

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.errors import UserError
from dtbacklash.prove import nuisances
from dtbacklash.prove.draw import draw, record
from dtbacklash.prove.secret import Secret
from dtbacklash.prove.simulator.given import Loop, Unlisted
from dtbacklash.prove.simulator.rig import simulate_other
from dtbacklash.prove.testbench import rms

STEP_S = 1e-3
#: of clean recordings of 3 s, from before there were lifelike ones: a hidden size, and the sums of |command| and of the
#: first channel's size; another processor may give another last digit
CLEAN = {
    ("lead_screw", 4, "single"): (0.026388185360544637, 1673.3832068089582, 1954.0276790707906),
    ("lead_screw", 11, "unknown"): (0.0012399591251422099, 887.4092649549775, 2628.279730501197),
    ("pendulum", 3, "single"): (0.02351026104239837, 1869.681389110438, 369.8090038455038),
    ("two_mass_stage", 3, "unknown"): (0.06433257512635895, 4019.7640013362234, 146.5764257526994),
}


@pytest.mark.parametrize(("name", "seed", "kind"), CLEAN)
def test_clean_recordings_are_as_they_were(name, seed, kind, short):
    rig = nominal_rig(name)
    secret = draw(seed, rig, kind=kind)
    assert (secret.machine, secret.beside) == ("clean", [])
    size = secret.unknown["size"] if secret.unknown else next(iter(secret.effects[0]["parameters"].values()))
    _, run = record(secret, rig)
    sums = (float(np.abs(values).sum()) for values in (run.u, run.seen[secret.channels[0]]))
    assert (size, *sums) == pytest.approx(CLEAN[name, seed, kind], rel=1e-9)


@pytest.mark.parametrize(
    ("name", "seed", "kind"),
    [
        ("lead_screw", 1, "single"), ("two_mass_stage", 2, "single"), ("oscillator", 3, "several"),
        ("pendulum", 4, "unknown"),
        *(pytest.param(*one, marks=pytest.mark.nightly) for one in (
            ("rotary_drive", 5, "single"), ("emps", 6, "single"), ("silverbox", 7, "nothing"), ("brfd", 8, "single"),
            ("disk", 9, "parameters"), ("anticogging", 10, "single"),
        )),
    ],
)  # fmt: skip
def test_what_is_hidden_is_the_main_thing(name, seed, kind, short):
    rig = nominal_rig(name)
    secret = draw(seed, rig, kind=kind, machine="lifelike")
    assert secret.kind == kind
    assert 3 <= len(secret.beside) <= 10
    assert 40.0 / 1.2**2 <= secret.beside_visibility**2 <= 500.0 * 1.2**2
    main = [v for n, v in secret.visibility.items() if n != "parameters"]
    assert all(v >= 5.0 * secret.beside_visibility for v in main)
    assert len(main) == {"single": 1, "unknown": 1, "several": len(secret.effects)}.get(kind, 0)
    places = [(thing["location"], thing.get("effect") or thing["name"]) for thing in secret.beside]
    assert len(set(places)) == len(places)
    assert not set(places) & {(e["location"], e["effect"]) for e in secret.effects}
    lacking = [thing for thing in secret.beside if "effect" not in thing]
    assert 0 < len(lacking) < len(secret.beside)  # of the catalogue, and outside of it
    assert all(thing["description"].startswith(nuisances.DESCRIPTIONS[thing["name"]]) for thing in lacking)
    again = Secret.from_json(secret.to_json())
    run, same = record(secret, rig)[1], record(again, rig)[1]
    assert not run.diverged
    assert all(np.array_equal(run.seen[channel], same.seen[channel]) for channel in secret.channels)


def test_a_secret_of_before_there_were_small_things_is_read():
    told = {"seed": 1, "rig": "pendulum", "kind": "nothing"}
    secret = Secret.from_json(str(told).replace("'", '"'))
    assert (secret.machine, secret.beside, secret.laws) == ("clean", [], ())
    with pytest.raises(UserError, match="sealed"):
        Secret.from_json('{"seed": 1, "rig": "pendulum", "kind": "nothing", "other": 1}')


def moved(rig, *laws, courses=0.0, n=2000):
    """Runs of a rig under two sines, with and without these laws."""
    t_s = STEP_S * np.arange(n)
    u, none = np.sin(23.0 * t_s) + 0.5 * np.sin(7.0 * t_s), np.zeros(n)
    loop = Loop(False, u, none, none + courses)
    return simulate_other(rig, loop, STEP_S, None, *laws), simulate_other(rig, loop, STEP_S)


@pytest.mark.parametrize(
    ("law", "error"),
    [
        (Unlisted("sensor_theta", "interpolation", 1e-4, wave=300.0), lambda y: 1e-4 * np.sin(300.0 * y)),
        (Unlisted("sensor_theta", "curved_scale", 0.02, 0.5), lambda y: 0.02 * y**2 / 0.5),
        (Unlisted("sensor_theta", "reading_drift", 0.02), lambda y: 0.02 * np.cos(STEP_S * np.arange(len(y)))),
    ],
)  # fmt: skip
def test_an_error_of_a_scale_is_what_its_name_says(law, error):
    run, plain = moved(nominal_rig("pendulum"), law, courses=np.cos(STEP_S * np.arange(2000)))
    y = plain.truth["theta"]
    assert run.truth["theta"] - y == pytest.approx(error(y), abs=1e-12)
    assert np.array_equal(run.truth["omega"], plain.truth["omega"])


def test_a_clock_that_jitters_samples_all_channels_at_another_time():
    early = 2e-4 * np.random.default_rng(0).standard_normal(2000)
    run, plain = moved(nominal_rig("pendulum"), Unlisted("clock", "clock_jitter", 2e-4), courses=early / 2e-4)
    for sensor in ("theta", "omega"):
        rate = np.gradient(plain.truth[sensor], STEP_S)
        error = run.truth[sensor] - plain.truth[sensor]
        assert rms((error - rate * early)[2:-2]) < 0.05 * rms(error)


def test_creep_gives_way_like_a_spring_and_then_slides():
    """A force of 1 N holds a mass that creeps by 1 mm until it slides against 1 N (a spring of 1 N/mm at first)."""
    rig = nominal_rig("two_mass_stage")
    law, n = Unlisted("carriage", "creep", 1.0, 1e-3), 4000
    none = np.zeros(n)
    loops = [Loop(False, none + force / 12.0, none, none) for force in (0.2, 3.0)]
    held, slid = (simulate_other(rig, loop, STEP_S, None, law).truth["x_c"] for loop in loops)
    assert np.abs(held).max() < 1e-3
    at, t_s = 2e-3, STEP_S * n
    assert slid[-1] == pytest.approx((3.0 - 1.0) / 6.5 * 0.5 * t_s**2, rel=0.1)
    assert slid[-1] > at


def test_a_friction_or_a_play_is_a_right_name_for_one_that_the_catalogue_lacks():
    rig = nominal_rig("oscillator")
    assert nuisances.akin(rig, "mass", "creep") == [
        ("mass", "ground_friction"), ("spring", "hysteresis"), ("spring", "dry_friction"),
    ]  # fmt: skip
    assert nuisances.akin(nominal_rig("lead_screw"), "gear", "angular_play") == [("gear", "backlash")]
    assert nuisances.akin(rig, "mass", "coloured_force") == []
