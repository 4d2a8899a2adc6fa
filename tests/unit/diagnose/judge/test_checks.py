"""The checks: each statistic against what is known of it, and rows that fail where something is wrong."""

import numpy as np
import pytest
from scipy.stats import chi2

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.errors import free_running
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.judge.checks import all_checks, coloured, ljung_box, whiteness
from dtbacklash.diagnose.search.leave_out import refit_with
from dtbacklash.diagnose.search.model import Model, Named
from dtbacklash.diagnose.settings import SETTINGS

from ..conftest import recorded

COULOMB = ("motor_bearing", "coulomb_friction")


def test_ljung_box_of_white_noise_has_its_distribution_and_colour_shows():
    rng, lags = np.random.default_rng(1), SETTINGS.white_lags
    values = [ljung_box(rng.standard_normal(3000), lags) for _ in range(200)]
    assert np.mean(values) == pytest.approx(lags, rel=0.1)
    assert np.mean(np.array(values) > chi2.ppf(0.95, lags)) == pytest.approx(0.05, abs=0.04)
    white = rng.standard_normal(3000)
    assert ljung_box(white[1:] + 0.3 * white[:-1], lags) > 100
    assert ljung_box(np.zeros(3000), lags) == 0.0
    assert np.isnan(ljung_box(white[:50], lags))


@pytest.fixture(scope="module")
def evidence(rig):
    return Evidence.gather(rig, [recorded(rig.with_effect(*COULOMB, {"torque": 0.02}), seconds=8.0)])


@pytest.fixture(scope="module")
def nominal(rig, evidence):
    return fit(evidence, rig, nominal_free(rig))


def rows(model, errors):
    free = free_running(model.evidence, model.nominal, model.fitted)
    return {c.check: c for c in all_checks(model, errors, free, None)}


def test_a_model_that_lacks_friction_fails_and_says_where(evidence, nominal):
    found = rows(Model(evidence, nominal, nominal), {})
    assert not found["residual of theta_m is noise"].passed
    assert found["residual of theta_m is noise"].statistic > 100
    assert not found["residual of theta_m is white"].passed
    assert found["recalibrated no worse than nominal"].passed
    assert "the findings lower the held-out error" not in found
    assert all(c.source and c.comment for c in found.values())


def test_a_model_with_it_passes(evidence, nominal):
    fitted = refit_with(evidence, nominal, [(COULOMB, {"torque": 0.015})])
    found = rows(Model(evidence, nominal, fitted, (Named(COULOMB),)), {(*COULOMB, "torque"): 1e-5})
    assert [c.check for c in found.values() if not c.passed] == []
    away = found["Coulomb friction at motor bearing is not zero"]
    assert (away.operator, away.threshold) == (">", 1.96)
    assert away.statistic == pytest.approx(2000, rel=0.1)


def test_an_effect_of_nothing_and_a_parameter_at_its_end_are_seen(rig, evidence, nominal):
    nothing = refit_with(evidence, nominal, [(COULOMB, {"torque": 0.015})])
    nothing = fit(evidence, nothing.rig.with_effect(*COULOMB, {"torque": 1e-9}), [])
    far = fit(evidence, nothing.rig.with_parameters({"m": 5.0 * (1 + 3.0 * rig.config.parameters["m"].tolerance)}), [])
    over = {"mass": 0.5, "frequency": 12.0, "damping_ratio": 2.0}
    far = fit(evidence, far.rig.with_effect("mass_2", "absorber", over), [])
    named = Named(COULOMB), Named(("mass_2", "absorber"))
    found = rows(Model(evidence, nominal, far, named), {(*COULOMB, "torque"): 1e-5})
    assert not found["Coulomb friction at motor bearing is not zero"].passed
    assert not found["the findings' parameters are inside their bounds"].passed
    assert "`damping_ratio`" in found["the findings' parameters are inside their bounds"].comment
    without = rows(Model(evidence, nominal, far, (Named(COULOMB),)), {})
    assert without["Coulomb friction at motor bearing is not zero"].statistic is None


def test_running_freely_is_judged_by_the_commands_alone(rig, evidence, nominal):
    fitted = refit_with(evidence, nominal, [(COULOMB, {"torque": 0.015})])
    free = free_running(evidence, nominal, fitted)
    assert free.held_out.extended < 0.02 < free.held_out.nominal


def test_a_free_simulation_that_runs_away_is_none(evidence, nominal):
    wild = fit(evidence, nominal.rig.with_effect("link_1", "cubic_stiffness", {"k3": -1e14}), [])
    free = free_running(evidence, nominal, wild)
    assert free.train.extended is None
    assert free.held_out.extended is None
    assert free.held_out.nominal is not None


def test_what_is_left_of_a_law_is_coloured_and_what_is_left_of_the_truth_is_not(evidence, nominal):
    fitted = refit_with(evidence, nominal, [(COULOMB, {"torque": 0.015})])
    assert coloured(whiteness(evidence, fitted)) == set()
    off = fit(evidence, fitted.rig.with_effect(*COULOMB, {"torque": 0.0152}), [])
    assert "theta_m" in coloured(whiteness(evidence, off))
