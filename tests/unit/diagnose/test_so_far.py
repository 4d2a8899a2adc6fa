"""What a diagnosis on its way says: names with their sizes, and the share done by what its steps took."""

import pytest

from dtbacklash.diagnose.so_far import Pace


def test_the_share_done_is_that_of_the_time():
    now = [0.0]
    pace = Pace(lambda: now[0])
    told = []
    for at, stage, counted, names in (
        (8.0, "recalibrating", 0.02, 0), (10.0, "round 1", 0.1, 0), (30.0, "round 2", 0.2, 1),
        (50.0, "judging a", 0.6, 1), (70.0, "modelling", 0.9, 1), (80.0, "drawing", 1.0, 1),
    ):  # fmt: skip
        now[0] = at
        told.append(pace.share(stage, counted, names))
    assert told[0] < told[1] + 1e-9 <= 0.05 + 1e-9  # what is ahead is not known yet
    assert told[2] == pytest.approx(30.0 / (30.0 + 3 * 20.0))  # this round, a name to judge, and the end
    assert told[3] == pytest.approx(50.0 / (50.0 + 2 * 20.0))
    assert told[4] == pytest.approx(70.0 / (70.0 + 1 * 20.0))
    assert told[5] == 1.0


def test_the_share_done_never_falls():
    now = [0.0]
    pace = Pace(lambda: now[0])
    shares = []
    for k, names in enumerate([0, 0, 1, 2, 4, 4]):
        now[0] = 1.5**k
        shares.append(pace.share(f"round {k}", 0.1 + 0.05 * k, names))
    assert shares == sorted(shares)
