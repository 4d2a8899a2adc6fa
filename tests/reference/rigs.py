"""The rigs and the commands on which the compiled simulation is compared with the reference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.signal import lfilter

import dtbacklash
from dtbacklash.config.rig import ParameterConfig, RigConfig
from dtbacklash.physics.rig import Rig, build_rig

Array = NDArray[np.float64]


def lead_screw() -> Rig:
    """The paper's rig, from the file that the package ships."""
    path = Path(dtbacklash.__file__).parent / "conf" / "rig" / "lead_screw.yaml"
    described = yaml.safe_load(path.read_text())
    described["parameters"] = {k: ParameterConfig(**v) for k, v in described["parameters"].items()}
    return build_rig(RigConfig(**described))


def carriage() -> Rig:
    """A mass of 95 kg on a bearing, pushed by an ideal force: 1 V is 35 N."""
    return build_rig(
        RigConfig(
            name="carriage",
            parameters={"M": ParameterConfig(95.0, "kg"), "gain": ParameterConfig(35.0, "N/V")},
            elements={
                "amplifier": {"kind": "amplifier", "drives": "motor"},
                "motor": {"kind": "actuator", "gain": "gain", "drives": "carriage"},
                "carriage": {"kind": "carriage", "mass": "M"},
            },
            sensors={
                "q": {"of": "carriage", "quantity": "position"},
                "v": {"of": "carriage", "quantity": "velocity"},
            },
        )
    )


def damper() -> Rig:
    """A mass on a spring, pushed by an ideal force, that drags a brake along by a coupling."""
    return build_rig(
        RigConfig(
            name="damper",
            parameters={
                "m": ParameterConfig(1.0, "kg"),
                "k": ParameterConfig(2000.0, "N/m"),
                "stiff": ParameterConfig(5e3, "N/m"),
                "c": ParameterConfig(20.0, "N s/m"),
                "friction": ParameterConfig(5.0, "N"),
                "gain": ParameterConfig(1.0, "N/V"),
            },
            elements={
                "amplifier": {"kind": "amplifier", "drives": "source"},
                "source": {"kind": "actuator", "gain": "gain", "drives": "mass_1"},
                "mass_1": {"kind": "mass", "mass": "m"},
                "link_1": {"kind": "link", "between": ["ground", "mass_1"], "stiffness": "k", "damping": "c"},
                "joint": {"kind": "coupling", "between": ["band", "mass_1"], "stiffness": "stiff", "damping": "c"},
                "band": {"kind": "brake", "mass": "m", "friction": "friction"},
            },
            sensors={
                "q1": {"of": "mass_1", "quantity": "position"},
                "force": {"of": "joint", "quantity": "force"},
            },
        )
    )


def oscillator(damping: float = 4.0) -> Rig:
    """Two masses: one tied to the ground and pushed by an ideal force, one tied to the first."""
    return build_rig(
        RigConfig(
            name="oscillator",
            parameters={
                "m": ParameterConfig(1.0, "kg"),
                "k": ParameterConfig(2000.0, "N/m"),
                "c": ParameterConfig(damping, "N s/m"),
                "gain": ParameterConfig(1.0, "N/V"),
            },
            elements={
                "amplifier": {"kind": "amplifier", "drives": "source"},
                "source": {"kind": "actuator", "gain": "gain", "drives": "mass_1"},
                "mass_1": {"kind": "mass", "mass": "m"},
                "link_1": {"kind": "link", "between": ["ground", "mass_1"], "stiffness": "k", "damping": "c"},
                "mass_2": {"kind": "mass", "mass": "m"},
                "link_2": {"kind": "link", "between": ["mass_1", "mass_2"], "stiffness": "k", "damping": "c"},
            },
            sensors={
                "q1": {"of": "mass_1", "quantity": "position"},
                "q2": {"of": "mass_2", "quantity": "position"},
            },
        )
    )


def two_inertias(damping: float = 0.02) -> Rig:
    """A torque motor that turns a second inertia through a shaft: 1 V is 0.05 N m."""
    return build_rig(
        RigConfig(
            name="two_inertias",
            parameters={
                "J_1": ParameterConfig(2e-3, "kg m^2"),
                "J_2": ParameterConfig(3e-3, "kg m^2"),
                "k": ParameterConfig(5.0, "N m/rad"),
                "c": ParameterConfig(damping, "N m s/rad"),
                "gain": ParameterConfig(0.05, "N m/V"),
            },
            elements={
                "amplifier": {"kind": "amplifier", "drives": "motor"},
                "motor": {"kind": "actuator", "gain": "gain", "drives": "rotor_1"},
                "rotor_1": {"kind": "rotor", "inertia": "J_1"},
                "shaft": {"kind": "shaft", "between": ["rotor_1", "rotor_2"], "stiffness": "k", "damping": "c"},
                "rotor_2": {"kind": "rotor", "inertia": "J_2"},
            },
            sensors={
                "theta_1": {"of": "rotor_1", "quantity": "position"},
                "theta_2": {"of": "rotor_2", "quantity": "position"},
            },
        )
    )


def geared(last: str = "belt") -> Rig:
    """A torque motor, a gearbox of 4:1, and a pulley with its belt (or a pinion on its rack) that moves a carriage."""
    return build_rig(
        RigConfig(
            name="geared",
            parameters={
                "J_1": ParameterConfig(1e-4, "kg m^2"),
                "J_2": ParameterConfig(5e-4, "kg m^2"),
                "M": ParameterConfig(2.0, "kg"),
                "ratio": ParameterConfig(4.0),
                "radius": ParameterConfig(0.03, "m"),
                "k_1": ParameterConfig(30.0, "N m/rad"),
                "c_1": ParameterConfig(0.05, "N m s/rad"),
                "k_2": ParameterConfig(2e4, "N/m"),
                "c_2": ParameterConfig(30.0, "N s/m"),
                "gain": ParameterConfig(0.05, "N m/V"),
            },
            elements={
                "motor": {"kind": "actuator", "gain": "gain", "drives": "rotor"},
                "rotor": {"kind": "rotor", "inertia": "J_1"},
                "teeth": {
                    "kind": "gearbox", "between": ["rotor", "pulley"], "ratio": "ratio", "stiffness": "k_1",
                    "damping": "c_1",
                },
                "pulley": {"kind": "rotor", "inertia": "J_2"},
                last: {
                    "kind": last, "between": ["pulley", "carriage"], "radius": "radius", "stiffness": "k_2",
                    "damping": "c_2",
                },
                "carriage": {"kind": "carriage", "mass": "M"},
            },
            sensors={
                "theta": {"of": "rotor", "quantity": "position"},
                "x": {"of": "carriage", "quantity": "position"},
            },
        )
    )  # fmt: skip


def served() -> Rig:
    """A servo that turns a rotor with a load behind a shaft: its command is an angle, 1 V is 1 rad."""
    return build_rig(
        RigConfig(
            name="served",
            parameters={
                "J_1": ParameterConfig(2e-3, "kg m^2"),
                "J_2": ParameterConfig(1e-3, "kg m^2"),
                "k": ParameterConfig(40.0, "N m/rad"),
                "c": ParameterConfig(0.05, "N m s/rad"),
                "K_p": ParameterConfig(8.0, "N m/rad"),
                "K_d": ParameterConfig(0.2, "N m s/rad"),
            },
            elements={
                "servo": {"kind": "servo", "position_gain": "K_p", "speed_gain": "K_d", "drives": "rotor"},
                "rotor": {"kind": "rotor", "inertia": "J_1"},
                "shaft": {"kind": "shaft", "between": ["rotor", "load"], "stiffness": "k", "damping": "c"},
                "load": {"kind": "rotor", "inertia": "J_2"},
            },
            sensors={
                "theta": {"of": "rotor", "quantity": "position"},
                "theta_l": {"of": "load", "quantity": "position"},
            },
        )
    )


def served_carriage() -> Rig:
    """A linear servo that pushes a carriage: its command is a place, 1 V is 1 m."""
    return build_rig(
        RigConfig(
            name="served_carriage",
            parameters={
                "M": ParameterConfig(2.0, "kg"),
                "K_p": ParameterConfig(8000.0, "N/m"),
                "K_d": ParameterConfig(200.0, "N s/m"),
            },
            elements={
                "drive": {"kind": "linear_servo", "position_gain": "K_p", "speed_gain": "K_d", "drives": "carriage"},
                "carriage": {"kind": "carriage", "mass": "M"},
            },
            sensors={"x": {"of": "carriage", "quantity": "position"}},
        )
    )


def random_steps(samples: int, hold: int, size: float, seed: int = 1) -> Array:
    """Filtered random steps, each held for ``hold`` samples; (samples,) V."""
    steps = np.random.default_rng(seed).standard_normal(samples // hold + 1)
    return size * np.repeat(lfilter([0.3], [1.0, -0.7], steps), hold)[:samples]
