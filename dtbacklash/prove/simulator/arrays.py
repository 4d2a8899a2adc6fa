"""The arrays of the concealing simulator's inner loop; :mod:`.columns` names their columns and entries."""

from typing import NamedTuple

from dtbacklash.arrays import Floats, Ints


class Machine(NamedTuple):
    """A rig with ``nb`` bodies, of which the first is the motor's rotor.

    inertia (nb,), body (nb, N_BODY), link (nl, N_LINK), link_ends (nl, 2), friction (nf, N_FRICTION), friction_ends
    (nf, 2), drive (N_DRIVE,), sensor (ns, N_SENSOR), unknown (N_UNKNOWN,). The state is
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
    """State and work space; ``bristle`` and ``yielding`` hold (state, displacement) in turn."""

    x: Floats
    start: Floats
    trial: Floats
    total: Floats
    rates: Floats
    force: Floats
    bristle: Floats
    bristle_start: Floats
    yielding_start: Floats
    scalar: Floats
    control: Floats


class Signals(NamedTuple):
    """(N+1,) reference (m, or V in open loop), added voltage, disturbance; (N+1, ns) noise in SI; (2,) roles."""

    reference: Floats
    dither: Floats
    disturbance: Floats
    noise: Floats
    roles: Ints
