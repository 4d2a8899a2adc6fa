"""The arrays of the concealing simulator's inner loop, with names of their columns and entries."""

from typing import NamedTuple

from dtbacklash.arrays import Floats, Ints

GROUND, BASE = -1, -2

# columns of `body`
B_VISCOUS, B_DIFFERENCE, B_LEVELS, B_COGGING, B_WAVE, B_PHASE, B_LOAD, B_WEIGHT, B_ANGLE, N_BODY = range(10)
# columns of `link`
(L_K, L_C, L_CUBIC, L_QUADRATIC, L_FORCE, L_YIELD, L_STOP, L_CLEARANCE, L_DRIFT, L_LOST, L_LEVER, L_LOSS,
 N_LINK) = range(13)  # fmt: skip
# columns of `friction`; F_LOADED: 1 where the friction of what passes on an effort belongs to it
F_COULOMB, F_STRIBECK, F_SPEED, F_BRISTLE, F_DAMPING, F_LOADED, N_FRICTION = range(7)
# entries of `drive`; D_EFFORT: N or N m per volt of an ideal actuator; D_TRAVEL: m per volt of a positioner
(D_R, D_L, D_KT, D_KB, D_RIPPLE, D_PERIODS, D_PHASE, D_HEAT, D_TAU, D_LEAD, D_SHARE, D_BASE_MASS, D_PITCH, D_WAVE,
 D_SHIFT, D_GAP, D_GAIN, D_DEAD, D_LIMIT, D_DELAY, D_BODY, D_EFFORT, D_TRAVEL, D_LAG, D_HOLD, D_BRAKE, D_FAST,
 D_STRONG, D_LOSS, D_SCREW_LOSS, N_DRIVE) = range(31)  # fmt: skip
# columns of `sensor`
Y_INDEX, Y_GAIN, Y_OFFSET, Y_DELAY, Y_NOISE, Y_COUNT, Y_PLACE, Y_OFF_CENTRE, Y_PHASE, N_SENSOR = range(10)
#: `sensor[:, Y_INDEX]` of a sensor on the mass that a rigid screw carries: position, velocity; of the force of the
#: link, or the acceleration of the body, Y_PLACE
BASE_POSITION, BASE_VELOCITY, LINK_FORCE, ACCELERATION = -1, -2, -3, -4
# columns of `unknown` (U_PLACE: the body, link or sensor), and the kinds of physics that the catalogue does not have
U_KIND, U_PLACE, U_SIZE, U_SCALE, U_WAVE, U_PHASE, U_SECOND, U_SHIFT, N_UNKNOWN = range(9)
(POSITION_DAMPING, DISTURBANCE, DIRECTIONAL_TORQUE, ROOT_SPRING, SPEED_STIFFENING, ANGULAR_PLAY, POSITION_MASS,
 COLOURED_FORCE, DOUBLE_RIPPLE, WANDERING_FRICTION, CREEP, POSITION_GAIN, GAIN_DRIFT, INTERPOLATION,
 CURVED_SCALE, READING_DRIFT, CLOCK_JITTER) = range(17)  # fmt: skip
# entries of `control` and values of C_MODE; C_RATE: gain on the rate; C_CORNER: its filter, per sample
C_MODE, C_GAIN, C_FILTER, C_INTEGRAL, C_LIMIT, C_RATE, C_CORNER, N_CONTROL = range(8)
OPEN, CASCADE, PID = range(3)
#: states of the controllers
N_HELD = 4
# entries of `scalar`; S_FROM to S_IMPOSED_RATE: how a positioner moves between two samples
S_HEAT, S_BASE, S_BASE_RATE, S_CONTACT, S_ON_BASE, S_FROM, S_SINCE, S_IMPOSED_RATE, N_SCALAR = range(9)


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


class Memory(NamedTuple):
    """State and work space; ``bristle`` and ``yielding`` hold (state, displacement) in turn.

    lost (nb,): friction of what passes on an effort at each body, N or N m.
    course (3, nu): what physics beyond the catalogue does by a course of its own, now, and at both ends of a step.
    """

    x: Floats
    start: Floats
    trial: Floats
    total: Floats
    rates: Floats
    force: Floats
    lost: Floats
    bristle: Floats
    bristle_start: Floats
    yielding_start: Floats
    scalar: Floats
    control: Floats
    course: Floats


class Signals(NamedTuple):
    """(N+1,) reference (m, or V in open loop), added voltage; (N+1, nu) courses; (N+1, ns) noise; (2,) roles."""

    reference: Floats
    dither: Floats
    courses: Floats
    noise: Floats
    roles: Ints
