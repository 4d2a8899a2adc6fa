"""The concealing simulator: from a rig's description to the arrays of its inner loop."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from dtbacklash.arrays import Floats, Ints
from dtbacklash.physics.element_kinds import ROTARY
from dtbacklash.physics.rig import SENSOR_PREFIX, Element, Rig
from dtbacklash.prove.simulator.given import Errors, Unlisted
from dtbacklash.prove.simulator.library import lib as col

#: damping of a compliant screw against the mass that it carries
SCREW_DAMPING_RATIO = 0.02
#: least number of steps per sample; more where the rig is faster than STEP_RATE per step
STEPS_MIN, STEP_RATE = 50, 0.25
#: a lag of the drive that needs more steps per sample is too short to show, and is left out
STEPS_LAG = 1000
#: the same where the nominal model has dry friction, or a friction grows with its load: no bristle may show as a spring
STEPS_BRAKE = 200
#: (frequency, damping ratio) of a bristle at rest with what it holds, frequency per step: the first body's, others'
BRISTLE_ROTOR, BRISTLE_MASS = (0.3, 0.7), (0.1, 0.2)


class Machine(NamedTuple):
    """A rig with ``nb`` bodies, of which the first is the motor's rotor.

    inertia (nb,), body (nb, N_BODY), link (nl, N_LINK), link_ends (nl, 2), friction (nf, N_FRICTION), friction_ends
    (nf, 2), drive (N_DRIVE,), sensor (ns, N_SENSOR), unknown (nu, N_UNKNOWN). The state is
    [current, screw's angle, positions (nb), velocities (nb)].
    """

    sample_time: float
    substeps: int
    inertia: Floats
    body: Floats
    link: Floats
    link_ends: Ints
    friction: Floats
    friction_ends: Ints
    drive: Floats
    sensor: Floats
    unknown: Floats


@dataclass
class _Net:
    """The bodies and what connects them, while they are collected."""

    names: list[str]
    inertia: list[float]
    base: str | None
    link: list[list[float]] = field(default_factory=list)
    link_ends: list[tuple[int, int]] = field(default_factory=list)
    friction: list[list[float]] = field(default_factory=list)
    friction_ends: list[tuple[int, int]] = field(default_factory=list)

    def end(self, name: str) -> int:
        if name == "ground":
            return col.GROUND
        return col.BASE if name == self.base else self.names.index(name)

    def join(self, a: int, b: int, k: float, c: float, lever: float = 1.0) -> list[float]:
        """Add a spring and a damper from a to b; returns their row, to which effects are added."""
        row = [0.0] * col.N_LINK
        row[col.L_K], row[col.L_C], row[col.L_LEVER] = k, c, lever
        self.link.append(row)
        self.link_ends.append((a, b))
        return row

    def reduced(self, a: int, b: int, lever: float = 1.0) -> float:
        """The reduced mass of two ends; ground and base do not move."""
        free = [arm**2 / self.inertia[end] for end, arm in ((a, lever), (b, 1.0)) if end >= 0]
        return 1.0 / sum(free)


def driven_body(rig: Rig) -> str | None:
    """The body that the motor or actuator drives; None where a positioner moves the rig."""
    drive = rig.drive
    return drive.neighbours["drives"] if drive else None


def carried_mass(rig: Rig) -> str | None:
    """The mass that the screw carries; None without a screw, or one that carries nothing."""
    screw = rig.only("screw")
    return screw.neighbours.get("carries") if screw else None


def machine(rig: Rig, sample_time_s: float, errors: Errors, *unknown: Unlisted) -> Machine:
    """The arrays of a rig for one sampling time."""
    net = _bodies(rig)
    links = _links(rig, net)
    drive = _drive(rig, net)
    if drive[col.D_LAG] * STEP_RATE * STEPS_LAG < sample_time_s:
        drive[col.D_LAG] = 0.0
    rubs = any("friction" in e.values for e in rig.bodies()) or any(_loss(rig, e) for e in rig.elements.values())
    least = STEPS_BRAKE if rubs else STEPS_MIN
    substeps = max(least, _substeps(net, drive, sample_time_s))
    _frictions(rig, net, substeps / sample_time_s)
    _creep(net, unknown)
    body = np.array([_body_row(rig, name) for name in net.names])
    return Machine(
        sample_time=sample_time_s, substeps=substeps, inertia=np.array(net.inertia), body=body,
        link=np.array(net.link).reshape(-1, col.N_LINK), link_ends=_ends(net.link_ends),
        friction=np.array(net.friction).reshape(-1, col.N_FRICTION), friction_ends=_ends(net.friction_ends),
        drive=drive, sensor=_sensors(rig, net, links, errors),
        unknown=np.array([_unknown(one, rig, net, links) for one in unknown]).reshape(-1, col.N_UNKNOWN),
    )  # fmt: skip


def _ends(pairs: list[tuple[int, int]]) -> Ints:
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _bodies(rig: Rig) -> _Net:
    """The bodies that move by themselves: first the motor's rotor or the driven one; hidden ones last."""
    gives_way, positioner = _of_screw(rig, "compliance"), rig.only("positioner")
    carried = carried_mass(rig)
    base = positioner.name if positioner else None if gives_way else carried
    moving = [e for e in rig.bodies() if e.name != base]
    motor = rig.motor_rotor()
    first = motor.name if motor else driven_body(rig)
    moving.sort(key=lambda e: e.name != first)
    net = _Net([e.name for e in moving], [e.values[e.trait.inertia] for e in moving], base)
    if gives_way and carried:
        k, m = 1.0 / gives_way["compliance"], rig.elements[carried].values["mass"]
        net.join(col.BASE, net.end(carried), k, 2.0 * SCREW_DAMPING_RATIO * math.sqrt(k * m))
    for element in rig.bodies():
        k, c = element.values.get("ground_stiffness", 0.0), element.values.get("ground_damping", 0.0)
        if k or c:
            net.join(col.GROUND, net.end(element.name), k, c)
        if absorber := rig.effect(element.name, "absorber"):
            net.names.append(f"absorber of {element.name}")
            net.inertia.append(absorber["mass"])
            omega = 2.0 * math.pi * absorber["frequency"]
            c = 2.0 * absorber["damping_ratio"] * omega * absorber["mass"]
            net.join(net.end(element.name), len(net.names) - 1, omega**2 * absorber["mass"], c)
    return net


def body_names(rig: Rig) -> list[str]:
    """The bodies that move by themselves, in the order of the state."""
    return _bodies(rig).names


def _of_screw(rig: Rig, effect: str) -> dict[str, float] | None:
    screw = rig.only("screw")
    return rig.effect(screw.name, effect) if screw else None


def _loss(rig: Rig, element: Element | None) -> float:
    """Share of the effort that an element passes on which its friction takes."""
    return ((rig.effect(element.name, "load_friction") if element else None) or {}).get("share", 0.0)


def _effort_of(effect: dict[str, float]) -> float:
    """The effort of an effect: N where it slides, N m where it turns."""
    return effect.get("force", effect.get("torque", 0.0))


def _links(rig: Rig, net: _Net) -> dict[str, int]:
    """Add the links with their effects; returns where each is."""
    where = {}
    columns = {
        "cubic_stiffness": ((col.L_CUBIC, "k3"),),
        "quadratic_damping": ((col.L_QUADRATIC, "c2"),),
        "hysteresis": ((col.L_YIELD, "displacement"),),
        "bumper": ((col.L_STOP, "stiffness"), (col.L_CLEARANCE, "clearance")),
        "stiffness_drift": ((col.L_DRIFT, "rate"),),
        "backlash": ((col.L_LOST, "lost_motion"),),
    }
    for element in rig.links():
        a, b = (net.end(name) for name in element.neighbours["between"])
        where[element.name] = len(net.link)
        v = element.values
        lever = v["radius"] if "radius" in v else 1.0 / v.get("ratio", 1.0)
        row = net.join(a, b, v["stiffness"], v.get("damping", 0.0), lever)
        for name, entries in columns.items():
            if effect := rig.effect(element.name, name):
                for column, parameter in entries:
                    row[column] = effect[parameter]
        row[col.L_FORCE] = _effort_of(rig.effect(element.name, "hysteresis") or {})
        row[col.L_LOSS] = _loss(rig, element)
    return where


def _substeps(net: _Net, drive: Floats, sample_time_s: float) -> int:
    """The steps per sample that the fastest pole needs: the motor's, or a bound of the structure's."""
    fastest = 0.0
    if drive[col.D_L] > 0.0:
        driven = int(drive[col.D_BODY])
        circuit = np.array([
            [-drive[col.D_R] / drive[col.D_L], -drive[col.D_KB] / drive[col.D_L]],
            [drive[col.D_KT] / net.inertia[driven], 0.0],
        ])  # fmt: skip
        fastest = float(np.abs(np.linalg.eigvals(circuit)).max())
    if drive[col.D_LAG] > 0.0:
        fastest = 1.0 / drive[col.D_LAG]
    if drive[col.D_HOLD] > 0.0:
        held = net.inertia[int(drive[col.D_BODY])]
        fastest = max(2.0 * math.sqrt(drive[col.D_HOLD] / held), 2.0 * drive[col.D_BRAKE] / held)
    for (a, b), row in zip(net.link_ends, net.link, strict=True):
        if max(a, b) >= 0:
            m = net.reduced(a, b, row[col.L_LEVER])
            fastest = max(fastest, 2.0 * math.sqrt(row[col.L_K] / m), 2.0 * row[col.L_C] / m)
    return math.ceil(fastest * sample_time_s / STEP_RATE)


def _frictions(rig: Rig, net: _Net, step_rate: float) -> None:
    """Add the bristles: of bearings against the ground, and across links."""
    for element in rig.elements.values():
        coulomb = rig.effect(element.name, "coulomb_friction") or rig.effect(element.name, "ground_friction") or {}
        stribeck = rig.effect(element.name, "stribeck_friction") or {}
        level = _effort_of(coulomb) + element.values.get("friction", 0.0)
        loaded = _loses(rig, element)
        if element.name in net.names and (level or stribeck or loaded):
            levels = level, _effort_of(stribeck)
            _bristle(net, col.GROUND, net.end(element.name), levels, stribeck.get("speed", 1.0), step_rate, loaded)
        if dry := rig.effect(element.name, "dry_friction"):
            a, b = (net.end(name) for name in element.neighbours["between"])
            _bristle(net, a, b, (_effort_of(dry), 0.0), 1.0, step_rate)


def _loses(rig: Rig, body: Element) -> bool:
    """Whether something at a body passes on an effort with friction: its drive, the screw or a spring behind it."""
    behind = [e for e in rig.links() if e.neighbours["between"][0] == body.name]
    behind += [e for e in (rig.drive, rig.only("screw")) if e and body.name == driven_body(rig)]
    return any(_loss(rig, element) for element in behind)


def _bristle(
    net: _Net, a: int, b: int, levels: tuple[float, float], speed: float, step_rate: float, loaded: bool = False
) -> None:
    m = net.reduced(a, b)
    per_step, ratio = BRISTLE_ROTOR if b == 0 else BRISTLE_MASS
    omega = per_step * step_rate
    net.friction.append([*levels, speed, m * omega**2, 2.0 * ratio * omega * m, float(loaded)])
    net.friction_ends.append((a, b))


def _creep(net: _Net, unknown: tuple[Unlisted, ...]) -> None:
    """Add the bristles of what creeps before it slides: so soft that they give way by a part of the motion."""
    for one in unknown:
        if one.name == "creep":
            net.friction.append([one.size, 0.0, 1.0, one.size / one.scale, 0.0, 0.0])
            net.friction_ends.append((col.GROUND, net.end(one.location)))


def _body_row(rig: Rig, name: str) -> Floats:
    row, there = np.zeros(col.N_BODY), rig.effects.get(name, {})
    row[col.B_VISCOUS] = there.get("viscous_friction", {}).get("coefficient", 0.0)
    directed = there.get("asymmetric_friction", {})
    row[col.B_DIFFERENCE] = directed.get("viscous_difference", 0.0)
    row[col.B_LEVELS] = directed.get("coulomb_difference", 0.0)
    if cogging := there.get("cogging"):
        turns = rig.elements[name].trait.axis == ROTARY
        wave = cogging["periods" if turns else "wave_number"]
        row[col.B_COGGING : col.B_LOAD] = [_effort_of(cogging), wave, cogging["phase"]]
    if weight := there.get("gravity"):
        row[[col.B_WEIGHT, col.B_ANGLE]] = [weight["torque"], weight["phase"]]
    row[col.B_LOAD] = _effort_of(there.get("constant_load", {}))
    row[col.B_LOAD] += _effort_of(there.get("constant_force", {}))
    return row


def _drive(rig: Rig, net: _Net) -> Floats:
    """The row of amplifier, motor or actuator or positioner, gear and screw."""
    row = np.zeros(col.N_DRIVE)
    driven, positioner, actuator = driven_body(rig), rig.only("positioner"), rig.only("actuator")
    row[col.D_BODY] = net.names.index(driven) if driven else -1
    row[col.D_TRAVEL] = positioner.values["travel"] if positioner else 0.0
    row[col.D_EFFORT] = actuator.values["gain"] if actuator else 0.0
    if actuator:
        row[col.D_LAG] = (rig.effect(actuator.name, "lag") or {}).get("time", 0.0)
    if servo := rig.servo:
        row[[col.D_HOLD, col.D_BRAKE]] = servo.values["position_gain"], servo.values.get("speed_gain", 0.0)
        row[col.D_FAST] = (rig.effect(servo.name, "speed_limit") or {}).get("speed", math.inf)
        row[col.D_STRONG] = (rig.effect(servo.name, "effort_limit") or {}).get("effort", math.inf)
    if circuit := rig.only("motor_circuit"):
        _wind(rig, circuit, row)
    gear, screw, amplifier = rig.only("gear"), rig.only("screw"), rig.only("amplifier")
    row[col.D_LEAD] = screw.values["lead"] if screw else 0.0
    row[[col.D_LOSS, col.D_SCREW_LOSS]] = _loss(rig, rig.drive), _loss(rig, screw)
    row[col.D_SHARE] = (_of_screw(rig, "load_reaction") or {}).get("share", 0.0)
    row[col.D_BASE_MASS] = rig.elements[net.base].values["mass"] if net.base and not positioner else 0.0
    if pitch := _of_screw(rig, "pitch_error"):
        row[[col.D_PITCH, col.D_WAVE, col.D_SHIFT]] = [pitch[n] for n in ("amplitude", "periods", "phase")]
    row[col.D_GAP] = ((rig.effect(gear.name, "backlash") if gear else None) or {}).get("half_gap", 0.0)
    there = rig.effects.get(amplifier.name, {}) if amplifier else {}
    row[col.D_GAIN] = 1.0 + there.get("gain_error", {}).get("relative", 0.0)
    row[col.D_DEAD] = there.get("dead_zone", {}).get("half_width", 0.0)
    row[col.D_LIMIT] = there.get("saturation", {}).get("limit", math.inf)
    row[col.D_DELAY] = there.get("delay", {}).get("time", 0.0)
    return row


def _wind(rig: Rig, circuit: Element, row: Floats) -> None:
    """A motor's winding with its effects."""
    v = circuit.values
    row[[col.D_R, col.D_L]] = v["resistance"], v["inductance"]
    row[[col.D_KT, col.D_KB]] = v["torque_constant"], v["emf_constant"]
    if ripple := rig.effect(circuit.name, "torque_ripple"):
        row[[col.D_RIPPLE, col.D_PERIODS, col.D_PHASE]] = [ripple[n] for n in ("relative", "periods", "phase")]
    heat = rig.effect(circuit.name, "resistance_heating") or {}
    row[[col.D_HEAT, col.D_TAU]] = heat.get("gain", 0.0), heat.get("time_constant", 1.0)


def _sensors(rig: Rig, net: _Net, links: dict[str, int], errors: Errors) -> Floats:
    rows = np.zeros((len(rig.sensors), col.N_SENSOR))
    for row, (name, sensor) in zip(rows, rig.sensors.items(), strict=True):
        if sensor.quantity == "current":
            row[col.Y_INDEX] = 0
        elif sensor.quantity in ("force", "torque"):
            row[col.Y_INDEX], row[col.Y_PLACE] = col.LINK_FORCE, links[sensor.of]
        elif sensor.quantity == "acceleration":
            row[col.Y_INDEX], row[col.Y_PLACE] = col.ACCELERATION, net.names.index(sensor.of)
        elif sensor.of == net.base:
            row[col.Y_INDEX] = col.BASE_POSITION if sensor.quantity == "position" else col.BASE_VELOCITY
        else:
            first = 2 if sensor.quantity == "position" else 2 + len(net.names)
            row[col.Y_INDEX] = first + net.names.index(sensor.of)
        there = rig.effects.get(SENSOR_PREFIX + name, {})
        row[col.Y_GAIN] = 1.0 + there.get("gain_error", {}).get("relative", 0.0)
        row[col.Y_OFFSET] = there.get("offset", {}).get("offset", 0.0)
        off_centre = there.get("eccentricity", {})
        row[col.Y_OFF_CENTRE], row[col.Y_PHASE] = off_centre.get("amplitude", 0.0), off_centre.get("phase", 0.0)
        row[col.Y_DELAY] = there.get("delay", {}).get("time", 0.0)
        row[col.Y_NOISE], row[col.Y_COUNT] = errors.noise.get(name, 0.0), errors.resolution.get(name, 0.0)
    return rows


def _unknown(unknown: Unlisted, rig: Rig, net: _Net, links: dict[str, int]) -> list[float]:
    """The row of a law that the catalogue does not have; its place is a link, a body, a sensor, or -1."""
    places = {SENSOR_PREFIX + name: j for j, name in enumerate(rig.sensors)}
    places |= {name: j for j, name in enumerate(net.names)} | links
    row = [float(getattr(col, unknown.name.upper())), places.get(unknown.location, -1.0), unknown.size, unknown.scale]
    return [*row, unknown.wave, unknown.phase, unknown.second, unknown.shift]
