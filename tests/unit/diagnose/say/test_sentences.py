"""What is said: when a finding matters, what of a name is open, and how much is explained."""

import numpy as np
import pytest

from dtbacklash.diagnose.named import Ground, Stands
from dtbacklash.diagnose.say.sentences import _when_it_moves, explained_said, open_said
from dtbacklash.diagnose.shown import Explained, Left

from ..conftest import STEP_S

T_S = STEP_S * np.arange(8000)
#: of what swings
SPEED = 4.0 * np.cos(4.0 * T_S)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (np.exp(-((SPEED / 0.2) ** 2)), "of the mismatch lies within 50 ms of a velocity reversal"),
        ((SPEED / 4.0) ** 8, "of the mismatch lies in the quarter of the time in which it moves fastest"),
        (np.ones(len(T_S)), ""),
    ],
)
def test_when_a_change_goes_with_reversals_or_with_speed_it_is_said(change, expected):
    assert _when_it_moves(STEP_S, SPEED, change).endswith(expected)
    assert bool(_when_it_moves(STEP_S, SPEED, change)) == bool(expected)


@pytest.mark.parametrize(
    ("where", "law", "size", "expected"),
    [
        (True, True, True, ""),
        (False, True, True, " The recording leaves open where it acts."),
        (True, False, True, " The recording leaves open which law it is."),
        (False, False, True, " The recording leaves open where it acts and which law it is."),
        (True, False, False, " The recording hardly needs it: it may not be there."),
    ],
)
def test_what_of_a_name_is_open_is_said(where, law, size, expected):
    assert open_said(Stands(Ground(where), Ground(law), Ground(size))) == expected


LEFT = {"q3": Left(5e-5, "m", 0.021, 12.3)}
REST = "Left: q3 0.05 mm (2.1 % of its motion, 12 floors)"


@pytest.mark.parametrize(
    ("much", "findings", "expected"),
    [
        (
            Explained(0.5, 0.9731, LEFT), True,
            "The extended rig explains 97.3 % of the mismatch as compared and 50 % of the mismatch simulated freely. "
            f"{REST}.",
        ),
        (
            Explained(-3.0, 0.99995, LEFT), False,
            f"The recalibrated rig explains over 99.99 % of the mismatch as compared. {REST}.",
        ),
        (
            Explained(None, 0.9991, LEFT, True), True,
            f"The extended rig explains 99.910 % of the mismatch as compared. {REST}, which is what was called enough.",
        ),
        (Explained(None, None, LEFT, False), True, f"{REST}, more than what was called enough."),
    ],
)  # fmt: skip
def test_how_much_is_explained_is_said(much, findings, expected):
    assert explained_said(much, findings) == expected
