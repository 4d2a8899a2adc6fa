"""What is put back into a MuJoCo model moves it as the diagnosis' own simulation does."""

import numpy as np
import pandas as pd
import pytest

from dtbacklash.api.rigs import load_rig
from dtbacklash.diagnosis.explain.found_model import found_model
from dtbacklash.diagnosis.predictions import segments_of
from dtbacklash.diagnosis.records import records_of
from dtbacklash.physics import catalogue
from dtbacklash.recording.model import Recording

mujoco = pytest.importorskip("mujoco")

MODEL = """<mujoco><option timestep="0.001" gravity="0 0 0" integrator="RK4"/>
<worldbody><body name="wheel"><joint name="axle" type="hinge" axis="0 0 1" damping="0.2"/>
<geom type="cylinder" size="0.2 0.02" mass="5"/></body></worldbody>
<actuator><motor name="spin" joint="axle"/></actuator></mujoco>"""
STEP_S, N = 5e-3, 800
#: a law of a user's own
LAWS = {
    "ratchet": {
        "acts_on": "turning_joint", "law": "-drag*min(v, 0)**2*sign(v)*exp(sin(q))",
        "parameters": {"drag": {"low": 0, "high": 1, "start": 0.01}},
    },
}  # fmt: skip
FOUND = {
    "axle": {
        "viscous_friction": {"coefficient": 0.1}, "coulomb_friction": {"torque": 0.15},
        "cogging": {"torque": 0.2, "periods": 5.0, "phase": 0.4}, "constant_load": {"torque": 0.05},
        "stribeck_friction": {"torque": 0.1, "speed": 0.5}, "ratchet": {"drag": 0.03},
    },
    "actuator_spin": {"dead_zone": {"half_width": 0.1}},
    "sensor_angle": {"offset": {"offset": 0.01}},
}  # fmt: skip


@pytest.fixture
def withdrawn():
    yield
    catalogue.withdraw(LAWS)


@pytest.mark.usefixtures("withdrawn")
def test_the_mended_model_and_its_laws_move_as_the_diagnosis_simulates(tmp_path):
    (tmp_path / "wheel.xml").write_text(MODEL)
    rig = load_rig({
        "model": str(tmp_path / "wheel.xml"), "commands": {"u": "spin"}, "effects": FOUND, "laws": LAWS,
        "sensors": {"angle": {"of": "axle", "quantity": "position", "absolute": True}},
        "tolerances": {"bodies.wheel.mass": 0.1},
    }).with_parameters({"bodies.wheel.mass": 6.0})  # fmt: skip
    t = STEP_S * np.arange(N)
    frame = pd.DataFrame({"t": t, "u": np.sin(5.0 * t) + 0.7 * np.sin(1.3 * t), "angle": 0.0 * t})
    frame.loc[1:, "angle"] = 1e-9 * np.sin(t[1:])
    records = records_of(Recording.from_frame(frame, rig=rig), rig, True, False)
    p = segments_of(rig, records, [1]).predictors[0]
    gains = p.gains(rig, p.first_noise_levels())
    gains.K[:] = 0.0
    ours = p.run(rig, gains).X[:, 0]

    files = found_model(rig)
    assert "not in it, as it is no force or stands in C: offset of angle" in files["laws.py"]
    laws: dict = {}
    exec(files["laws.py"], laws)  # the script that users are given
    m = mujoco.MjModel.from_xml_string(files["wheel.xml"])
    assert m.body("wheel").mass[0] == pytest.approx(6.0)
    assert m.dof_damping[0] == pytest.approx(0.3)
    d, theirs = mujoco.MjData(m), np.zeros(N)
    for k in range(N):
        theirs[k] = d.qpos[0]
        for _ in range(round(STEP_S / m.opt.timestep)):
            d.ctrl[:] = frame.u[k]
            laws["apply"](m, d)
            mujoco.mj_step(m, d)
    assert np.ptp(ours) > 0.3
    assert np.abs(theirs - ours).max() < 0.01 * np.ptp(ours)
    plain, d, without = mujoco.MjModel.from_xml_string(files["wheel.xml"]), mujoco.MjData(m), np.zeros(N)
    for k in range(N):
        without[k], d.ctrl[:] = d.qpos[0], frame.u[k]
        mujoco.mj_step(plain, d, nstep=5)
    assert np.abs(without - ours).max() > 0.1 * np.ptp(ours)
