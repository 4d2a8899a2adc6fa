"""Effects that the catalogue should have, and does not yet (docs/diagnosis.md, Limits)."""

import pytest

from dtbacklash.physics.catalogue import CATALOGUE


@pytest.mark.xfail(
    reason="the law of friction by direction serves rotors, carriages and brakes, and has no entry for a mass",
    strict=True,
    raises=AssertionError,
)
def test_friction_between_a_mass_and_the_ground_may_differ_by_direction() -> None:
    if ("carriage", "asymmetric_friction") not in CATALOGUE or ("mass", "ground_friction") not in CATALOGUE:
        pytest.fail("the catalogue has other names now")
    assert ("mass", "asymmetric_friction") in CATALOGUE
