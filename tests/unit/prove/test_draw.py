"""What is drawn: repeatable, of every kind, where it can be seen, and nothing that the rig does not take."""

import math

import numpy as np
import pytest
from told import refused

from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.prove import draw as drawing
from dtbacklash.prove import effect_sizes, excitation
from dtbacklash.prove.draw import draw, entries, record
from dtbacklash.prove.effect_sizes import DESCRIPTIONS, unknown_entries
from dtbacklash.prove.secret import KINDS, Secret
from dtbacklash.prove.simulator.rig import EFFECTS
from dtbacklash.prove.testbench import Bench


def test_the_same_seed_gives_the_same_secret_and_recording_to_the_last_bit(lead_screw, short):
    one, two = draw(4, lead_screw, kind="single"), draw(4, lead_screw, kind="single")
    assert one == two
    assert one != draw(5, lead_screw, kind="single")
    (loop, run), (_, again) = record(one, lead_screw), record(Secret.from_json(one.to_json()), lead_screw)
    assert np.array_equal(run.u, again.u)
    assert all(np.array_equal(run.seen[name], again.seen[name]) for name in run.seen)
    assert len(run.u) == len(loop.reference) == 3001
    assert not run.diverged


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_hides_what_its_name_says(lead_screw, short, kind):
    secret = draw(11, lead_screw, kind=kind)
    assert secret.kind == kind
    assert (len(secret.effects) > 0) == (kind in ("single", "several"))
    assert (secret.unknown is not None) == (kind == "unknown")
    if kind == "nothing":
        assert secret.parameters == {}
    if kind == "parameters":
        assert 1 <= len(secret.parameters) <= 3
        for name, value in secret.parameters.items():
            p = lead_screw.config.parameters[name]
            assert 0.69 <= abs(value / p.value - 1.0) / p.tolerance <= 2.01
    if kind == "several":
        assert len({e["location"] for e in secret.effects}) == len(secret.effects) >= 2
    hidden = {name: v for name, v in secret.visibility.items() if name != "parameters" or kind == "parameters"}
    assert all(0.5 <= v < 1e4 for v in hidden.values())
    assert len(hidden) == {"nothing": 0, "several": len(secret.effects)}.get(kind, 1)
    secret.true_rig(lead_screw)  # the rig takes it


def test_the_shares_are_those_that_are_promised(lead_screw):
    assert sum(drawing.SHARES.values()) == pytest.approx(1.0)
    kinds = [drawing.draw_kind(seed, lead_screw) for seed in range(2000)]
    for kind, share in drawing.SHARES.items():
        assert kinds.count(kind) / 2000 == pytest.approx(share, abs=0.03)


def test_the_kind_is_drawn_apart_from_everything_else(lead_screw):
    """The first number of a seed's own stream, from which instruments and duration come, says nothing of the kind."""
    first = np.array([np.random.default_rng([seed, 0]).random() for seed in range(2000)])
    kinds = np.array([drawing.draw_kind(seed, lead_screw) for seed in range(2000)])
    for kind in drawing.SHARES:
        assert np.mean(first[kinds == kind]) == pytest.approx(0.5, abs=0.07)


def test_every_effect_that_the_rig_takes_can_be_drawn(lead_screw):
    found = entries(lead_screw)
    assert {"mass_1"}.isdisjoint(place for place, _ in found)  # it moves as the screw does
    names = {name for _, name in found}
    kinds = {e.kind for e in lead_screw.elements.values()} | {"sensor"}
    assert names == {name for (kind, name), one in CATALOGUE.items() if kind in kinds and not one.is_table} & EFFECTS
    without = lead_screw.with_effect("gear", "backlash", {"half_gap": 0.1})
    assert ("gear", "backlash") not in entries(without)  # it is known there
    few = found[::5]
    picks = [drawing._pick((s, 0), few, 1)[0] for s in range(1000)]
    counts = [picks.count(entry) for entry in few]
    assert min(counts) > 0.5 * 1000 / len(few)
    assert max(counts) < 1.6 * 1000 / len(few)
    assert {name for _, name in unknown_entries(lead_screw)} == set(DESCRIPTIONS)


@pytest.mark.check
def test_a_new_entry_of_the_catalogue_leaves_every_other_recording_as_it_was(lead_screw, short, monkeypatch):
    """To the last bit, where it is not hidden itself; a recording in which it is becomes another."""
    seeds = range(30, 38)
    new = [draw(seed, lead_screw, kind="several") for seed in seeds]
    monkeypatch.delitem(CATALOGUE, ("rotor", "gravity"))
    old = [draw(seed, lead_screw, kind="several") for seed in seeds]
    holds = ["gravity" in [e["effect"] for e in secret.effects] for secret in new]
    assert [one == two for one, two in zip(new, old, strict=True)] == [not held for held in holds]
    assert not all(holds)
    picks = [drawing._pick((s, 0), entries(lead_screw), 1) for s in range(300)]
    monkeypatch.undo()
    again = [drawing._pick((s, 0), entries(lead_screw), 1) for s in range(300)]
    changed = [b for a, b in zip(picks, again, strict=True) if a != b]
    assert changed
    assert {name for [(_, name)] in changed} == {"gravity"}


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("target", [3.0, 30.0, 300.0])
def test_a_size_is_found_for_the_visibility_that_was_drawn(power, target):
    size = effect_sizes.strength_for(lambda s: 1e4 * s**power, target, 0.3, 1.0)
    assert 1e4 * size**power == pytest.approx(target, rel=0.25)


def test_a_size_stays_where_the_loop_is_stable_and_the_effect_allowed():
    assert effect_sizes.strength_for(lambda s: s, 300.0, 0.3, 2.0) == 2.0
    stable = effect_sizes.strength_for(lambda s: 10.0 * s if s < 1.0 else math.inf, 300.0, 5.0, 100.0)
    assert 0.3 < stable < 1.0


def test_what_cannot_be_seen_is_not_hidden(lead_screw, short):
    """The light motor of the rig hardly warms up: only who asks for that very effect gets it."""
    secret = draw(1, lead_screw, effect="motor_circuit.resistance_heating")
    assert secret.visibility["motor_circuit.resistance_heating"] < drawing.LEAST_VISIBLE
    assert not drawing._is_seen(secret)


def test_an_error_of_a_sensor_is_recorded(lead_screw, short):
    secret = draw(1, lead_screw, effect="sensor_i_m.offset")
    assert secret.instruments == "rich"
    assert secret.channels == list(lead_screw.sensors)
    assert draw(1, lead_screw, kind="nothing", instruments="minimal").channels == ["theta_m", "q3"]
    with refused("instruments=all: choose one of minimal, rich"):
        draw(1, lead_screw, instruments="all")


@pytest.mark.parametrize("form", ["steps", "staircase", "multisine", "voltage_multisine", "voltage_chirp"])
def test_every_excitation_turns_the_motor_round_often(lead_screw, form):
    rng = np.random.default_rng(3)
    drawn = {**_drawn(rng, lead_screw, closed=not form.startswith("voltage")), "form": form}
    secret = Secret(0, "lead_screw", "nothing", excitation=drawn, channels=["theta_m", "q3"], duration_s=10.0)
    bench = Bench(lead_screw, secret)
    run = bench.quiet(lead_screw)
    speed = run.states[:, 2 + len(run.bodies)]
    assert not run.diverged
    assert np.abs(run.u).max() < 48.0
    assert np.count_nonzero(np.diff(np.sign(speed))) >= 10
    assert 5e-5 < np.std(run.truth["q3"]) < 1e-2


def _drawn(rng, rig, closed):
    while True:
        found = excitation.draw_excitation(rng, rig)
        if found["form"].startswith("voltage") != closed:
            return found


def test_a_disturbance_has_a_course_of_its_own():
    one, two = excitation.disturbance(1, 20.0, 1e-3), excitation.disturbance(2, 20.0, 1e-3)
    assert np.sqrt(np.mean(one**2)) == pytest.approx(1.0)
    assert abs(np.corrcoef(one, two)[0, 1]) < 0.3
