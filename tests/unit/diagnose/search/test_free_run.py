"""A right law is not taken back for a free run that says nothing: a stage that slides over magnets, in a loop."""

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnose import Record
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.refit import ON, fit
from dtbacklash.diagnose.search.objections import _holds_slowly, _predicts, _repeats, free_error
from dtbacklash.diagnose.search.parts import divided
from dtbacklash.diagnose.search.slow_pull import slow_evidence
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.kernel.plant import new_state
from dtbacklash.physics.kernel.sample import advance, sense
from dtbacklash.physics.rig import Rig

STEP_S, NOISE = 1e-3, 5e-6
KEY = ("carriage", "cogging")
RIPPLE = {"force": 2.0, "wave_number": 420.0, "phase": 0.4}


@pytest.fixture(scope="module")
def stage() -> Rig:
    return nominal_rig("two_mass_stage")


@pytest.fixture(scope="module")
def recorded(stage) -> Record:
    """Steps of the carriage in a PD loop that feels the noise of its sensor."""
    rng, samples = np.random.default_rng(5), 8000
    plant = compile_plant(stage.with_effect(*KEY, RIPPLE), STEP_S)
    state, shown, u, none = new_state(plant), np.zeros((samples, 2)), np.zeros(samples), np.zeros(1)
    before, reference = 0.0, np.repeat(rng.uniform(-0.05, 0.05, 8), samples // 8)
    for k in range(samples):
        sense(plant, state, 0.0, 0.0, shown[k])
        shown[k] += rng.normal(0.0, NOISE, 2)
        u[k] = 60.0 * (reference[k] - shown[k, 0]) - 8.0 * (shown[k, 0] - before) / STEP_S
        before = shown[k, 0]
        advance(plant, state, k * STEP_S, u[k], 0.0, 0.0, none, k)
    train = np.arange(samples) < 0.6 * samples
    y = {"x_c": shown[:, 0].copy(), "x_t": shown[:, 1].copy()}
    return Record(STEP_S, u, y, train, ~train)


def test_a_stage_that_cannot_be_run_freely_is_not_judged_by_that(stage, recorded):
    """The right law, as near as a fit ends, loses the motion beside a rig that happens to keep it."""
    evidence = Evidence.gather(stage, divided([recorded]))
    exact, near = (
        fit(evidence, stage.with_effect(*KEY, {**RIPPLE, "force": force}), []) for force in (2.0, 2.002)
    )  # fmt: skip
    assert evidence.rms(near.residuals) < 1.1
    assert free_error(evidence, near.rig) > 1.0
    assert _holds_slowly(evidence, exact, near, [KEY])
    switched_off = near.rig.with_effect("amplifier", "dead_zone", {"half_width": 1e2})
    assert not _holds_slowly(evidence, exact, fit(evidence, switched_off, []), [KEY, ("amplifier", "dead_zone")])


def test_a_run_from_the_top_of_a_tooth_does_not_repeat_and_one_without_teeth_does(stage, recorded):
    slow = slow_evidence(Evidence.gather(stage, divided([recorded])))
    true, plain = (fit(slow, rig, [], rounds=ON) for rig in (stage.with_effect(*KEY, RIPPLE), stage))
    assert not _repeats(slow, true, [KEY])
    assert _repeats(slow, plain, [])


def test_a_law_that_leaves_noise_under_a_slower_pull_too_is_not_judged_by_the_free_run(stage, recorded):
    """What is nearly the truth snaps to another cog in a free run; what only switches the drive off is pulled along."""
    evidence = Evidence.gather(stage, divided([recorded]))
    plain = fit(evidence, stage, nominal_free(stage))
    near = fit(evidence, stage.with_effect(*KEY, {**RIPPLE, "force": 2.002}), [])
    assert _predicts(evidence, plain, near)
    switched_off = fit(evidence, near.rig.with_effect("amplifier", "dead_zone", {"half_width": 1e2}), [])
    assert not _predicts(evidence, plain, switched_off)
