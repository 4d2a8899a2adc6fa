"""The whole loop: it finds nothing where nothing is missing, and one or two effects where they are."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis.engine import proposals
from dtbacklash.diagnosis.engine import selection as searching
from dtbacklash.diagnosis.engine.fit import FittedModel
from dtbacklash.diagnosis.engine.screening import idle_laws, share_of
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.diagnosis.engine.selection import StepwiseSelection, described
from dtbacklash.errors import UserError

from .conftest import command, predictor_of, recorded, segments_of

COULOMB, VISCOUS, GRAVITY = (("disk", name) for name in ("coulomb_friction", "viscous_friction", "gravity"))
#: rig, size of its command, what it has and the nominal one lacks
CASES = {
    "nothing on a pendulum": ("pendulum", 0.4, {}),
    "nothing on an oscillator": ("oscillator", 1.0, {}),
    "nothing on a drive": ("rotary_drive", 1.0, {}),
    "friction": ("pendulum", 0.4, {COULOMB: {"torque": 0.02}}),
    "gravity": ("pendulum", 0.4, {GRAVITY: {"torque": 0.05, "phase": 0.0}}),
    "spring": ("oscillator", 1.5, {("spring", "cubic_stiffness"): {"k3": 2e6}}),
    "drag": ("two_mass_stage", 1.0, {("carriage", "viscous_friction"): {"coefficient": 12.0}}),
    "two frictions": ("pendulum", 0.4, {COULOMB: {"torque": 0.02}, VISCOUS: {"coefficient": 0.004}}),
    "friction and weight": ("pendulum", 0.5, {COULOMB: {"torque": 0.02}, GRAVITY: {"torque": 0.05, "phase": 0.0}}),
}


@cache
def searched(case: str) -> tuple[StepwiseSelection, FittedModel]:
    name, rms, effects = CASES[case]
    rig = true = nominal_rig(name)
    for key, values in effects.items():
        true = true.with_effect(*key, values)
    u = command(8.0, rms)
    found = StepwiseSelection(segments_of(rig, u, recorded(true, u)))
    return found, found.run()


#: the longest search, and beside the other pair the only one with a law of the position: for `make check`
SLOW = {"friction and weight": pytest.mark.check}


@pytest.mark.parametrize("case", [pytest.param(case, marks=SLOW.get(case, ())) for case in CASES])
def test_it_finds_what_is_missing_and_nothing_else(case):
    search, model = searched(case)
    effects = CASES[case][2]
    assert set(model.keys) == set(effects), described(model)
    for key, values in effects.items():
        for name, value in values.items():
            near = {"abs": 0.02} if name == "phase" else {"rel": 0.01}
            assert model.rig.effect(*key)[name] == pytest.approx(value, **near)
    assert search.unknown(model) < 0.01
    if effects:
        assert search.unknown(search.nothing) > 0.05
        assert model.loss < search.nothing.loss - 1000.0
        assert search.gains[next(iter(effects))] > 0.0


def test_the_same_is_found_to_the_last_bit():
    _, model = searched("friction")
    again = searched.__wrapped__("friction")[1]
    assert (again.keys, again.loss) == (model.keys, model.loss)
    assert np.array_equal(again.x, model.x)


def test_a_name_that_is_not_needed_is_taken_out():
    search, model = searched("friction")
    rig = model.rig.with_effect(*VISCOUS, {"coefficient": 1e-5})
    search.now = search.fitted(rig, model, (*model.keys, VISCOUS))
    search.eliminate_backward()
    assert search.now.keys == (COULOMB,)
    search.now = model


def test_what_a_law_makes_of_the_motion_is_its_share():
    search, model = searched("friction")
    # friction takes what it holds of what a volt's torque makes: a good part
    assert 0.05 < share_of(search.segments, model, COULOMB) < 2.0
    assert not idle_laws(search, model)
    faint = replace(model, rig=model.rig.with_effect(*COULOMB, {"torque": 1e-3}))
    assert share_of(search.segments, faint, COULOMB) == pytest.approx(
        share_of(search.segments, model, COULOMB) * 1e-3 / 0.02, rel=0.1
    )
    # beside what stays unknown: nothing, and a tenth of what moves it
    assert not idle_laws(search, faint)
    most = 0.1 / search.unknown(faint)
    much = replace(faint, noise_levels=search.segments.scaled(faint.noise_levels, most))
    assert idle_laws(search, much) == (COULOMB,)
    rules, search.rules = search.rules, replace(search.rules, min_effect=0.5 * share_of(search.segments, much, COULOMB))
    assert not idle_laws(search, much)
    search.rules = rules
    late = replace(model, rig=model.rig.with_effect("sensor_theta", "delay", {"time": 1e-3}))
    assert share_of(search.segments, late, ("sensor_theta", "delay")) == np.inf


def test_a_wrong_name_is_exchanged_for_the_right_ones():
    """From a friction that grows with speed, and a load, to dry friction."""
    search, model = searched("friction")
    wrong = search.nothing.rig.with_effect(*VISCOUS, {"coefficient": 0.01}).with_effect(*GRAVITY, {"torque": 0.002})
    search.now = search.fitted(wrong, search.nothing, (VISCOUS, GRAVITY), (0.1, 1.0))
    before = search.now.score
    assert search.swap()
    assert COULOMB in search.now.keys
    assert search.now.score < before - 1000.0
    search.now = model


def test_what_was_tried_is_kept():
    search, model = searched("two frictions")
    assert search.tried[tuple(sorted(model.keys))] <= model.score + 5.0
    assert min(search.tried.values()) > model.score - 200.0
    assert all(isinstance(m, FittedModel) for tried in search.beaten.values() for m in tried)


def test_a_law_goes_with_what_lets_it_act():
    """A force on the mass that a screw carries acts as long as the screw yields: it is taken out with that."""
    rig, u = nominal_rig("lead_screw"), command(6.0, 3.0)
    size = rig.takes("screw")["compliance"].size
    yields, drags = ("screw", "compliance"), ("mass_1", "viscous_friction")
    both = rig.with_effect(*yields, {size.name: size.typical}).with_effect(*drags, {"coefficient": 5.0})
    search = StepwiseSelection(segments_of(rig, u, recorded(both, u)))
    model = replace(search.nothing, rig=both, keys=(yields, drags))
    assert search.without(model, yields).keys == ()
    assert search.without(model, drags).keys == (yields,)


@pytest.mark.parametrize("seed", [3, 4])
def test_a_law_that_acts_little_at_first_is_at_its_own_place(seed):
    """A small friction of one of two bodies that a spring joins, in a recording that begins quietly."""
    rig = nominal_rig("two_mass_stage")
    true = rig.with_effect("carriage", "viscous_friction", {"coefficient": 3.0})
    u = command(8.0, 1.0, seed - 2)
    u *= np.where(np.arange(len(u)) > 0.4 * len(u), 1.0, 0.02)
    assert StepwiseSelection(segments_of(rig, u, recorded(true, u, seed=seed))).run().keys == (
        ("carriage", "viscous_friction"),
    )


def test_quick_fits_use_the_noise_levels_of_the_stretch_that_they_look_at(monkeypatch):
    """The longest one, which need not be the first."""
    rig = nominal_rig("pendulum")
    true = rig.with_effect(*COULOMB, {"torque": 0.02})
    parts = [(command(s, rms, seed), noise) for s, rms, seed, noise in ((5.0, 0.6, 1, 1e-2), (9.0, 0.3, 2, 1e-4))]
    segments = Segments(rig, tuple(predictor_of(rig, u, recorded(true, u, noise)) for u, noise in parts))
    search = StepwiseSelection(segments)
    asked = []
    columns = searching.CandidateSensitivities

    def spy(segments: Segments, model: FittedModel, sizes, *rest, **named):
        asked.append((segments, sizes))
        return columns(segments, model, sizes, *rest, **named)

    for module in (searching, proposals):
        monkeypatch.setattr(module, "CandidateSensitivities", spy)
    proposals.propose(search, search.nothing)
    proposals.propose(search, search.nothing, quick=True)
    quick = [sizes for seen, sizes in asked if seen is search.quick]
    assert len(quick) >= 2
    noise = search.nothing.noise_levels[1][1:]
    assert np.abs(noise - search.nothing.noise_levels[0][1:]).min() > 1.0
    for sizes in quick:
        assert len(sizes) == 1
        assert np.array_equal(sizes[0][1:], noise)


def test_several_recordings_are_searched_together():
    rig = nominal_rig("pendulum")
    true = rig.with_effect(*COULOMB, {"torque": 0.02})
    pair = [command(s, 0.4, seed) for s, seed in ((5.0, 1), (6.0, 2))]
    model = StepwiseSelection(Segments(rig, tuple(predictor_of(rig, u, recorded(true, u)) for u in pair))).run()
    assert model.keys == (COULOMB,)
    assert model.rig.effect(*COULOMB)["torque"] == pytest.approx(0.02, rel=0.01)
    assert len(model.noise_levels) == 2


def test_progress_is_told():
    said = []
    rig, u = nominal_rig("pendulum"), command(5.0, 0.4)
    StepwiseSelection(segments_of(rig, u, recorded(rig, u)), tell=lambda text, share: said.append((text, share))).run()
    assert said
    assert all(text and 0.0 <= share <= 1.0 for text, share in said)


def test_a_nominal_rig_that_runs_away_is_refused(monkeypatch):
    rig, u = nominal_rig("pendulum"), command(5.0, 0.4)
    segments = segments_of(rig, u, recorded(rig, u))
    monkeypatch.setattr(Segments, "residuals", lambda *_: None)
    with pytest.raises(UserError, match="does not follow it"):
        StepwiseSelection(segments)
