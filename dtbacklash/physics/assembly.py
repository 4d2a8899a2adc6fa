"""From a checked rig to the arrays of the compiled simulation."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats, Ints
from dtbacklash.errors import UserError
from dtbacklash.physics.bodies import FrictionContact, Parts, take_apart
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Effect, Values
from dtbacklash.physics.effects.slots import ROW_PARAMETERS
from dtbacklash.physics.kernel import dispatch
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.exponential import discretise
from dtbacklash.physics.kernel.plant import Plant
from dtbacklash.physics.rig import SENSOR_PREFIX, Element, Rig

#: steps a sample where forces act beside the linear plant: errs by less than 1e-4 mm on every effect (tests)
SUBSTEPS_FORCED = 8
#: slots that leave the linear plant's answer to a held input as it is
BESIDE_NOTHING = (pl.READING, pl.COMMAND)

Active = list[tuple[Effect, Values]]


class Entries:
    """The laws of a rig's effects, by slot and place; places are added in the order of a slot's elements.

    decays : the rate at which each memory falls by itself, 1/s.
    """

    def __init__(self, first_memory: int) -> None:
        self._first_memory = first_memory
        self._places: dict[int, list[list[tuple[int, int, list[float]]]]] = {slot: [] for slot in range(pl.N_SLOTS)}
        self.decays: list[float] = []

    @property
    def forced(self) -> bool:
        """Whether something acts beside the linear plant."""
        return any(there for slot, places in self._places.items() if slot not in BESIDE_NOTHING for there in places)

    @property
    def loaded(self) -> bool:
        """Whether a dry friction depends on what its place carries."""
        return any(load != pl.NOTHING for there in self._places[pl.FRICTION] for _, load, _ in there)

    def place(self, slot: int, effects: Active) -> None:
        """Add the next place of a slot with the effects that act there."""
        ordered = sorted(effects, key=lambda pair: getattr(pair[0].slot, "stage", 0))
        number = len(self._places[slot])
        self._places[slot].append([(dispatch.code_of(e), number, list(values.values())) for e, values in ordered])

    def rub(self, contact: FrictionContact) -> None:
        """Add the next friction contact; a law that does not ask for what it carries is not told."""
        there = [(dispatch.PLAIN_FRICTION, pl.NOTHING, [contact.level])] if contact.level else []
        for (effect, values), load in zip(contact.effects, contact.loads, strict=True):
            told = load if "load" in slots.asked(effect) else pl.NOTHING
            there.append((dispatch.code_of(effect), told, list(values.values())))
        self._places[pl.FRICTION].append(there)

    def remember(self, slot: int, effects: Active) -> None:
        """Add the next place of a slot whose effects have a memory each."""
        there = []
        for effect, values in effects:
            memory = self._first_memory + len(self.decays)
            there.append((dispatch.code_of(effect), memory, list(values.values())))
            decay = getattr(effect.slot, "decay", None)
            self.decays.append(1.0 / values[decay] if decay else 0.0)
        self._places[slot].append(there)

    def arrays(self, number: Any = float) -> tuple[Ints, Ints, Ints, Floats]:
        """``slot``, ``first``, ``law`` and ``law_p`` of :class:`~dtbacklash.physics.kernel.plant.Plant`."""
        slots, first, laws, parameters = [], [0], [], []
        for slot in range(pl.N_SLOTS):
            slots.append(len(first) - 1)
            for there in self._places[slot]:
                for code, memory, values in there:
                    laws.append((code, memory))
                    parameters.append(values + [0.0] * (ROW_PARAMETERS - len(values)))
                first.append(len(laws))
        return (
            np.array(slots, dtype=np.int64), np.array(first, dtype=np.int64),
            np.array(laws, dtype=np.int64).reshape(-1, 2),
            np.array(parameters, dtype=number).reshape(-1, ROW_PARAMETERS),
        )  # fmt: skip


def compile_plant(
    rig: Rig, sample_time_s: float, substeps: int = 0, event_levels: int = 16, imposed: bool = False,
    where_forced: tuple[int, int] | None = None,
) -> Plant:  # fmt: skip
    """Compile a rig for the simulation.

    Parameters
    ----------
    rig : a checked rig.
    sample_time_s : sampling time, s.
    substeps : steps a sample; 0 chooses 1 where the linear solution is exact and nothing is imposed by a positioner,
        else SUBSTEPS_FORCED.
    event_levels : a contact is located to ``sample_time_s / substeps / 2**event_levels``.
    imposed : drive the gear with a given motor angle instead of the simulated motor. A positioner always imposes.
    where_forced : substeps and event levels instead of those where forces act beside the linear plant.

    Source: exponential time differencing of second order with a ramp (Cox & Matthews, J. Comput. Phys. 176
    (2002) 430), exact for the linear part and for inputs that are constant or linear in a step.
    """
    imposed = imposed or rig.only("positioner") is not None
    parts = _parts(rig, imposed)
    circuit = None if imposed else rig.only("motor_circuit")
    first_aux = (1 if circuit else 0) + 2 * len(parts.bodies.names)
    entries = _entries(parts, circuit, first_aux)
    drive = None if imposed else rig.drive
    row = _drive_row(rig, drive)
    limited = any(map(math.isfinite, row[[pl.C_ASKED, pl.C_LARGEST]]))
    forced = entries.forced or limited
    if where_forced and forced:
        substeps, event_levels = where_forced
    # a positioner moves smoothly between the samples, whether another law needs more steps or not
    smooth = rig.only("positioner") is not None
    substeps = substeps or (SUBSTEPS_FORCED if forced or smooth else 1)
    screw = _screw_row(parts)
    sensors = _sensor_rows(parts, circuit)
    A, G = _continuous(parts, circuit, entries.decays, screw)
    A, G = _filtered(rig, A, G, sensors)
    E, P1, P2 = discretise(np.asarray(A, float), np.asarray(G, float), sample_time_s / substeps, event_levels + 1)
    delay = _delay(rig, sample_time_s, substeps << event_levels)
    looks = _sensor_delays(rig, sample_time_s, substeps << event_levels)
    slot, first, law, law_p = entries.arrays(rig.number)
    return Plant(
        E=E, P1=P1, P2=P2, A=A, G=G, slot=slot, first=first, law=law, law_p=law_p,
        link=np.array(parts.link, dtype=rig.number).reshape(-1, pl.N_LINK),
        link_ends=_ends(parts.link_ends), friction_ends=_ends([contact.ends for contact in parts.contacts]),
        circuit=row, screw=screw,
        sensor=sensors, sensor_whole=looks[0], sensor_tick=looks[1], sensor_part=looks[2],
        sensor_play=0.5 * np.array([rig.amount(SENSOR_PREFIX + s, slots.ShownPlay, "width") for s in rig.sensors]),
        sample_time=sample_time_s, substeps=substeps, levels=event_levels + 1,
        current=0 if circuit else -1, rotor=parts.rotor,
        driven=parts.bodies.names.index(drive.neighbours["drives"]) if drive else -1,
        limited=limited, lag=first_aux + len(entries.decays) if _lag(rig, drive) else -1, loaded=entries.loaded,
        n_bodies=len(parts.bodies.names), position=1 if circuit else 0,
        has_base=_base_drive(rig) is not None, imposed=imposed, forced=forced,
        delay_whole=delay[0], delay_ticks=delay[1], delay_part=delay[2],
    )  # fmt: skip


def poles_of(plant: Plant) -> np.ndarray:
    """(states,) complex poles of the linear part of a plant, with its gear in contact, 1/s."""
    return np.linalg.eigvals(plant.A[0 if plant.rotor < 0 else 1])


def state_names(rig: Rig, imposed: bool = False) -> list[str]:
    """The bodies in the order in which the state holds them (positions, then velocities)."""
    return _parts(rig, imposed).bodies.names


def _parts(rig: Rig, imposed: bool) -> Parts:
    return rig.once(("parts", imposed), lambda: take_apart(rig, imposed))


def _base_drive(rig: Rig) -> Element | None:
    """The element that moves the base: a screw or a positioner."""
    return rig.only("screw") or rig.only("positioner")


def _entries(parts: Parts, circuit: Element | None, first_aux: int) -> Entries:
    """The laws of the rig's effects, by slot and place."""
    rig = parts.rig
    entries = Entries(first_aux)
    for name in parts.bodies.names:
        entries.place(pl.BODY_EFFORT, rig.active(name, slots.BodyEffort))
        entries.remember(pl.BODY_MEMORY, rig.active(name, slots.BodyMemory))
    for element in parts.springs:
        entries.place(pl.LINK, rig.active(element.name, slots.SpringPlay))
        entries.place(pl.LINK, rig.active(element.name, slots.SpringForce))
        entries.remember(pl.LINK, rig.active(element.name, slots.SpringMemory))
    for contact in parts.contacts:
        entries.rub(contact)
    for name in rig.sensors:
        entries.place(pl.READING, rig.active(SENSOR_PREFIX + name, slots.Reading))
    single = (
        (pl.COMMAND, rig.only("amplifier"), slots.Command), (pl.LEAD, rig.only("screw"), slots.Lead),
        (pl.MOTOR_TORQUE, circuit, slots.MotorTorque),
    )  # fmt: skip
    for place, where, slot in single:
        entries.place(place, rig.active(where.name, slot) if where else [])
    entries.remember(pl.WINDING, rig.active(circuit.name, slots.WindingMemory) if circuit else [])
    return entries


def _ends(pairs: list[tuple[int, int]]) -> Ints:
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _drive_row(rig: Rig, drive: Element | None) -> Floats:
    """What the drive is made of; a servo's limits are infinite where it has none.

    Raises
    ------
    UserError : a limit of the speed that a servo without speed_gain would ask for.
    """
    row = np.zeros(pl.N_CIRCUIT, dtype=rig.number)
    row[pl.C_ASKED] = row[pl.C_LARGEST] = math.inf
    if drive is None:
        return row
    columns = {
        "resistance": pl.C_R, "torque_constant": pl.C_KT, "gain": pl.C_GAIN, "position_gain": pl.C_POSITION,
        "speed_gain": pl.C_SPEED,
    }  # fmt: skip
    for name, column in columns.items():
        row[column] = drive.values.get(name, 0.0)
    if drive is rig.servo:
        fastest = rig.amount(drive.name, slots.SpeedLimit, "speed")
        if fastest and not row[pl.C_SPEED]:
            key = f"rig.effects.{drive.name}.speed_limit.speed"
            raise UserError(key, fastest, f"needs a {drive.kind} with a speed_gain")
        row[pl.C_ASKED] = row[pl.C_SPEED] * fastest or math.inf
        row[pl.C_LARGEST] = rig.amount(drive.name, slots.EffortLimit, "effort") or math.inf
    return row


def _lag(rig: Rig, drive: Element | None) -> float:
    """Time constant of an actuator behind its command, s."""
    return rig.amount(drive.name, slots.Lag, "time") if drive else 0.0


def _screw_row(parts: Parts) -> Floats:
    rig = parts.rig
    row = np.zeros(pl.N_SCREW, dtype=rig.number)
    screw, rotor = rig.only("screw"), rig.motor_rotor()
    if positioner := rig.only("positioner"):
        row[pl.S_LEAD] = positioner.values["travel"]
    if screw is None:
        return row
    row[pl.S_LEAD] = screw.values["lead"]
    row[pl.S_SHARE] = rig.amount(screw.name, slots.Reaction, "share")
    row[pl.S_BASE_MASS] = rig.elements[parts.base].values["mass"] if parts.base else 0.0
    row[pl.S_INERTIA] = rotor.values["inertia"] if rotor else 0.0
    row[pl.S_BASE_K], row[pl.S_BASE_C] = parts.bodies.at_base, parts.bodies.at_base_c
    return row


#: a part of a tick that is rounding
NO_PART = 1e-6


def _delay(rig: Rig, sample_time_s: float, ticks: int) -> tuple[int, int, float]:
    """The amplifier's delay: whole samples, ticks, and a part of one."""
    amplifier = rig.only("amplifier")
    total = (float(rig.amount(amplifier.name, slots.Late, "time")) if amplifier else 0.0) / sample_time_s * ticks
    whole = int(total + NO_PART)
    part = max(total - whole, 0.0)
    return whole // ticks, whole % ticks, part if part > NO_PART else 0.0


def _sensor_rows(parts: Parts, circuit: Element | None) -> Floats:
    rig, names = parts.rig, parts.bodies.names
    rows = []
    first = 1 if circuit else 0
    for sensor in rig.sensors.values():
        row = np.zeros(pl.N_SENSOR)
        springs = [e.name for e in parts.springs]
        if sensor.of in springs:
            row[pl.Y_INDEX], row[pl.Y_PLACE] = pl.LINK_FORCE, springs.index(sensor.of)
        elif sensor.of not in names and sensor.of != parts.base and not (circuit and sensor.of == circuit.name):
            row[pl.Y_INDEX] = np.nan  # measures what is imposed: there is nothing to simulate
        elif sensor.quantity == "current":
            row[pl.Y_INDEX] = 0
        elif sensor.quantity == "acceleration" and sensor.of != parts.base:
            row[pl.Y_INDEX], row[pl.Y_PLACE] = pl.ACCELERATION, names.index(sensor.of)
        elif sensor.quantity == "acceleration":
            allowed = "the acceleration of a mass that no rigid screw carries; give the screw `compliance`"
            raise UserError(f"rig.sensors.{sensor.name}.of", sensor.of, allowed)
        elif sensor.of == parts.base:
            row[pl.Y_INDEX] = pl.BASE_POSITION if sensor.quantity == "position" else pl.BASE_VELOCITY
        else:
            body = names.index(sensor.of)
            row[pl.Y_INDEX] = first + body + (0 if sensor.quantity == "position" else len(names))
        rows.append(row)
    return np.array(rows).reshape(-1, pl.N_SENSOR)


def _sensor_delays(rig: Rig, sample_time_s: float, ticks: int) -> tuple[Ints, Ints, Floats]:
    """Whole samples of every sensor's delay; the tick within a sample after which it looks (0: its end); the part."""
    delays = [rig.amount(SENSOR_PREFIX + name, slots.Late, "time") for name in rig.sensors]
    total = np.array(delays) / sample_time_s * ticks
    most = np.ceil(total - NO_PART).astype(np.int64)
    whole, tick, part = most // ticks, (-most) % ticks, np.maximum(most - total, 0.0)
    # within the first tick of a sample it looks at the end of the sample before
    part[(tick == 0) | (part <= NO_PART)] = 0.0
    return whole, tick, part


def _continuous(parts: Parts, circuit: Element | None, decays: list[float], screw: Floats) -> tuple[Floats, Floats]:
    """A (2, n, n) and G (2, channels, n), gear free and in contact. ``decays`` : rates at which memories fall, 1/s."""
    b, rig = parts.bodies, parts.rig
    nb, first, n_aux = len(b.names), 1 if circuit else 0, len(decays)
    drive = rig.drive
    lag = _lag(rig, None if parts.imposed else drive)
    n = first + 2 * nb + n_aux + (1 if lag else 0)
    q, v = slice(first, first + nb), slice(first + nb, first + 2 * nb)
    A, G = (np.zeros((2, rows, n), dtype=rig.number) for rows in (n, pl.CH_F + nb + n_aux))
    lead, share, r = screw[pl.S_LEAD], screw[pl.S_SHARE], parts.rotor
    for contact in (0, 1):
        inertia = b.inertia.copy()
        K, C = b.K.copy(), b.C.copy()
        base_k, base_c = b.base_k.copy(), b.base_c.copy()
        if contact and r >= 0:
            K[:, r] -= b.base_k * lead
            C[:, r] -= b.base_c * lead
            back = share * lead  # torque on the rotor per newton that the base feels
            inertia[r] += back * lead * screw[pl.S_BASE_MASS]
            K[r] -= back * b.base_k
            C[r] -= back * b.base_c
            K[r, r] += back * lead * b.at_base
            C[r, r] += back * lead * b.at_base_c
            base_k[r] -= back * b.at_base
            base_c[r] -= back * b.at_base_c
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
            per_volt = drive.values["position_gain" if drive is rig.servo else "gain"] / inertia[target]
            G[contact, pl.CH_V, v.start + target] = per_volt
            if lag:  # the last state is what has arrived of the command
                G[contact, pl.CH_V, v.start + target], A[contact, v.start + target, n - 1] = 0.0, per_volt
                G[contact, pl.CH_V, n - 1], A[contact, n - 1, n - 1] = 1.0 / lag, -1.0 / lag
        for j, decay in enumerate(decays):
            G[contact, pl.CH_F + nb + j, first + 2 * nb + j] = 1.0
            if math.isfinite(decay):
                A[contact, first + 2 * nb + j, first + 2 * nb + j] = -decay
    return A, G


def _filtered(rig: Rig, A: Floats, G: Floats, sensors: Floats) -> tuple[Floats, Floats]:
    """The same with the states of sensors' filters, which these show from now on: ``sensors`` is changed.

    Raises
    ------
    UserError : a sensor of what is no state, such as a force.
    """
    for name, row in zip(rig.sensors, sensors, strict=True):
        for effect, values in rig.active(SENSOR_PREFIX + name, slots.Filter):
            assert isinstance(effect.slot, slots.Filter)
            if not row[pl.Y_INDEX] >= 0:
                key = f"rig.effects.{SENSOR_PREFIX}{name}.{effect.name}"
                raise UserError(key, name, "a sensor of a body's position or speed, or of a current")
            F, g = _realised(*effect.slot.transfer(values))
            n, order, source = A.shape[1], len(g), int(row[pl.Y_INDEX])
            A = np.pad(A, ((0, 0), (0, order), (0, order)))
            G = np.pad(G, ((0, 0), (0, 0), (0, order)))
            A[:, n:, n:], A[:, n:, source] = F, g
            row[[pl.Y_INDEX, pl.Y_PLACE]] = n, order
    return A, G


def _realised(numerator: Sequence[float], denominator: Sequence[float]) -> tuple[Floats, Floats]:
    """F (k, k), g (k,) of x' = F x + g u: a filter that shows its first state; at rest all of them are u.

    The observable canonical form (Kailath, Linear Systems, 1980, section 2.1), with its states scaled.
    """
    a, order = np.asarray(denominator) / denominator[0], len(denominator) - 1
    b = np.pad(np.asarray(numerator) / denominator[0], (order + 1 - len(numerator), 0))
    scale = (a - b)[:order]
    F = np.diag(scale[1:] / scale[:-1], 1)
    F[:, 0] -= a[1:] / scale
    return F, b[1:] / scale
