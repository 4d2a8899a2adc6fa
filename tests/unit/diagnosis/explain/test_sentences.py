"""What is said: when a finding matters, what of a name is open, and how much is explained."""

import numpy as np
import pytest

from dtbacklash.diagnosis.explain.sentences import _when_it_moves, certainty_said, explained_said
from dtbacklash.diagnosis.findings import Alternative, Evidence, Ground
from dtbacklash.diagnosis.plot_data import Explained, Left

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


LATE = ("moving_average", "low_pass")


@pytest.mark.parametrize(
    ("mark", "grounds", "others", "explains", "expected"),
    [
        ("sure", (True, True, True), (), True, ""),
        ("one_of", (True, False, True), LATE, True,
         " (delay, moving average or low pass: this recording cannot tell which)"),
        ("one_of", (True, False, True), ("speed_table",), True,
         " (delay or another law over the speed: this recording cannot tell which)"),
        ("partial", (False, True, True), (), True, ". The recording leaves open where it acts"),
        ("partial", (False, False, True), (), True, ". The recording leaves open where it acts and which law it is"),
        ("partial", (True, False, False), (), True,
         ". It may not be there: the rig without it predicts the recording as well"),
        ("partial", (True, True, True), (), False,
         ". It leads all that was tried in its place, but most of what was unknown is left"),
    ],
)  # fmt: skip
def test_what_of_a_name_is_open_follows_from_what_it_does_not_lead(mark, grounds, others, explains, expected):
    where, law, size = map(Ground, grounds)
    also = [Alternative("sensor_q3", effect) for effect in others]
    assert certainty_said(mark, Evidence(where, law, size), ("sensor_q3", "delay"), also, explains) == expected


def test_laws_that_fit_alike_at_other_places_are_said_with_their_places():
    stands = Evidence(Ground(False), Ground(True), Ground(True))
    said = certainty_said("one_of", stands, ("amplifier", "delay"), [Alternative("shaker", "lag")], True)
    assert said == " (delay at the amplifier or lag at the shaker: this recording cannot tell which)"


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
