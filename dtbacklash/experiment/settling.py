"""Whether the loop rests or goes round in a cycle, and how fast the gap in force grows between two answers."""

import math

import numpy as np

from dtbacklash.arrays import Floats, Ints
from dtbacklash.twin.link.service import Answer

#: at rest: samples of a stretch, how far the means of two may differ (rad, m), and how many times that a stretch spans
AT_REST, STILL, SWINGS = 250, (0.03, 2e-6), 10.0
#: how long a loop has before its new gap is judged, and each of the two stretches that are looked at, s
JUDGED_AFTER_S, STRETCH_S = 3.0, 1.0
#: the gap in force grows at most so many times as fast as it grew between the last two answers
AHEAD = 2.0


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


def cycles(theta_m: Floats, gap_rad: float) -> bool:
    """Whether the motor goes round in its believed gap: in both halves of theta_m (n,), rad, it spans the half-gap.

    In a cycle within the gap it strikes both ends of it, so that it spans twice the half-gap and more.
    """
    half = theta_m.size // 2
    least = max(gap_rad, SWINGS * STILL[0])
    return bool(np.ptp(theta_m[:half]) > least and np.ptp(theta_m[half:]) > least)


def growth_ahead(answer: Answer, earlier: tuple[float, Answer] | None) -> float:
    """How fast the gap in force goes on growing after an answer, rad/s: what its buffer and the answers both show.

    The growth since the answer before, whose buffer lies so many seconds ``earlier``, may double or end: it is the mean
    and the standard deviation of a prior. The growth within the buffer is the measurement. Dry friction looks like
    growth within a buffer, so the gap is taken to grow at most AHEAD times as fast as it did for sure. A growth that
    has slowed goes on slowing: half the time between two answers ago it was the one, now it is the other. Without an
    answer before, or where the buffer shows no growth, it does not grow.
    """
    if earlier is None or earlier[0] <= 0.0 or not (answer.guarded and earlier[1].guarded):
        return 0.0
    now, then = answer.chosen.estimate, earlier[1].chosen.estimate
    been = (now.gap_rad - then.gap_rad) / earlier[0]
    been_std = math.hypot(now.std_rad, then.std_rad) / earlier[0]
    most = AHEAD * max(abs(been) - been_std, 0.0)
    if not (most > 0.0 and math.isfinite(now.growth_std_rad_s)):
        return 0.0
    prior, seen = been**2 + been_std**2, now.growth_std_rad_s**2
    ahead = (seen * been + prior * now.growth_rad_s) / (seen + prior)
    side = math.copysign(1.0, been)
    return side * max(min(side * ahead, side * (2.0 * now.growth_rad_s - been), most), 0.0)
