"""The bank of signatures: where a fit begins."""

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.search.grow import scores_about
from dtbacklash.diagnose.search.model import Log, Model
from dtbacklash.physics.simulate import simulate

from ..conftest import STEP_S, Record, command


@pytest.mark.parametrize("lost_motion", [0.02, 0.4])
def test_a_play_is_begun_with_at_a_size_from_which_there_is_a_way(lost_motion):
    """The stretch of the nominal shaft, from which the search begins, is far below the wider play."""
    rig = nominal_rig("rotary_drive")
    u = command(6.0, 4)
    shown = simulate(rig.with_effect("shaft", "backlash", {"lost_motion": lost_motion}), u[:-1], STEP_S).sensors
    noise = np.random.default_rng(4).normal(0.0, 1e-5, len(u))
    mask = np.arange(len(u)) < 0.7 * len(u)
    record = Record(STEP_S, u, {"theta_m": shown["theta_m"] + noise, "theta_l": shown["theta_l"] + noise}, mask, ~mask)
    evidence = Evidence.gather(rig, [record])
    nominal = fit(evidence, rig, nominal_free(rig))
    scores = {s.candidate.key: s for s in scores_about(Model(evidence, nominal, nominal), Log())}
    assert 0.25 * lost_motion < scores["shaft", "backlash"].values["lost_motion"] < 4.0 * lost_motion
