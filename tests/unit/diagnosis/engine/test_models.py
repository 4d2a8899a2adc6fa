"""Models of MuJoCo and FMUs as what a predictor asks: against solutions that are written by hand."""

from __future__ import annotations

import math
import pickle
import re
import threading
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from fmus import COLUMNS, EQUATIONS, EXCHANGED, JOINTS, STAGE, Machine

import dtbacklash as dtb
from dtbacklash.api.rigs import load_rig
from dtbacklash.diagnosis.engine.candidates import CandidateSensitivities
from dtbacklash.diagnosis.engine.columns import ColumnMaker
from dtbacklash.diagnosis.engine.efforts import efforts
from dtbacklash.diagnosis.engine.fit import FitProblem
from dtbacklash.diagnosis.engine.motion import motion_of
from dtbacklash.diagnosis.explain.found_model import found_model
from dtbacklash.diagnosis.explain.observability_notes import beforehand
from dtbacklash.diagnosis.parallel import on_cores, spread
from dtbacklash.diagnosis.predictions import segments_of
from dtbacklash.diagnosis.records import STEPPED, records_of, ways_to_read
from dtbacklash.errors import UserError
from dtbacklash.physics import fmu_file
from dtbacklash.physics.effects.slots import Contact, Passing
from dtbacklash.physics.mjcf import mended, new_rig
from dtbacklash.recording.model import Recording

mujoco = pytest.importorskip("mujoco")
pytest.importorskip("fmpy")

#: a turning and a sliding joint, each by itself: J = 0.25 + 0.05 kg m^2, m = 3 kg, no gravity
MODEL = """<mujoco><option timestep="{step}" gravity="0 0 0"/>
<worldbody>
<body name="wheel"><joint name="axle" type="hinge" axis="0 0 1" damping="0.2" armature="0.05"/>
<inertial pos="0 0 0" mass="1" diaginertia="0.25 0.25 0.25"/></body>
<body name="cart" pos="0 3 0"><joint name="rail" type="slide" axis="1 0 0" damping="1.5"/>
<inertial pos="0 0 0" mass="3" diaginertia="0.1 0.1 0.1"/></body>
</worldbody>
<actuator><motor name="spin" joint="axle" gear="2"/><motor joint="rail"/></actuator></mujoco>"""
RIG = {**COLUMNS, "tolerances": {"joints.axle.damping": "20 %", "bodies.cart.mass": 0.05}}
STEP_S, N = 4e-3, 1500
MASS = {"mujoco": "bodies.cart.mass", "fmu": "cart.m"}


@pytest.fixture
def rig(tmp_path):
    (tmp_path / "machine.xml").write_text(MODEL.format(step=2e-3))
    return load_rig({**RIG, "model": str(tmp_path / "machine.xml")})


@pytest.fixture(scope="module")
def exchanged(tmp_path_factory):
    """FMI version -> the machine as an FMU."""
    folder = tmp_path_factory.mktemp("fmus")
    return {version: EQUATIONS.build(folder / f"machine{version}.fmu", version) for version in (2, 3)}


@pytest.fixture(params=["mujoco", 2, 3])
def either(request, rig, exchanged):
    """The rig of each simulator."""
    return rig if request.param == "mujoco" else load_rig({**EXCHANGED, "model": str(exchanged[request.param])})


def commands() -> tuple[np.ndarray, np.ndarray]:
    t = STEP_S * np.arange(N)
    return 0.3 * np.sin(3.0 * t) + 0.2 * np.sin(11.0 * t), 4.0 * np.cos(2.0 * t) + 2.0 * np.sin(7.0 * t)


def answered(
    u: np.ndarray,
    inertia: float,
    damping: float,
    level: float = 0.0,
    held=lambda q: 0.0,
    after=lambda q, v: v,
    parts=200,
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) position and speed of one body from rest, by small steps.

    level : of a dry friction that is smooth. held : force against it by position. after : its speed behind a step.
    """
    q = v = 0.0
    found = np.zeros((N, 2))
    for k in range(N):
        found[k] = q, v
        for _ in range(parts):
            force = u[k] - level * math.tanh(v / 1e-4) - held(q)
            v = after(q, (v + STEP_S / parts * force / inertia) / (1.0 + STEP_S / parts * damping / inertia))
            q += STEP_S / parts * v
    return found[:, 0], found[:, 1]


def passed(rig, columns: dict[str, np.ndarray], every: int = 1, way: str = "") -> dict[str, np.ndarray]:
    """Channel -> (N,) what a free run of the model leaves of it."""
    frame = pd.DataFrame({"t": STEP_S * np.arange(N), **columns})
    records = records_of(Recording.from_frame(frame, rig=rig), rig, True, False)
    records = {"": records, **ways_to_read(records, rig)}[way]
    predictor = segments_of(rig, records, [every]).predictors[0]
    left = predictor.simulate(rig, predictor.gains(rig, predictor.first_noise_levels()))
    return dict(zip(predictor.readings.channels, np.nan_to_num(left.T), strict=True))


def test_two_commands_move_two_joints_as_their_equations_say(either):
    spin, push = commands()
    angle, _ = answered(2.0 * spin, 0.3, 0.2)
    way, speed = answered(push, 3.0, 1.5)
    left = passed(either, {"torque": spin, "push": push, "angle": angle, "way": way})
    assert np.abs(left["angle"]).max() < 1e-3 * np.ptp(angle)
    assert np.abs(left["way"]).max() < 1e-3 * np.ptp(way)
    before = np.concatenate([[0.0], push[:-1]])  # an accelerometer is read before the command steps
    shaken = (before - 1.5 * speed) / 3.0
    left = passed(either, {"torque": spin, "push": push, "angle": angle, "way": way, "shaken": shaken})
    assert np.abs(left["shaken"][2:]).max() < 0.01


@pytest.mark.parametrize(
    ("place", "effect", "values", "change"),
    [
        ("axle", "viscous_friction", {"coefficient": 0.15}, {"damping": 0.35}),
        ("axle", "constant_load", {"torque": 0.1}, {"more": 0.1}),
        ("axle", "coulomb_friction", {"torque": 0.12}, {"level": 0.12}),
        ("actuator_spin", "gain_error", {"relative": -0.2}, {"gain": 1.6}),
        ("actuator_spin", "dead_zone", {"half_width": 0.1}, {"dead": 0.1}),
        ("actuator_spin", "delay", {"time": 3 * STEP_S}, {"late": 3}),
        ("sensor_angle", "gain_error", {"relative": 0.1}, {"shown": 1.1}),
        ("sensor_angle", "delay", {"time": 7.5 * STEP_S}, {"seen": 7.5}),
    ],
)
def test_the_catalogues_laws_act_in_a_model_as_written_by_hand(either, place, effect, values, change):
    spin, push = commands()
    u = np.concatenate([np.zeros(change.get("late", 0)), spin])[:N]
    if dead := change.get("dead"):
        u = np.sign(u) * np.maximum(np.abs(u) - dead, 0.0)
    u = change.get("gain", 2.0) * u + change.get("more", 0.0)
    angle, _ = answered(u, 0.3, change.get("damping", 0.2), change.get("level", 0.0))
    t = STEP_S * np.arange(N)
    shown = change.get("shown", 1.0) * np.interp(t - change.get("seen", 0.0) * STEP_S, t, angle)
    columns = {"torque": spin, "push": push, "angle": shown, "way": answered(push, 3.0, 1.5)[0]}
    whole = np.ptp(angle)
    without = np.abs(passed(either, columns)["angle"]).max()
    left = np.abs(passed(either.with_effect(place, effect, values), columns)["angle"][4:]).max()
    assert without > 0.01 * whole
    assert left < (0.01 if effect == "coulomb_friction" else 0.002) * whole


def test_the_linear_part_is_that_of_the_equations(either):
    has_the_linear_part_of_the_equations(either)


def test_the_linear_part_of_an_fmu_that_moves_by_its_clock_is_that_without(tmp_path):
    shaking = EQUATIONS.equations.replace("axle_w) / J;", "axle_w) / J + 0.5 * sin(5.0 * t);")
    assert shaking != EQUATIONS.equations
    fmu = replace(EQUATIONS, equations=shaking).build(tmp_path / "shaken.fmu")
    has_the_linear_part_of_the_equations(load_rig({**EXCHANGED, "model": str(fmu)}))


def has_the_linear_part_of_the_equations(either):
    spin, push = commands()
    frame = pd.DataFrame({"t": STEP_S * np.arange(N), "torque": spin, "push": push, "angle": spin, "way": push})
    records = records_of(Recording.from_frame(frame, rig=either), either, True, False)
    L = segments_of(either, records, [1]).linear
    assert L.states == ("axle q", "rail q", "axle v", "rail v")
    for j, (inertia, damping) in enumerate(((0.3, 0.2), (3.0, 1.5))):
        keeps = math.exp(-damping / inertia * STEP_S)
        assert L.A[1, 2 + j, 2 + j] == pytest.approx(keeps, rel=1e-6)
        assert L.B[1, 2 + j, j] == pytest.approx((1.0 - keeps) / damping, rel=1e-6)
        assert L.inertia[j] == pytest.approx(inertia, rel=0.02)


def test_a_mass_moves_its_bodys_inertia_with_it(either):
    heavier = either.with_parameters({MASS[either.config.simulator]: 6.0})
    spin, push = commands()
    way, _ = answered(push, 6.0, 1.5)
    left = passed(heavier, {"torque": spin, "push": push, "angle": spin, "way": way})
    assert np.abs(left["way"]).max() < 1e-3 * np.ptp(way)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"sensors": {"x": {"of": "ralo", "quantity": "position"}}}, "rig.sensors.x.of"),
        ({"commands": {"torque": "spun", "push": "rail"}}, "did you mean spin; it has"),
        ({"commands": {"torque": "spin", "push": "rail", "more": "spin"}}, "is commanded by two columns"),
        ({"commands": {"angle": "spin", "push": "rail"}}, "is no command: the column is a sensor or the time"),
        ({"commands": {"torque": "spin"}}, "every actuator of the model has a column: {COLUMN: rail}"),
        ({"tolerances": {"joints.axel.damping": 0.1}}, "did you mean axle; it has"),
        ({"tolerances": {"joints.axle.colour": 0.1}}, "joints.NAME.damping"),
        ({"tolerances": {"joints.axle.damping": "many %"}}, "must be as 20 %"),
        ({"fixed": ["door"]}, "the model has no such name"),
        ({"model": "nowhere.xml"}, "no such file"),
    ],
)
def test_what_the_model_has_not_is_told_in_one_line(rig, change, said):
    with pytest.raises(UserError) as error:
        load_rig({**RIG, "model": rig.config.model, **change})
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_commands_that_are_logged_more_seldom_are_held(either):
    spin, push = (np.where(np.arange(N) % 4 == 0, u, np.nan) for u in commands())
    frame = pd.DataFrame(
        {"t": STEP_S * np.arange(N), "torque": spin, "push": push, "angle": commands()[1], "way": commands()[0]}
    )
    (record,) = records_of(Recording.from_frame(frame, rig=either), either, True, False)
    assert record.inputs is not None
    assert record.inputs[:8, 1].tolist() == push[[0, 0, 0, 0, 4, 4, 4, 4]].tolist()


def test_one_of_two_commands_may_be_idle(either):
    _, push = commands()
    frame = pd.DataFrame({"t": STEP_S * np.arange(N), "torque": 0.0, "push": push, "angle": -push, "way": push})
    recording = Recording.from_frame(frame, rig=either)
    assert not [note for note in recording.notes if "while" in note]
    assert records_of(recording, either, True, False)[0].driven


def test_a_mended_model_finds_what_lies_beside_the_model(rig, tmp_path):
    corners = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    faces = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "corner.obj").write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
        + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
    )
    text = MODEL.format(step=2e-3).replace("<worldbody>", '<compiler meshdir="parts"/><asset><mesh name="corner" '
        'file="corner.obj"/></asset><worldbody><geom type="mesh" mesh="corner"/>')  # fmt: skip
    (tmp_path / "meshed.xml").write_text(text)
    config = load_rig({**RIG, "model": str(tmp_path / "meshed.xml")}).config
    (tmp_path / "found").mkdir()
    (tmp_path / "found" / "meshed.xml").write_text(mended(config, {}, {}, {}))
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "found" / "meshed.xml")).nmesh == 1


def test_a_new_rig_of_a_model_can_be_read(tmp_path):
    text = MODEL.format(step=2e-3).replace('"spin"', '"no: 1"').replace('"rail"', '"on"')
    thrown = '<body name="ball" pos="0 9 0"><freejoint name="free"/><geom size="0.1"/></body></worldbody>'
    for damped in (True, False):
        bare = re.sub(r'damping="[\d.]+"|armature="[\d.]+"|name="(wheel|cart)"', "", text)  # nothing may be off
        (tmp_path / "machine.xml").write_text(text.replace("</worldbody>", thrown) if damped else bare)
        described = yaml.safe_load(new_rig(str(tmp_path / "machine.xml")))
        rig = load_rig({**described, "model": str(tmp_path / "machine.xml")})
        assert (rig.config.commands, list(rig.bodies())[1].name) == ({"no: 1": "no: 1", "u_on": "on"}, "on")
        assert [(s.name, s.of) for s in rig.sensors.values()] == [("axle", "axle"), ("on", "on")]
        assert described.get("fixed", []) == ["free"] * damped
    (tmp_path / "machine.xml").write_text(re.sub("<actuator>.*</actuator>", "", text, flags=re.DOTALL))
    with pytest.raises(UserError, match=r"rig.model=.*machine.xml: has no actuator that moves a joint"):
        new_rig(str(tmp_path / "machine.xml"))


def test_a_new_rig_names_columns_as_the_model_names_actuators_and_sensors(tmp_path):
    """So that a log with these heads is read as it is."""
    sensors = """<sensor><jointpos name="q1" joint="axle"/><jointvel name="w1" joint="axle"/><jointpos joint="rail"/>
        <actuatorfrc name="tau" actuator="spin"/><accelerometer name="a" site="here"/></sensor></mujoco>"""
    text = MODEL.format(step=2e-3).replace("</mujoco>", sensors)
    (tmp_path / "machine.xml").write_text(text.replace("<worldbody>", '<worldbody><site name="here"/>'))
    rig = load_rig({**yaml.safe_load(new_rig(str(tmp_path / "machine.xml"))), "model": str(tmp_path / "machine.xml")})
    assert [(s.name, s.of, s.quantity) for s in rig.sensors.values()] == [
        ("q1", "axle", "position"), ("w1", "axle", "velocity"), ("rail", "rail", "position"),
        ("tau", "actuator_spin", "torque"),
    ]  # fmt: skip
    assert rig.config.commands == {"spin": "spin", "u_rail": "rail"}


def test_a_free_joint_and_a_step_that_is_no_divisor_are_refused(rig, tmp_path):
    free = tmp_path / "free.xml"
    free.write_text(MODEL.format(step=2e-3).replace('<body name="cart"', '<body><freejoint name="loose"/>'
                    '<geom size="0.1"/></body><body name="cart"'))  # fmt: skip
    with pytest.raises(UserError, match=r"joint loose: neither turns nor slides.*fixed"):
        load_rig({**RIG, "model": str(free)})
    assert "loose" not in load_rig({**RIG, "model": str(free), "fixed": ["loose"]}).elements
    coarse = tmp_path / "coarse.xml"
    coarse.write_text(MODEL.format(step=3e-3))
    spin, push = commands()
    with pytest.raises(UserError, match=r'its step, 0.003 s, must divide the sample, 0.004 s.*timestep="0.002"'):
        passed(load_rig({**RIG, "model": str(coarse)}), {"torque": spin, "push": push, "angle": spin, "way": push})


def test_a_joint_that_no_reading_shows_is_told(either):
    spin, push = commands()
    with pytest.raises(UserError, match=r"rig.sensors=angle: joint rail moves none of them: give it a sensor"):
        passed(either, {"torque": spin, "push": push, "angle": spin})


def test_averaged_readings_are_predicted_by_commands_that_are_averaged_alike(either):
    spin, push = commands()
    angle, _ = answered(2.0 * spin, 0.3, 0.2)
    way, _ = answered(push, 3.0, 1.5)
    left = passed(either, {"torque": spin, "push": push, "angle": angle, "way": way}, every=5)
    assert len(left["way"]) == N // 5
    # the first mean is not the first position: what is left is a start that drifts by it
    assert np.abs(np.diff(left["angle"])).max() < 1e-3 * np.ptp(angle)
    assert np.abs(np.diff(left["way"])).max() < 1e-3 * np.ptp(way)


def held(rig, level: float = 0.0) -> tuple:
    """Bench, and sizes of unknown forces, of a log in which the axle rubs."""
    spin, push = commands()
    angle, way = answered(2.0 * spin, 0.3, 0.2, level)[0], answered(push, 3.0, 1.5)[0]
    noise = 1e-4 * np.random.default_rng(3).standard_normal((2, N))
    columns = {"torque": spin, "push": push, "angle": angle + noise[0], "way": way + noise[1]}
    frame = pd.DataFrame({"t": STEP_S * np.arange(N), **columns})
    segments = segments_of(rig, records_of(Recording.from_frame(frame, rig=rig), rig, True, False), [1])
    return segments, segments.tuned(rig)[0]


def test_columns_by_the_linear_part_are_those_of_passes(either):
    segments, sizes = held(either, 0.12)
    motion = motion_of(segments, either, segments.gains(either, sizes))
    model = FitProblem(segments, either, (), motion).model(np.zeros(2), sizes, 0.0)
    columns, gains = CandidateSensitivities(segments, model, sizes), segments.gains(either, sizes)
    problem = FitProblem(segments, either, (), columns.motion)
    x, kinds = problem.start(), set()
    rows = problem.residuals(x, gains)
    for title, near in problem.leads(x, gains).items():
        j = [f.title for f in problem.free].index(title)
        exact = problem.sensitivity(j, x, gains, rows)[: problem.innovation_rows]
        assert np.linalg.norm(near - exact) < 0.02 * np.linalg.norm(exact)
    make = ColumnMaker(segments, either, gains, columns.motion, rows[: problem.innovation_rows])
    for h, _ in columns.hypotheses:
        small = isinstance(h.effect.slot, Passing) and not h.as_it_is
        if efforts(h, either, columns.motion) is None or (isinstance(h.effect.slot, Contact) and not small):
            continue  # a friction that is large holds, which no effort does
        near, exact = make.columns(h), make.simulated(h)
        for one, other in zip(near, exact, strict=True):
            # what has a kink has it where the predicted motion has: a little elsewhere
            cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
            assert cosine > 0.9, (h.key, h.values)
        kinds.add((h.effect.name, h.as_it_is))
    assert {("dead_zone", True), ("saturation", True), ("delay", True), ("viscous_friction", False)} <= kinds


def test_a_friction_is_the_same_at_each_step_of_the_model(rig, tmp_path):
    sizes = []
    for step in (2e-3, 1e-3, 5e-4):
        (tmp_path / "machine.xml").write_text(MODEL.format(step=step))
        segments, at = held(rig, 0.12)
        start = rig.with_effect("axle", "coulomb_friction", {"torque": 0.2})
        motion = motion_of(segments, rig, segments.gains(rig, at))
        model = FitProblem(segments, start, [("axle", "coulomb_friction")], motion).homotopy_fit(at)
        sizes.append(model.rig.effects["axle"]["coulomb_friction"]["torque"])
    assert sizes == pytest.approx([0.12] * 3, rel=0.01)


def geared(u: np.ndarray, gap: float, parts: int = 400) -> np.ndarray:
    """(N,) angle of the wheel that a rotor of its armature turns through a gap, on teeth that hardly give way."""
    a = w = q = v = 0.0
    found, h = np.zeros(N), STEP_S / parts
    for k in range(N):
        found[k] = q
        for _ in range(parts):
            bent = (a - q) - min(max(a - q, -0.5 * gap), 0.5 * gap)
            teeth = 5e3 * bent + 20.0 * (w - v) if bent else 0.0
            w, v = w + h * (2.0 * u[k] - 0.2 * w - teeth) / 0.05, v + h * teeth / 0.25
            a, q = a + h * w, q + h * v
    return found


def test_a_gap_between_an_actuator_and_its_joint_opens_and_closes(rig):
    u, push = commands()
    way, speed = answered(push, 3.0, 1.5)
    shaken = (push - 1.5 * speed) / 3.0
    there = {"torque": u, "push": push, "angle": geared(u, 0.05), "way": way, "shaken": shaken}
    with_gap = passed(rig.with_effect("axle", "backlash", {"lost_motion": 0.05}), there)["angle"]
    assert np.sqrt(np.mean(with_gap**2)) < 0.05 * np.sqrt(np.mean(passed(rig, there)["angle"] ** 2))
    assert "backlash" not in rig.takes("rail")  # no armature there
    m = mujoco.MjModel.from_xml_string(mended(rig.config, {}, {}, {"axle": 0.05}))
    assert np.ptp(m.joint("play_axle").range) == pytest.approx(0.05, rel=1e-4)
    usual = '<default><joint damping="0.7" armature="0.3" frictionloss="0.2" stiffness="5" ref="10"/></default>'
    (place := Path(rig.config.model)).write_text(place.read_text().replace("<worldbody>", usual + "<worldbody>"))
    m = mujoco.MjModel.from_xml_string(mended(rig.config, {}, {}, {"axle": 0.05}))
    gap = m.joint("play_axle")
    own = (gap.damping, gap.armature, gap.frictionloss, gap.qpos0, m.jnt_stiffness[gap.id], m.qpos_spring[gap.qposadr])
    assert not np.concatenate([np.ravel(one) for one in own]).any()


@pytest.mark.check
def test_a_gap_between_an_actuator_and_its_joint_is_named(rig):
    (u, push), rng = commands(), np.random.default_rng(1)
    way, speed = answered(push, 3.0, 1.5)
    angle = np.round(geared(u, 0.03) / 1e-4 + 0.3 * rng.standard_normal(N)) * 1e-4
    there = {"t": STEP_S * np.arange(N), "torque": u, "push": push, "angle": angle,
             "way": np.round(way / 1e-5 + 0.3 * rng.standard_normal(N)) * 1e-5,
             "shaken": (push - 1.5 * speed) / 3.0 + 0.01 * rng.standard_normal(N)}  # fmt: skip
    (cause,) = dtb.diagnose(pd.DataFrame(there), rig, jobs=1).diagnosis.findings
    assert (cause.location, cause.effect, cause.confidence) == ("axle", "backlash", "sure")
    assert cause.parameters["lost_motion"].value == pytest.approx(0.03, rel=0.03)


def test_a_log_that_a_simulation_made_follows_its_own_steps(rig):
    spin, push = commands()
    m = mujoco.MjModel.from_xml_path(rig.config.model)
    d, found = mujoco.MjData(m), np.zeros((N, 2))
    for k in range(N):
        found[k], d.ctrl[:] = d.qpos, (spin[k], push[k])
        mujoco.mj_step(m, d, nstep=2)
    columns = {"torque": spin, "push": push, "angle": found[:, 0], "way": found[:, 1]}
    assert np.abs(passed(rig, columns, way=STEPPED)["angle"]).max() < 1e-10
    assert np.abs(passed(rig, columns)["angle"]).max() > 1e-4
    runge = Path(rig.config.model).with_name("runge.xml")
    runge.write_text(MODEL.format(step=2e-3).replace("<option", '<option integrator="RK4"'))
    assert not ways_to_read([], load_rig({**RIG, "model": str(runge)}))


def test_a_sample_that_is_far_too_long_for_an_fmu_is_told(tmp_path):
    stiff = replace(EQUATIONS, equations=EQUATIONS.equations.replace("1.5 *", "1e7 *")).build(tmp_path / "stiff.fmu")
    spin, push = commands()
    with pytest.raises(UserError, match=r"its fastest motion, 3.33e\+06 rad/s, takes \d+ steps a sample; at most 2000"):
        passed(load_rig({**EXCHANGED, "model": str(stiff)}), {"torque": spin, "push": push, "angle": spin, "way": push})


def test_where_an_fmu_takes_no_force_nothing_is_looked_for_and_that_is_said(exchanged):
    joints = {**JOINTS, "axle": {"position": "axle.phi"}}
    rig = load_rig({**EXCHANGED, "model": str(exchanged[3]), "joints": joints})
    assert not rig.takes("axle")
    assert {"dead_zone", "delay"} <= set(rig.takes("actuator_spin"))
    assert "load_friction" not in rig.takes("actuator_spin")
    assert "coulomb_friction" in rig.takes("rail")
    (sentence,) = beforehand(rig)
    assert sentence.startswith("The FMU has no input that pushes axle: friction, cogging and loads are not looked for")
    with pytest.raises(UserError, match="coulomb_friction"):
        rig.with_effect("axle", "coulomb_friction", {"torque": 0.1})
    spin, push = commands()
    angle, _ = answered(2.0 * spin, 0.3, 0.2)
    left = passed(rig, {"torque": spin, "push": push, "angle": angle, "way": push})
    assert np.abs(left["angle"]).max() < 1e-3 * np.ptp(angle)


def test_any_variable_of_an_fmu_is_a_sensor(exchanged):
    sensors = {**COLUMNS["sensors"], "watts": {"of": "power", "quantity": "value"}}
    rig = load_rig({**EXCHANGED, "model": str(exchanged[3]), "sensors": sensors})
    spin, push = commands()
    way, speed = answered(push, 3.0, 1.5)
    before = np.concatenate([[0.0], push[:-1]])
    left = passed(rig, {"torque": spin, "push": push, "angle": spin, "way": way, "watts": before * speed})
    assert np.abs(left["watts"][1:]).max() < 1e-3 * np.ptp(before * speed)


def test_what_sensors_show_of_states_is_what_they_showed_in_the_pass(tmp_path):
    timed = replace(EQUATIONS, equations=EQUATIONS.equations.replace("rail * rail_v;", "rail * rail_v + sin(5.0 * t);"))
    sensors = {"way": COLUMNS["sensors"]["way"], "angle": COLUMNS["sensors"]["angle"],
               "watts": {"of": "power", "quantity": "value"}}  # fmt: skip
    rig = load_rig({**EXCHANGED, "model": str(timed.build(tmp_path / "timed.fmu")), "sensors": sensors})
    spin, push = commands()
    frame = pd.DataFrame({"t": STEP_S * np.arange(N), "torque": spin, "push": push, "angle": spin, "way": push})
    predictor = segments_of(
        rig, records_of(Recording.from_frame(frame.assign(watts=push), rig=rig), rig, True, False), [1]
    )
    predictor = predictor.predictors[0]
    gains = predictor.gains(rig, predictor.first_noise_levels())
    gains.K[:] = 0.0
    found = predictor.run(rig, gains)
    there = predictor.simulated.shown(rig, found.X)
    np.testing.assert_allclose(there, predictor.readings.y - found.D, rtol=0, atol=1e-9)
    watts = predictor.readings.channels.index("watts")
    assert np.ptp(there[:, watts] - np.sin(5.0 * STEP_S * np.arange(len(there)))) > 1.0


def test_a_value_is_read_in_the_unit_of_the_fmus_variable(exchanged):
    sensors = {"way": COLUMNS["sensors"]["way"], "watts": {"of": "power", "quantity": "value"},
               "tug": {"of": "push", "quantity": "value"}}  # fmt: skip
    rig = load_rig({**EXCHANGED, "model": str(exchanged[3]), "sensors": sensors})
    spin, push = commands()

    def read(*heads: str) -> Recording:
        frame = pd.DataFrame({"t": STEP_S * np.arange(N), "torque": spin, "push": push, "way": push})
        return Recording.from_frame(frame.assign(**dict.fromkeys(heads, push)), rig=rig)

    np.testing.assert_array_equal(read("watts [W]", "tug").channels["watts"], push)  # W: no unit of recordings
    np.testing.assert_allclose(read("watts", "tug [mN]").channels["tug"], 1e-3 * push)
    with pytest.raises(UserError, match=r"column watts \[mV\] is in mV, and power of the FMU in W"):
        read("watts [mV]", "tug")


def test_arrays_of_an_fmu_are_numbers_of_which_each_is_named(tmp_path):
    pair = Machine(
        {"x[1]": (0.0, "m"), "x[2]": (0.0, "m"), "v[1]": (0.0, "m/s"), "v[2]": (0.0, "m/s")},
        {"k": 900.0, "m[1]": 4.0, "m[2]": 2.5, "c": 15.0},
        {"u": "V", "F[1]": "N", "F[2]": "N"},
        """  double s = k * (x_2_ - x_1_) + c * (v_2_ - v_1_); pull_1_ = s; pull_2_ = u - s;
  D_x_1_ = v_1_; D_x_2_ = v_2_; D_v_1_ = (12.0 * u + F_1_ + s) / m_1_; D_v_2_ = (F_2_ - s) / m_2_;""",
        {"pull[1]": "N", "pull[2]": "N"},
    )
    joints = {n: {"position": f"x[{k}]", "force": f"F[{k}]"} for k, n in ((1, "carriage"), (2, "table"))}
    sensors = {"x_c": {"of": "carriage", "quantity": "position", "absolute": True},
               "pull": {"of": "pull[2]", "quantity": "value"}}  # fmt: skip
    spin, push = commands()
    found = []
    for arrays in (False, True):
        path = pair.build(tmp_path / f"pair_{arrays}.fmu", 3, arrays)
        content = {"model": str(path), "commands": {"u": "u"}, "joints": joints, "sensors": sensors}
        rig = load_rig({**content, "tolerances": {"m[2]": 0.1}}).with_parameters({"m[2]": 1.7})
        rig = rig.with_effect("table", "coulomb_friction", {"force": 2.0})
        found.append(passed(rig, {"u": spin, "x_c": 0.01 * push, "pull": push}))
    assert b'name="m" valueReference="9"' in zipfile.ZipFile(path).read("modelDescription.xml")
    for channel in sensors:
        np.testing.assert_array_equal(found[1][channel], found[0][channel])
    assert np.ptp(found[0]["pull"] - push) > 0.1


def test_what_is_found_in_an_fmu_moves_it_from_outside_as_it_does_inside(tmp_path):
    geared = replace(
        EQUATIONS, equations=EQUATIONS.equations.replace("(rail +", "(gear * rail +"),
        parameters={**EQUATIONS.parameters, "gear": 1.0},
    )  # fmt: skip
    tolerances = {**EXCHANGED["tolerances"], "gear": 0.1}
    rig = load_rig({**EXCHANGED, "model": str(geared.build(tmp_path / "geared.fmu")), "tolerances": tolerances})
    rig = rig.with_parameters({"cart.m": 4.0, "gear": 1.5})
    found = [
        ("rail", "coulomb_friction", {"force": 0.8}), ("rail", "viscous_friction", {"coefficient": 0.7}),
        ("rail", "constant_force", {"force": 0.3}), ("actuator_rail", "dead_zone", {"half_width": 1.5}),
        ("actuator_rail", "load_friction", {"share": 0.3}),
        ("sensor_way", "offset", {"offset": 0.1}),
    ]  # fmt: skip
    for place, name, values in found:
        rig = rig.with_effect(place, name, values)
    files = found_model(rig)
    assert yaml.safe_load(files["parameters.yaml"]) == {"axle.d": 0.2, "cart.m": 4.0, "gear": 1.5}
    assert "not in it, as it is no force or stands in C: offset of way" in files["laws.py"]
    laws: dict = {}
    exec(files["laws.py"], laws)  # the script that users are given
    spin, push = commands()
    q = v = 0.0
    way = np.zeros(N)
    for k in range(N):
        way[k] = q + 0.1
        for part in range(200):
            told = laws["inputs"](
                STEP_S * (k + part / 200), {"rail": q}, {"rail": v}, {"spin": spin[k], "rail": push[k]}
            )
            v += STEP_S / 200 * (1.5 * told["rail"] + told["push"] - 1.5 * v) / 4.0
            q += STEP_S / 200 * v
    left = passed(rig, {"torque": spin, "push": push, "angle": spin, "way": way})
    assert np.abs(left["way"] - left["way"][0]).max() < 0.01 * np.ptp(way)


@pytest.mark.parametrize("version", [2, 3])
def test_what_switches_in_an_fmu_switches(tmp_path, version):
    wall = replace(
        EQUATIONS,
        equations=EQUATIONS.equations.replace("- 1.5", "- touch * 400.0 * (rail_s - 0.2) - 1.5"),
        discrete={"touch": 0.0, "jumps": 0.0}, signs=("rail_s - 0.2",),
        event="touch = rail_s > 0.2; if (t > 0.6 && jumps < 1.0) { jumps = 1.0; axle_phi += 1.0; moved = 1; }",
    )  # fmt: skip
    rig = load_rig({**EXCHANGED, "model": str(wall.build(tmp_path / "wall.fmu", version))})
    spin, push = commands()
    way = answered(push, 3.0, 1.5, held=lambda q: 400.0 * max(q - 0.2, 0.0))[0]
    assert way.max() > 0.21
    first = int(np.argmax((way[1:] - 0.2) * (way[:-1] - 0.2) * (np.arange(N - 1) * STEP_S > 0.6) < 0.0))
    angle, _ = answered(2.0 * spin, 0.3, 0.2)
    angle[first + 1 :] += 1.0  # the first event after 0.6 s
    left = passed(rig, {"torque": spin, "push": push, "angle": angle, "way": way})
    assert np.abs(left["way"]).max() < 0.01 * np.ptp(way)
    assert np.abs(np.delete(left["angle"], [first, first + 1, first + 2])).max() < 0.01


@pytest.mark.parametrize("switches", [False, True])
def test_a_stiff_wall_that_an_fmu_meets_later_takes_the_steps_that_it_needs(tmp_path, switches):
    pressed = "touch * 2e6 * (rail_s - 0.2)" if switches else "2e6 * fmax(rail_s - 0.2, 0.0)"
    stiff = replace(EQUATIONS, equations=EQUATIONS.equations.replace("- 1.5", f"- {pressed} - 1.5"))
    if switches:
        stiff = replace(stiff, discrete={"touch": 0.0}, signs=("rail_s - 0.2",), event="touch = rail_s > 0.2;")
    rig = load_rig({**EXCHANGED, "model": str(stiff.build(tmp_path / "stiff.fmu", 3))})
    spin, push = commands()
    way = answered(push, 3.0, 1.5, held=lambda q: 2e6 * max(q - 0.2, 0.0), parts=400)[0]
    assert 0.19 < way.max() < 0.201 < answered(push, 3.0, 1.5)[0].max()  # it meets the wall and comes back
    angle, _ = answered(2.0 * spin, 0.3, 0.2)
    left = passed(rig, {"torque": spin, "push": push, "angle": angle, "way": way})["way"]
    assert np.abs(left).max() < 0.01 * np.ptp(way)


@pytest.mark.parametrize("version", [2, 3])
def test_an_event_of_an_fmu_takes_place_within_a_step(tmp_path, version):
    bounces = replace(
        EQUATIONS, signs=("rail_s - 0.2",),
        event="if (rail_s > 0.2 && rail_v > 0.0) { rail_v = -0.8 * rail_v; moved = 1; }",
    )  # fmt: skip
    rig = load_rig({**EXCHANGED, "model": str(bounces.build(tmp_path / "bounces.fmu", version))})
    spin, push = commands()
    way = answered(push, 3.0, 1.5, after=lambda q, v: -0.8 * v if q > 0.2 and v > 0.0 else v, parts=400)[0]
    assert 0.19 < way.max() < 0.201 < answered(push, 3.0, 1.5)[0].max()
    angle, _ = answered(2.0 * spin, 0.3, 0.2)
    left = passed(rig, {"torque": spin, "push": push, "angle": angle, "way": way})["way"]
    assert np.abs(left).max() < 2e-4


@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_switches_as_its_clock_strikes_and_no_earlier(tmp_path, version):
    ticking = replace(
        EQUATIONS, discrete={"due": 0.1, "begun": 0.0}, signs=("1.0",), clock="due",
        event="if (t >= due) { due += 0.1; axle_phi += 0.01; moved = 1; } "
        "else if (begun > 0.5) { axle_phi += 1.0; moved = 1; } begun = 1.0;",
    )  # fmt: skip
    rig = load_rig({**EXCHANGED, "model": str(ticking.build(tmp_path / "ticking.fmu", version))})
    spin, push = commands()
    angle = answered(2.0 * spin, 0.3, 0.2)[0] + 0.01 * (np.arange(N) // 25)
    left = passed(rig, {"torque": spin, "push": push, "angle": angle, "way": answered(push, 3.0, 1.5)[0]})
    assert np.abs(left["angle"]).max() < 5e-3


@pytest.mark.parametrize("once", [False, True])
def test_threads_find_in_an_fmu_what_one_finds(tmp_path, monkeypatch, once):
    head = '<ModelExchange modelIdentifier="machine"'
    only = {head: f'{head} canBeInstantiatedOnlyOncePerProcess="{str(once).lower()}"'}
    rig = load_rig({**EXCHANGED, "model": str(EQUATIONS.build(tmp_path / "machine.fmu", 2, **only))})
    made, begun = [], fmu_file.Instance.__init__

    def counted(self, model):
        made.append(model)
        begun(self, model)

    monkeypatch.setattr(fmu_file.Instance, "__init__", counted)
    spin, push = commands()
    frame = pd.DataFrame({"t": STEP_S * np.arange(N), "torque": spin, "push": push, "angle": spin, "way": push})
    predictor = segments_of(rig, records_of(Recording.from_frame(frame, rig=rig), rig, True, False), [1]).predictors[0]
    gains = predictor.gains(rig, predictor.first_noise_levels())

    def left(mass: float) -> np.ndarray:
        changed = rig.with_parameters({"cart.m": mass}).with_effect("rail", "coulomb_friction", {"force": 0.8})
        return predictor.run(changed, gains).D

    masses = np.linspace(2.0, 6.0, 6)
    found = {}
    for jobs in (1, 2, 2):
        with on_cores(jobs):
            found[jobs] = spread(left, masses)
        np.testing.assert_array_equal(found[jobs], found[1])
    assert np.ptp(found[1], axis=0).max() > 0.0
    for _ in range(3):
        thread = threading.Thread(target=left, args=(2.0,))
        thread.start()
        thread.join()
    assert len(made) <= (0 if once else 4)  # the first one was made as the rig was read


def test_an_fmu_goes_to_another_process(exchanged):
    rig = load_rig({**EXCHANGED, "model": str(exchanged[3])})
    spin, push = commands()
    frame = pd.DataFrame({"t": STEP_S * np.arange(N), "torque": spin, "push": push, "angle": spin, "way": push})
    predictor = segments_of(rig, records_of(Recording.from_frame(frame, rig=rig), rig, True, False), [1]).predictors[0]
    gains = predictor.gains(rig, predictor.first_noise_levels())
    before = predictor.run(rig, gains).D
    away = pickle.dumps((predictor, rig, gains))
    fmu_file._read.cache_clear()
    there, rig, gains = pickle.loads(away)  # what was written a moment ago
    np.testing.assert_array_equal(there.run(rig, gains).D, before)


def test_an_instance_of_an_fmu_is_freed(exchanged):
    freed, instance = (
        [],
        fmu_file.Instance(fmu_file.model_of(load_rig({**EXCHANGED, "model": str(exchanged[3])}).config)),
    )
    instance.fmu.fmi3FreeInstance = freed.append
    del instance
    assert len(freed) == 1


def test_a_position_that_nobody_reads_begins_where_its_spring_leaves_it(tmp_path):
    joints = {"carriage": {"position": "x_c", "force": "F_c"}, "table": {"position": "x_t", "force": "F_t"}}
    rig = load_rig({
        "model": str(STAGE.build(tmp_path / "stage.fmu", 3)), "commands": {"u": "u"}, "joints": joints,
        "sensors": {"x_c": {"of": "carriage", "quantity": "position", "absolute": True}},
    })  # fmt: skip
    left = passed(rig, {"u": 1e-9 * commands()[0], "x_c": 0.5 + 1e-9 * commands()[1]})
    assert np.abs(left["x_c"]).max() < 1e-7
