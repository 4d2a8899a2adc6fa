"""Work over threads and processes: the same results in the same order."""

from operator import neg

import numpy as np
import pytest
from joblib import parallel_config

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.search.grow import scores_about
from dtbacklash.diagnose.search.model import Log, Model
from dtbacklash.diagnose.spread import on_cores, spread

from .conftest import recorded


def test_results_come_in_their_order():
    for jobs in (None, 1, 2):
        with on_cores(jobs):
            assert spread(neg, range(20)) == [-k for k in range(20)]
    with on_cores(2):
        assert spread(neg, []) == []


@pytest.mark.check
def test_the_bank_is_the_same_in_threads_and_in_processes(rig):
    truth = rig.with_effect("gear", "backlash", {"half_gap": 0.05})
    evidence = Evidence.gather(rig, [recorded(truth, seconds=4.0)])
    fitted = fit(evidence, rig, nominal_free(rig))
    alone = scores_about(Model(evidence, fitted, fitted), Log())
    with on_cores(2):
        threads = scores_about(Model(evidence, fitted, fitted), Log())
    with parallel_config(backend="loky", n_jobs=2):
        processes = scores_about(Model(evidence, fitted, fitted), Log())
    for others in (threads, processes):
        assert [s.candidate.key for s in others] == [s.candidate.key for s in alone]
        assert np.allclose([s.gain for s in others], [s.gain for s in alone], rtol=1e-9, atol=1e-9)
