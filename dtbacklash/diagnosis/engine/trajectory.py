"""How the bodies of a rig move along a pass of its predictor, and the forces that act on them meanwhile."""

from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.simulator import Linear
from dtbacklash.physics.effects import slots
from dtbacklash.physics.element_kinds import AXES
from dtbacklash.physics.rig import Element, Rig

#: of a speed's power, what lies within the band of the motion (share); above it is noise that a predictor lets through
BAND = 0.99
#: the least force of a body, as its inertia takes its part of the largest (share)
LEAST = 1e-3


class Trajectory:
    """Positions, speeds and commands of (N,) samples of a rig.

    X : (N, n) states of the linear part. command : (N,) in the unit of the rig's drive. commands : of the actuators of
    a simulator's model. loads : gives (N, bodies) what these exert on each joint, N or N m; None for other rigs.
    """

    def __init__(
        self, rig: Rig, linear: Linear, X: Floats, command: Floats, step_s: float,
        commands: Mapping[str, Floats] | None = None, loads: Callable[[], Floats] | None = None,
    ) -> None:  # fmt: skip
        self.rig, self.linear, self.command, self.step_s = rig, linear, command, step_s
        n, v = len(linear.bodies), linear.speed
        self.position = dict(zip(linear.bodies, X[:, v - n : v].T, strict=True))
        self.speed = dict(zip(linear.bodies, X[:, v : v + n].T, strict=True))
        self.current = X[:, 0] if linear.states[0] == "current" else None
        self.commands, self._loads = commands or {}, loads
        screw, positioner, rotor = rig.only("screw"), rig.only("positioner"), rig.motor_rotor()
        self._lead = screw.values["lead"] if screw else positioner.values["travel"] if positioner else 0.0
        self._base = screw.neighbours.get("carries") if screw else positioner.name if positioner else None
        self._driver = self.position.get(rotor.name) if rotor else None, self.speed.get(rotor.name) if rotor else None
        if positioner:
            self._driver = command, np.gradient(command, step_s)

    @cached_property
    def loads(self) -> dict[str, Floats]:
        """Joint of a simulator's model -> (N,) what actuators exert on it, N or N m; empty for other rigs."""
        return dict(zip(self.linear.bodies, self._loads().T, strict=True)) if self._loads else {}

    def driving(self, drive: Element) -> Floats | None:
        """(N,) the effort of a drive on the body that it drives, N or N m; None where it is not known."""
        v, body = drive.values, drive.neighbours["drives"]
        if drive.trait.trait == slots.JOINT_DRIVE:
            return self.loads.get(body)
        if "torque_constant" in v:
            return np.asarray(v["torque_constant"] * self.current) if self.current is not None else None
        if "position_gain" in v:
            speed = v.get("speed_gain", 0.0) * self.speed[body]
            return np.asarray(v["position_gain"] * (self.command - self.position[body]) - speed)
        return np.asarray(v["gain"] * self.command) if "gain" in v else None

    def stretch(self, spring: Element) -> tuple[Floats, Floats]:
        """(N,) stretch of a spring, m or rad, and its rate."""
        a, b = spring.neighbours["between"]
        found = [self._end(b, rate) - spring.lever * self._end(a, rate) for rate in (False, True)]
        return found[0], found[1]

    def _end(self, name: str, rate: bool) -> Floats:
        of = self.speed if rate else self.position
        if name in of:
            return np.asarray(of[name])
        driver = self._driver[rate]
        if name != self._base or driver is None:
            return np.zeros(len(self.command))
        return np.asarray(self._lead * driver)

    @cached_property
    def acting(self) -> dict[str, float]:
        """Body -> the largest of the forces that act on it along the motion, rms, N or N m.

        Its inertia times its acceleration; each spring with its damper, about its mean, as zeros of sensors are
        arbitrary; the effort of its drive; the friction that the rig knows. The unknown force is a share of this.
        """
        found = self._net()
        for name in found:
            for force in self._forces(name):
                if np.isfinite(force):
                    found[name] = max(found[name], float(force))
        least = LEAST * max(found.values()) / float(self.linear.inertia.max())
        inertia = dict(zip(self.linear.bodies, self.linear.inertia.tolist(), strict=True))
        return {name: max(force, least * inertia[name]) + 1e-300 for name, force in found.items()}

    def _net(self) -> dict[str, float]:
        """Body -> inertia times rms acceleration, as a motion of its speed's spread and mean frequency has."""
        speed = np.column_stack([v - v.mean() for v in self.speed.values()])
        power = np.abs(np.fft.rfft(speed * np.hanning(len(speed))[:, None], axis=0)) ** 2
        band = np.arange(len(power))[:, None] / (len(speed) * self.step_s)
        total = np.cumsum(power, axis=0)
        inside = total <= BAND * np.maximum(total[-1], 1e-300)
        mean = np.sqrt((power * inside * band**2).sum(axis=0) / np.maximum((power * inside).sum(axis=0), 1e-300))
        force = self.linear.inertia * 2.0 * np.pi * mean * speed.std(axis=0)
        return dict(zip(self.linear.bodies, force.tolist(), strict=True))

    def _forces(self, name: str) -> list[float]:
        """Rms of what springs, drives and known friction exert on a body, N or N m."""
        rig, q, v = self.rig, self.position[name], self.speed[name]
        found = [float(np.sqrt(np.mean(self.loads[name] ** 2)))] if name in self.loads else []
        for spring in rig.links():
            a, b = spring.neighbours["between"]
            if name in (a, b):
                stretch, rate = self.stretch(spring)
                force = spring.values["stiffness"] * stretch + spring.values.get("damping", 0.0) * rate
                found.append((spring.lever if name == a else 1.0) * float(np.std(force)))
        element = rig.elements.get(name)
        if element is None:
            return found
        ground = element.values.get("ground_stiffness", 0.0) * q + element.values.get("ground_damping", 0.0) * v
        found.append(float(np.std(ground)))
        drive = rig.drive
        if drive is not None and drive.neighbours.get("drives") == name and not self.loads:
            effort = self.driving(drive)
            found += [] if effort is None else [float(np.sqrt(np.mean(effort**2)))]
        viscous = rig.amount(name, slots.BodyDamping, "coefficient") * float(np.sqrt(np.mean(v**2)))
        unit = AXES[element.trait.axis][2]
        dry = [values[e.size.name] for e, values in rig.active(name, slots.Contact) if e.size.unit == unit]
        return [*found, viscous + element.values.get("friction", 0.0) + sum(dry)]
