"""A resonance that is narrower than it is misplaced."""

from dataclasses import replace

import numpy as np
import pytest
from ringing import blade, known, recorded

from dtbacklash.diagnose import diagnose_records
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.approach import Echo, Stage, approached
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.refit import fit

#: where a fit that begins at the nominal parameters damps the mode of the blade instead of moving it
OFF = {"m_2": 0.21, "k_2": 2.16e4}


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return Evidence.gather(known(blade()), [recorded(blade(**OFF), 5)])


def test_the_fit_alone_ends_in_a_wrong_valley(evidence):
    """Else the next test would show nothing."""
    direct = fit(evidence, evidence.nominal, nominal_free(evidence.nominal))
    assert evidence.rms(direct.residuals) > 3.0


def test_the_fit_that_is_led_ends_at_the_truth(evidence):
    free = nominal_free(evidence.nominal)
    led = fit(evidence, evidence.nominal, free, approached(evidence, evidence.nominal, free, np.zeros(len(free))))
    assert evidence.rms(led.residuals) < 1.05
    found = {f.name: f.value(x) for f, x in zip(free, led.x, strict=True)}
    for name, value in OFF.items():
        assert found[name] == pytest.approx(value, rel=0.02)


@pytest.mark.parametrize("seed", [7, 8])
@pytest.mark.nightly
def test_wrong_frequencies_are_parameters_and_no_physics(seed):
    found = diagnose_records(known(blade()), [recorded(blade(**OFF), seed)])
    assert found.verdict == "parameters"
    assert not found.findings


@pytest.mark.nightly
def test_a_law_beside_wrong_frequencies_is_named_alone():
    truth = blade(**OFF).with_effect("foot", "cubic_stiffness", {"k3": 4e8})
    found = diagnose_records(known(blade()), [recorded(truth, 9)])
    assert found.verdict == "missing_physics"
    assert [(f.location, f.effect) for f in found.findings] == [("foot", "cubic_stiffness")]


def test_of_white_noise_each_lag_has_the_variance_of_what_is_looked_at(evidence):
    """Not more than 1, so that a stage counts as its samples do."""
    record = evidence.records[0]
    rng = np.random.default_rng(1)
    noise = {evidence.blocks[0].name: [rng.normal(0.0, 1.0, (record.samples, 2))]}
    echo = Echo(evidence, evidence.nominal, nominal_free(evidence.nominal), Stage(400, np.inf))
    rows = echo.data(noise, evidence.blocks[0].name)
    taper = 0.5 + 0.5 * np.cos(np.pi * np.arange(400) / 400)
    assert rows.shape == (2, 400)
    # only the training part is looked at; above 100 Hz the command says nothing
    assert 0.6 * 0.2 * 0.5 < np.mean((rows / taper)[:, :200] ** 2) < 0.6 * 0.2 * 1.5


def test_without_ringing_nothing_is_led():
    rig = known(blade(c_1=60.0, c_2=100.0))
    evidence = Evidence.gather(rig, [recorded(rig, 3, 4000)])
    x = np.full(7, 0.3)
    assert np.array_equal(approached(evidence, rig, nominal_free(rig), x), x)


def test_records_of_any_length_and_with_gaps_are_led_together(evidence):
    """A part that is not fitted to, or in which the command rests, says nothing and does no harm."""
    (record,) = evidence.records
    rng = np.arange(record.samples)
    gap = replace(record, train=record.train & ~((rng > 2000) & (rng < 2500)))
    held = replace(record, train=np.zeros(record.samples, dtype=bool))
    short = replace(
        record, u=np.full(900, 0.1), y={c: np.zeros(900) for c in record.y}, train=np.ones(900, dtype=bool),
        held=np.zeros(900, dtype=bool),
    )  # fmt: skip
    free = nominal_free(evidence.nominal)
    several = replace(evidence, records=[short, gap, held])
    led = fit(evidence, evidence.nominal, free, approached(several, evidence.nominal, free, np.zeros(len(free))))
    assert evidence.rms(led.residuals) < 1.05
    none = replace(evidence, records=[short, held])
    x = np.full(len(free), 0.1)
    assert np.array_equal(approached(none, evidence.nominal, free, x), x)
