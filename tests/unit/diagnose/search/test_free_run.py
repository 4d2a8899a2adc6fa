"""A right law is not taken back where no free run can follow: a stage that slides over magnets, in a loop."""

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnose import Record
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.search.objections import hands_back
from dtbacklash.diagnose.search.parts import divided
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


def test_what_a_slower_pull_bears_out_stays_and_what_hands_the_measurement_back_goes(stage, recorded):
    """A carriage that snaps to another cog after the smallest error is judged by no free run."""
    evidence = Evidence.gather(stage, divided([recorded]))
    plain = fit(evidence, stage, nominal_free(stage))
    near = fit(evidence, stage.with_effect(*KEY, {**RIPPLE, "force": 2.002}), [])
    assert evidence.rms(near.residuals) < 1.1
    assert hands_back(evidence, plain, near, (KEY,)) is None
    off = ("amplifier", "dead_zone")
    switched_off = fit(evidence, near.rig.with_effect(*off, {"half_width": 1e2}), [])
    assert hands_back(evidence, near, switched_off, (KEY, off)) == off
