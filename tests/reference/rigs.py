"""The rigs and the commands on which the compiled simulation is compared with the reference."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.signal import lfilter

import dtbacklash
from dtbacklash.config.rig import ParameterConfig, RigConfig
from dtbacklash.physics.rig import Rig, build_rig

Array = NDArray[np.float64]
AMPLIFIER = {"kind": "amplifier", "drives": "source"}
SOURCE = {"kind": "actuator", "gain": "gain", "drives": "mass_1"}


def lead_screw() -> Rig:
    """The paper's rig, from the file that the package ships."""
    path = Path(dtbacklash.__file__).parent / "conf" / "rig" / "lead_screw.yaml"
    described = yaml.safe_load(path.read_text())
    described["parameters"] = {k: ParameterConfig(**v) for k, v in described["parameters"].items()}
    return build_rig(RigConfig(**described))


def built(name: str, parameters: dict[str, tuple], elements: dict[str, Any], sensors: dict[str, str]) -> Rig:
    """A rig. parameters : name -> value and unit. sensors : name -> element and quantity, in two words."""
    return build_rig(
        RigConfig(
            name=name,
            parameters={n: ParameterConfig(*one) for n, one in parameters.items()},
            elements=elements,
            sensors={n: dict(zip(("of", "quantity"), said.split(), strict=True)) for n, said in sensors.items()},
        )
    )


def spring(kind: str, first: str, second: str, stiffness: str = "k", damping: str = "c", **more: str) -> dict[str, Any]:
    return {"kind": kind, "between": [first, second], "stiffness": stiffness, "damping": damping, **more}


def carriage() -> Rig:
    """A mass of 95 kg on a bearing, pushed by an ideal force: 1 V is 35 N."""
    elements = {
        "amplifier": {"kind": "amplifier", "drives": "motor"},
        "motor": {"kind": "actuator", "gain": "gain", "drives": "carriage"},
        "carriage": {"kind": "carriage", "mass": "M"},
    }
    sensors = {"q": "carriage position", "v": "carriage velocity"}
    return built("carriage", {"M": (95.0, "kg"), "gain": (35.0, "N/V")}, elements, sensors)


def damper() -> Rig:
    """A mass on a spring, pushed by an ideal force, that drags a brake along by a coupling."""
    parameters = {
        "m": (1.0, "kg"), "k": (2000.0, "N/m"), "stiff": (5e3, "N/m"), "c": (20.0, "N s/m"), "friction": (5.0, "N"),
        "gain": (1.0, "N/V"),
    }  # fmt: skip
    elements = {
        "amplifier": AMPLIFIER, "source": SOURCE, "mass_1": {"kind": "mass", "mass": "m"},
        "link_1": spring("link", "ground", "mass_1"), "joint": spring("coupling", "band", "mass_1", "stiff"),
        "band": {"kind": "brake", "mass": "m", "friction": "friction"},
    }  # fmt: skip
    return built("damper", parameters, elements, {"q1": "mass_1 position", "force": "joint force"})


def oscillator(damping: float = 4.0) -> Rig:
    """Two masses: one tied to the ground and pushed by an ideal force, one tied to the first."""
    parameters = {"m": (1.0, "kg"), "k": (2000.0, "N/m"), "c": (damping, "N s/m"), "gain": (1.0, "N/V")}
    elements = {
        "amplifier": AMPLIFIER, "source": SOURCE, "mass_1": {"kind": "mass", "mass": "m"},
        "link_1": spring("link", "ground", "mass_1"), "mass_2": {"kind": "mass", "mass": "m"},
        "link_2": spring("link", "mass_1", "mass_2"),
    }  # fmt: skip
    return built("oscillator", parameters, elements, {"q1": "mass_1 position", "q2": "mass_2 position"})


def two_inertias(damping: float = 0.02) -> Rig:
    """A torque motor that turns a second inertia through a shaft: 1 V is 0.05 N m."""
    parameters = {
        "J_1": (2e-3, "kg m^2"), "J_2": (3e-3, "kg m^2"), "k": (5.0, "N m/rad"), "c": (damping, "N m s/rad"),
        "gain": (0.05, "N m/V"),
    }  # fmt: skip
    elements = {
        "amplifier": {"kind": "amplifier", "drives": "motor"},
        "motor": {"kind": "actuator", "gain": "gain", "drives": "rotor_1"},
        "rotor_1": {"kind": "rotor", "inertia": "J_1"},
        "shaft": spring("shaft", "rotor_1", "rotor_2"),
        "rotor_2": {"kind": "rotor", "inertia": "J_2"},
    }
    return built("two_inertias", parameters, elements, {"theta_1": "rotor_1 position", "theta_2": "rotor_2 position"})


def geared(last: str = "belt") -> Rig:
    """A torque motor, a gearbox of 4:1, and a pulley with its belt (or a pinion on its rack) that moves a carriage."""
    parameters = {
        "J_1": (1e-4, "kg m^2"), "J_2": (5e-4, "kg m^2"), "M": (2.0, "kg"), "ratio": (4.0,), "radius": (0.03, "m"),
        "k_1": (30.0, "N m/rad"), "c_1": (0.05, "N m s/rad"), "k_2": (2e4, "N/m"), "c_2": (30.0, "N s/m"),
        "gain": (0.05, "N m/V"),
    }  # fmt: skip
    elements = {
        "motor": {"kind": "actuator", "gain": "gain", "drives": "rotor"},
        "rotor": {"kind": "rotor", "inertia": "J_1"},
        "teeth": spring("gearbox", "rotor", "pulley", "k_1", "c_1", ratio="ratio"),
        "pulley": {"kind": "rotor", "inertia": "J_2"},
        last: spring(last, "pulley", "carriage", "k_2", "c_2", radius="radius"),
        "carriage": {"kind": "carriage", "mass": "M"},
    }
    return built("geared", parameters, elements, {"theta": "rotor position", "x": "carriage position"})


def served() -> Rig:
    """A servo that turns a rotor with a load behind a shaft: its command is an angle, 1 V is 1 rad."""
    parameters = {
        "J_1": (2e-3, "kg m^2"), "J_2": (1e-3, "kg m^2"), "k": (40.0, "N m/rad"), "c": (0.05, "N m s/rad"),
        "K_p": (8.0, "N m/rad"), "K_d": (0.2, "N m s/rad"),
    }  # fmt: skip
    elements = {
        "servo": {"kind": "servo", "position_gain": "K_p", "speed_gain": "K_d", "drives": "rotor"},
        "rotor": {"kind": "rotor", "inertia": "J_1"},
        "shaft": spring("shaft", "rotor", "load"),
        "load": {"kind": "rotor", "inertia": "J_2"},
    }
    return built("served", parameters, elements, {"theta": "rotor position", "theta_l": "load position"})


def served_carriage() -> Rig:
    """A linear servo that pushes a carriage: its command is a place, 1 V is 1 m."""
    parameters = {"M": (2.0, "kg"), "K_p": (8000.0, "N/m"), "K_d": (200.0, "N s/m")}
    elements = {
        "drive": {"kind": "linear_servo", "position_gain": "K_p", "speed_gain": "K_d", "drives": "carriage"},
        "carriage": {"kind": "carriage", "mass": "M"},
    }
    return built("served_carriage", parameters, elements, {"x": "carriage position"})


def random_steps(samples: int, hold: int, size: float, seed: int = 1) -> Array:
    """Filtered random steps, each held for ``hold`` samples; (samples,) V."""
    steps = np.random.default_rng(seed).standard_normal(samples // hold + 1)
    return size * np.repeat(lfilter([0.3], [1.0, -0.7], steps), hold)[:samples]
