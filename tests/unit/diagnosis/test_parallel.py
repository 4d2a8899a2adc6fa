"""Work over threads: the same results in the same order."""

from operator import neg

from dtbacklash.diagnosis.parallel import on_cores, spread


def test_results_come_in_their_order():
    for jobs in (None, 1, 2):
        with on_cores(jobs):
            assert spread(neg, range(20)) == [-k for k in range(20)]
    with on_cores(2):
        assert spread(neg, []) == []
