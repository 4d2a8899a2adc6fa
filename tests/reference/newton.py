"""The equations of motion of a rig, force by force, in SI.

State: the winding's current, the position and velocity of every body that can move by itself, the hysteretic
variable of every link that has one, the winding's rise of resistance. A mass that a rigid screw carries is not a
body: it is where the screw is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

FREE, RIGID = 0, 2  # contact on the positive or negative side is +1 or -1
GROUND = "ground"
SCREW = "the screw's end"


#: (position, velocity, time) -> effort on a single body
Effort = Callable[[float, float, float], float]


@dataclass
class Link:
    """Everything that acts along the line between two ends; the stretch counts from ``a`` to ``b``."""

    a: str
    b: str
    stiffness: float = 0.0
    damping: float = 0.0
    cubic: float = 0.0
    quadratic: float = 0.0
    hysteresis: float = 0.0
    displacement: float = 1.0
    stop: float = 0.0
    clearance: float = 0.0
    drift: float = 0.0
    z: int = -1  # where its hysteretic variable stands in the state
    play: float = 0.0  # the stretch, side to side, over which the spring does not take hold
    arm: float = 1.0  # how far its end at a goes per unit of a's motion: a pulley's radius, 1/ratio of teeth
    name: str = ""


@dataclass
class Contact:
    """A dry friction between two ends: it sticks (0) or slips in a direction (-1, 1).

    losses : share of the effort that something passes on at end b, by its name.
    """

    a: str
    b: str
    coulomb: float
    stribeck: float = 0.0
    speed: float = 1.0
    mode: int = 0
    losses: dict[str, float] = field(default_factory=dict)

    def level(self, rate: float, passed: dict[str, float]) -> float:
        lost = sum(share * abs(passed[name]) for name, share in self.losses.items())
        return self.coulomb + self.stribeck * math.exp(-((rate / self.speed) ** 2)) + lost


@dataclass
class Body:
    """A body that moves by itself, and what acts on it alone."""

    inertia: float
    q: int
    v: int
    viscous: float = 0.0
    difference: float = 0.0
    levels: float = 0.0
    cogging: tuple[float, float, float] = (0.0, 0.0, 0.0)
    load: float = 0.0
    others: list[Effort] = field(default_factory=list)


@dataclass
class Screw:
    """The worm gear and the lead screw."""

    lead: float
    share: float = 0.0
    pitch: tuple[float, float, float] = (0.0, 0.0, 0.0)
    carried: str | None = None
    carried_mass: float = 0.0
    name: str = ""

    def travel(self, angle: float) -> float:
        amplitude, periods, phase = self.pitch
        return self.lead * angle + amplitude * (math.sin(periods * angle + phase) - math.sin(phase))

    def slope(self, angle: float) -> float:
        amplitude, periods, phase = self.pitch
        return self.lead + amplitude * periods * math.cos(periods * angle + phase)

    def curvature(self, angle: float) -> float:
        amplitude, periods, phase = self.pitch
        return -amplitude * periods**2 * math.sin(periods * angle + phase)


@dataclass
class Machine:
    """A rig ready to be integrated; ``gear``, the contacts' modes, ``held`` and the inputs change on the way."""

    bodies: dict[str, Body] = field(default_factory=dict)
    links: list[Link] = field(default_factory=list)
    contacts: list[Contact] = field(default_factory=list)
    screw: Screw | None = None
    rotor: str | None = None
    circuit: dict[str, float] | None = None
    ripple: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heating: tuple[float, float] | None = None
    driven: str = ""
    driving: str = ""
    gain: float = 0.0
    lag: float = 0.0  # time constant of the actuator behind its command; what has arrived is the last state
    servo: dict[str, float] | None = None
    size: int = 0
    amplifier: dict[str, dict[str, float]] = field(default_factory=dict)
    # what changes
    gear: int = FREE
    held: float = 0.0  # the screw's angle while the gear is free
    resting: int = 0  # the side on which a motor leans that cannot push the load on; the self-locking screw stands
    drive: float = 0.0
    gap: tuple[float, float, float] = (0.0, 0.0, 0.0)  # at time, half-gap, its rate

    def amplify(self, u: float) -> float:
        """What leaves the amplifier for a command."""
        u *= 1.0 + self.amplifier.get("gain_error", {}).get("relative", 0.0)
        width = self.amplifier.get("dead_zone", {}).get("half_width", 0.0)
        u = math.copysign(max(abs(u) - width, 0.0), u)
        limit = self.amplifier.get("saturation", {}).get("limit", math.inf)
        return max(-limit, min(limit, u))

    def half_gap(self, t: float) -> float:
        return self.gap[1] + self.gap[2] * (t - self.gap[0])

    def screw_angle(self, t: float, x: np.ndarray) -> tuple[float, float]:
        """theta_d and its rate."""
        if self.gear == FREE or self.rotor is None:
            return self.held, 0.0
        body = self.bodies[self.rotor]
        if self.gear == RIGID:
            return x[body.q], x[body.v]
        return x[body.q] - self.gear * self.half_gap(t), x[body.v] - self.gear * self.gap[2]

    def ends(self, t: float, x: list[float]) -> dict[str, tuple[float, float]]:
        """Position and velocity of everything that a link or a friction can be fastened to."""
        where = {name: (x[body.q], x[body.v]) for name, body in self.bodies.items()}
        where[GROUND] = (0.0, 0.0)
        if self.screw:
            angle, rate = self.screw_angle(t, x)
            where[SCREW] = self.screw.travel(angle), self.screw.slope(angle) * rate
            if self.screw.carried and not self._gives_way():
                where[self.screw.carried] = where[SCREW]
        return where

    def slip(self, t: float, x: list[float], contact: Contact) -> float:
        """Velocity of end b against end a."""
        where = self.ends(t, x)
        return where[contact.b][1] - where[contact.a][1]

    def rates(self, t: float, x: list[float], holding: list[float] | None = None) -> list[float]:
        """x' with given forces in the contacts that stick (without: those that keep them at rest)."""
        if holding is None:
            holding = self.holding(t, x)
        passed = self.passed_on(t, x)
        out = self._rates(t, x, holding, passed)
        screw = self.screw
        if not screw or not any(c.mode and screw.name in c.losses for c in self.contacts):
            return out
        # what the screw passes on depends on how the base speeds up, and that on the friction: repeated until it stays
        for _ in range(200):
            before, passed[screw.name] = passed[screw.name], self._push(t, x, out, holding, passed)
            if abs(passed[screw.name] - before) <= 1e-15 * abs(before):
                break
            out = self._rates(t, x, holding, passed)
        return out

    def passed_on(self, t: float, x: list[float]) -> dict[str, float]:
        """The effort that each drive and transmission passes on, at the body that it brakes; the screw at rest."""
        lossy = {name for contact in self.contacts for name in contact.losses}
        passed = {k.name: k.arm * self.force_in(k.name, t, x) for k in self.links if k.name in lossy}
        if self.driving in lossy:
            effort = dict.fromkeys(self.bodies, 0.0)
            self._drive(x, effort, [0.0] * self.size)
            passed[self.driving] = effort[self.driven]
        if self.screw and self.screw.name in lossy:
            passed[self.screw.name] = 0.0
            passed[self.screw.name] = self._push(t, x, [0.0] * self.size, [0.0] * len(self.contacts), passed)
        return passed

    def _push(self, t: float, x: list[float], out: list[float], holding: list[float], passed: dict) -> float:
        """Torque by which the screw pushes what it carries, which speeds up as the rates say, N m."""
        screw, body = self.screw, self.bodies[self.rotor]
        if self.gear == FREE:
            return 0.0
        angle, rate = self.screw_angle(t, x)
        slope = screw.slope(angle)
        effort = dict.fromkeys(self.ends(t, x), 0.0)
        self._connect(t, x, effort, [0.0] * self.size, holding, passed)
        force = -effort[SCREW]
        if screw.carried and not self._gives_way():
            force -= effort[screw.carried]
            force += screw.carried_mass * (slope * out[body.v] + screw.curvature(angle) * rate**2)
        return slope * force

    def _rates(self, t: float, x: list[float], holding: list[float], passed: dict[str, float]) -> list[float]:
        out = [0.0] * self.size
        effort = dict.fromkeys(self.ends(t, x), 0.0)
        self._connect(t, x, effort, out, holding, passed)
        for name, body in self.bodies.items():
            q, v = x[body.q], x[body.v]
            amplitude, wave, phase = body.cogging
            effort[name] += body.load - body.viscous * v - body.difference * abs(v) - body.levels
            effort[name] += amplitude * math.sin(wave * q + phase)
            for other in body.others:
                effort[name] += other(q, v, t)
        self._drive(x, effort, out)
        for name, body in self.bodies.items():
            out[body.q] = x[body.v]
            out[body.v] = effort[name] / body.inertia
        if self.screw and self.screw.share and self.gear != FREE:
            self._react(t, x, effort, out)
        if self.resting:
            out[self.bodies[self.rotor].v] = 0.0
        return out

    def _connect(
        self, t: float, x: list[float], effort: dict, out: list[float], holding: list[float], passed: dict
    ) -> None:
        """Efforts of the links and of the friction contacts at their ends."""
        where = self.ends(t, x)
        for link in self.links:
            force = self._link_force(link, t, x, where, out)
            effort[link.b] -= force
            effort[link.a] += link.arm * force
        for contact, hold in zip(self.contacts, holding, strict=True):
            force = hold
            if contact.mode:
                rate = where[contact.b][1] - where[contact.a][1]
                force = -contact.mode * contact.level(rate, passed)
            effort[contact.b] += force
            effort[contact.a] -= force

    def leaning(self, t: float, x: list[float], side: int) -> tuple[float, float]:
        """Acceleration of the motor towards ``side`` without the screw, and with it."""
        before, found = (self.gear, self.resting), []
        self.resting = 0
        for self.gear in (FREE, side):
            found.append(side * self.rates(t, x)[self.bodies[self.rotor].v])
        self.gear, self.resting = before
        return found[0], found[1]

    def _link_force(self, link: Link, t: float, x: list[float], where: dict, out: list[float]) -> float:
        (qa, va), (qb, vb) = where[link.a], where[link.b]
        s, rate = qb - link.arm * qa, vb - link.arm * va
        s = math.copysign(max(abs(s) - 0.5 * link.play, 0.0), s)
        force = link.stiffness * (1.0 + link.drift * t) * s + link.damping * rate
        force += link.cubic * s**3 + link.quadratic * abs(rate) * rate
        if s > link.clearance:
            force += link.stop * (s - link.clearance)
        if link.z >= 0:
            z = x[link.z]
            force += link.hysteresis * z
            out[link.z] = (rate - 0.5 * abs(rate) * z - 0.5 * rate * abs(z)) / link.displacement
        return force

    def force_in(self, name: str, t: float, x: list[float]) -> float:
        """The force of one link, by its name."""
        link = next(k for k in self.links if k.name == name)
        return self._link_force(link, t, x, self.ends(t, x), [0.0] * self.size)

    def _drive(self, x: list[float], effort: dict[str, float], out: list[float]) -> None:
        """The motor's torque, or the actuator's force."""
        if self.servo:
            effort[self.driven] += self._loop(x[self.bodies[self.driven].q], x[self.bodies[self.driven].v])
            return
        if self.circuit is None:
            arrived = self.drive
            if self.lag:
                arrived = x[self.size - 1]
                out[self.size - 1] = (self.drive - arrived) / self.lag
            if self.driven:
                effort[self.driven] += self.gain * arrived
            return
        body, i = self.bodies[self.driven], x[0]
        resistance = self.circuit["resistance"]
        if self.heating:
            gain, time_constant = self.heating
            rise = x[self.size - 1]
            out[self.size - 1] = (gain * resistance * i * i - rise) / time_constant
            resistance *= 1.0 + rise
        out[0] = (self.drive - resistance * i - self.circuit["emf_constant"] * x[body.v]) / self.circuit["inductance"]
        relative, periods, phase = self.ripple
        effort[self.driven] += (
            self.circuit["torque_constant"] * i * (1.0 + relative * math.sin(periods * x[body.q] + phase))
        )

    def _loop(self, q: float, v: float) -> float:
        """A position loop asks for a speed, a speed loop for an effort; each up to its limit."""
        hold, brake = self.servo["position_gain"], self.servo.get("speed_gain", 0.0)
        if not brake:
            effort = hold * (self.drive - q)
        else:
            asked = hold / brake * (self.drive - q)
            asked = math.copysign(min(abs(asked), self.servo.get("speed", math.inf)), asked)
            effort = brake * (asked - v)
        return math.copysign(min(abs(effort), self.servo.get("effort", math.inf)), effort)

    def _react(self, t: float, x: list[float], effort: dict[str, float], out: list[float]) -> None:
        """The rotor carries what hangs on the screw: J w' = T - share d'(theta) (M x1'' - forces on the screw)."""
        screw, body = self.screw, self.bodies[self.rotor]
        angle, rate = self.screw_angle(t, x)
        slope = screw.slope(angle)
        on_screw = effort[SCREW] + (effort[screw.carried] if screw.carried and not self._gives_way() else 0.0)
        moving = 0.0 if self._gives_way() else screw.carried_mass
        torque = effort[self.rotor] + screw.share * slope * (on_screw - moving * screw.curvature(angle) * rate**2)
        out[body.v] = torque / (body.inertia + screw.share * slope**2 * moving)

    def _gives_way(self) -> bool:
        return self.screw.carried in self.bodies

    def most_held(self, t: float, x: list[float], contact: Contact) -> float:
        """The force that a contact can hold at rest, N or N m."""
        return contact.level(0.0, self.passed_on(t, x))

    def holding(self, t: float, x: list[float]) -> list[float]:
        """The forces (on end b) that leave the contacts that stick without acceleration; 0 where it slips."""
        stuck = [j for j, c in enumerate(self.contacts) if c.mode == 0]
        forces = [0.0] * len(self.contacts)
        if not stuck:
            return forces
        free = self.slip_accelerations(t, x, forces)
        response = np.zeros((len(stuck), len(stuck)))
        for column, j in enumerate(stuck):
            unit = [0.0] * len(self.contacts)
            unit[j] = 1.0
            one = self.slip_accelerations(t, x, unit)
            response[:, column] = [one[k] - free[k] for k in stuck]
        found = np.linalg.solve(response, [-free[k] for k in stuck])
        for j, force in zip(stuck, found, strict=True):
            forces[j] = float(force)
        return forces

    def slip_accelerations(self, t: float, x: list[float], holding: list[float]) -> list[float]:
        """Acceleration of b against a for every contact."""
        out = self.rates(t, x, holding)
        acceleration = {name: out[body.v] for name, body in self.bodies.items()}
        acceleration[GROUND] = 0.0
        if self.screw and self.screw.carried and not self._gives_way():
            angle, rate = self.screw_angle(t, x)
            turning = out[self.bodies[self.rotor].v] if self.gear != FREE else 0.0
            carried = self.screw.slope(angle) * turning + self.screw.curvature(angle) * rate**2
            acceleration[self.screw.carried] = carried
        return [acceleration[c.b] - acceleration[c.a] for c in self.contacts]

    def energy(self, x: list[float], t: float = 0.0) -> float:
        """Kinetic energy, and that of the linear springs, J."""
        where = self.ends(t, x)
        total = sum(0.5 * body.inertia * x[body.v] ** 2 for body in self.bodies.values())
        return total + sum(0.5 * k.stiffness * (where[k.b][0] - k.arm * where[k.a][0]) ** 2 for k in self.links)
