"""What a run writes, and what it takes to repeat it."""

import json
import math

import numpy as np

from dtbacklash.commands import run_files
from dtbacklash.config.run import RunConfig


def test_numpy_and_nan_become_json():
    value = {
        "a": np.float64(1.5),
        "b": [np.int64(2), math.nan, math.inf],
        "c": (np.bool_(True), None),
        "d": np.arange(2),
    }
    expected = {"a": 1.5, "b": [2, None, None], "c": [True, None], "d": [0, 1]}
    assert json.loads(json.dumps(run_files.json_able(value), allow_nan=False)) == expected


def test_provenance_repeats_a_run_and_names_no_place():
    found = run_files.provenance(RunConfig(seed=5))
    assert found["seed"] == 5
    assert found["config"]["controller"]["k_theta_v_per_rad"] == 15.0
    assert {"python", "dtbacklash", "numpy", "numba", "control"} <= set(found["versions"])
    assert str(run_files.Path.cwd()) not in json.dumps(found)
