"""From a checked rig to the arrays of the compiled simulation."""

import math
from dataclasses import dataclass

import numpy as np

from dtbacklash.errors import UserError
from dtbacklash.physics import plant as pl
from dtbacklash.physics.elements import GROUND, SLIDING_KINDS
from dtbacklash.physics.exponential import discretise
from dtbacklash.physics.plant import Floats, Ints, Plant
from dtbacklash.physics.rig import SENSOR_PREFIX, Element, Rig

#: damping ratio of the axial spring of a screw that gives way, with the mass that it carries
SCREW_DAMPING_RATIO = 0.02

#: steps a sample where forces act beside the linear plant: errs by less than 1e-4 mm on every effect (tests)
SUBSTEPS_FORCED = 8


@dataclass
class _Bodies:
    """The bodies that have a state of their own: names, inertias, and stiffness and damping between them."""

    names: list[str]
    inertia: Floats
    K: Floats
    C: Floats
    base_k: Floats  # force on each body per metre of the base
    base_c: Floats
    at_base: float  # stiffness that the base feels,
    at_base_c: float  # and damping

    def end(self, name: str, base: str | None) -> int:
        """Index of a body, or BASE or GROUND."""
        if name == GROUND:
            return pl.GROUND
        return pl.BASE if name == base else self.names.index(name)

    def connect(self, a: int, b: int, k: float, c: float) -> None:
        """Put a spring and a damper between two ends."""
        for one, other in ((a, b), (b, a)):
            if one >= 0:
                self.K[one, one] += k
                self.C[one, one] += c
                if other >= 0:
                    self.K[one, other] -= k
                    self.C[one, other] -= c
                elif other == pl.BASE:
                    self.base_k[one] += k
                    self.base_c[one] += c
            elif one == pl.BASE:
                self.at_base += k
                self.at_base_c += c


@dataclass
class _Parts:
    """The rig taken apart into what the arrays need."""

    rig: Rig
    bodies: _Bodies
    base: str | None  # name of the mass that moves with a rigid screw
    imposed: bool
    link: list[list[float]]
    link_ends: list[tuple[int, int]]
    aux_of_link: list[int]
    friction: list[list[float]]
    friction_ends: list[tuple[int, int]]


def compile_plant(
    rig: Rig, sample_time_s: float, substeps: int = 0, event_levels: int = 16, imposed: bool = False
) -> Plant:
    """Compile a rig for the simulation.

    Parameters
    ----------
    rig : a checked rig.
    sample_time_s : sampling time, s.
    substeps : steps a sample; 0 chooses 1 where the linear solution is exact, else SUBSTEPS_FORCED.
    event_levels : a contact is located to ``sample_time_s / substeps / 2**event_levels``.
    imposed : drive the gear with a given motor angle instead of the simulated motor. A positioner always imposes.

    Source: exponential time differencing of second order with a ramp (Cox & Matthews, J. Comput. Phys. 176
    (2002) 430), exact for the linear part and for inputs that are constant or linear in a step.
    """
    imposed = imposed or rig.only("positioner") is not None
    parts = _take_apart(rig, imposed)
    n_aux = sum(1 for j in parts.aux_of_link if j >= 0)
    circuit = None if imposed else rig.only("motor_circuit")
    heat = rig.effect(circuit.name, "resistance_heating") if circuit else None
    first_aux = (1 if circuit else 0) + 2 * len(parts.bodies.names)
    aux_of_link = [first_aux + j if j >= 0 else -1 for j in parts.aux_of_link]
    heat_index = first_aux + n_aux if heat else -1
    body = _body_rows(parts)
    link = np.array(parts.link, dtype=float).reshape(-1, pl.N_LINK)
    circuit_row = _circuit_row(rig, circuit)
    screw = _screw_row(parts)
    forced = bool(body.any() or link[:, pl.L_BESIDE :].any() or parts.friction or heat or circuit_row[pl.C_RIPPLE])
    forced = forced or bool(screw[pl.S_AMPLITUDE])
    substeps = substeps or (SUBSTEPS_FORCED if forced else 1)
    A, G = _continuous(parts, circuit, n_aux + (1 if heat else 0), heat, screw)
    E, P1, P2 = discretise(A, G, sample_time_s / substeps, event_levels + 1)
    delay = _delay(rig, sample_time_s, substeps << event_levels)
    looks = _sensor_delays(rig, sample_time_s, substeps << event_levels)
    return Plant(
        E=E, P1=P1, P2=P2, A=A, G=G, body=body, link=link,
        link_ends=np.array(parts.link_ends, dtype=np.int64).reshape(-1, 2),
        friction=np.array(parts.friction, dtype=float).reshape(-1, pl.N_FRICTION),
        friction_ends=np.array(parts.friction_ends, dtype=np.int64).reshape(-1, 2),
        circuit=circuit_row, amplifier=_amplifier_row(rig), screw=screw,
        sensor=_sensor_rows(parts, circuit), sensor_whole=looks[0], sensor_tick=looks[1],
        aux_of_link=np.array(aux_of_link, dtype=np.int64),
        sample_time=sample_time_s, substeps=substeps, levels=event_levels + 1,
        current=0 if circuit else -1,
        rotor=-1 if imposed or rig.only("rotor") is None else 0,
        n_bodies=len(parts.bodies.names), position=1 if circuit else 0,
        heat=heat_index, has_base=_base_drive(rig) is not None, imposed=imposed, forced=forced,
        delay_whole=delay[0], delay_ticks=delay[1],
    )  # fmt: skip


def _base_drive(rig: Rig) -> Element | None:
    """What moves the base, whatever else happens: a screw or a positioner."""
    return rig.only("screw") or rig.only("positioner")


def state_names(rig: Rig, imposed: bool = False) -> list[str]:
    """The bodies in the order in which the state holds them (positions, then velocities)."""
    return _take_apart(rig, imposed).bodies.names


def _take_apart(rig: Rig, imposed: bool) -> _Parts:
    rotor, screw = rig.only("rotor"), rig.only("screw")
    compliance = rig.effect(screw.name, "compliance") if screw else None
    carried = screw.neighbours.get("carries") if screw else None
    base = _base(rig)
    inertia: dict[str, float] = {}
    if rotor and not imposed:
        inertia[rotor.name] = rotor.values["inertia"]
    masses = [e for kind in SLIDING_KINDS for e in rig.of_kind(kind)]
    order = list(rig.elements)
    for element in sorted(masses, key=lambda e: order.index(e.name)):
        if element.name != base:
            inertia[element.name] = element.values["mass"]
    absorbers = {f"absorber of {e.name}": (e.name, a) for e in masses if (a := rig.effect(e.name, "absorber"))}
    for name, (_, absorber) in absorbers.items():
        inertia[name] = absorber["mass"]
    nb = len(inertia)
    bodies = _Bodies(
        list(inertia), np.array(list(inertia.values())), np.zeros((nb, nb)), np.zeros((nb, nb)), np.zeros(nb),
        np.zeros(nb), 0.0, 0.0,
    )  # fmt: skip
    parts = _Parts(rig, bodies, base, imposed, [], [], [], [], [])
    if screw and compliance:
        stiffness = 1.0 / compliance["compliance"]
        mass = rig.elements[carried].values["mass"] if carried else 0.0
        if not carried:
            raise UserError(f"rig.effects.{screw.name}.compliance", compliance, "a screw that carries a mass")
        damping = 2.0 * SCREW_DAMPING_RATIO * math.sqrt(stiffness * mass)
        bodies.connect(pl.BASE, bodies.names.index(carried), stiffness, damping)
    for element in masses:
        end = bodies.end(element.name, base)
        bodies.connect(pl.GROUND, end, element.values.get("ground_stiffness", 0.0),
                       element.values.get("ground_damping", 0.0))  # fmt: skip
    for name, (host, absorber) in absorbers.items():
        omega = 2.0 * math.pi * absorber["frequency"]
        m, zeta = absorber["mass"], absorber["damping_ratio"]
        bodies.connect(bodies.end(host, base), bodies.names.index(name), m * omega**2, 2 * zeta * omega * m)
    for element in rig.links():
        _add_link(parts, element)
    for element in rig.elements.values():
        _add_bearing(parts, element)
    for effect in rig.effects.get(base or "", {}):
        if effect != "absorber":
            allowed = (
                "no force on a mass that a rigid screw carries; give the screw `compliance` or choose another mass"
            )
            raise UserError(f"rig.effects.{base}.{effect}", rig.effects[base or ""][effect], allowed)
    return parts


def _base(rig: Rig) -> str | None:
    """What moves as it is driven, whatever pulls on it: a positioner, or the mass on a screw that does not give way."""
    if positioner := rig.only("positioner"):
        return positioner.name
    screw = rig.only("screw")
    if screw is None or rig.effect(screw.name, "compliance"):
        return None
    return screw.neighbours.get("carries")


def _add_link(parts: _Parts, element: Element) -> None:
    rig, bodies = parts.rig, parts.bodies
    a, b = (bodies.end(name, parts.base) for name in element.neighbours["between"])
    k, c = element.values["stiffness"], element.values.get("damping", 0.0)
    bodies.connect(a, b, k, c)
    row = [0.0] * pl.N_LINK
    row[pl.L_K], row[pl.L_C] = k, c
    columns = {
        "cubic_stiffness": {"k3": pl.L_CUBIC},
        "quadratic_damping": {"c2": pl.L_QUADRATIC},
        "hysteresis": {"force": pl.L_FORCE, "displacement": pl.L_DISPLACEMENT},
        "bumper": {"stiffness": pl.L_STOP, "clearance": pl.L_CLEARANCE},
        "stiffness_drift": {"rate": pl.L_DRIFT},
    }
    for name, where in columns.items():
        for parameter, value in (rig.effect(element.name, name) or {}).items():
            row[where[parameter]] = value
    if play := rig.effect(element.name, "backlash"):
        row[pl.L_HALF_GAP] = 0.5 * play["lost_motion"]
    parts.link.append(row)
    parts.link_ends.append((a, b))
    parts.aux_of_link.append(sum(1 for j in parts.aux_of_link if j >= 0) if row[pl.L_FORCE] else -1)
    if dry := rig.effect(element.name, "dry_friction"):
        parts.friction.append([dry["force"], 0.0, 1.0])
        parts.friction_ends.append((a, b))


def _add_bearing(parts: _Parts, element: Element) -> None:
    """Friction of a body against the ground; the viscous part is linear and goes into the damping matrix."""
    rig, names = parts.rig, parts.bodies.names
    if element.name not in names:
        return
    body = names.index(element.name)
    if viscous := rig.effect(element.name, "viscous_friction"):
        parts.bodies.C[body, body] += viscous["coefficient"]
    coulomb = rig.effect(element.name, "coulomb_friction") or rig.effect(element.name, "ground_friction")
    stribeck = rig.effect(element.name, "stribeck_friction")
    level = element.values.get("friction", 0.0)
    if coulomb or stribeck or level:
        level += next(iter(coulomb.values())) if coulomb else 0.0
        extra, speed = tuple(stribeck.values()) if stribeck else (0.0, 1.0)
        parts.friction.append([level, extra, speed])
        parts.friction_ends.append((pl.GROUND, body))


def _body_rows(parts: _Parts) -> Floats:
    rows = np.zeros((len(parts.bodies.names), pl.N_BODY))
    for row, name in zip(rows, parts.bodies.names, strict=True):
        there = parts.rig.effects.get(name, {})
        if difference := there.get("asymmetric_friction"):
            row[pl.B_DIFFERENCE] = difference["viscous_difference"]
        if cogging := there.get("cogging"):
            row[[pl.B_COGGING, pl.B_WAVE, pl.B_PHASE]] = list(cogging.values())
        load = there.get("constant_load") or there.get("constant_force")
        if load:
            row[pl.B_LOAD] = next(iter(load.values()))
    return rows


def _circuit_row(rig: Rig, circuit: Element | None) -> Floats:
    row = np.zeros(pl.N_CIRCUIT)
    if circuit is None:
        return row
    row[pl.C_R], row[pl.C_KT] = circuit.values["resistance"], circuit.values["torque_constant"]
    row[pl.C_TAU] = 1.0
    if heat := rig.effect(circuit.name, "resistance_heating"):
        row[pl.C_HEAT], row[pl.C_TAU] = heat["gain"], heat["time_constant"]
    if ripple := rig.effect(circuit.name, "torque_ripple"):
        row[[pl.C_RIPPLE, pl.C_PERIODS, pl.C_PHASE]] = list(ripple.values())
    return row


def _screw_row(parts: _Parts) -> Floats:
    rig, row = parts.rig, np.zeros(pl.N_SCREW)
    screw, rotor = rig.only("screw"), rig.only("rotor")
    if positioner := rig.only("positioner"):
        row[pl.S_LEAD] = positioner.values["travel"]
    if screw is None:
        return row
    row[pl.S_LEAD] = screw.values["lead"]
    if reaction := rig.effect(screw.name, "load_reaction"):
        row[pl.S_SHARE] = reaction["share"]
    if error := rig.effect(screw.name, "pitch_error"):
        row[[pl.S_AMPLITUDE, pl.S_PERIODS, pl.S_PHASE]] = list(error.values())
    row[pl.S_BASE_MASS] = rig.elements[parts.base].values["mass"] if parts.base else 0.0
    row[pl.S_INERTIA] = rotor.values["inertia"] if rotor else 0.0
    return row


def _amplifier_row(rig: Rig) -> Floats:
    amplifier = rig.only("amplifier")
    row = np.array([math.inf, 0.0, 1.0])
    if amplifier is None:
        return row
    if saturation := rig.effect(amplifier.name, "saturation"):
        row[pl.A_LIMIT] = saturation["limit"]
    if dead := rig.effect(amplifier.name, "dead_zone"):
        row[pl.A_DEAD] = dead["half_width"]
    if gain := rig.effect(amplifier.name, "gain_error"):
        row[pl.A_GAIN] = 1.0 + gain["relative"]
    return row


def _delay(rig: Rig, sample_time_s: float, ticks: int) -> tuple[int, int]:
    amplifier = rig.only("amplifier")
    delay = rig.effect(amplifier.name, "delay") if amplifier else None
    total = round((delay["time"] if delay else 0.0) / sample_time_s * ticks)
    return total // ticks, total % ticks


def _sensor_rows(parts: _Parts, circuit: Element | None) -> Floats:
    rig, names = parts.rig, parts.bodies.names
    rows = []
    first = 1 if circuit else 0
    for sensor in rig.sensors.values():
        row = np.zeros(pl.N_SENSOR)
        if sensor.quantity == "force":
            row[pl.Y_INDEX] = pl.LINK_FORCE
            row[pl.Y_LINK] = [e.name for e in rig.links()].index(sensor.of)
        elif sensor.of not in names and sensor.of != parts.base and not (circuit and sensor.of == circuit.name):
            row[pl.Y_INDEX] = np.nan  # measures what is imposed: there is nothing to simulate
        elif sensor.quantity == "current":
            row[pl.Y_INDEX] = 0
        elif sensor.of == parts.base:
            row[pl.Y_INDEX] = pl.BASE_POSITION if sensor.quantity == "position" else pl.BASE_VELOCITY
        else:
            body = names.index(sensor.of)
            row[pl.Y_INDEX] = first + body + (0 if sensor.quantity == "position" else len(names))
        there = rig.effects.get(SENSOR_PREFIX + sensor.name, {})
        row[pl.Y_GAIN] = 1.0 + there.get("gain_error", {}).get("relative", 0.0)
        row[pl.Y_OFFSET] = there.get("offset", {}).get("offset", 0.0)
        rows.append(row)
    return np.array(rows).reshape(-1, pl.N_SENSOR)


def _sensor_delays(rig: Rig, sample_time_s: float, ticks: int) -> tuple[Ints, Ints]:
    """Whole samples of every sensor's delay, and the tick within a sample at which it looks (0: at its end)."""
    delays = [rig.effects.get(SENSOR_PREFIX + name, {}).get("delay", {}).get("time", 0.0) for name in rig.sensors]
    total = np.round(np.array(delays) / sample_time_s * ticks).astype(np.int64)
    return total // ticks, (-total) % ticks


def _continuous(
    parts: _Parts, circuit: Element | None, n_aux: int, heat: dict[str, float] | None, screw: Floats
) -> tuple[Floats, Floats]:
    """A (2, n, n) and G (2, channels, n), gear free and in contact."""
    b, rig = parts.bodies, parts.rig
    nb, first = len(b.names), 1 if circuit else 0
    n = first + 2 * nb + n_aux
    q, v = slice(first, first + nb), slice(first + nb, first + 2 * nb)
    A, G = np.zeros((2, n, n)), np.zeros((2, pl.CH_F + nb + n_aux, n))
    lead, share = screw[pl.S_LEAD], screw[pl.S_SHARE]
    drive = rig.only("actuator")
    for contact in (0, 1):
        inertia = b.inertia.copy()
        K, C = b.K.copy(), b.C.copy()
        base_k, base_c = b.base_k.copy(), b.base_c.copy()
        if contact and not parts.imposed and rig.only("rotor"):
            K[:, 0] -= b.base_k * lead
            C[:, 0] -= b.base_c * lead
            back = share * lead  # torque on the rotor per newton that the base feels
            inertia[0] += back * lead * screw[pl.S_BASE_MASS]
            K[0] -= back * b.base_k
            C[0] -= back * b.base_c
            K[0, 0] += back * lead * b.at_base
            C[0, 0] += back * lead * b.at_base_c
            base_k[0] -= back * b.at_base
            base_c[0] -= back * b.at_base_c
        A[contact, q, v] = np.eye(nb)
        A[contact, v, q] = -K / inertia[:, None]
        A[contact, v, v] = -C / inertia[:, None]
        G[contact, pl.CH_D, v] = base_k / inertia
        G[contact, pl.CH_DD, v] = base_c / inertia
        G[contact, pl.CH_F : pl.CH_F + nb, v] = np.diag(1.0 / inertia)
        if circuit:
            target = v.start + b.names.index(circuit.neighbours["drives"])
            values = circuit.values
            A[contact, 0, 0] = -values["resistance"] / values["inductance"]
            A[contact, 0, target] = -values["emf_constant"] / values["inductance"]
            A[contact, target, 0] = values["torque_constant"] / inertia[target - v.start]
            G[contact, pl.CH_V, 0] = 1.0 / values["inductance"]
        elif drive and not parts.imposed:
            target = b.names.index(drive.neighbours["drives"])
            G[contact, pl.CH_V, v.start + target] = drive.values["gain"] / inertia[target]
        for j in range(n_aux):
            G[contact, pl.CH_F + nb + j, first + 2 * nb + j] = 1.0
        if heat:
            A[contact, n - 1, n - 1] = -1.0 / heat["time_constant"]
    return A, G
