"""Whether the loop rests, and the half-gap in force."""

import math
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats, Ints
from dtbacklash.core.library import buffer, lib, struct
from dtbacklash.experiment.loop import GapInForce
from dtbacklash.twin.link.service import Answer

#: at rest: samples of a stretch, how far the means of two may differ (rad, m), and how many times that a stretch spans
AT_REST, STILL, SWINGS = 250, (0.03, 2e-6), 10.0


def at_rest(seen: Floats, roles: tuple[int, int], changes: Ints, k: int) -> bool:
    """Whether the loop is at rest before sample k: its reference has not changed for a while, and nothing moves.

    Nothing moves: the means of the last two stretches of AT_REST samples differ by no more than STILL (rad, m). The
    motor may creep in its gap.
    """
    if k < 2 * AT_REST or bool(np.any((changes > k - 2 * AT_REST) & (changes <= k))):
        return False
    for role, still in zip(roles, STILL, strict=True):
        before, now = seen[k - 2 * AT_REST : k - AT_REST, role], seen[k - AT_REST : k, role]
        if abs(float(np.mean(now) - np.mean(before))) > still or float(np.ptp(now)) > SWINGS * still:
            return False
    return True


class HalfGap:
    """The half-gap in force, as the core keeps it (``adaptation.c``): put in force, grown, judged, taken back.

    gap_rad : at the first sample. growth_s : for how long an answer's gap goes on growing. most_rad : physical bound.
    """

    def __init__(self, gap_rad: float, sample_time_s: float, growth_s: float, most_rad: float) -> None:
        self.struct = struct(
            "GapInForce", sample_time=sample_time_s, grows_s=growth_s, most=most_rad, gap=gap_rad, rested=gap_rad,
            new_since=-1, condemned=math.inf, forgiven=-1,
        )  # fmt: skip

    def at(self, k: int) -> float:
        """The half-gap at sample k, rad."""
        found: float = lib.dtb_gap_at(self.struct, k)
        return found

    @property
    def segment(self) -> GapInForce:
        """It as the samples of a segment take it."""
        return GapInForce(self.struct.gap, self.struct.growth, self.struct.since)

    def grows_until(self) -> int | None:
        """The sample at which it stops growing; None while it does not grow."""
        return int(self.struct.until) if self.struct.growth else None

    def end_growth(self, k: int) -> None:
        """Stop it growing where that is due before sample k."""
        lib.dtb_end_growth(self.struct, k)

    def put(self, answer: Answer, middle: int, k: int) -> bool:
        """Put an answer in force at sample k, whose buffer has its ``middle`` there; False where it is not believed."""
        return bool(lib.dtb_put_in_force(self.struct, answer_struct(answer, middle), k))

    def judged_at(self, last_change: int) -> int | None:
        """The sample from which on a new one may be judged, if the reference does not change; None: none is new."""
        found: int = lib.dtb_judged_at(self.struct, last_change)
        return None if found < 0 else found

    def take_back(self, k: int, theta_m: Floats) -> bool:
        """Go back to the last one that rested, if the motor goes round in it; theta_m (n,), rad, before sample k."""
        stretch = lib.dtb_stretch(self.struct)
        spans = np.array([np.ptp(theta_m[k - 2 * stretch : k - stretch]), np.ptp(theta_m[k - stretch : k])])
        return bool(lib.dtb_take_back(self.struct, k, buffer(spans)))

    @property
    def condemned_rad(self) -> float:
        """The half-gap that was taken back, rad."""
        return float(self.struct.condemned)


def answer_struct(answer: Answer, middle: int) -> Any:
    """What the twin answers, as the core takes it. middle : sample in the middle of its buffer."""
    e = answer.chosen.estimate
    return struct(
        "GapAnswer", half_gap=answer.gap_rad, gap=e.gap_rad, std=e.std_rad, growth=e.growth_rad_s,
        growth_std=e.growth_std_rad_s, guarded=answer.guarded, middle=middle,
    )  # fmt: skip
