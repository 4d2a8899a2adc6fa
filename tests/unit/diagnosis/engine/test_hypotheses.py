"""What a rig may lack: from the catalogue's declarations, as the recording can show it."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis.engine.efforts import Entry, efforts
from dtbacklash.diagnosis.engine.hypotheses import hypotheses, knots_of, unseen_positions
from dtbacklash.diagnosis.engine.motion import Motion, motion_of
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.physics import catalogue
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Role
from dtbacklash.physics.effects.table import KNOTS, SHAPES, STATES, weights
from dtbacklash.physics.rig import Rig, build_rig

from .conftest import STEP_S, command, recorded, segments_of

#: rig -> size of the command, V
RIGS = {"pendulum": 0.4, "oscillator": 1.0, "two_mass_stage": 1.0, "rotary_drive": 1.0, "lead_screw": 3.0}
each = pytest.mark.parametrize("name", list(RIGS))


def segments(name: str, channels: tuple[str, ...] = (), seconds: float = 6.0) -> tuple[Rig, Segments]:
    rig, u = nominal_rig(name), command(seconds, RIGS[name])
    return rig, segments_of(rig, u, {c: y for c, y in recorded(rig, u).items() if c in channels or not channels})


def moved(rig: Rig, seen: Segments) -> Motion:
    return motion_of(seen, rig, seen.gains(rig, tuple(p.first_noise_levels() for p in seen.predictors)))


def offered(rig: Rig, seen: Segments, **how) -> list:
    return list(hypotheses(seen, rig, moved(rig, seen), **how))


@each
def test_every_effect_that_a_rig_takes_is_offered_where_the_recording_can_show_it(name):
    rig, seen = segments(name)
    motion = moved(rig, seen)
    found = list(hypotheses(seen, rig, motion))
    keys = {h.key for h in found}
    held = rig.elements["screw"].neighbours["carries"] if "screw" in rig.elements else ""
    expected = set()
    for place in rig.places:
        for effect in rig.takes(place).values():
            plain = not effect.is_table and effect.declared is None
            # a rigid screw moves its mass, whatever acts there but what swings on it
            acts = place != held or isinstance(effect.slot, slots.HiddenBody)
            if plain and acts and effect.is_shown(motion(place)):
                expected.add((place, effect.name))
    assert keys == expected
    assert len(keys) >= 8
    assert not any(h.effect.is_table for h in found)


@each
def test_each_start_is_one_that_the_rig_can_have(name):
    rig, seen = segments(name)
    found = offered(rig, seen)
    for h in found:
        for p in h.effect.parameters:
            assert p.low <= h.values[p.name] <= p.high, (h.key, p.name)
        assert h.values[h.effect.size.name] != h.effect.size.neutral
        assert h.put(rig, None).effect(*h.key) is not None
        assert 1 <= h.counts <= len(h.effect.parameters)
    # none twice, but where larger frictions end at the same bound
    starts = [(h.key, h.as_it_is, tuple(h.values.items())) for h in found]
    assert len(starts) <= len(set(starts)) + 1


@each
def test_tables_are_offered_only_when_they_are_asked_for(name):
    rig, seen = segments(name)
    found = offered(rig, seen, tables=True)
    assert found
    assert all(h.effect.is_table for h in found)
    motion = moved(rig, seen)
    for h in found:
        knots = np.array([h.values[n] for n in STATES])
        state = motion.states(h.place)[SHAPES[h.effect.name].over]
        assert np.all(np.diff(knots) > 0.0)
        assert np.quantile(state, 0.01) >= knots[0]
        assert np.quantile(state, 0.99) <= knots[-1]
        assert h.put(rig, np.ones(KNOTS)).effect(*h.key)["f3"] == 1.0
    speeds = {h.place for h in found if h.effect.name == "speed_table"}
    held = rig.elements["screw"].neighbours["carries"] if "screw" in rig.elements else ""
    assert speeds == {b for b in seen.linear.bodies if b != held}


def test_sensors_that_were_not_recorded_are_not_asked_about():
    rig, seen = segments("rotary_drive", ("theta_m", "i_m"))
    places = {h.place for h in offered(rig, seen)}
    assert {"sensor_theta_m", "sensor_i_m"} <= places
    assert "sensor_theta_l" not in places


def test_what_is_there_or_left_out_is_not_asked_about():
    rig, seen = segments("pendulum")
    keys = {h.key for h in offered(rig, seen)}
    gravity, friction = ("disk", "gravity"), ("disk", "coulomb_friction")
    assert {gravity, friction} <= keys
    heavy = rig.with_effect(*gravity, {"torque": 0.02})
    assert gravity not in {h.key for h in offered(heavy, seen)}
    assert {h.key for h in offered(rig, seen, without=(friction,))} == keys - {friction}


def test_laws_of_a_position_are_not_offered_where_only_speeds_are_read():
    rig, both = segments("pendulum")
    _, speeds = segments("pendulum", ("omega",))
    assert unseen_positions(both) == set()
    assert unseen_positions(speeds) == {"disk"}
    lost = {h.key for h in offered(rig, both)} - {h.key for h in offered(rig, speeds)}
    assert ("disk", "gravity") in lost
    of_position = {e.name for e in rig.takes("disk").values() if {"position", "angle"} & slots.asked(e)}
    assert {name for place, name in lost if place == "disk"} <= of_position
    tables = {h.effect.name for h in offered(rig, speeds, tables=True)}
    assert "speed_table" in tables
    assert not {"position_table", "position_damping_table"} & tables
    # a spring to the ground shows where its mass is, one between two bodies does not
    assert unseen_positions(segments("oscillator", ("v",))[1]) == set()
    assert unseen_positions(segments("rotary_drive", ("i_m",))[1]) == {"motor_rotor", "load"}


def test_a_law_of_ones_own_is_offered_and_one_that_another_recording_showed_only_where_the_rig_has_it(as_before):
    declared = {
        "acts_on": "rotor",
        "law": "-drag*abs(v)*v",
        "parameters": {"drag": {"unit": "N m s^2/rad^2", "start": 0.01}},
    }
    rig, seen = segments("pendulum")
    catalogue.declare({"engine_drag": declared}, "rig.laws")
    assert ("disk", "engine_drag") in {h.key for h in offered(rig, seen)}
    catalogue.declare({"engine_found": declared}, "rig.laws", foreign=False)
    key = ("disk", "engine_found")
    assert key not in {h.key for h in offered(rig, seen)}
    bringing = build_rig(replace(rig.config, laws={"engine_found": declared}))
    assert key in {h.key for h in offered(bringing, seen)}


def test_a_wave_finer_than_those_that_are_scanned_stands_out_in_what_has_to_be_corrected():
    rig, u = nominal_rig("pendulum"), command(6.0, RIGS["pendulum"])
    still = moved(rig, segments_of(rig, u, recorded(rig, u)))
    assert not len(still.ripples("disk", 48.0))
    true = rig.with_effect("disk", "cogging", {"torque": 0.2 * still("disk").force, "periods": 72.0, "phase": 1.0})
    seen = segments_of(rig, u, recorded(true, u))
    assert 72.0 in moved(rig, seen).ripples("disk", 48.0)
    assert 72.0 in [h.values["periods"] for h in offered(rig, seen) if h.key == ("disk", "cogging")]
    assert not len(moved(rig, seen).ripples("disk", 400.0))


def test_waves_are_scanned_over_whole_turns_and_over_the_way():
    rig, seen = segments("pendulum")
    (wave,) = {h.effect.of_role(Role.WAVE).name for h in offered(rig, seen) if h.key == ("disk", "cogging")}
    scanned = [h.values[wave] for h in offered(rig, seen) if h.key == ("disk", "cogging")]
    assert np.all(np.diff(scanned) > 0.0)
    assert scanned == [float(round(w)) for w in scanned]
    rig, seen = segments("two_mass_stage")
    sliding = [h for h in offered(rig, seen) if h.key == ("carriage", "cogging")]
    way = moved(rig, seen)("carriage").way
    over = np.array([h.values[h.effect.of_role(Role.WAVE).name] for h in sliding]) * way / (2.0 * np.pi)
    assert over.max() <= 24.0
    assert np.allclose(np.diff(over), 0.25)


def test_a_dry_friction_is_offered_at_larger_starts_too():
    rig, seen = segments("pendulum")
    starts = [h for h in offered(rig, seen) if h.key == ("disk", "coulomb_friction")]
    sizes = sorted({h.values["torque"] for h in starts})
    assert sizes[-1] > 3.0 * sizes[0]
    assert {h.as_it_is for h in starts} == {True, False}


@pytest.mark.parametrize("rate", [False, True])
def test_knots_run_upwards_over_what_the_state_covers(rate):
    rng = np.random.default_rng(1)
    for state in (rng.normal(size=5000), np.sin(np.linspace(0, 60, 5000)) + 3.0, rng.uniform(-1, 5, 5000) ** 3):
        knots = knots_of(state, rate)
        assert knots.shape == (KNOTS,)
        assert np.all(np.diff(knots) > 0.0)
        low, high = np.quantile(state, (0.002, 0.998))
        if rate:
            assert knots[-1] == -knots[0] == pytest.approx(max(abs(low), abs(high)))
            assert np.diff(knots).argmin() == KNOTS // 2 - 1  # dense around rest
        else:
            assert (knots[0], knots[-1]) == (pytest.approx(low), pytest.approx(high))
    assert knots_of(np.full(100, 2.0), rate) is None


def test_efforts_of_a_table_are_its_weights_and_of_a_wave_its_sine_and_cosine():
    rig, seen = segments("oscillator")
    motion, found = moved(rig, seen), offered(rig, seen, tables=True)
    for name in ("position_damping_table", "stretch_table"):
        (h,) = (h for h in found if h.effect.name == name)
        states, shape = motion.states(h.place), SHAPES[name]
        every = slice(None, None, 101)
        expected = weights(states[shape.over][every], np.array([h.values[n] for n in STATES])).T
        expected = expected * states[shape.times][every] if shape.times else expected
        F, where = efforts(h, rig, motion)
        assert np.allclose(F[:, every], expected, atol=1e-12)
        assert where == Entry({"mass": -1.0 if name == "stretch_table" else 1.0})
    rig, seen = segments("pendulum")
    motion = moved(rig, seen)
    h = next(h for h in offered(rig, seen) if h.key == ("disk", "cogging"))
    turned = h.values[h.effect.of_role(Role.WAVE).name] * motion.position["disk"]
    (sine, cosine), where = efforts(h, rig, motion)
    assert np.allclose(np.abs(sine), np.abs(np.sin(turned)))
    assert np.allclose(np.abs(cosine), np.abs(np.cos(turned)))
    assert where == Entry({"disk": 1.0})
    (braked,), _ = efforts(next(h for h in offered(rig, seen) if h.key == ("disk", "viscous_friction")), rig, motion)
    assert np.allclose(braked, -motion.speed["disk"])


def test_places_move_as_they_were_simulated():
    """The predicted motion of a clean recording against the simulation itself."""
    from dtbacklash.physics.simulate import simulate

    rig, seen = segments("rotary_drive")
    motion = moved(rig, seen)
    names = list(seen.linear.states)
    X = simulate(rig, command(6.0, RIGS["rotary_drive"])[:-1], STEP_S).states
    for body in ("motor_rotor", "load"):
        q, v = X[:, names.index(f"{body} q")], X[:, names.index(f"{body} v")]
        assert np.abs(motion.position[body] - q).std() < 5e-3 * q.std()
        place = motion(body)
        assert place.way == pytest.approx(np.ptp(q), rel=0.02)
        assert place.speed == pytest.approx(np.quantile(np.abs(v), 0.98), rel=0.05)
        assert place.values == rig.elements[body].values
    stretch = X[:, names.index("load q")] - X[:, names.index("motor_rotor q")]
    assert motion("shaft").span == pytest.approx(np.quantile(np.abs(stretch), 0.95), rel=0.2)
    assert motion("shaft").duration_s == pytest.approx(6.0, abs=0.01)
    assert set(motion.states("shaft")) == {"command", "stretch", "stretch rate"}
    assert set(motion.states("load")) == {"command", "position", "speed"}
    assert motion.states("sensor_i_m") == {}
