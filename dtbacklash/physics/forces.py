"""The forces that act beside the linear plant: every nonlinear effect of the catalogue, summed into channels."""

from dtbacklash.compiled import inlined
from dtbacklash.physics import laws
from dtbacklash.physics import plant as pl


@inlined
def base_motion(P, x, contact, theta_d, theta_d_rate):
    """Position and velocity of the screw's base, m and m/s, with the error of its lead."""
    S = P.screw
    d, rate = S[pl.S_LEAD] * theta_d, S[pl.S_LEAD] * theta_d_rate
    if S[pl.S_AMPLITUDE] != 0.0:
        e = laws.periodic(theta_d, S[pl.S_AMPLITUDE], S[pl.S_PERIODS], S[pl.S_PHASE])
        d += e - laws.periodic(0.0, S[pl.S_AMPLITUDE], S[pl.S_PERIODS], S[pl.S_PHASE])
        slope = laws.periodic_slope(theta_d, S[pl.S_AMPLITUDE], S[pl.S_PERIODS], S[pl.S_PHASE])
        rate += slope * theta_d_rate
    return d, rate


@inlined
def end_velocity(P, x, end, base_rate):
    """Velocity of an end of a link or friction contact, m/s or rad/s."""
    if end >= 0:
        return x[P.position + P.n_bodies + end]
    return base_rate if end == pl.BASE else 0.0


@inlined
def end_position(P, x, end, base):
    """Position of an end of a link, m."""
    if end >= 0:
        return x[P.position + end]
    return base if end == pl.BASE else 0.0


@inlined
def push(P, w, contact, end, effort):
    """Add an effort to a body; on the base it reaches the rotor by the screw's reaction."""
    if end >= 0:
        w[pl.CH_F + end] += effort
    elif end == pl.BASE and contact == 1 and P.rotor >= 0:
        w[pl.CH_F + P.rotor] += effort * P.screw[pl.S_SHARE] * P.screw[pl.S_LEAD]


@inlined
def stretch_of(P, x, j, base, base_rate):
    """Stretch of link ``j`` and its rate, m and m/s."""
    a, b = P.link_ends[j, 0], P.link_ends[j, 1]
    s = end_position(P, x, b, base) - end_position(P, x, a, base)
    return s, end_velocity(P, x, b, base_rate) - end_velocity(P, x, a, base_rate)


@inlined
def force_beside(P, x, j, s, rate, t):
    """Force of link ``j`` beyond its spring and damper, N."""
    row = P.link[j]
    force = 0.0
    if row[pl.L_HALF_GAP] != 0.0:
        held = laws.lost_motion(s, row[pl.L_HALF_GAP])
        force += row[pl.L_K] * (held - s)
        s = held
    if row[pl.L_CUBIC] != 0.0:
        force += laws.cubic_stiffness(s, row[pl.L_CUBIC])
    if row[pl.L_QUADRATIC] != 0.0:
        force += laws.quadratic_damping(rate, row[pl.L_QUADRATIC])
    if row[pl.L_STOP] != 0.0:
        force += laws.bumper(s, row[pl.L_CLEARANCE], row[pl.L_STOP])
    if row[pl.L_DRIFT] != 0.0:
        force += laws.stiffness_drift(s, t, row[pl.L_K], row[pl.L_DRIFT])
    if P.aux_of_link[j] >= 0:
        force += row[pl.L_FORCE] * x[P.aux_of_link[j]]
    return force


@inlined
def link_forces(P, x, w, contact, t, base, base_rate):
    """Forces of the links beyond spring and damper."""
    for j in range(P.link.shape[0]):
        row = P.link[j]
        s, rate = stretch_of(P, x, j, base, base_rate)
        force = force_beside(P, x, j, s, rate, t)
        aux = P.aux_of_link[j]
        if aux >= 0:
            channel = pl.CH_F + P.n_bodies + aux - (P.position + 2 * P.n_bodies)
            w[channel] += laws.bouc_wen_rate(x[aux], rate, row[pl.L_DISPLACEMENT])
        push(P, w, contact, P.link_ends[j, 1], -force)
        push(P, w, contact, P.link_ends[j, 0], force)


@inlined
def body_forces(P, x, w):
    """Forces on single bodies: asymmetric viscous friction, cogging, constant loads."""
    for i in range(P.n_bodies):
        row = P.body[i]
        effort = row[pl.B_LOAD]
        if row[pl.B_DIFFERENCE] != 0.0:
            effort += laws.asymmetric_friction(x[P.position + P.n_bodies + i], row[pl.B_DIFFERENCE])
        if row[pl.B_COGGING] != 0.0:
            effort += laws.periodic(x[P.position + i], row[pl.B_COGGING], row[pl.B_WAVE], row[pl.B_PHASE])
        w[pl.CH_F + i] += effort


@inlined
def circuit_forces(P, x, w):
    """Torque ripple on the rotor, and the voltage that a warm winding eats."""
    C = P.circuit
    i = x[P.current]
    if C[pl.C_RIPPLE] != 0.0 and P.rotor >= 0:
        angle = x[P.position + P.rotor]
        w[pl.CH_F + P.rotor] += C[pl.C_KT] * i * laws.periodic(angle, C[pl.C_RIPPLE], C[pl.C_PERIODS], C[pl.C_PHASE])
    if P.heat >= 0:
        y = x[P.heat]
        w[pl.CH_V] -= C[pl.C_R] * y * i
        # the decay -y/tau is linear and stands in A; the winding's channel is the last one
        w[w.shape[0] - 1] += laws.heating_rate(0.0, i, C[pl.C_R], C[pl.C_HEAT], C[pl.C_TAU])


@inlined
def slip_forces(P, x, mode, w, contact, base_rate):
    """Forces of the friction contacts that slip; those that stick are solved for in the step."""
    for c in range(P.friction.shape[0]):
        direction = mode[1 + c]
        if direction != 0:
            a, b = P.friction_ends[c, 0], P.friction_ends[c, 1]
            rate = end_velocity(P, x, b, base_rate) - end_velocity(P, x, a, base_rate)
            row = P.friction[c]
            level = laws.friction_level(abs(rate), row[pl.F_COULOMB], row[pl.F_STRIBECK], row[pl.F_SPEED])
            push(P, w, contact, b, -direction * level)
            push(P, w, contact, a, direction * level)


@inlined
def add_forces(P, x, mode, w, contact, t, theta_d, theta_d_rate):
    """Add to the channels ``w`` everything that acts beside the linear plant at state ``x`` and time ``t``."""
    base, base_rate = 0.0, 0.0
    if P.has_base:
        base, base_rate = base_motion(P, x, contact, theta_d, theta_d_rate)
        if P.screw[pl.S_AMPLITUDE] != 0.0:
            w[pl.CH_D] += base - P.screw[pl.S_LEAD] * theta_d
            w[pl.CH_DD] += base_rate - P.screw[pl.S_LEAD] * theta_d_rate
    link_forces(P, x, w, contact, t, base, base_rate)
    body_forces(P, x, w)
    if P.current >= 0:
        circuit_forces(P, x, w)
    slip_forces(P, x, mode, w, contact, base_rate)
