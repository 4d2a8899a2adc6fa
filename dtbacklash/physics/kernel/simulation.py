"""A plant as the core simulates it: from a state, along commands, and what its sensors show."""

from dtbacklash.arrays import Floats
from dtbacklash.core.library import buffer, lib
from dtbacklash.physics.kernel.plant import Plant, State
from dtbacklash.physics.kernel.structs import plant_struct, state_struct


def sense(P: Plant, S: State, gap: float, gap_rate: float, y: Floats) -> None:
    """Write what every sensor shows at this sample into ``y`` (sensors,): delayed, scaled and offset, no noise."""
    lib.dtb_sense(plant_struct(P), state_struct(S), gap, gap_rate, buffer(y, len(P.sensor)))


def run(P: Plant, S: State, u: Floats, gap: Floats, theta: Floats, y: Floats, x: Floats, theta_d: Floats) -> None:
    """Simulate N samples from a state.

    Parameters
    ----------
    u : (N,) commands, each held over a sample. gap : (N + 1,) half-gap, rad. theta : (N + 1,) what is imposed.
    y (N + 1, sensors), x (N + 1, states), theta_d (N + 1,) : filled from their second rows on with what sensors show,
    states, and the screw's angle, rad.
    """
    n = len(u)
    lib.dtb_run(
        plant_struct(P), state_struct(S), n, buffer(u, n), buffer(gap, n + 1), buffer(theta, n + 1), n + 1,
        buffer(y, n + 1, len(P.sensor)), buffer(x, n + 1, len(S.x)), buffer(theta_d, n + 1),
    )  # fmt: skip


def amplify(P: Plant, u: Floats, out: Floats) -> None:
    """What the amplifier makes of each command (N,), into ``out``."""
    lib.dtb_amplified(plant_struct(P), buffer(u, len(u)), len(u), buffer(out, len(u)))
