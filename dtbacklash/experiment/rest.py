"""Whether the loop rests, or goes round in a cycle."""

import numpy as np

from dtbacklash.arrays import Floats, Ints

#: at rest: samples of a stretch, how far the means of two may differ (rad, m), and how many times that a stretch spans
AT_REST, STILL, SWINGS = 250, (0.03, 2e-6), 10.0
#: how long a loop has before its new gap is judged, and each of the two stretches that are looked at, s
JUDGED_AFTER_S, STRETCH_S = 3.0, 1.0


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
