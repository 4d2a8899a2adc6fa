"""The closed loop: plant, sensors, controller and novelty index, sample by sample, in the core (``loop.c``)."""

from typing import Any, NamedTuple

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.control.laws import Controller, ControllerState, controller_state_struct, controller_struct
from dtbacklash.core.library import buffer, ffi, lib, struct
from dtbacklash.physics.kernel.plant import Plant, State
from dtbacklash.physics.kernel.structs import plant_struct, state_struct
from dtbacklash.twin.gap.novelty import lock_in_struct

#: why a segment ended; ALARM and the place of a novelty index: it has risen
RAN, NOVELTY, DIVERGED, ALARM = lib.RAN, lib.NOVELTY, lib.DIVERGED, lib.ALARM


class Signals(NamedTuple):
    """What goes into a run, (N+1,) each: reference (m, or V in open loop), half-gap rad, noise (N+1, sensors) SI.

    ``noise`` may have no rows: then there is none. ``resolution`` (sensors,): size of a count, 0 for none. ``moving`` :
    -1, 0 or 1, how the reference moves, where it is known ahead; else empty.
    """

    reference: Floats
    gap: Floats
    noise: Floats
    resolution: Floats
    moving: Floats = np.zeros(0)


class Traces(NamedTuple):
    """What comes out: (N+1,) voltage, theta_d, gap estimate, prediction error, novelty; (N+1, sensors) the rest."""

    u: Floats
    theta_d: Floats
    gap_hat: Floats
    eps: Floats
    novelty: Floats
    truth: Floats
    seen: Floats


class GapInForce(NamedTuple):
    """The believed half-gap: ``gap`` rad at sample ``since``, growing by ``growth`` a sample."""

    gap: float
    growth: float = 0.0
    since: int = 0


def run_segment(
    P: Plant, S: State, C: Controller, X: ControllerState, detector: Floats, oscillator: tuple[Floats, float, float],
    signals: Signals, traces: Traces, roles: tuple[int, int], first: int, stop: int, in_force: GapInForce,
    limits: tuple[float, float], before: float, indexes: Any = None,
) -> tuple[int, int]:  # fmt: skip
    """Run the samples ``first <= k < stop``.

    roles : sensors (index or -1) that show theta_m and q3. oscillator : (sos, cos_step, sin_step) of the lock-in filter
        and ``detector`` its state. limits : |q3| that counts as diverged, m, and the novelty that ends the segment, m
        (inf for never). before : novelty before the first sample, m; it has to rise through its limit. indexes : of
        :func:`.indexes.indexes_struct`, which then end the segment as well; None for none.

    Raises ValueError: arrays that are not of the run's samples and of the plant's sensors.

    Returns (k, why) : the sample after the last one that was run, and RAN, NOVELTY, DIVERGED, or ALARM and the place of
    an index.
    """
    segment = struct(
        "Segment", first=first, stop=stop, theta_m=roles[0], q3=roles[1], gap=in_force.gap, growth=in_force.growth,
        since=in_force.since, largest=limits[0], novelty=limits[1], before=before,
    )  # fmt: skip
    n, sensors, noisy, ahead = len(signals.gap), len(P.sensor), len(signals.noise) > 0, len(signals.moving) > 0
    if not 0 <= first <= stop <= n or n < 2:
        raise ValueError(f"samples {first} to {stop} of {n}")
    shapes = {
        "noise": (n if noisy else 0, sensors), "resolution": (sensors,), "moving": (n if ahead else 0,),
        "truth": (n, sensors), "seen": (n, sensors),
    }  # fmt: skip
    given = struct("Signals", **_buffers(signals, n, shapes), samples=n, sensors=sensors, noisy=noisy, ahead=ahead)
    made = struct("Traces", **_buffers(traces, n, shapes))
    why = ffi.new("int64_t *")
    after = lib.dtb_run_loop(
        plant_struct(P), state_struct(S), controller_struct(C), controller_state_struct(X),
        lock_in_struct(detector, *oscillator), ffi.NULL if indexes is None else indexes, given, made, segment, why,
    )  # fmt: skip
    return int(after), int(why[0])


def _buffers(arrays: Signals | Traces, samples: int, shapes: dict[str, tuple[int, ...]]) -> dict[str, Any]:
    """The arrays as the core takes them. shapes : of those that do not have one number for each sample."""
    return {name: buffer(array, *shapes.get(name, (samples,))) for name, array in arrays._asdict().items()}
