"""Faults of a recording from the command line: a file with a turned or swapped sensor, one that judges itself."""

import json

import numpy as np
import pandas as pd
import pytest
from nominal import nominal_rig

from dtbacklash.physics.simulate import simulate

pytestmark = pytest.mark.check

STEP_S = 1e-3


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    """What the sensors of the paper's rig show of a motor with dry friction."""
    rig = nominal_rig("lead_screw").with_effect("motor_bearing", "coulomb_friction", {"torque": 0.03})
    t = STEP_S * np.arange(8001)
    random = np.random.default_rng(1)
    u = sum(
        np.sin(2 * np.pi * f * t + p)
        for f, p in zip(np.arange(0.3, 9.0, 0.3), random.uniform(0, 6.28, 29), strict=True)
    )
    u = 2.5 * u / u.std()
    shown = simulate(rig, u[:-1], STEP_S).sensors
    noisy = {n: shown[n] + s * random.standard_normal(len(t)) for n, s in (("q2", 1e-6), ("q3", 1e-6))}
    count = 2 * np.pi / 4096
    return pd.DataFrame({"t": t, "u": u, "theta_m": count * np.round(shown["theta_m"] / count), **{
        f"{n} [mm]": 1e3 * v for n, v in noisy.items()
    }})  # fmt: skip


def diagnosed(process, tmp_path, frame: pd.DataFrame, name: str) -> tuple[dict, str, str]:
    frame.to_csv(tmp_path / f"{name}.csv", index=False)
    done = process("diagnose", f"recording={name}.csv", f"out={name}")
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / name / "diagnosis.json").read_text(encoding="utf-8"))
    return document, done.stdout, (tmp_path / name / "report.html").read_text(encoding="utf-8")


def test_a_turned_sensor_is_told_instead_of_physics(process, tmp_path, table):
    document, said, page = diagnosed(process, tmp_path, table.assign(**{"q3 [mm]": -table["q3 [mm]"]}), "turned")
    assert (document["verdict"], document["findings"]) == ("unexplained", [])
    assert document["located"]["location"] == "sensor_q3"
    for text in (said, page):
        assert "No physics was looked for: q3 has its sign turned round" in text
    failing = [row["check"] for row in document["checks"] if not row["pass"]]
    assert "polarity of q3" in failing
    assert "polarity of theta_m" not in failing
    assert (tmp_path / "turned" / "figures" / "curve_q3.png").is_file()


@pytest.mark.nightly
def test_swapped_sensors_are_told_instead_of_physics(process, tmp_path, table):
    swapped = table.assign(**{"q2 [mm]": table["q3 [mm]"], "q3 [mm]": table["q2 [mm]"]})
    document, said, _ = diagnosed(process, tmp_path, swapped, "swapped")
    assert (document["verdict"], document["findings"]) == ("unexplained", [])
    assert "q3 and q2 have changed places" in said
    assert "Swap q3 and q2" in document["next_experiment"]


def test_a_recording_does_not_judge_itself(process, tmp_path, table):
    table.to_csv(tmp_path / "bench.csv", index=False)
    done = process("diagnose", "recording=bench.csv", "validation=bench.csv", "out=found")
    assert done.returncode == 2
    assert done.stderr.startswith("dtb: error: validation=bench.csv: holds 8001 samples of the recording itself")
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "found").exists()
