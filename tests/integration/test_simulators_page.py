"""docs/simulators.md from end to end: its model and its log, the cause by name, and the mended model."""

import json
import math
import re
import runpy
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from fmus import ARM, STAGE, compiled

import dtbacklash as dtb
from dtbacklash.cli import main

PAGE = Path(__file__).parents[2] / "docs" / "simulators.md"
pytestmark = pytest.mark.check


def block(language: str, number: int = 0) -> str:
    return re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)[number]


def left(mujoco, model: str, log: pd.DataFrame) -> np.ndarray:
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
    mujoco = pytest.importorskip("mujoco")
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
    before, after = left(mujoco, "arm.xml", log), left(mujoco, "diagnosis/found/arm.xml", log)
    assert (after < 0.3 * before).all()


def stage_log(level: float, load: float, table: float = 2.5, parts: int = 40) -> pd.DataFrame:
    """The stage in closed loop on counts of 1 um, by small steps; dry friction of the carriage, a load on the table."""
    rng, rows, xc, xt, vc, vt, last, h = np.random.default_rng(1), [], 0.0, 0.0, 0.0, 0.0, 0.0, 1e-3 / parts
    for k in range(5000):
        t = 1e-3 * k
        c, b = (float(v) for v in np.round(1e6 * np.array([xc, xt]) + 0.2 * rng.standard_normal(2)) / 1e6)
        reference = 0.05 * math.sin(4.4 * t) + 0.02 * math.sin(11.9 * t + 1.0) + 0.004 * math.sin(38.0 * t)
        u, last = min(max(150.0 * (reference - c) - 6.0 * (c - last) / 1e-3, -30.0), 30.0), c
        rows.append((t, u, c, b))
        for _ in range(parts):
            s = 2.5e4 * (xt - xc) + 15.0 * (vt - vc)
            vc += h * (12.0 * u + s - level * math.tanh(vc / 1e-4)) / 4.0
            vt += h * (load - s) / table
            xc, xt = xc + h * vc, xt + h * vt
    return pd.DataFrame(rows, columns=["t", "u", "x_c", "x_t"])


@pytest.mark.parametrize(("version", "level", "load"), [
    pytest.param(2, 6.0, 0.0, marks=pytest.mark.nightly), (3, 0.0, 4.0),
    pytest.param(3, 0.0, 0.0, marks=pytest.mark.nightly), (0, 6.0, 0.0),
])  # fmt: skip
def test_an_fmu_is_diagnosed_as_the_rig_that_it_was_made_from(tmp_path, monkeypatch, capsys, version, level, load):
    pytest.importorskip("fmpy")
    monkeypatch.chdir(tmp_path)
    STAGE.build(Path("stage.fmu"), version) if version else compiled("stage", Path("stage.fmu"))
    stage_log(level, load).to_csv("log.csv", index=False)
    assert main(["rig", "new", "fmu", "stage.fmu"]) == 0
    assert "x_c: {position: x_c, speed: v_c, force: F_c}" in Path("stage.yaml").read_text()
    Path("stage.yaml").write_text(block("yaml", 1))
    assert main(["rig", "check", "stage.yaml"]) == 0
    assert "carriage: coulomb_friction" in capsys.readouterr().out
    assert main(["diagnose", "recording=log.csv", "rig=stage.yaml", "out=diagnosis", "jobs=1"]) == 0
    assert "fmpy simulate" in capsys.readouterr().out
    found = json.loads(Path("diagnosis/diagnosis.json").read_text())["findings"]
    known = dtb.diagnose("log.csv", "two_mass_stage", jobs=1).diagnosis.findings
    assert [(f["location"], f["effect"], f["confidence"]) for f in found] == [
        (f.location, f.effect, f.confidence) for f in known
    ]
    assert len(found) == bool(level or load)
    for theirs, ours in zip(found, known, strict=True):
        low, high = ours.parameters["force"].ci95
        assert low < theirs["parameters"]["force"]["value"] < high
        assert theirs["parameters"]["force"]["value"] == pytest.approx(level + load, rel=0.03)
        assert "def inputs(" in Path("diagnosis/found/laws.py").read_text()
    assert set(yaml.safe_load(Path("diagnosis/found/parameters.yaml").read_text())) == {"K_f", "m_c", "m_t", "k", "c"}
    assert dtb.load_rig("diagnosis/rig.yaml").config.joints["table"]["force"] == "F_t"  # it can be diagnosed with again


def test_two_recordings_of_an_fmu_say_what_both_show(tmp_path, monkeypatch):
    pytest.importorskip("fmpy")
    monkeypatch.chdir(tmp_path)
    compiled("stage", Path("stage.fmu"))
    Path("stage.yaml").write_text(block("yaml", 1))
    log = stage_log(6.0, 0.0)
    log[:3000].to_csv("a.csv", index=False)
    log[3000:].to_csv("b.csv", index=False)  # it begins in motion
    found = dtb.diagnose(["a.csv", "b.csv"], "stage.yaml", jobs=1).diagnosis
    (cause,) = found.findings
    assert (cause.location, cause.effect, cause.confidence) == ("carriage", "coulomb_friction", "sure")
    assert cause.parameters["force"].value == pytest.approx(6.0, rel=0.02)
    assert [record.name for record in found.recordings] == ["a.csv", "b.csv"]


def crane_log(level: float, load: float) -> pd.DataFrame:
    """The crane in closed loop on counts, by small steps; dry friction of the trolley, kg on the hook."""
    rng, rows, last, h = np.random.default_rng(1), [], 0.0, 5e-3 / 40
    s, a, v, w, i = np.zeros(5)
    for k in range(3000):
        t = 5e-3 * k
        q = round((s + 2e-5 * rng.standard_normal()) / 5e-5) * 5e-5
        angle = round((a + 2e-4 * rng.standard_normal()) / 1e-4) * 1e-4
        reference = 0.5 * math.sin(0.9 * t) + 0.15 * math.sin(2.6 * t + 1.0) + 0.03 * math.sin(7.0 * t)
        u, last = min(max(60.0 * (reference - q) - 3.0 * (q - last) / 5e-3, -48.0), 48.0), q
        rows.append((t, u, q, angle))
        for _ in range(40):
            coupled, own = load * 1.2 * math.cos(a), load * 1.2**2
            pull = 40.0 * i - 25.0 * v + load * 1.2 * math.sin(a) * w**2 - level * math.tanh(v / 1e-3)
            swing = -0.8 * w - load * 9.81 * 1.2 * math.sin(a)
            whole = (60.0 + load) * own - coupled**2
            v += h * (own * pull - coupled * swing) / whole
            w += h * ((60.0 + load) * swing - coupled * pull) / whole
            i += h * (u - 0.8 * i - 40.0 * v) / 4e-3
            s, a = s + h * v, a + h * w
    return pd.DataFrame(rows, columns=["t", "u", "way", "angle"])


def test_a_crane_of_another_tool_is_diagnosed(tmp_path, monkeypatch):
    pytest.importorskip("fmpy")
    monkeypatch.chdir(tmp_path)
    rig = {
        "model": str(compiled("crane", tmp_path / "crane.fmu")), "commands": {"u": "volts"},
        "joints": {"trolley": {"position": "crane.q[1]", "force": "F[1]", "slides": True},
                   "rope": {"position": "crane.q[2]", "force": "F[2]"}},
        "sensors": {"way": {"of": "trolley", "quantity": "position", "absolute": True},
                    "angle": {"of": "rope", "quantity": "position", "absolute": True}},
        "tolerances": {"trolley.mass": "5 %", "load.mass": "10 %", "damping[1]": "20 %", "damping[2]": "30 %",
                       "motor.k": "5 %"},
    }  # fmt: skip
    crane_log(30.0, 22.0).to_csv("log.csv", index=False)
    found = dtb.diagnose("log.csv", rig, jobs=1).diagnosis
    (cause,) = found.findings
    assert (cause.location, cause.effect, cause.confidence) == ("trolley", "coulomb_friction", "sure")
    low, high = cause.parameters["force"].ci95
    assert low < 30.0 < high
    assert found.recalibrated["load.mass"].value == pytest.approx(22.0, rel=0.01)


def test_an_fmu_of_the_same_arm_names_the_same_cause(tmp_path, monkeypatch):
    pytest.importorskip("mujoco")
    pytest.importorskip("fmpy")
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(block("xml"))
    Path("log.py").write_text(block("python"))
    runpy.run_path("log.py")
    rig = {
        **yaml.safe_load(block("yaml")), "model": str(ARM.build(tmp_path / "arm.fmu")),
        "commands": {"u1": "u1", "u2": "u2"}, "tolerances": {"d1": "30 %", "d2": "30 %", "m2": "5 %"},
        "joints": {"shoulder": {"position": "q1", "force": "tau1"}, "elbow": {"position": "q2", "force": "tau2"}},
    }  # fmt: skip
    found = dtb.diagnose("log.csv", rig, jobs=1).diagnosis
    (cause,) = found.findings
    assert (cause.location, cause.effect, cause.confidence) == ("elbow", "coulomb_friction", "sure")
    assert cause.parameters["torque"].value == pytest.approx(0.25, rel=0.03)
    assert found.recalibrated["m2"].value == pytest.approx(1.03 * 0.8, rel=0.01)
