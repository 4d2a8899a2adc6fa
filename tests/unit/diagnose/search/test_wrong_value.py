"""One parameter of the rig that is off by far more than its tolerance."""

import re

import numpy as np
import pytest
from ringing import blade, known, recorded

from dtbacklash.diagnose import diagnose_records


@pytest.mark.parametrize(
    ("name", "value", "tolerances"), [("m_1", 1.3, 6.0), ("k_1", 1650.0, 4.5), ("m_2", 0.26, 6.0)], ids=str
)
@pytest.mark.nightly
def test_a_value_that_its_tolerance_excludes_is_no_physics(name, value, tolerances):
    found = diagnose_records(known(blade()), [recorded(blade(**{name: value}), 11)])
    assert found.verdict == "parameters"
    assert not found.findings
    estimate = found.recalibrated[name]
    assert estimate.ci95[0] <= value <= estimate.ci95[1]
    (row,) = [c for c in found.checks if c.check == "the rig's parameters are inside their tolerances"]
    assert row.statistic == pytest.approx(tolerances, rel=0.05)
    said = re.search(rf"`{name}` is ([\d.]+) of its tolerances from nominal", found.summary)
    assert said
    assert float(said[1]) == pytest.approx(tolerances, rel=0.05)
    assert not row.passed
    # what is written as the next nominal rig has the tolerance that was given
    assert found.extended.config.parameters[name].tolerance == known(blade()).config.parameters[name].tolerance


@pytest.mark.parametrize("factor", [4.0, 8.0])
@pytest.mark.nightly
def test_a_damping_that_was_guessed_is_found_however_wrong_it_is(factor):
    """Damping is what one knows least of: four times its value was viscous friction, or physics of no name."""
    value = factor * known(blade()).config.parameters["c_2"].value
    found = diagnose_records(known(blade()), [recorded(blade(c_2=value), 15)])
    assert (found.verdict, found.findings) == ("parameters", ())
    estimate = found.recalibrated["c_2"]
    assert estimate.value == pytest.approx(value, rel=0.05)
    assert "of its tolerances from nominal" in found.summary


@pytest.mark.nightly
def test_a_damper_to_the_ground_does_what_viscous_friction_does_and_both_are_said():
    truth = blade(c_1=4.0 * known(blade()).config.parameters["c_1"].value)
    found = diagnose_records(known(blade()), [recorded(truth, 15)])
    assert (found.verdict, found.findings) == ("parameters", ())
    assert [(o.location, o.effect) for o in found.recalibrated["c_1"].also_fits] == [("frame", "viscous_friction")]
    assert "Viscous friction at the frame would explain no less than `c_1`." in found.summary


@pytest.mark.check
def test_a_gain_error_stays_one_and_the_parameter_that_would_do_as_well_is_said():
    """What a gain error does, a gain far off does, too: the tolerance speaks for the effect."""
    truth = blade().with_effect("amplifier", "gain_error", {"relative": -0.5})
    found = diagnose_records(known(blade()), [recorded(truth, 12)])
    assert found.verdict == "missing_physics"
    (finding,) = found.findings
    assert (finding.location, finding.effect, finding.confidence) == ("amplifier", "gain_error", "partial")
    other = finding.also_fits[-1]
    assert other.effect in known(blade()).config.elements[other.location].values()
    assert f"cannot tell gain error from {other.effect.replace('_', ' ')} at the" in found.summary
    assert "of its tolerances from nominal" in found.summary
    assert "by itself" in found.next_experiment


@pytest.mark.nightly
def test_two_values_that_are_off_are_not_a_gain_error_for_sure():
    """The mass by four of its tolerances, the stiffness by 2.5: nearly what a gain error does with a softer spring."""
    truth = blade(m_1=1.2, m_2=0.24, k_1=1.25 * 3000.0, k_2=1.25 * 2.4e4)
    found = diagnose_records(known(blade()), [recorded(truth, 14)])
    assert not any(f.confidence == "sure" for f in found.findings)


@pytest.mark.nightly
def test_a_law_is_not_taken_for_a_parameter_that_is_off():
    truth = blade().with_effect("foot", "cubic_stiffness", {"k3": 2e9})
    found = diagnose_records(known(blade()), [recorded(truth, 13)])
    assert [(f.location, f.effect) for f in found.findings] == [("foot", "cubic_stiffness")]
    assert np.isfinite(found.findings[0].parameters["k3"].ci95).all()
