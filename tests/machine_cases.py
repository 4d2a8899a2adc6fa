"""Recordings of machines that differ from their nominal rigs, for the check of units: all in right units."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import machines as m
import numpy as np
import pandas as pd
from nominal import nominal_rig

from dtbacklash.config.rig import ParameterConfig, RigConfig
from dtbacklash.physics.rig import Rig, build_rig


@dataclass(frozen=True)
class Case:
    """A nominal rig and what its sensors showed, in SI."""

    name: str
    rig: Rig
    frame: pd.DataFrame


def rig(elements: dict, sensors: dict, **parameters: float) -> Rig:
    """A rig without effects."""
    configs = {name: ParameterConfig(value) for name, value in parameters.items()}
    return build_rig(RigConfig("mine", parameters=configs, elements=elements, sensors=sensors))


def carriage() -> Rig:
    return rig(
        {"amplifier": {"kind": "amplifier", "drives": "motor"},
         "motor": {"kind": "actuator", "gain": "g", "drives": "carriage"},
         "carriage": {"kind": "carriage", "mass": "M"}},
        {"x": {"of": "carriage", "quantity": "position"}, "v": {"of": "carriage", "quantity": "velocity"}},
        g=35.0, M=95.0,
    )  # fmt: skip


def oscillator() -> Rig:
    return rig(
        {"amplifier": {"kind": "amplifier", "drives": "source"},
         "source": {"kind": "actuator", "gain": "g", "drives": "mass_1"}, "mass_1": {"kind": "mass", "mass": "m"},
         "link_1": {"kind": "link", "between": ["ground", "mass_1"], "stiffness": "k", "damping": "c"}},
        {"y": {"of": "mass_1", "quantity": "position"}}, g=2.0, m=0.8, c=1.2, k=900.0,
    )  # fmt: skip


def stage(grounded: bool) -> Rig:
    ground = {"ground_stiffness": "kg", "ground_damping": "cg"} if grounded else {}
    return rig(
        {"amplifier": {"kind": "amplifier", "drives": "motor"},
         "motor": {"kind": "actuator", "gain": "g", "drives": "mass_1"}, "mass_1": {"kind": "mass", "mass": "m1"},
         "link_1": {"kind": "link", "between": ["mass_1", "mass_2"], "stiffness": "k", "damping": "c"},
         "mass_2": {"kind": "mass", "mass": "m2", **ground}},
        {"x1": {"of": "mass_1", "quantity": "position"}, "x2": {"of": "mass_2", "quantity": "position"}},
        g=10.0, m1=3.0, m2=1.5, k=4000.0, c=4.0, kg=500.0, cg=3.0,
    )  # fmt: skip


def motor() -> Rig:
    return rig(
        {"amplifier": {"kind": "amplifier", "drives": "circuit"},
         "circuit": {"kind": "motor_circuit", "resistance": "R", "inductance": "L", "torque_constant": "kT",
                     "emf_constant": "kB", "drives": "shaft"},
         "shaft": {"kind": "rotor", "inertia": "J"}},
        {"theta": {"of": "shaft", "quantity": "position"}, "i": {"of": "circuit", "quantity": "current"}},
        R=2.0, L=1e-3, kT=0.05, kB=0.05, J=2e-4,
    )  # fmt: skip


def _seen(name: str, nominal: Rig, machine: m.Machine, command: np.ndarray, noise: float, sensors: dict) -> Case:
    x, v, u = m.record(machine, command, noise)
    t = m.STEP_S * np.arange(len(u))
    columns = {"t": t, "u": u}
    for sensor, (what, body) in sensors.items():
        if what == "current":
            columns[sensor] = (u - 0.05 * v[:, 0]) / 2.0
        else:
            columns[sensor] = (x if what == "position" else v)[:, body]
    return Case(name, nominal, pd.DataFrame(columns))


def _small() -> Iterator[Case]:
    t = m.times(12.0)
    car = m.Machine((95.0,), gain=35.0)
    show = {"x": ("position", 0)}
    both = {"x": ("position", 0), "v": ("velocity", 0)}
    rub = replace(car, coulomb=20.0, viscous=200.0, load=3.0)
    noise = m.multisine(t, 3.0, 8.0)
    yield _seen("carriage, plain", carriage(), car, m.multisine(t, 2.0, 5.0), 1e-6, show)
    yield _seen("carriage, friction", carriage(), rub, noise, 1e-6, show)
    yield _seen("carriage, friction, speed too", carriage(), rub, noise, 1e-6, both)
    yield _seen("carriage, nearly stalls", carriage(), replace(car, coulomb=80.0), noise, 1e-6, show)
    yield _seen("carriage, creeps", carriage(), replace(car, coulomb=20.0, viscous=4000.0), noise, 1e-6, show)
    yield _seen("carriage, square", carriage(), replace(rub, dead_zone=0.3), m.square(t, 3.0, 0.7), 1e-6, show)
    yield _seen("carriage, one tone", carriage(), rub, 4.0 * np.sin(2 * np.pi * 0.8 * t), 1e-6, show)
    pid = replace(rub, pid=(400.0, 200.0, 60.0), limit=10.0)
    moves = m.smooth(t, m.steps(t, 0.1, 1.5), 0.5)
    yield _seen("carriage, PID", carriage(), pid, moves, 1e-6, show)
    yield _seen("carriage, PID, sticks", carriage(), replace(pid, coulomb=120.0), moves, 1e-6, show)
    yield _seen("carriage, PID, a load as large as the drive", carriage(), replace(pid, load=150.0), moves, 1e-6, show)
    osc = m.Machine((0.8,), gain=2.0, ground=900.0, ground_damping=1.2)
    see = {"y": ("position", 0)}
    yield _seen("oscillator, plain", oscillator(), osc, m.multisine(t, 3.0, 15.0), 1e-6, see)
    yield _seen("oscillator, cubic", oscillator(), replace(osc, cubic=5e6), m.multisine(t, 5.0, 15.0), 1e-6, see)
    yield _seen("oscillator, friction", oscillator(), replace(osc, coulomb=3.0), m.multisine(t, 3.0, 15.0), 1e-6, see)
    yield _seen(
        "oscillator, nearly stalls", oscillator(), replace(osc, coulomb=9.0), m.multisine(t, 3.0, 15.0), 1e-6, see
    )
    yield _seen("oscillator, released", oscillator(), replace(osc, start=0.05), m.multisine(t, 0.3, 15.0), 1e-6, see)
    yield _seen("oscillator, at its resonance", oscillator(), osc, 2.0 * np.sin(33.5 * t), 1e-6, see)
    yield _seen("oscillator, damped", oscillator(), replace(osc, viscous=120.0), m.steps(t, 5.0, 0.3), 1e-6, see)
    two = m.Machine((3.0, 1.5), gain=10.0, link=4000.0, link_damping=4.0)
    ends = {"x1": ("position", 0), "x2": ("position", 1)}
    for grounded in (False, True):
        own = replace(two, ground=500.0, ground_damping=3.0) if grounded else two
        word = "grounded" if grounded else "free"
        nominal = stage(grounded)
        yield _seen(f"stage, {word}, plain", nominal, own, m.multisine(t, 1.0, 20.0), 1e-6, ends)
        yield _seen(
            f"stage, {word}, friction", nominal, replace(own, coulomb=5.0, viscous=8.0), m.multisine(t, 1.5, 20.0),
            1e-6, ends,
        )  # fmt: skip
        yield _seen(
            f"stage, {word}, play", nominal, replace(own, gap=1e-3, coulomb=2.0), m.multisine(t, 2.0, 6.0), 1e-6, ends
        )
        yield _seen(
            f"stage, {word}, only the far end", nominal, replace(own, far_coulomb=6.0), m.multisine(t, 2.0, 20.0), 1e-6,
            {"x2": ("position", 1)},
        )  # fmt: skip
    yield _seen(
        "stage, PID", stage(False), replace(two, coulomb=4.0, pid=(600.0, 600.0, 25.0), limit=20.0),
        m.smooth(t, m.steps(t, 0.02, 1.0), 0.3), 1e-6, ends,
    )  # fmt: skip
    drive = m.Machine((2e-4,), gain=0.025, emf=0.05)
    look = {"theta": ("position", 0), "i": ("current", 0)}
    yield _seen("motor, plain", motor(), drive, m.multisine(t, 3.0, 8.0), 1e-4, look)
    yield _seen("motor, friction", motor(), replace(drive, coulomb=0.03), m.multisine(t, 3.0, 8.0), 1e-4, look)
    yield _seen("motor, nearly stalls", motor(), replace(drive, coulomb=0.12), m.multisine(t, 3.0, 8.0), 1e-4, look)
    yield _seen("motor, viscous", motor(), replace(drive, viscous=0.02), m.multisine(t, 3.0, 8.0), 1e-4, look)
    yield _seen("motor, pendulum", motor(), replace(drive, pendulum=0.1), m.multisine(t, 3.0, 3.0), 1e-4, look)
    yield _seen("motor, hoist", motor(), replace(drive, load=-0.06, coulomb=0.01), m.multisine(t, 3.0, 3.0), 1e-4, look)
    yield _seen(
        "motor, PID", motor(), replace(drive, coulomb=0.02, pid=(6.0, 3.0, 0.2), limit=12.0),
        m.smooth(t, m.steps(t, 6.0, 1.5), 0.5), 1e-4, look,
    )  # fmt: skip
    yield _seen(
        "motor, angle alone", motor(), replace(drive, coulomb=0.05), m.square(t, 5.0, 0.9), 1e-4,
        {"theta": ("position", 0)},
    )  # fmt: skip


def _screw() -> Iterator[Case]:
    """The paper's rig, by the package's own simulation, with something in it that the nominal rig has not."""
    from dtbacklash.config.compose import compose
    from dtbacklash.experiment.run import run_scenario
    from dtbacklash.physics.simulate import simulate

    nominal = nominal_rig("lead_screw")
    t = m.times(12.0)
    u = m.multisine(t, 3.0, 8.0)
    stalling = nominal.with_effect("motor_bearing", "coulomb_friction", {"torque": 0.15})
    worn = nominal.with_effect("gear", "backlash", {"half_gap": 1.5})
    for name, true, keep in (
        ("plain", nominal, ("theta_m", "q3", "i_m", "q2")),
        ("friction", nominal.with_effect("motor_bearing", "coulomb_friction", {"torque": 0.05}), ("theta_m", "q3")),
        ("nearly stalls", stalling, ("theta_m", "q3", "i_m")),
        ("play", worn, ("theta_m", "q3")),
        ("play, q3 alone", worn, ("q3",)),
        ("play as wide as the motion", nominal.with_effect("gear", "backlash", {"half_gap": 6.0}), ("theta_m", "q3")),
        ("friction and play, q3 alone", stalling.with_effect("gear", "backlash", {"half_gap": 0.5}), ("q3",)),
    ):
        seen = simulate(true, u[:-1], m.STEP_S).sensors
        yield Case(f"screw, {name}", nominal, pd.DataFrame({"t": t, "u": u, **{s: seen[s] for s in keep}}))
    for name, words in (
        ("closed loop", ("controller.internal_model=bare",)),
        (
            "closed loop, friction",
            ("rig.effects.motor_bearing.coulomb_friction.torque=0.01", "controller.internal_model=inner_loop"),
        ),
    ):
        config = compose("controller=nimc_fixed", "profile=constant", "profile.start_deg=30", "duration_s=20",
                         "sensors=encoder", "reference=staircase", "controller.crossing=run", *words)  # fmt: skip
        result = run_scenario(config)
        frame = pd.DataFrame({"t": result.t_s, **result.seen})
        yield Case(f"screw, {name}", nominal, frame)


@cache
def all_cases() -> tuple[Case, ...]:
    """More than twenty-five recordings in right units."""
    return *_small(), *_screw()


#: kind -> rig, machine, what its sensors show, command, a speed, a displacement, the gains of its loop
_KINDS: dict[str, tuple] = {
    "carriage": (carriage, m.Machine((95.0,), gain=35.0), {"x": ("position", 0)}, 3.0, 0.5, 0.1, (400.0, 200.0, 60.0)),
    "oscillator": (oscillator, m.Machine((0.8,), gain=2.0, ground=900.0, ground_damping=1.2), {"y": ("position", 0)},
                   4.0, 0.3, 0.02, (200.0, 2000.0, 5.0)),
    "free stage": (lambda: stage(False), m.Machine((3.0, 1.5), gain=10.0, link=4000.0, link_damping=4.0),
                   {"x1": ("position", 0), "x2": ("position", 1)}, 1.5, 0.5, 0.02, (600.0, 600.0, 25.0)),
    "grounded stage": (lambda: stage(True), m.Machine((3.0, 1.5), 10.0, 0.0, 500.0, 3.0, 4000.0, 4.0),
                       {"x1": ("position", 0), "x2": ("position", 1)}, 1.5, 0.5, 0.02, (600.0, 600.0, 25.0)),
    "motor": (motor, m.Machine((2e-4,), gain=0.025, emf=0.05), {"theta": ("position", 0), "i": ("current", 0)},
              3.0, 60.0, 3.0, (6.0, 3.0, 0.2)),
}  # fmt: skip


def drawn_case(seed: int) -> Case:
    """A machine, its command and its sensors at random: effects of any size, bad encoders."""
    g = np.random.default_rng(seed)
    kind = str(g.choice(list(_KINDS)))
    nominal, machine, sensors, top, speed, way, gains = _KINDS[kind]
    t = m.times(float(g.choice([4, 8, 12])))
    full = 2.0 * top * machine.gain

    def perhaps(share: float, value: float) -> float:
        return float(value) if g.random() < share else 0.0

    machine = replace(
        machine,
        gain=machine.gain * float(np.exp(g.normal(0, 0.2))),
        inertia=tuple(x * float(np.exp(g.normal(0, 0.2))) for x in machine.inertia),
        coulomb=perhaps(0.6, full * g.uniform(0, 0.95)),
        viscous=perhaps(0.4, 0.1 * 10 ** g.uniform(-1, 1.5) * full / speed),
        load=perhaps(0.3, full * g.uniform(-0.8, 0.8)),
        pendulum=perhaps(0.3, full * g.uniform(0, 1)) if kind == "motor" else 0.0,
        cubic=perhaps(0.4, 10 ** g.uniform(0, 4) * machine.ground),
        gap=perhaps(0.4, 10 ** g.uniform(-5, -2)) if "stage" in kind else 0.0,
        far_coulomb=perhaps(0.4, full * g.uniform(0, 0.7)) if "stage" in kind else 0.0,
        dead_zone=perhaps(0.3, top * g.uniform(0, 1)),
        start=perhaps(0.2, g.normal() * way),
    )
    form = str(g.choice(["slow", "fast", "steps", "square", "tone", "chirp", "loop"]))
    command = {
        "slow": lambda: m.multisine(t, top, float(g.choice([2, 8, 30])), seed),
        "fast": lambda: m.multisine(t, top, 100.0, seed),
        "steps": lambda: m.steps(t, 2 * top, float(g.uniform(0.1, 2)), seed),
        "square": lambda: m.square(t, 1.5 * top, float(g.uniform(0.1, 2))),
        "tone": lambda: 1.5 * top * np.sin(2 * np.pi * 10 ** g.uniform(-0.7, 1.2) * t),
        "chirp": lambda: 1.5 * top * np.sin(2 * np.pi * (0.2 * t + t**2 * g.uniform(0.05, 1))),
        "loop": lambda: m.smooth(t, m.steps(t, way, 1.2, seed), 0.4),
    }[form]()
    if form == "loop":
        machine = replace(machine, pid=gains, limit=4 * top)
    case = _seen(f"{kind}, {form}, {seed}", nominal(), machine, command, 0.0, sensors)
    columns = {name: case.frame[name].to_numpy() for name in ("t", "u")}
    for name in sensors:
        y = case.frame[name].to_numpy()
        count = max(np.ptp(y), 1e-12) / 10 ** g.uniform(1.0, 4.5)
        y = np.round(y / count) * count if g.random() < 0.5 else y + count * g.standard_normal(len(y))
        late = int(g.integers(1, 10)) if g.random() < 0.3 else 0
        columns[name] = np.concatenate([np.full(late, y[0]), y[: len(y) - late]]) + perhaps(0.2, 3 * np.ptp(y))
    return replace(case, frame=pd.DataFrame(columns))
