"""What the catalogue refuses, and that everything in it is whole."""

from dataclasses import replace

import numpy as np
import pytest
from told import refused

from dtbacklash.errors import UserError
from dtbacklash.physics import catalogue
from dtbacklash.physics.catalogue import CATALOGUE, register
from dtbacklash.physics.drawing import drawing_of, law_curve
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.body import GRAVITY
from dtbacklash.physics.effects.declare import Place, Role
from dtbacklash.physics.effects.table import KNOTS
from dtbacklash.physics.element_kinds import KINDS

PLACE = Place(
    values={"stiffness": 1e4, "damping": 30.0, "mass": 5.0, "resistance": 12.0}, duration_s=20.0,
    modes=(4.0, 11.0), command=np.linspace(-3.0, 3.0, 100), speed=2.0, stretch=np.linspace(-1e-4, 1e-4, 100), span=9e-5,
    reach=1e-4, stretch_rate=1e-3, force=1.0, force_most=8.0, current=0.1, travel=2e-3,
)  # fmt: skip


WAY = {"way": 3.0}
STRETCHED = np.concatenate([np.zeros(50), np.full(5, 1e-4), np.zeros(50)])


@pytest.mark.parametrize(("key", "values", "moved", "simpler"), [
    (("rotor", "gravity"), {}, {"way": 0.1}, "constant_load"),  # over 0.1 rad a sine is a straight line
    (("rotor", "gravity"), {}, WAY, ""),
    (("sensor", "eccentricity"), {}, {"way": 0.1}, "gain_error"),
    (("sensor", "eccentricity"), {}, WAY, ""),
    (("rotor", "cogging"), {}, {"way": 0.1}, ""),
    (("rotor", "stribeck_friction"), {"speed": 1.9}, WAY, "coulomb_friction"),  # the end of its fall is never seen
    (("rotor", "stribeck_friction"), {"speed": 0.5}, WAY, ""),
    (("amplifier", "saturation"), {"limit": 2.99}, WAY, "gain_error"),
    (("amplifier", "saturation"), {"limit": 2.99}, {"command": 3.0 * np.sin(np.linspace(0.0, 20.0, 999))}, ""),
    (("link", "bumper"), {"clearance": 5e-5}, {"stretch": np.tile(STRETCHED, 2)}, "cubic_stiffness"),
    (("link", "bumper"), {"clearance": 5e-5}, {"stretch": np.tile(STRETCHED, 3)}, ""),
])  # fmt: skip
def test_a_law_whose_shape_ends_beyond_the_motion_does_what_a_simpler_one_does(key, values, moved, simpler):
    assert CATALOGUE[key].simpler_at(values, replace(PLACE, **moved)) == simpler
    if simpler:
        assert (key[0], simpler) in CATALOGUE


def test_every_effect_has_a_slot_starts_and_a_concealed_size():
    for key, effect in CATALOGUE.items():
        whole(key, effect)


def whole(key, effect):
    assert (effect.kind, effect.name) == key
    assert catalogue.effects_of(effect.kind)[effect.name] is effect
    assert catalogue.kind_named(effect.kind).takes(effect.slot)
    if effect.is_table:  # nothing that is searched for or concealed
        assert [p.role for p in effect.parameters].count(Role.KNOT) == KNOTS
        return
    size, *others = effect.parameters
    assert size.low <= size.neutral <= size.high
    assert size.typical != size.neutral
    # what adds to the law as the size does is off unless it is asked for
    assert all(p.neutral is None or p.typical == p.neutral for p in others), key
    assert size.role in (Role.SIZE, Role.TIME)
    assert [p.role for p in others].count(Role.SIZE) == 0
    starts = effect.start_values(PLACE)
    assert starts
    for values in starts:
        assert effect.complete(values, "key") == values
    shape = effect.draw_shape(np.random.default_rng(0), PLACE)
    assert 0.0 < shape.guess <= shape.most, key
    assert not effect.is_neutral(effect.complete(shape.values(shape.guess), "key"))
    for idle in ((), *((p.name,) for p in effect.amplitudes)):
        assert "{" not in effect.said(idle).format(location="here", **{p.name: p.name for p in effect.parameters}), key


def test_what_is_drawn_of_a_concealed_friction_is_allowed_at_a_body_that_hardly_moves():
    effect = CATALOGUE["rotor", "stribeck_friction"]
    shape = effect.draw_shape(np.random.default_rng(0), replace(PLACE, speed=1e-12))
    assert effect.complete(shape.values(shape.guess), "key")["speed"] == 1e-9


def test_bounds_are_inclusive_and_kept():
    for effect in CATALOGUE.values():
        everything = {p.name: p.typical for p in effect.parameters}
        size = everything if effect.is_table else {effect.size.name: effect.size.typical}
        for p in effect.parameters:
            assert p.low <= p.typical <= p.high
            for value in () if effect.is_table and p.role is Role.GIVEN else (p.low, p.high):  # its ends are in order
                assert effect.complete(size | {p.name: value}, "key")[p.name] == value
            for value in (p.low - abs(p.low) - 1.0, p.high + abs(p.high) + 1.0):
                if p.role is Role.ANGLE:  # it begins anew after a turn
                    kept = effect.complete(size | {p.name: value}, "key")[p.name]
                    assert (kept - value) % (2.0 * np.pi) == pytest.approx(0.0, abs=1e-9) or (
                        (value - kept) % (2.0 * np.pi) == pytest.approx(0.0, abs=1e-9)
                    )
                elif value not in (p.low, p.high):  # beyond an infinite bound there is nothing
                    with refused(f"key.{p.name}="):
                        effect.complete(size | {p.name: value}, "key")


def test_a_law_of_one_state_is_drawn_as_what_it_is():
    drawn = slots.BodyEffort, slots.Contact, slots.SpringForce, slots.Command
    for key, effect in CATALOGUE.items():
        drawing = drawing_of(effect)
        if drawing is None:
            assert isinstance(effect.slot, slots.Passing) or not isinstance(effect.slot, drawn), key
            continue
        values = {p.name: p.typical for p in effect.parameters}
        wide = 1.5 * (drawing.width(values) if drawing.width else 10.0)
        state, effort = law_curve(drawing, values, {"stiffness": 1e4, "damping": 1.0}, (-wide, wide))
        assert len(state) == len(effort) > 400, key
        assert np.isfinite(effort).all(), key
        assert np.any(effort != 0.0), key
        assert np.ptp(effort) > 0 or drawing.state == "time" or effect.is_table, key  # whose values are alike
        assert drawing.wave == "" or drawing.wave in values


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"kind": "wheel"}, "wheel: acts nowhere; choose one of amplifier"),
        ({"kind": "amplifier"}, "BodyEffort: acts nowhere: an element of kind `amplifier` has no such slot"),
        ({"slot": slots.BodyEffort(lambda position, torque, phase, more: 0.0)}, "a law's arguments are states"),
        ({"slot": slots.BodyDamping("coefficient")}, "its slot names a parameter that it does not have"),
        ({"parameters": GRAVITY.parameters[::-1]}, "the first parameter is the size"),
        ({"parameters": (replace(GRAVITY.parameters[0], name="time"),)}, "is the name of a state"),
        ({}, "rotor: is in the catalogue already"),
    ],
)
def test_an_entry_that_is_not_whole_is_refused(changes, words):
    with refused(words):
        register(replace(GRAVITY, **changes))


def test_every_slot_is_on_some_kind_and_every_kind_that_acts_takes_an_effect():
    known = [kind for kind in vars(slots).values() if isinstance(kind, type) and issubclass(kind, slots.Slot)]
    traits = {kind.trait for kind in KINDS.values()} | {slots.SLIDING_BODY, slots.SENSOR}
    for slot in known:
        assert slot is slots.Slot or set(slot.on) <= traits
    for kind in KINDS.values():
        assert bool(kind.trait) == bool(catalogue.effects_of(kind.name)), kind.name


@pytest.mark.parametrize("kind", ["rotor", "carriage", "brake"])
def test_friction_that_differs_by_direction_takes_either_difference(kind):
    effect = CATALOGUE[kind, "asymmetric_friction"]
    both = {"viscous_difference": 0.0, "coulomb_difference": 0.0}
    assert effect.complete({"coulomb_difference": -2.0}, "key") == both | {"coulomb_difference": -2.0}
    assert effect.complete({"viscous_difference": 3.0}, "key") == both | {"viscous_difference": 3.0}
    with pytest.raises(UserError, match=r"`viscous_difference` \[.*\] or `coulomb_difference` \[.*\] must be given"):
        effect.complete({}, "key")
    assert effect.is_neutral(both)
    assert not effect.is_neutral(both | {"coulomb_difference": -2.0})
    assert effect.idle(both) == {"coulomb_difference"}
    assert effect.idle(both | {"coulomb_difference": -2.0}) == {"viscous_difference"}
    assert effect.idle({"viscous_difference": 3.0, "coulomb_difference": -2.0}) == set()


@pytest.mark.parametrize(("kind", "name", "values"), [
    ("rotor", "coulomb_friction", {"torque": 4e4}),
    ("rotor", "gravity", {"torque": 2e5, "phase": 0.1}),
    ("mass", "absorber", {"mass": 4e5, "frequency": 0.002, "damping_ratio": 0.1}),
    ("mass", "absorber", {"mass": 1e-9, "frequency": 2e5, "damping_ratio": 0.1}),
    ("link", "hysteresis", {"force": 1e-9, "displacement": 1e-11}),
    ("amplifier", "delay", {"time": 0.4}),
])  # fmt: skip
def test_a_machine_may_be_large_or_small(kind, name, values):
    """What bounds a search is the recording: a law that a machine may have can be written down."""
    assert CATALOGUE[kind, name].complete(values, "key") == values
