"""Laws that wave over a position: which wave numbers are looked at, and found."""

import numpy as np
import pytest

from dtbacklash.diagnose import Record, diagnose_records
from dtbacklash.diagnose.data.candidates import Candidate
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.refit import QUICK, fit
from dtbacklash.diagnose.propose.locate import Bank
from dtbacklash.diagnose.propose.periodic import wave_grid

from ..conftest import STEP_S, recorded

#: two seconds up to full speed and back, as a motor is run in
AMPLITUDE_V, FREQUENCY_HZ = 7.5, 0.25


@pytest.fixture(scope="module")
def turning(rig):
    """A motor with 24 cogs a turn that passes them too fast to be sampled, at times."""
    t = np.arange(round(16.0 / STEP_S) + 1) * STEP_S
    u = AMPLITUDE_V * np.sin(2.0 * np.pi * FREQUENCY_HZ * t)
    cogging = {"torque": 3e-3, "periods": 24.0, "phase": 1.0}
    return recorded(rig.with_effect("motor_bearing", "cogging", cogging), seed=0, u=u)


def test_where_nothing_moves_no_wave_is_looked_for(rig):
    """A structure that is plucked while its motor rests."""
    t = STEP_S * np.arange(2001)
    q3 = 1e-3 * np.exp(-3.0 * t) * np.cos(20.0 * t) + 1e-6 * np.random.default_rng(0).standard_normal(len(t))
    train = t < 1.4
    still = Record(STEP_S, np.zeros(len(t)), {"q3": q3}, train, ~train)
    evidence = Evidence.gather(rig, [still])
    bank = Bank(evidence, fit(evidence, rig, nominal_free(rig), rounds=QUICK))
    for place, name in (("motor_bearing", "cogging"), ("motor_circuit", "torque_ripple")):
        assert wave_grid(Candidate(place, rig.takes(place)[name]), bank) == []


@pytest.mark.nightly
def test_cogs_that_are_passed_too_fast_at_times_are_found_where_they_are_passed_slowly(rig, turning):
    fastest = np.quantile(np.abs(np.diff(turning.y["theta_m"])) / STEP_S, 0.98)
    assert 24.0 * fastest * STEP_S > 0.5 * np.pi, "a cog has four samples at least"
    found = diagnose_records(rig, [turning])
    assert [(f.location, f.effect) for f in found.findings] == [("motor_bearing", "cogging")]
    assert found.findings[0].parameters["periods"].value == pytest.approx(24.0, rel=1e-3)
