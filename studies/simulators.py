"""Concealed recordings on MuJoCo models that nobody here wrote: those in gymnasium's wheel, in closed loop.

Models and laws (or that nothing is hidden) take turns, the joint and all sizes are drawn. The machine is the model with
masses and dampings off within their tolerances, in steps twenty times finer, with the law as a formula of its own. A
controller on counts and noise moves it; the diagnosis gets the log and the model as gymnasium has it (extra mujoco;
gymnasium is only looked for, as a folder).
"""

from __future__ import annotations

import importlib.util
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.linalg import solve_discrete_are

import dtbacklash as dtb
from dtbacklash.arrays import Floats
from dtbacklash.physics.mjcf import new_rig
from studies.measure import Row

#: model -> joints that never move, size of the reference or of the push, and a count of each joint, m or rad
MODELS: dict[str, tuple[list[str], float, list[float]]] = {
    "inverted_double_pendulum": ([], 0.12, [1e-5, 2 * np.pi / 65536, 2 * np.pi / 65536]),
    "reacher": (["target_x", "target_y"], 0.5, [2 * np.pi / 65536] * 2),
}
SAMPLES, FINER, WARM = 1500, 20, 200
MASSES, DAMPINGS = 0.05, 0.3
#: what is hidden: its name in the catalogue (of what turns), or empty
LAWS = ("coulomb_friction", "viscous_friction", "cogging", "constant_load", "quadratic_drag", "delay", "")
#: names of the same law at what slides; viscous friction is right as well where the model's damping was recalibrated
ALIKE = {"constant_load": {"constant_load", "constant_force"}}
Law = Callable[[Floats, Floats], Floats]


def folder() -> Path:
    """gymnasium's models."""
    found = importlib.util.find_spec("gymnasium")
    if found is None or found.origin is None:
        raise SystemExit("the study needs gymnasium's models: pip install --no-deps gymnasium")
    return Path(found.origin).parent / "envs" / "mujoco" / "assets"


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

        self.mj, self.name = mujoco, name
        fixed, self.reach, self.counts = MODELS[name]
        spec = mujoco.MjSpec.from_file(str(folder() / f"{name}.xml"))
        for joint in fixed:
            spec.delete(spec.joint(joint))
        self.plain, self.m = spec.compile(), spec.compile()
        self.m.body_mass *= (ratio := 1.0 + MASSES * np.clip(rng.standard_normal(self.m.nbody), -2, 2))
        self.m.body_inertia *= ratio[:, None]
        self.m.dof_damping *= 1.0 + DAMPINGS * np.clip(rng.standard_normal(self.m.nv), -2, 2)
        self.step_s = self.m.opt.timestep
        self.m.opt.timestep /= FINER
        mujoco.mj_setConst(self.m, mujoco.MjData(self.m))
        self.t = self.step_s * np.arange(SAMPLES + WARM)
        hz, phases = np.array([0.17, 0.31, 0.53, 0.83, 1.31, 1.9]), rng.uniform(0.0, 6.28, (self.m.nu, 6))
        waves = np.sin(6.283 * hz[:, None] * self.t + phases[..., None]) / (1.0 + hz[:, None])
        self.reference = self.reach * waves.sum(axis=1).T

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
        d, n, counts = self.mj.MjData(self.m), self.m.nv, np.array(self.counts)
        F, L = self.gains() if self.name == "inverted_double_pendulum" else (np.zeros(0), np.zeros(0))
        x, last = np.zeros(2 * n), np.zeros(n)
        U, Y, V, past = [], [], [], [d.qpos.copy()] * (late + 1)
        for r in self.reference:
            past.append(d.qpos.copy())
            y = d.qpos.copy()
            y[-1] = past[-1 - late][-1]
            y = np.round((y + 0.5 * counts * rng.standard_normal(n)) / counts) * counts
            if len(F):
                x = x + L @ (y - x[:n])
                u = np.clip(-F @ x + r, -1.0, 1.0)
                x = self.A @ x + self.B @ u
            else:
                u = np.clip(0.6 * (r - y) - 0.06 * (y - last) / self.step_s, -1.0, 1.0)
            last = y
            U.append(u)
            Y.append(y)
            V.append(d.qvel.copy())
            d.ctrl[:] = u
            for _ in range(FINER):
                d.qfrc_applied[:] = law(d.qpos, d.qvel)
                self.mj.mj_step(self.m, d)
        return np.array(U)[WARM:], np.array(Y)[WARM:], np.array(V)[WARM:]


def case(seed: int) -> Row:
    """One concealed recording and what a diagnosis says of it."""
    rng = np.random.default_rng(seed)
    name = list(MODELS)[seed % len(MODELS)]
    machine = Machine(name, rng)
    _, _, V = machine.run(lambda q, v: np.zeros(len(q)), 0, rng)
    inverse = np.zeros((machine.m.nv, machine.m.nv))
    d = machine.mj.MjData(machine.m)
    machine.mj.mj_forward(machine.m, d)
    machine.mj.mj_solveM(machine.m, d, inverse, np.eye(machine.m.nv))
    force = np.gradient(V, machine.step_s, axis=0).std(axis=0) / np.diag(inverse)
    hidden, j = LAWS[seed // len(MODELS) % len(LAWS)], int(rng.integers(machine.m.nv))
    late = int(hidden == "delay") * int(rng.integers(1, 4))
    law = law_of(hidden, j, float(rng.uniform(0.1, 0.3)), force, V.std(axis=0), float(rng.uniform(0.0, 6.28)))
    U, Y, _ = machine.run(law, late, rng)
    joints = [machine.m.joint(k).name for k in range(machine.m.nv)]
    with tempfile.TemporaryDirectory() as place:
        model = Path(place) / f"{name}.xml"
        model.write_bytes((folder() / model.name).read_bytes())
        rig = model.with_suffix(".yaml")
        fixed = MODELS[name][0]
        text = [line for line in new_rig(str(model)).splitlines() if not any(f in line for f in fixed)]
        rig.write_text("\n".join([*text, f"fixed: [{', '.join(fixed)}]", ""]))
        commands = {c: U[:, k] for k, c in enumerate(dtb.load_rig(rig).config.commands)}
        frame = pd.DataFrame({"t": machine.step_s * np.arange(len(U)), **commands,
                              **{f"q_{b}": Y[:, k] for k, b in enumerate(joints)}})  # fmt: skip
        begun = time.process_time()
        found = dtb.diagnose(frame, rig, jobs=1)
        seconds = time.process_time() - begun
    place_hidden = f"sensor_q_{joints[-1]}" if hidden == "delay" else joints[j]
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
        "sure_false": sum(not is_true(one) for one in sure), "cpu_s": seconds,
    }  # fmt: skip


def simulator_rows(n: int, seed: int, kept: Path) -> list[Row]:
    """A row a case; each is written as it is done."""
    rows: list[Any] = []
    for k in range(seed, seed + n):
        rows.append(case(k))
        pd.DataFrame(rows).to_csv(kept, index=False)
    return rows


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
