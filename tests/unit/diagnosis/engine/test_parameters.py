"""What a rig is known to after a diagnosis."""

import math

import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis.engine.parameters import with_errors


@pytest.mark.parametrize(
    ("calibrated", "share", "known"),
    [
        (True, 0.004, 0.004),  # the recording has told more
        (True, 1e-6, 1e-3),  # no recording knows the next one so well
        (True, 3.0, None),  # it has told less
        (True, math.nan, None),
        (False, 0.004, None),  # it is not explained
    ],
)
def test_a_recording_narrows_what_is_believed_of_a_parameter(calibrated, share, known):
    rig = nominal_rig("lead_screw")
    before = rig.config.parameters["k"]
    after = with_errors(rig, {("", "", "k"): share * before.value}, calibrated).config.parameters
    assert after["k"].tolerance == pytest.approx(before.tolerance if known is None else known)
    assert after["k"].value == before.value
    assert after["J"] == rig.config.parameters["J"]
