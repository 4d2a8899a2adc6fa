"""What earns its place: on residuals made up for the purpose, and beside parameters that could do the same."""

from dataclasses import replace

import numpy as np
import pytest

from dtbacklash.diagnose.data.candidates import candidates
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import (
    earns,
    formulation_floors,
    in_errors,
    in_errors_of_noise,
    paired,
    significance,
)
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import QUICK, fit
from dtbacklash.diagnose.propose.locate import Bank
from dtbacklash.diagnose.search.grow import _from_the_middle
from dtbacklash.diagnose.search.leave_out import borne, eliminate, refit_with
from dtbacklash.diagnose.search.model import Log, Model, Named, Trial
from dtbacklash.diagnose.search.order import apart
from dtbacklash.diagnose.settings import settings

from ..conftest import recorded


@pytest.fixture(scope="module")
def evidence(rig) -> Evidence:
    return Evidence.gather(rig, [recorded(rig)])


@pytest.fixture(scope="module")
def nominal(rig, evidence) -> Fit:
    return fit(evidence, rig, nominal_free(rig), rounds=QUICK)


def made(nominal: Fit, evidence: Evidence, seed: int, burst: float = 0.0, share: float = 1.0) -> Fit:
    """The fit with noise for residuals, and in the motor's a short burst in the held-out part."""
    rng = np.random.default_rng(seed)
    residuals = {}
    for block in evidence.blocks:
        shape = nominal.residuals[block.name][0].shape
        residuals[block.name] = [rng.normal(0.0, 1.0, shape)]
    held = np.flatnonzero(evidence.records[0].held)
    residuals["motor"][0][held[100:130], 0] += burst * share
    return replace(nominal, residuals=residuals)


def test_a_burst_that_goes_is_sure_though_it_is_in_one_stretch(nominal, evidence):
    before, after = made(nominal, evidence, 1, burst=300.0), made(nominal, evidence, 1)
    after.residuals["structure"] = before.residuals["structure"]
    assert paired(evidence, before, after)[2] < 2.0
    assert earns(evidence, before, after, before)


def test_a_burst_that_shrinks_is_not(nominal, evidence):
    before, after = made(nominal, evidence, 1, burst=300.0), made(nominal, evidence, 1, burst=300.0, share=0.5)
    after.residuals["structure"] = before.residuals["structure"]
    assert not earns(evidence, before, after, before)


def test_a_little_that_shows_once_is_sure_if_it_leaves_noise(nominal, evidence):
    """A resonance that a chirp passes: in two of a dozen stretches, where it is hardly larger than the noise."""
    before, after = made(nominal, evidence, 1), made(nominal, evidence, 1)
    held = np.flatnonzero(evidence.records[0].held)
    before.residuals["motor"][0][held[100:700], 0] += 1.5 * np.sin(0.3 * np.arange(600))
    after.residuals["structure"] = before.residuals["structure"]
    assert paired(evidence, before, after)[2] < 2.0
    assert earns(evidence, before, after, before)
    assert not earns(evidence, after, before, before)


@pytest.mark.parametrize("seed", range(5))
def test_what_differs_from_noise_by_chance_gains_nothing(nominal, evidence, seed):
    """A model that differs from the true one, whose residual is noise, is further from it, by as much as it differs."""
    before, other = made(nominal, evidence, seed), made(nominal, evidence, seed)
    held = np.flatnonzero(evidence.records[0].held)
    other.residuals["motor"][0][held[100:700], 0] += 1.5 * np.sin(0.3 * np.arange(600) + seed)
    other.residuals["structure"] = before.residuals["structure"]
    assert abs(in_errors_of_noise(evidence, before, other, {"motor": [0]})) < 4.0
    assert in_errors_of_noise(evidence, other, before, {"motor": [0]}) > 10.0


def test_a_mismatch_that_few_stretches_hold_most_of_is_seen_to_fall(nominal, evidence):
    """A law that leaves a thirtieth of it everywhere is sure, though of the loss itself one stretch says nearly all."""
    before, after = made(nominal, evidence, 1), made(nominal, evidence, 2)
    held = np.flatnonzero(evidence.records[0].held)
    for number, some in enumerate(np.array_split(held, 12)):
        mismatch = (300.0 if number == 5 else 5.0 + number) * np.ones(len(some))
        before.residuals["motor"][0][some, 0] += mismatch
        after.residuals["motor"][0][some, 0] += mismatch / 30.0
    after.residuals["structure"] = before.residuals["structure"]
    squares = [evidence.stretches(fitted.residuals, "motor")[0] for fitted in (before, after)]
    fall = squares[0] - squares[1]
    assert fall.mean() < 2.0 * fall.std(ddof=1) / np.sqrt(len(fall))
    assert significance(evidence, before.residuals, after.residuals) > 2.0
    assert significance(evidence, after.residuals, before.residuals) < -1.0


def test_what_the_counts_pass_on_is_not_earned(nominal, evidence):
    """The structure is driven by the encoder's counts: a part of its floor may be fitted by chance."""
    before = made(nominal, evidence, 1)
    after = replace(before, residuals={**before.residuals, "structure": [0.95 * before.residuals["structure"][0]]})
    gained = 1.0 - 0.95**2
    passed = float(evidence.passed()["structure"][0])
    assert passed > 0.01
    assert paired(evidence, before, after)[1] == pytest.approx(gained - settings().earn_counts_share * passed, abs=0.02)


@pytest.mark.parametrize(
    ("place", "effect", "values", "earned"),
    [("sensor_q2", "delay", {"time": 1e-3}, True), ("mass_2", "ground_friction", {"force": 0.1}, False)],
)
def test_what_a_sensor_does_wrong_is_earned_in_its_own_channel(rig, place, effect, values, earned):
    """Beside a large mismatch elsewhere a third of its own is a sixth of all: too little for an effect of a body."""
    record = recorded(rig)
    record.y["q2"] = record.y["q3"] + np.random.default_rng(0).normal(0.0, 1e-6, record.samples)
    evidence = Evidence.gather(rig, [record])
    (block,) = [b for b in evidence.blocks if "q2" in b.channels]
    nominal = fit(evidence, rig, [])
    before = made(nominal, evidence, 1)
    before.residuals[block.name][0][:] *= 10.0
    column = block.channels.index("q2")
    after = replace(before, rig=rig.with_effect(place, effect, values), residuals=dict(before.residuals))
    after.residuals[block.name] = [before.residuals[block.name][0].copy()]
    after.residuals[block.name][0][:, column] *= np.sqrt(0.65)
    assert earns(evidence, before, after, before) == earned


@pytest.mark.parametrize(("torque", "believed"), [(3e-4, True), (1e-2, False)])
def test_what_is_tiny_is_believed_where_no_law_has_another_formulation_as_large(rig, torque, believed):
    """A tenth of a floor, beside a mismatch of a million that dry friction and the parameters made."""
    rubbing = rig.with_effect("motor_bearing", "coulomb_friction", {"torque": torque})
    evidence = Evidence.gather(rig, [recorded(rubbing, 4.0)])
    before, after = (replace(made(fit(evidence, rubbing, []), evidence, 1), rig=rubbing) for _ in range(2))
    before.residuals["motor"] = [1.05 * after.residuals["motor"][0]]
    assert (formulation_floors(evidence, before) < 0.1) == believed
    assert earns(evidence, before, after, before)
    huge = replace(before, residuals={k: [1e3 * e for e in v] for k, v in after.residuals.items()})
    assert earns(evidence, before, after, huge) == believed


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


def test_a_fit_from_the_middle_is_of_all_blocks(rig):
    """What a fit says of a block is what its rig leaves there, also where the block has no effect."""
    truth = rig.with_parameters({"k": 8800.0, "k_B": 0.1145}).with_effect("amplifier", "dead_zone", {"half_width": 0.1})
    given = Evidence.gather(rig, [recorded(truth, seconds=6.0)])
    first = fit(given, rig, nominal_free(rig))
    with_it = refit_with(given, first, [(("amplifier", "dead_zone"), {"half_width": 0.1})])
    astray = with_it.rig.with_parameters({"k_B": 0.1 * (1.0 + 0.05 * 1.01 * settings().astray_tolerances)})
    stuck = replace(with_it, rig=astray, residuals=given.residuals(astray))
    model = _from_the_middle(Model(given, first, stuck, (Named(("amplifier", "dead_zone")),)))
    assert model.fitted is not stuck
    again = given.residuals(model.fitted.rig)
    for block in given.blocks:
        assert np.allclose(model.fitted.residuals[block.name][0], again[block.name][0])
    assert max(v.max() for v in given.mean_square(again, "held").values()) < 1.5


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
