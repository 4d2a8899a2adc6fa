"""docs/simulators.md from end to end: its model and its log, the cause by name, and the mended model."""

import re
import runpy
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dtbacklash.cli import main

mujoco = pytest.importorskip("mujoco")
PAGE = Path(__file__).parents[2] / "docs" / "simulators.md"
pytestmark = pytest.mark.check


def block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert found
    return found[1]


def left(model: str, log: pd.DataFrame) -> np.ndarray:
    """How far a model is from the log after a tenth of a second from each fifth sample, rms of each joint."""
    m = mujoco.MjModel.from_xml_path(model)
    m.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    d, q, u = mujoco.MjData(m), log[["q1", "q2"]].to_numpy(), log[["u1", "u2"]].to_numpy()
    v, found = np.gradient(q, 0.01, axis=0), []
    for k in range(5, len(q) - 15, 5):
        mujoco.mj_resetData(m, d)
        d.qpos[:], d.qvel[:] = q[k], v[k]
        for i in range(k, k + 10):
            d.ctrl[:] = u[i]
            mujoco.mj_step(m, d, nstep=2)
        found.append(d.qpos - q[k + 10])
    return np.sqrt(np.mean(np.square(found), axis=0))


def test_from_a_model_and_a_log_to_a_named_cause_and_a_mended_model(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(block("xml"))
    Path("log.py").write_text(block("python"))
    runpy.run_path("log.py")
    assert main(["rig", "new", "mjcf", "arm.xml"]) == 0
    assert "joints.elbow.damping: 30 %" in Path("arm.yaml").read_text()
    Path("arm.yaml").write_text(block("yaml"))
    assert main(["rig", "check", "arm.yaml"]) == 0
    assert "elbow: coulomb_friction" in capsys.readouterr().out
    assert main(["diagnose", "recording=log.csv", "rig=arm.yaml", "out=diagnosis", "jobs=1"]) == 0
    assert "--mjcf=diagnosis/found/arm.xml" in capsys.readouterr().out
    mended = mujoco.MjModel.from_xml_path("diagnosis/found/arm.xml")
    assert mended.joint("elbow").frictionloss[0] == pytest.approx(0.25, rel=0.03)
    assert mended.joint("shoulder").frictionloss[0] == 0.0
    assert mended.body("fore").mass[0] == pytest.approx(1.03 * 0.8, rel=0.01)
    log = pd.read_csv("log.csv")
    before, after = left("arm.xml", log), left("diagnosis/found/arm.xml", log)
    assert (after < 0.3 * before).all()
