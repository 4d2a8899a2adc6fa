"""Open-loop simulation of a rig: commands in, sensors out."""

from dataclasses import dataclass

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.effects import slots
from dtbacklash.physics.kernel.plant import Plant, State, new_state, place_at
from dtbacklash.physics.kernel.simulation import run, sense
from dtbacklash.physics.rig import Rig


@dataclass(frozen=True)
class Response:
    """A simulation at the N+1 sampling instants: sensors by name (SI), states, the screw's angle."""

    t_s: Floats
    sensors: dict[str, Floats]
    states: Floats
    theta_d_rad: Floats


def simulate_plant(
    plant: Plant, u: Floats, gap_rad: Floats, theta_m_rad: Floats
) -> tuple[Floats, Floats, Floats, State]:
    """Simulate a compiled plant from rest.

    Parameters
    ----------
    u : (N,) commands, each held over a sample, V. gap_rad : (N+1,) half-gap. theta_m_rad : (N+1,) the motor's
        angle (or the positioner's command) where the plant was compiled with ``imposed``.

    Returns
    -------
    sensors (N+1, sensors) in SI, states (N+1, n), theta_d (N+1,), and the last state.
    """
    state = new_state(plant)
    if plant.imposed:
        place_at(plant, state, theta_m_rad[0])
    y = np.zeros((len(u) + 1, len(plant.sensor)))
    x = np.zeros((len(u) + 1, plant.A.shape[1]))
    theta_d = np.zeros(len(u) + 1)
    sense(plant, state, gap_rad[0], 0.0, y[0])
    run(plant, state, u, gap_rad, theta_m_rad, y, x, theta_d)
    return y, x, theta_d, state


def simulate(
    rig: Rig,
    u: Floats,
    sample_time_s: float,
    gap_rad: Floats | None = None,
    theta_m_rad: Floats | None = None,
    substeps: int = 0,
    event_levels: int = 16,
) -> Response:
    """Simulate a rig from rest for given commands.

    Parameters
    ----------
    u : (N,) commands, V. sample_time_s : s.
    gap_rad : (N+1,) gap added to the rig's own half-gap, rad; None for none.
    theta_m_rad : (N+1,) the motor's angle, if it is given instead of simulated; a positioner follows the command.
    """
    n = len(u)
    own = rig_half_gap(rig)
    gap = np.full(n + 1, own) if gap_rad is None else np.ascontiguousarray(gap_rad, dtype=float) + own
    imposed = theta_m_rad is not None
    if rig.only("positioner"):
        theta_m_rad = np.append(u, u[-1:])
    theta = np.zeros(n + 1) if theta_m_rad is None else np.ascontiguousarray(theta_m_rad, dtype=float)
    plant = compile_plant(rig, sample_time_s, substeps, event_levels, imposed)
    y, x, theta_d, _ = simulate_plant(plant, np.ascontiguousarray(u, dtype=float), gap, theta)
    sensors = {name: y[:, j] for j, name in enumerate(rig.sensors)}
    return Response(sample_time_s * np.arange(n + 1, dtype=np.float64), sensors, x, theta_d)


def simulate_roughly(rig: Rig, u: Floats, sample_time_s: float) -> Response:
    """Like :func:`simulate`, as finely as is enough to compare models or commands with one another."""
    return simulate(rig, u, sample_time_s, substeps=2, event_levels=4)


def rig_half_gap(rig: Rig) -> float:
    """The half-gap of the rig's own backlash, rad; a profile adds to it."""
    gear = rig.only("gear")
    return rig.amount(gear.name, slots.GearPlay, "half_gap") if gear else 0.0
