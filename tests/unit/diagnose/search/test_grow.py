"""The search for names: where quick fits begin, and which rivals are finished."""

from dataclasses import replace

import pytest
from nominal import nominal_rig

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import held_loss
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.refit import FULL, QUICK, fit
from dtbacklash.diagnose.search import attempts, grow
from dtbacklash.diagnose.search.model import Log, Model, Trial
from dtbacklash.diagnose.search.rivals import _in_place
from dtbacklash.diagnose.settings import SETTINGS

from ..fit.test_refit import shaken

STIFFENING = ("spring", "cubic_stiffness")
#: it comes to what leaves noise; it never does
CLOSE, HOPELESS = STIFFENING, ("spring", "quadratic_damping")


@pytest.fixture(scope="module")
def recalibrated() -> Model:
    """Of an oscillator whose spring hardens: what the parameters can do for that, which leads them astray."""
    rig = nominal_rig("oscillator")
    evidence = Evidence.gather(rig, [shaken(rig.with_effect(*STIFFENING, {"k3": 2e6}))])
    fitted = fit(evidence, rig, nominal_free(rig))
    return Model(evidence, fitted, fitted)


def trial(model: Model, key: tuple[str, str]) -> Trial:
    """A quick fit of the best value in the bank."""
    score = next(s for s in grow.scores_about(model, Log()) if s.candidate.key == key)
    return attempts.attempt(model.evidence, model.fitted, score)


def test_a_rival_that_leaves_far_more_at_a_glance_is_not_finished(recalibrated, monkeypatch):
    model, fitted = recalibrated, []
    plain = attempts.refit_with

    def counted(evidence, current, added, left_out=None, rounds=FULL, near=None):
        fitted.append((added[0][0], rounds))
        return plain(evidence, current, added, left_out, rounds, near)

    rivals = [trial(model, key) for key in (CLOSE, HOPELESS)]
    chosen = attempts.finish(model.evidence, model.fitted, rivals[0]).fitted
    monkeypatch.setattr(attempts, "refit_with", counted)
    beside, log = replace(model, fitted=chosen), Log()
    ended = _in_place(beside, log, model.fitted, rivals)
    assert set(fitted) == {(CLOSE, QUICK), (HOPELESS, QUICK), (CLOSE, FULL)}
    left = {t.key: t.held_out for t in ended}
    assert left[CLOSE] == pytest.approx(held_loss(model.evidence, chosen), rel=0.02)
    assert left[HOPELESS] > SETTINGS.hopeless_ratio * left[CLOSE]
    fitted.clear()
    again = _in_place(beside, log, model.fitted, rivals)
    assert not fitted
    assert {t.key: t.held_out for t in again} == left
