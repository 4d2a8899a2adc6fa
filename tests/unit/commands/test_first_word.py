"""Nothing is loaded before the first word of a diagnosis that is not needed for it."""

import subprocess
import sys

import numpy as np
import pytest

SCRIPT = """
import sys
from dtbacklash.cli import main
from dtbacklash.diagnosis import pipeline
from dtbacklash.errors import UserError
def run(course):
    heavy = {"pandas", "joblib", "numba", "matplotlib", "jinja2", "control"}
    heavy |= {"scipy." + name for name in ("signal", "stats", "ndimage", "interpolate", "io")}
    loaded = heavy & set(sys.modules)
    print(f"began with {sorted(loaded)}")
    raise UserError("stop", "here", "")
pipeline._Course.run = run
main(["diagnose", "recording=arm.csv", "rig=pendulum", "out=found"])
"""


@pytest.mark.check
def test_a_diagnosis_begins_without_libraries_that_only_its_page_needs(tmp_path):
    from dtbacklash.config.compose import compose
    from dtbacklash.physics.rig import build_rig
    from dtbacklash.physics.simulate import simulate

    rig, rng = build_rig(compose("rig=pendulum").rig), np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.0, 1.0, 60), 20)
    theta = simulate(rig, u[:-1], 0.005).sensors["theta"] + 1e-4 * rng.standard_normal(len(u))
    rows = np.column_stack([0.005 * np.arange(len(u)), u, theta])
    np.savetxt(tmp_path / "arm.csv", rows, "%.6f", ",", header="t,u,theta", comments="")
    said = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert "began with []" in said.stdout, said.stdout + said.stderr
