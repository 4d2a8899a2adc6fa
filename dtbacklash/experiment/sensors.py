"""The sensors of a run: their columns and units in traces, their errors, and which of them the controller reads."""

import numpy as np

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.config.run import RunConfig
from dtbacklash.control.chain import driven_chain
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig, Sensor

#: names that a sensor may not have: the columns of traces and recordings
RESERVED = ("t", "r", "u", "theta_d", "gap", "gap_hat", "eps", "novelty")


def column(sensor: Sensor) -> str:
    """The name of a sensor's column in traces and settings, e.g. ``q2_mm``."""
    return f"{sensor.name}_{units.suffix(units.shown(sensor.unit)[0])}"


def trace_factor(sensor: Sensor) -> float:
    """What turns a sensor's SI values into those of its column."""
    return units.shown(sensor.unit)[1]


def sensor_errors(config: RunConfig, sensors: list[Sensor], n: int) -> tuple[Floats, Floats]:
    """Noise (n, sensors) or (0, sensors), and resolutions (sensors,), in SI.

    Raises UserError: a column that the rig has not.
    """
    noise, resolution = np.zeros((0, len(sensors))), np.zeros(len(sensors))
    columns = {column(sensor): (j, trace_factor(sensor)) for j, sensor in enumerate(sensors)}
    for kind, sizes in (("noise", config.sensors.noise), ("resolution", config.sensors.resolution)):
        for name, size in sizes.items():
            if name not in columns:
                raise UserError(f"sensors.{kind}.{name}", size, f"no such column; known: {', '.join(columns)}")
            j, factor = columns[name]
            if kind == "resolution":
                resolution[j] = size / factor
            elif size > 0.0:
                if not len(noise):
                    noise = np.zeros((n, len(sensors)))
                # a stream of its own for each sensor: adding one does not change the others
                rng = np.random.default_rng([config.seed, j])
                noise[:, j] = rng.normal(0.0, size / factor, n)
    return noise, resolution


def roles(rig: Rig, closed: bool) -> tuple[int, int]:
    """Which sensors show the motor's angle and the position of the last mass (-1: none).

    Raises UserError: a closed loop lacks one of them; a sensor has a name that means something else.
    """
    bodies = [e.name for e in rig.elements.values() if e.kind in ("mass", "carriage")]
    end = driven_chain(rig)[0][-1].name if closed else (bodies or [""])[-1]
    rotor = rig.motor_rotor()
    motor, output = -1, -1
    for j, sensor in enumerate(rig.sensors.values()):
        if sensor.quantity == "position" and rotor is not None and sensor.of == rotor.name:
            motor = j
        elif sensor.quantity == "position" and sensor.of == end:
            output = j
    if closed and (motor < 0 or output < 0):
        allowed = f"a closed loop needs position sensors on the motor and on {end}"
        raise UserError("rig.sensors", ", ".join(rig.sensors), allowed)
    for j, name in enumerate(rig.sensors):
        if name in RESERVED or (name == "q3" and j != output) or (name == "theta_m" and j != motor):
            allowed = f"another name; kept for the traces: {', '.join(RESERVED)}, q3 ({end}) and theta_m (the motor)"
            raise UserError(f"rig.sensors.{name}", name, allowed)
    return motor, output
