"""How fast the gap in force goes on growing between two answers of the twin."""

from __future__ import annotations

import math

from dtbacklash.twin.link.service import Answer

#: the gap in force grows at most so many times as fast as it grew between the last two answers
AHEAD = 2.0


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
