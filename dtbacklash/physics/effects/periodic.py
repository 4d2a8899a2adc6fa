"""Laws that are periodic in a position: cogging, the ripple of a torque or of a lead, gravity."""

import math


def periodic(position, amplitude, wave_number, phase):
    """``amplitude sin(wave_number position + phase)``: cogging, the ripple of a torque or of a lead."""
    return amplitude * math.sin(wave_number * position + phase)


def periodic_slope(position, amplitude, wave_number, phase):
    """Derivative of :func:`periodic` by position."""
    return amplitude * wave_number * math.cos(wave_number * position + phase)
