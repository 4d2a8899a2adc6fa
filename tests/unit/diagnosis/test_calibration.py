"""Calibration: intervals, correlations, and what a recording cannot see, in words."""

import numpy as np
import pytest

from dtbacklash.diagnosis import diagnose_records
from dtbacklash.diagnosis.explain.calibration import blind_said


def test_a_rig_is_calibrated_as_it_is_and_nothing_is_named(rig, clean):
    """Of positions alone no recording tells the size of masses, springs and dampers that grow together."""
    softer = rig.with_parameters({"k": 1.05 * rig.config.parameters["k"].value})
    found = diagnose_records(softer, [clean], depth="none")
    assert not found.findings
    assert found.verdict in ("parameters", "consistent")
    calibration = found.calibration
    k, m = calibration.parameters["k"].value, calibration.parameters["m"].value
    assert k / m == pytest.approx(rig.config.parameters["k"].value / rig.config.parameters["m"].value, rel=1e-3)
    assert calibration.correlation["k"]["m"] > 0.9
    matrix = np.array([list(row.values()) for row in calibration.correlation.values()])
    assert np.allclose(matrix, matrix.T)
    assert np.allclose(np.diag(matrix), 1.0)
    (growing,) = [one for one in calibration.blind if "k" in one.parameters]
    assert growing.sentence == "`m`, `k` and `c` can grow alike: the recording does not notice."
    assert found.summary.startswith("No physics was looked for (search=none)")


@pytest.mark.parametrize(("changes", "said"), [
    ({"k": 1.0, "m": 1.1}, "`k` and `m` can grow alike: the recording does not notice."),
    ({"k": 1.0, "m": 3.0}, "`k` and `m` can grow together: the recording does not notice."),
    ({"R": 1.0, "J": -0.5}, "`R` can grow while `J` falls: the recording does not notice."),
    ({"c": -1.0}, "`c` is not seen: it stays as it was believed."),
])  # fmt: skip
def test_a_blind_direction_in_words(changes, said):
    assert blind_said(changes) == said
