"""The laws of the effects: one small compiled function each, in SI, without memory.

Everything that simulates or fits an effect calls the function that stands here; the catalogue names it. States
with memory (the play of the gear, the Bouc-Wen variable, the winding's temperature) appear as arguments, and the
function gives their rate or their next value.
"""

import math

from dtbacklash.compiled import law


@law
def dead_zone(u, half_width):
    """Voltage behind a dead zone: 0 while ``|u| <= half_width``, shifted towards zero outside. V -> V."""
    if u > half_width:
        return u - half_width
    if u < -half_width:
        return u + half_width
    return 0.0


@law
def saturation(u, limit):
    """Voltage clipped to ``[-limit, limit]``. V -> V."""
    return min(max(u, -limit), limit)


@law
def friction_level(speed, coulomb, stribeck, stribeck_speed):
    """Dry friction's magnitude at ``speed >= 0``: ``coulomb + stribeck exp(-(speed/stribeck_speed)^2)``.

    The Gaussian form of the Stribeck curve: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083.
    """
    if stribeck == 0.0:
        return coulomb
    ratio = speed / stribeck_speed
    return coulomb + stribeck * math.exp(-ratio * ratio)


@law
def asymmetric_friction(velocity, viscous_difference):
    """Effort of a viscous friction that differs between directions by ``2 viscous_difference``: ``-d |v|``.

    A Coulomb level that differs between directions is, while sliding, a constant load: it is declared as one.
    """
    return -viscous_difference * abs(velocity)


@law
def periodic(position, amplitude, wave_number, phase):
    """``amplitude sin(wave_number position + phase)``: cogging, the ripple of a torque or of a lead."""
    return amplitude * math.sin(wave_number * position + phase)


@law
def periodic_slope(position, amplitude, wave_number, phase):
    """Derivative of :func:`periodic` by position."""
    return amplitude * wave_number * math.cos(wave_number * position + phase)


@law
def play(theta_d, theta_m, half_gap):
    """Next output of the play operator: the screw stays until the motor's tooth pushes it.

    rad -> rad; Krasnosel'skii & Pokrovskii, Systems with Hysteresis (1989). It is the paper's Eqs (16)-(17).
    """
    return min(max(theta_d, theta_m - half_gap), theta_m + half_gap)


@law
def lost_motion(stretch, half_gap):
    """What is left of a stretch behind a play that springs back to its middle: :func:`play` from rest. m -> m."""
    return play(0.0, stretch, half_gap)


@law
def cubic_stiffness(stretch, k3):
    """Force of a hardening (k3 > 0) or softening spring: ``k3 stretch^3``. m -> N."""
    return k3 * stretch * stretch * stretch


@law
def quadratic_damping(rate, c2):
    """Force of a turbulent damper: ``c2 |rate| rate``. m/s -> N."""
    return c2 * abs(rate) * rate


@law
def bumper(stretch, clearance, stiffness):
    """Force of a one-sided elastic stop that touches at ``stretch = clearance``. m -> N."""
    return stiffness * (stretch - clearance) if stretch > clearance else 0.0


@law
def stiffness_drift(stretch, t, stiffness, rate):
    """Force that a linear spring gains when its stiffness drifts as ``k (1 + rate t)``. m, s -> N."""
    return stiffness * rate * t * stretch


@law
def bouc_wen_rate(z, rate, yield_displacement):
    """Rate of the dimensionless hysteretic variable, n = 1, A = 1, beta = gamma = 1/2; ``|z| <= 1``.

    Bouc (1967), Wen, J. Eng. Mech. 102 (1976) 249. The force is ``force * z``. m/s -> 1/s.
    """
    return (rate - 0.5 * abs(rate) * z - 0.5 * rate * abs(z)) / yield_displacement


@law
def heating_rate(y, current, resistance, gain, time_constant):
    """Rate of the relative rise ``y`` of a winding's resistance: ``(gain R i^2 - y)/time_constant``. A -> 1/s."""
    return (gain * resistance * current * current - y) / time_constant
