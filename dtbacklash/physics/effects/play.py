"""The play operator: backlash, wherever it is."""


def play(theta_d, theta_m, half_gap):
    """Next output of the play operator: the screw stays until the motor's tooth pushes it.

    rad -> rad; Krasnosel'skii & Pokrovskii, Systems with Hysteresis (1989). It is the paper's Eqs (16)-(17).
    """
    return min(max(theta_d, theta_m - half_gap), theta_m + half_gap)
