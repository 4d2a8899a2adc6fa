"""The one comparison of two fits, on residuals made up for the purpose; and what the search does by it."""

from dataclasses import replace

import numpy as np
import pytest

from dtbacklash.diagnose.data.candidates import candidates
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import (
    COUNTS,
    EARNS,
    FORMULATION_MAX,
    TOLD,
    alike,
    formulations,
    in_errors,
    lead,
    lead_of,
    other_formulations,
)
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import QUICK, fit
from dtbacklash.diagnose.propose.locate import Bank
from dtbacklash.diagnose.search.leave_out import borne, eliminate, refit_with
from dtbacklash.diagnose.search.model import Log, Model, Named, Trial
from dtbacklash.diagnose.search.order import apart
from dtbacklash.diagnose.settings import SETTINGS

from ..conftest import recorded

NOISE = 1.0
STRETCHES = SETTINGS.paired_stretches
EVERYWHERE = [1.0] * STRETCHES


@pytest.fixture(scope="module")
def evidence(rig) -> Evidence:
    return Evidence.gather(rig, [recorded(rig)])


@pytest.fixture(scope="module")
def nominal(rig, evidence) -> Fit:
    return fit(evidence, rig, nominal_free(rig), rounds=QUICK)


@pytest.fixture(scope="module")
def plain(rig, evidence) -> Fit:
    """A fit of nothing: its residuals are made up in the tests."""
    return fit(evidence, rig, [])


def noise(evidence: Evidence, seed: int = 1) -> dict[str, list[np.ndarray]]:
    """What a true model leaves."""
    rng, samples = np.random.default_rng(seed), evidence.records[0].samples
    return {b.name: [rng.normal(0.0, NOISE, (samples, len(b.channels)))] for b in evidence.blocks}


def beside(evidence: Evidence, left: dict, size: float | list[float], block: str = "motor", seed: int = 2) -> dict:
    """The same with something of another origin in one block, so large (rms) in each stretch of the held-out part."""
    more, rng = left[block][0].copy(), np.random.default_rng(seed)
    held = np.array_split(np.flatnonzero(evidence.records[0].held), STRETCHES)
    for some, rms in zip(held, np.broadcast_to(size, STRETCHES), strict=True):
        more[some, 0] += rms * rng.normal(0.0, 1.0, len(some))
    return {**left, block: [more]}


@pytest.mark.parametrize("seed", range(5))
def test_near_noise_what_differs_by_chance_leads_nothing(evidence, seed):
    """A model that differs from the true one, whose residual is noise, is further from it, by as much as it differs."""
    true = noise(evidence, seed)
    other = beside(evidence, true, 0.5, seed=seed + 10)
    assert not lead_of(evidence, true, other).clear
    ahead = lead_of(evidence, other, true)
    assert ahead.clear
    assert ahead.t > 5.0
    assert ahead.ratio == pytest.approx(np.sqrt((2.0 + 0.5**2) / 2.0), rel=0.05)


def test_nothing_leads_itself(evidence):
    left = noise(evidence)
    same = lead_of(evidence, left, left)
    assert (same.ratio, same.t, same.far, same.clear) == (1.0, 0.0, False, False)


@pytest.mark.parametrize("floors", [30.0, 3000.0])
@pytest.mark.parametrize(("times", "earned", "told"), [(1.05, False, False), (1.2, True, False), (1.5, True, True)])
def test_far_from_noise_the_ratio_counts_whatever_the_size(evidence, floors, times, earned, told):
    left = noise(evidence)
    before, after = (beside(evidence, left, size) for size in (times * floors, floors))
    ahead = lead_of(evidence, before, after)
    assert ahead.ratio == pytest.approx(times, rel=0.01)
    assert ahead.t > TOLD.errors
    assert ahead.agree == 1.0
    assert (ahead.clear, lead_of(evidence, before, after, TOLD).clear) == (earned, told)
    assert not lead_of(evidence, after, before).clear


def test_a_stretch_in_which_something_else_happens_does_not_decide(evidence):
    """Of the mean square one stretch says nearly all; what is in it, both leave."""
    rest = beside(evidence, noise(evidence), [1000.0 if j == 5 else 0.0 for j in range(STRETCHES)], seed=3)
    sizes = np.array([5.0 + j for j in range(STRETCHES)])
    before, after = (beside(evidence, rest, list(sizes * part)) for part in (1.0, 0.5))
    assert lead_of(evidence, before, after, TOLD).clear


def test_a_lead_near_noise_is_one_beside_a_stretch_in_which_both_leave_much(evidence):
    rest = beside(evidence, noise(evidence), [100.0 if j == 5 else 0.0 for j in range(STRETCHES)], seed=3)
    assert lead_of(evidence, beside(evidence, rest, 0.6), rest).clear


def test_one_stretch_that_falls_is_no_lead_where_all_others_rise(evidence):
    """It holds most of the mean square; in the others the second fit leaves a third more."""
    usual = beside(evidence, noise(evidence), [300.0 if j == 5 else 30.0 for j in range(STRETCHES)])
    once = beside(evidence, noise(evidence), [3.0 if j == 5 else 40.0 for j in range(STRETCHES)])
    assert not lead_of(evidence, usual, once).clear


@pytest.mark.parametrize(("ahead_in", "clear"), [(12, True), (10, True), (8, False)])
def test_nearly_all_stretches_agree(evidence, ahead_in, clear):
    left = noise(evidence)
    before = beside(evidence, left, 30.0)
    after = beside(evidence, left, [10.0 if j < ahead_in else 36.0 for j in range(STRETCHES)])
    found = lead_of(evidence, before, after)
    assert found.agree == pytest.approx(ahead_in / STRETCHES, abs=0.01)
    assert found.t > EARNS.errors
    assert found.far
    assert found.clear == clear


@pytest.mark.parametrize(("burst", "share", "clear"), [(300.0, 0.0, True), (300.0, 0.95, False), (0.2, 0.0, False)])
def test_what_happens_once_is_judged_where_it_happens(evidence, burst, share, clear):
    """Thirty samples of one stretch, as when a stop is touched."""
    true = noise(evidence)
    before, after = ({**true, "motor": [true["motor"][0].copy()]} for _ in range(2))
    held = np.flatnonzero(evidence.records[0].held)[100:130]
    before["motor"][0][held, 0] += burst
    after["motor"][0][held, 0] += share * burst
    assert lead_of(evidence, before, after).clear == clear
    assert not lead_of(evidence, after, before).clear


def test_what_differs_by_chance_in_one_stretch_leads_nothing(evidence):
    """An effect of one parameter that acts for thirty samples: one of a hundred candidates does so by chance."""
    clear = 0
    for seed in range(200):
        true, bump = noise(evidence, seed), np.zeros(evidence.records[0].samples)
        bump[np.flatnonzero(evidence.records[0].held)[100:130]] = 2.0 / np.sqrt(30.0)
        other = {**true, "motor": [true["motor"][0] + bump[:, None]]}
        clear += lead_of(evidence, true, other, cost=(1, 0.0)).clear
    assert clear <= 1


def test_a_little_that_shows_in_two_stretches_leads(evidence):
    """A resonance that a chirp passes, hardly larger than the noise."""
    true = noise(evidence)
    before = beside(evidence, true, [0.0, 1.2, 1.2, *[0.0] * (STRETCHES - 3)])
    assert lead_of(evidence, before, true).clear
    assert not lead_of(evidence, true, before).clear


@pytest.mark.parametrize(
    ("parameters", "relief", "clear"), [(0, 0.0, True), (40, 0.0, False), (40, 400.0, True), (0, -400.0, False)]
)
def test_parameters_and_priors_cost(evidence, parameters, relief, clear):
    """A twentieth of a floor in 3600 samples is worth some ninety of minus twice the log-likelihood."""
    true = noise(evidence)
    before = beside(evidence, true, 0.3, "structure")
    assert lead_of(evidence, before, true, cost=(parameters, relief)).clear == clear


def test_an_effect_s_parameters_and_penalty_are_paid_for(rig, evidence, plain):
    true = noise(evidence)
    behind = replace(plain, residuals=beside(evidence, true, 0.3, "structure"))
    rubbing = rig.with_effect("motor_bearing", "stribeck_friction", {"torque": 1e-3, "speed": 1.0})
    ahead = replace(plain, residuals=true, rig=rubbing)
    found, cheaper = lead(evidence, behind, ahead), lead(evidence, behind, replace(ahead, rig=rig))
    assert found.t < cheaper.t
    assert lead_of(evidence, behind.residuals, true, cost=(2, 0.0)) == found
    assert lead(evidence, replace(behind, penalty=9.0), ahead).t > found.t


@pytest.mark.parametrize(("part", "clear"), [("held", False), ("train", True), ("used", True)])
def test_a_lead_is_of_a_part(evidence, part, clear):
    true = noise(evidence)
    before = {**true, "motor": [np.where(evidence.records[0].train[:, None], 3.0, 1.0) * true["motor"][0]]}
    assert lead_of(evidence, before, true, part=part).clear == clear


def test_one_channel_is_enough_beside_a_large_mismatch_elsewhere(evidence):
    rest = beside(evidence, noise(evidence), 300.0, "motor")
    before, after = (beside(evidence, rest, size, "structure") for size in (10.0, 7.0))
    assert lead_of(evidence, before, after).ratio == pytest.approx(10.0 / 7.0, rel=0.02)
    assert lead_of(evidence, before, after).clear


@pytest.mark.parametrize(("times", "far"), [(0.5, False), (2.0, True)])
def test_what_an_encoder_s_counts_pass_on_is_no_lead(evidence, times, far):
    """The structure is driven by the encoder's counts: a part of its floor may be fitted by chance."""
    passed = COUNTS * float(evidence.passed()["structure"][0])
    assert passed > 0.003
    after = noise(evidence)
    before = {**after, "structure": [np.sqrt(1.0 + times * passed) * after["structure"][0]]}
    assert lead_of(evidence, before, after).far == far


@pytest.mark.parametrize(("allowed", "clear"), [(0.1, True), (0.4, False)])
def test_what_another_formulation_would_leave_is_no_lead(evidence, plain, allowed, clear):
    after = noise(evidence)
    before = beside(evidence, after, 0.5, "structure")
    may = {b.name: np.full(len(b.channels), allowed) for b in evidence.blocks}
    assert lead_of(evidence, before, after, allowed=may).clear == clear


def test_formulations_grow_with_the_law_and_are_a_few_floors_at_most(rig, evidence, plain):
    key, left = ("motor_bearing", "coulomb_friction"), []
    for torque in (3e-4, 1e-2):
        rubbing = rig.with_effect(*key, {"torque": torque})
        given = Evidence.gather(rig, [recorded(rubbing, 4.0)])
        left.append(float(formulations(given, fit(given, rubbing, []))["motor"][0]))
    assert left[0] < 0.1 < left[1]
    huge = {key: beside(evidence, noise(evidence), 1e4)}
    assert other_formulations(evidence, replace(plain, residuals=noise(evidence)), huge)["motor"][0] == FORMULATION_MAX


@pytest.mark.parametrize(("times", "same"), [(1.02, True), (1.15, False), (2.0, False)])
def test_fits_are_alike_where_neither_clearly_nor_by_much_one_leads(evidence, plain, times, same):
    left = noise(evidence)
    best, other = (replace(plain, residuals=beside(evidence, left, size)) for size in (30.0, times * 30.0))
    assert alike(evidence, best, other) == same
    assert alike(evidence, other, best)


def test_the_bank_takes_out_what_the_last_fit_left_alone(rig, evidence, nominal):
    """After an effect of the motor a gain of the structure's only sensor is still the lead's, not new."""
    fitted = refit_with(evidence, nominal, [(("amplifier", "dead_zone"), {"half_width": 0.01})])
    assert "p" not in {f.name for f in fitted.free}
    bank = Bank(evidence, fitted)
    listed = candidates(fitted.rig, evidence.blocks, evidence.moving)
    gain = next(c for c in listed if c.key == ("sensor_q3", "gain_error"))
    plain = bank.signature(gain, {"relative": 1e-3}, {})
    left = bank.project(plain)
    assert np.linalg.norm(left) < 0.02 * np.linalg.norm(plain)


def test_what_another_effect_needs_is_not_tried_without(rig, evidence, nominal):
    yielding = rig.with_effect("screw", "compliance", {"compliance": 1e-7})
    pushed = yielding.with_effect("mass_1", "constant_force", {"force": 1.0})
    held = replace(nominal, rig=pushed)
    model = Model(evidence, nominal, held, (Named(("screw", "compliance")), Named(("mass_1", "constant_force"))))
    assert borne(model, ("screw", "compliance"))
    assert not borne(model, ("mass_1", "constant_force"))
    # nothing of it is in the recording
    assert ("mass_1", "constant_force") not in eliminate(model, Log()).keys


def test_what_is_best_in_one_block_does_not_hide_another(evidence, nominal):
    def trial(place: str, name: str, left: float) -> Trial:
        changed = {k: [left * e for e in v] for k, v in nominal.residuals.items()}
        return Trial((place, name), None, replace(nominal, residuals=changed), left)

    motor, again, beyond = (
        trial("amplifier", "saturation", 0.1),
        trial("amplifier", "delay", 0.5),
        trial("screw", "compliance", 0.9),
    )
    first, second = apart(evidence, [again, motor, beyond])
    assert first == [again, motor, beyond]
    assert second == [beyond]


def test_few_stretches_have_to_say_more_than_many():
    rng = np.random.default_rng(0)
    fewest, usual, more = (rng.standard_normal((20000, n)) for n in (2, 12, 40))
    beyond = [float(np.mean(in_errors(values) > 3.5)) for values in (fewest, usual, more)]
    assert beyond[0] == pytest.approx(beyond[1], abs=0.002)
    assert beyond[2] <= beyond[1]
    assert np.array_equal(in_errors(np.ones((3, 1))), np.zeros(3))
    assert np.array_equal(in_errors(np.ones((3, 0))), np.zeros(3))
