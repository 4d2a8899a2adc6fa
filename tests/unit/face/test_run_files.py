"""What a run writes, and what it takes to repeat it."""

import json

from dtbacklash.config.run import RunConfig
from dtbacklash.face import run_files


def test_provenance_repeats_a_run_and_names_no_place():
    found = run_files.provenance(RunConfig(seed=5))
    assert found["seed"] == 5
    assert found["config"]["controller"]["k_theta_v_per_rad"] == 15.0
    assert {"python", "dtbacklash", "numpy", "numba", "control"} <= set(found["versions"])
    assert str(run_files.Path.cwd()) not in json.dumps(found)
