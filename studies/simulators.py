"""Concealed recordings on MuJoCo models in closed loop: two of gymnasium's wheel, and an arm of six joints.

Models and laws (or that nothing is hidden) take turns, the joint and all sizes are drawn. The machine is the model with
masses and dampings off within their tolerances, in steps twenty times finer, with the law as a formula of its own. A
controller on counts and noise moves it; the diagnosis gets the log and the model as it was (extra mujoco; gymnasium is
only looked for, as a folder).
"""

from __future__ import annotations

import importlib.util
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.linalg import solve_discrete_are

import dtbacklash as dtb
from dtbacklash.arrays import Floats
from dtbacklash.physics.mjcf import new_rig
from studies.measure import Row

COUNT = 2 * np.pi / 65536


class Moved(NamedTuple):
    """A model as it is moved. fixed : joints that never move. reach : size of the reference or of the push.

    counts : of each joint, m or rad. gains : by actuator, proportional and derivative ones; None: an LQG's. most : what
    an actuator is told at most. fed : whether it is told what the model needs for the reference, too. samples : that
    are recorded.
    """

    fixed: tuple[str, ...]
    reach: float
    counts: list[float]
    gains: tuple[list[float], list[float]] | None
    most: float = 1.0
    fed: bool = False
    samples: int = 1500


MODELS = {
    "inverted_double_pendulum": Moved((), 0.12, [1e-5, COUNT, COUNT], None),
    "reacher": Moved(("target_x", "target_y"), 0.5, [COUNT] * 2, ([0.6] * 2, [0.06] * 2)),
    "arm": Moved((), 0.3, [COUNT / 4] * 6, ([14, 14, 3.3, 0.6, 0.6, 0.3], [1.1, 1.1, 0.27, 0.05, 0.05, 0.025]),
                 5.0, True, 15000),
}  # fmt: skip
#: those that take turns in a study, and the arm's
OTHERS, OWN = ("inverted_double_pendulum", "reacher"), ("arm",)
#: an arm of six geared joints, of 18 kg and 0.9 m
ARM = """<mujoco model="arm"><option timestep="0.002"/><default>
<joint type="hinge" axis="0 1 0"/><geom type="capsule" size="0.05" contype="0" conaffinity="0"/><motor gear="100"/>
<default class="wrist"><joint damping="0.6" armature="0.06"/><geom size="0.035"/><motor gear="50"/></default></default>
<worldbody><body name="base" pos="0 0 0.1"><joint name="yaw" axis="0 0 1" damping="6" armature="0.8"/>
<geom fromto="0 0 0 0 0 0.12" mass="3.7"/>
<body name="upper" pos="0 0 0.12"><joint name="shoulder" damping="6" armature="0.8"/>
<geom fromto="0 0 0 0 0 0.42" mass="8"/>
<body name="fore" pos="0 0 0.42"><joint name="elbow" damping="4" armature="0.5"/>
<geom fromto="0 0 0 0 0 0.38" mass="3"/>
<body name="wrist" pos="0 0 0.38" childclass="wrist"><joint name="roll" axis="0 0 1"/>
<geom fromto="0 0 0 0 0.08 0" mass="1.2"/>
<body name="palm" pos="0 0.08 0"><joint name="pitch"/><geom fromto="0 0 0 0.05 0 0.1" mass="1.2"/>
<body name="hand" pos="0.05 0 0.1"><joint name="twist" axis="0 0 1" damping="0.3" armature="0.03"/>
<geom fromto="0 0 0 0.06 0.03 0.09" mass="0.6"/></body></body></body></body></body></body></worldbody>
<actuator><motor name="m1" joint="yaw"/><motor name="m2" joint="shoulder"/><motor name="m3" joint="elbow"/>
<motor name="m4" joint="roll" class="wrist"/><motor name="m5" joint="pitch" class="wrist"/>
<motor name="m6" joint="twist" class="wrist"/></actuator></mujoco>
"""
WARM, FINER = 200, 20
MASSES, DAMPINGS = 0.05, 0.3
#: what is hidden: its name in the catalogue (of what turns), or empty
LAWS = ("coulomb_friction", "viscous_friction", "cogging", "constant_load", "quadratic_drag", "delay", "")
#: names of the same law at what slides; viscous friction is right as well where the model's damping was recalibrated
ALIKE = {"constant_load": {"constant_load", "constant_force"}}
Law = Callable[[Floats, Floats], Floats]


def text_of(name: str) -> str:
    """A model's MJCF: our arm's, or one of gymnasium's."""
    if name in OWN:
        return ARM
    found = importlib.util.find_spec("gymnasium")
    if found is None or found.origin is None:
        raise SystemExit("the study needs gymnasium's models: pip install --no-deps gymnasium")
    return (Path(found.origin).parent / "envs" / "mujoco" / "assets" / f"{name}.xml").read_text()


def law_of(name: str, j: int, share: float, force: Floats, speed: Floats, phase: float) -> Law:
    """A hidden law at a joint. share : of the force that moves it; force, speed (joints,) rms."""
    size, v0 = share * force[j], 2e-3 * speed[j]

    def effort(q: Floats, v: Floats) -> Floats:
        found = np.zeros(len(q))
        found[j] = {
            "coulomb_friction": -size * np.tanh(v[j] / v0), "viscous_friction": -size * v[j] / speed[j],
            "cogging": size * np.sin(8.0 * q[j] + phase), "constant_load": size,
            "quadratic_drag": -size * v[j] * abs(v[j]) / speed[j] ** 2,
        }.get(name, 0.0)  # fmt: skip
        return found

    return effort


class Machine:
    """A model with other masses and dampings, moved in closed loop by what its counted joints show."""

    def __init__(self, name: str, rng: np.random.Generator) -> None:
        import mujoco

        self.mj, self.moved = mujoco, MODELS[name]
        spec = mujoco.MjSpec.from_string(text_of(name))
        for joint in self.moved.fixed:
            spec.delete(spec.joint(joint))
        self.plain, self.m = spec.compile(), spec.compile()
        self.m.body_mass *= (ratio := 1.0 + MASSES * np.clip(rng.standard_normal(self.m.nbody), -2, 2))
        self.m.body_inertia *= ratio[:, None]
        self.m.dof_damping *= 1.0 + DAMPINGS * np.clip(rng.standard_normal(self.m.nv), -2, 2)
        self.step_s = self.m.opt.timestep
        self.m.opt.timestep /= FINER
        mujoco.mj_setConst(self.m, mujoco.MjData(self.m))
        self.t = self.step_s * np.arange(self.moved.samples + WARM)
        hz, phases = np.array([0.17, 0.31, 0.53, 0.83, 1.31, 1.9]), rng.uniform(0.0, 6.28, (self.m.nu, 6))
        waves = np.sin(6.283 * hz[:, None] * self.t + phases[..., None]) / (1.0 + hz[:, None])
        self.reference = self.moved.reach * waves.sum(axis=1).T

        self.feed = self.needed() if self.moved.fed else np.zeros_like(self.reference)

    def needed(self) -> Floats:
        """(N, commands) what moves the plain model along the reference, where each joint has an actuator."""
        d, q = self.mj.MjData(self.plain), self.reference
        v = np.gradient(q, self.step_s, axis=0)
        a = np.gradient(v, self.step_s, axis=0)
        feed = np.zeros_like(q)
        for k in range(len(q)):
            d.qpos[:], d.qvel[:], d.qacc[:] = q[k], v[k], a[k]
            self.mj.mj_inverse(self.plain, d)
            feed[k] = d.qfrc_inverse / self.plain.actuator_gear[:, 0] + np.array(self.moved.gains)[1] * v[k]
        return feed

    def gains(self) -> tuple[Floats, Floats]:
        """An LQG of the plain model about its rest: feedback, and the correction of its state."""
        d, n = self.mj.MjData(self.plain), self.plain.nv
        self.plain.opt.integrator = self.mj.mjtIntegrator.mjINT_EULER
        A, B = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, self.plain.nu))
        self.mj.mjd_transitionFD(self.plain, d, 1e-6, True, A, B, None, None)
        C, B0 = np.eye(n, 2 * n), B
        P = solve_discrete_are(A, B, np.diag([*[10.0] * n, *[1.0] * n]), 10.0 * np.eye(self.plain.nu))
        F = np.linalg.solve(10.0 * np.eye(self.plain.nu) + B.T @ P @ B, B.T @ P @ A)
        noise = np.eye(n) * 1e-8
        S = solve_discrete_are(A.T, C.T, B0 @ B0.T * 1e-2 + 1e-9 * np.eye(2 * n), noise)
        L = S @ C.T @ np.linalg.inv(C @ S @ C.T + noise)
        self.A, self.B = A, B
        return np.asarray(F), np.asarray(L)

    def run(self, law: Law, late: int, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
        """(N, commands), (N, joints) as counted, and (N, joints) true speeds. late : samples, of the last joint."""
        d, n, counts = self.mj.MjData(self.m), self.m.nv, np.array(self.moved.counts)
        gains, most = np.array(self.moved.gains or 0.0), self.moved.most
        F, L = self.gains() if self.moved.gains is None else (np.zeros(0), np.zeros(0))
        if self.moved.fed:
            d.qpos[:] = self.reference[0]
        x, last = np.zeros(2 * n), d.qpos.copy()
        U, Y, V, past = [], [], [], [d.qpos.copy()] * (late + 1)
        for r, feed in zip(self.reference, self.feed, strict=True):
            past.append(d.qpos.copy())
            y = d.qpos.copy()
            y[-1] = past[-1 - late][-1]
            y = np.round((y + 0.5 * counts * rng.standard_normal(n)) / counts) * counts
            if len(F):
                x = x + L @ (y - x[:n])
                u = np.clip(-F @ x + r, -most, most)
                x = self.A @ x + self.B @ u
            else:
                u = np.clip(feed + gains[0] * (r - y) - gains[1] * (y - last) / self.step_s, -most, most)
            last = y
            U.append(u)
            Y.append(y)
            V.append(d.qvel.copy())
            d.ctrl[:] = u
            for _ in range(FINER):
                d.qfrc_applied[:] = law(d.qpos, d.qvel)
                self.mj.mj_step(self.m, d)
        return np.array(U)[WARM:], np.array(Y)[WARM:], np.array(V)[WARM:]


def case(seed: int, models: tuple[str, ...]) -> Row:
    """One concealed recording of one of these models, and what a diagnosis says of it."""
    rng = np.random.default_rng(seed)
    name = models[seed % len(models)]
    machine = Machine(name, rng)
    _, _, V = machine.run(lambda q, v: np.zeros(len(q)), 0, rng)
    inverse = np.zeros((machine.m.nv, machine.m.nv))
    d = machine.mj.MjData(machine.m)
    machine.mj.mj_forward(machine.m, d)
    machine.mj.mj_solveM(machine.m, d, inverse, np.eye(machine.m.nv))
    force = np.gradient(V, machine.step_s, axis=0).std(axis=0) / np.diag(inverse)
    hidden, j = LAWS[seed // len(models) % len(LAWS)], int(rng.integers(machine.m.nv))
    late = int(hidden == "delay") * int(rng.integers(1, 4))
    law = law_of(hidden, j, float(rng.uniform(0.1, 0.3)), force, V.std(axis=0), float(rng.uniform(0.0, 6.28)))
    U, Y, _ = machine.run(law, late, rng)
    joints = [machine.m.joint(k).name for k in range(machine.m.nv)]
    with tempfile.TemporaryDirectory() as place:
        model = Path(place) / f"{name}.xml"
        model.write_text(text_of(name))
        rig = model.with_suffix(".yaml")
        fixed = MODELS[name].fixed
        text = [line for line in new_rig(str(model)).splitlines() if not any(f in line for f in fixed)]
        rig.write_text("\n".join([*text, f"fixed: [{', '.join(fixed)}]", ""]))
        loaded = dtb.load_rig(rig)
        commands = {c: U[:, k] for k, c in enumerate(loaded.config.commands)}
        shows = {s.of: s.name for s in loaded.sensors.values() if s.quantity == "position"}
        frame = pd.DataFrame({"t": machine.step_s * np.arange(len(U)), **commands,
                              **{shows[b]: Y[:, k] for k, b in enumerate(joints) if b in shows}})  # fmt: skip
        begun, there = time.process_time(), time.monotonic()
        found = dtb.diagnose(frame, rig, jobs=2)
        seconds, wall = time.process_time() - begun, time.monotonic() - there
    place_hidden = f"sensor_{shows[joints[-1]]}" if hidden == "delay" else joints[j]
    names = ALIKE.get(hidden, {hidden})
    moved = sorted(found.diagnosis.recalibrated)
    damped = hidden == "viscous_friction" and f"joints.{joints[j]}.damping" in moved
    named = [(f.location, f.effect) for f in found.diagnosis.findings]
    sure = [(f.location, f.effect) for f in found.diagnosis.findings if f.confidence == "sure"]

    def is_true(one: tuple[str, str]) -> bool:
        return one[0] == place_hidden and one[1] in names

    return {
        "seed": seed, "what": f"{name}: {hidden or 'nothing'} at {place_hidden if hidden else '-'}",
        "named": ", ".join(f"{p}.{e}{'!' if (p, e) in sure else ''}" for p, e in named) or "-",
        "recalibrated": ", ".join(moved), "right": damped or any(map(is_true, named)) if hidden else not named,
        "sure": len(sure),
        "sure_false": sum(not is_true(one) for one in sure), "cpu_s": seconds, "wall_s": wall,
    }  # fmt: skip


def simulator_rows(n: int, seed: int, kept: Path, models: tuple[str, ...] = OTHERS) -> list[Row]:
    """A row a case; each is written as it is done, and those that are there already are taken from there."""
    rows: list[Any] = pd.read_csv(kept).to_dict("records") if kept.is_file() else []
    done = {row["seed"] for row in rows}
    for k in (k for k in range(seed, seed + n) if k not in done):
        rows.append(case(k, models))
        pd.DataFrame(rows).to_csv(kept, index=False)
    return [row for row in rows if seed <= row["seed"] < seed + n]


def simulator_words(rows: list[Row]) -> list[str]:
    """The counts in one sentence."""
    table = pd.DataFrame(rows)
    hidden = table[~table.what.str.contains("nothing")]
    nothing, sure = table[table.what.str.contains("nothing")], int(table.sure.sum())
    false = int(table.sure_false.sum())
    return [
        f"Main effect named at its place in {int(hidden.right.sum())} of {len(hidden)}; nothing where nothing is in "
        f"{int(nothing.right.sum())} of {len(nothing)}; {sure} sure names, {false} of them false; "
        f"median {table.cpu_s.median():.0f} s of processor time."
    ]
