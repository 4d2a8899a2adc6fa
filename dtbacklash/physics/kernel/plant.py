"""What the compiled simulation works on: flat arrays, and the integers that say where things are in them.

The continuous plant is ``x' = A x + G w`` with the state ``x = [i?, q (bodies), v (bodies), aux]`` and the
channels ``w``: the voltage, the base's extra position and velocity, an effort on each body, a rate for each
auxiliary state. ``A`` and ``G`` come in two versions: gear out of contact, and in contact.
"""

from typing import Any, NamedTuple

import numpy as np

from dtbacklash.arrays import Floats, Ints

# channels
CH_V, CH_D, CH_DD, CH_F = 0, 1, 2, 3

# ends of links and friction contacts that are not bodies
GROUND, BASE = -1, -2

# states of the gear; PLUS and MINUS are contacts on that side, RIGID means that there is no gap
FREE, PLUS, MINUS, RIGID = 0, 1, -1, 2

# columns of `link`; the lever is how far its first end goes per unit of the motion of the body there
L_K, L_C, L_LEVER, N_LINK = range(4)
# entries of `circuit`: of a winding; of an actuator; or of a servo, with the largest effort that its position loop asks
# for, and all
C_R, C_KT, C_GAIN, C_POSITION, C_SPEED, C_ASKED, C_LARGEST, N_CIRCUIT = range(8)
# entries of `screw`; the base's stiffness and damping are those that it feels while everything else stands
S_LEAD, S_SHARE, S_BASE_MASS, S_INERTIA, S_BASE_K, S_BASE_C, N_SCREW = range(7)
# columns of `sensor`; the place of one behind a filter is the filter's order
Y_INDEX, Y_PLACE, N_SENSOR = range(3)
#: `sensor[:, Y_INDEX]` of a sensor on the base (the mass that a rigid screw carries): position, velocity; and of one
#: that shows the force of the link, or the acceleration of the body, `sensor[:, Y_PLACE]`
BASE_POSITION, BASE_VELOCITY, LINK_FORCE, ACCELERATION = -1, -2, -3, -4

#: what a dry friction carries, where it is no link: the effort of the drive, that of the screw, or nothing that matters
NOTHING, DRIVE, SCREW = -1, -2, -3

# slots of the laws: what acts at body j, link j, contact j, sensor j; and at the amplifier, winding and screw (j = 0)
BODY_EFFORT, BODY_MEMORY, LINK, FRICTION, READING, COMMAND, WINDING, MOTOR_TORQUE, LEAD, N_SLOTS = range(10)
#: a link has three places that follow one another: its play, its forces, and those with a memory
PLAYS, FORCES, MEMORIES, PER_LINK = range(4)


class Plant(NamedTuple):
    """A rig, compiled for one sampling time. ``m`` gear modes, ``l`` step levels, ``n`` states, ``c`` channels.

    E : (m, l, n, n) transposed transition matrices over a step ``sample_time/substeps/2**level``.
    P1, P2 : (m, l, c, n) transposed responses to channels that are constant, and that rise from 0 to 1.
    A : (m, n, n), G : (m, c, n) the continuous matrices (G transposed).
    """

    E: Floats
    P1: Floats
    P2: Floats
    A: Floats
    G: Floats
    slot: Ints  # (N_SLOTS,) index in `first` of a slot's first place
    first: Ints  # the laws at a place: entries first[place] to first[place + 1] - 1
    # (entries, 2) code of the law in its slot; its memory's index in x, what a friction carries, or its place
    law: Ints
    law_p: Floats  # (entries, slots.ROW_PARAMETERS) its parameters
    link: Floats
    link_ends: Ints
    friction_ends: Ints
    circuit: Floats
    screw: Floats
    sensor: Floats
    sensor_whole: Ints  # a sensor's delay: whole samples,
    sensor_tick: Ints  # the tick of a sample at or after which it looks (0: at its end),
    sensor_part: Floats  # and how much of a tick after it
    sensor_play: Floats  # half the gap between what it senses and what turns it
    sample_time: float
    substeps: int
    levels: int
    current: int  # index of i in x, or -1
    rotor: int  # index of the motor's rotor among the bodies, or -1
    driven: int  # index of the body that the drive drives, or -1
    limited: bool  # a servo has limits
    lag: int  # index in x of what has arrived at an actuator that lags, or -1
    loaded: bool  # a dry friction depends on what its place carries
    n_bodies: int
    position: int  # index of the first position in x
    has_base: bool  # a screw or a positioner drives the structure
    imposed: bool  # the motor's angle (or the positioner's command) is given instead of simulated
    forced: bool  # something besides the voltage and the gear acts
    delay_whole: int  # the amplifier's delay: whole samples,
    delay_ticks: int  # ticks (sample_time/substeps/2**(levels-1)),
    delay_part: float  # and a part of a tick

    def __reduce__(self) -> tuple[Any, ...]:
        """What is pickled names the laws of others, whose codes hold in this process alone."""
        from dtbacklash.physics.kernel import dispatch

        return _again, (tuple(self), dispatch.named(self.law[:, 0]))


def _again(values: tuple[Any, ...], named: dict[int, Any]) -> "Plant":
    """A plant of another process, with the codes of its laws in this one."""
    from dtbacklash.physics.kernel import dispatch

    plant = Plant(*values)
    for entry, name in named.items():
        plant.law[entry, 0] = dispatch.code_named(name)
    return plant


class State(NamedTuple):
    """What changes while a plant is simulated, and room to work in. Made by :func:`new_state`."""

    x: Floats  # (n,)
    gear: Floats  # (2,) theta_d while the gear is out of contact or its motion imposed, and then its rate
    mode: Ints  # (1 + frictions,) state of the gear, then -1/0/1 a friction contact: slips back, sticks, slips
    commands: Floats  # the last commands u, newest first
    seen: Floats  # (depth, sensors) what the sensors have looked at, newest first
    caught: Floats  # (sensors,) what those that look within a sample saw in the last one
    played: Floats  # (sensors,) where those behind a gap stand
    xn: Floats
    xp: Floats
    w0: Floats
    w1: Floats
    lean: Ints  # (1,) the side on which the motor leans on a load that it cannot move; 0: it does not
    reaction: Floats  # (frictions,) the force that keeps a sticking contact at rest
    load: Floats  # (entries,) what the place of a dry friction carries
    now: Floats  # (2,) time, s, and voltage in force, for what is measured of forces


def new_state(plant: Plant) -> State:
    """The plant at rest at zero, gear centred in its gap, every friction contact sticking."""
    n, channels = plant.A.shape[1], plant.G.shape[1]
    frictions, sensors = len(plant.friction_ends), len(plant.sensor)
    depth = int(plant.sensor_whole.max(initial=0)) + 1
    mode = np.zeros(1 + frictions, dtype=np.int64)
    mode[0] = FREE if plant.imposed else RIGID
    return State(
        x=np.zeros(n),
        gear=np.zeros(2),
        mode=mode,
        commands=np.zeros(plant.delay_whole + 2),
        seen=np.zeros((depth, sensors)),
        caught=np.zeros(sensors),
        played=np.zeros(sensors),
        xn=np.zeros(n),
        xp=np.zeros(n),
        w0=np.zeros(channels),
        w1=np.zeros(channels),
        lean=np.zeros(1, dtype=np.int64),
        reaction=np.zeros(frictions),
        load=np.zeros(len(plant.law)),
        now=np.zeros(2),
    )


def place_at(plant: Plant, state: State, angle: float) -> None:
    """Put a plant with a base at rest with the motor at ``angle``, rad (a positioner at the command ``angle``, V)."""
    state.gear[0] = angle
    for j in range(plant.n_bodies):
        state.x[plant.position + j] = angle if j == plant.rotor else plant.screw[S_LEAD] * angle
