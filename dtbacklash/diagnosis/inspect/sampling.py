"""Whether the sampling can carry what is asked: samples per period of the rig's modes that the recording shows.

A mode matters where the nominal rig, driven by the recorded command, shows more of it in a recorded motion than the
sensor's noise: a stiff coupling at many times the sampling rate does not.
"""

from dataclasses import dataclass

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.resampling import noise_of
from dtbacklash.diagnosis.records import Record
from dtbacklash.errors import UserError
from dtbacklash.physics.bodies import natural_frequencies_hz
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate
from dtbacklash.recording.plausible import plain_rig

#: with fewer a measured angle, linear between samples, drives a mode wrongly by more than a tenth (samples per period)
MODE_SAMPLES_MIN = 6.0
#: from this share of its frequency on, power belongs to a mode: damping widens it (share)
MODE_BAND_SHARE = 0.7

#: samples that are looked at
SAMPLES_MAX = 20_000
#: steps of a sample in which the nominal rig is simulated
FINE = 8


@dataclass(frozen=True)
class Carried:
    """The fastest mode that matters, Hz, and how many samples a period of it has; None if no mode matters."""

    frequency_hz: float | None
    per_period: float

    @property
    def enough(self) -> bool:
        """Whether the sampling carries it."""
        return self.per_period >= MODE_SAMPLES_MIN


def carried(rig: Rig, record: Record) -> Carried:
    """The fastest of the rig's modes that its recorded channels show, against the sampling."""
    step = record.sample_time_s
    modes = sorted(map(float, natural_frequencies_hz(rig)), reverse=True)
    fast = [f for f in modes if f * step * MODE_SAMPLES_MIN > 1.0]
    try:
        shown = _response(rig, record) if fast else {}
    except UserError:
        modes = []
    noise = {name: noise_of(record.y[name])[0] for name in shown} if modes else {}
    for f in modes:
        if f not in fast or any(_rms_above(shown[n], MODE_BAND_SHARE * f, step / FINE) > noise[n] for n in noise):
            return Carried(f, 1.0 / (f * step))
    return Carried(None, 2.0 * MODE_SAMPLES_MIN)


def _response(rig: Rig, record: Record) -> dict[str, Floats]:
    """Recorded motions as the nominal rig shows them, in steps of a sample's ``FINE``-th part."""
    u = np.repeat(record.u[: SAMPLES_MAX // FINE], FINE)
    found = simulate(plain_rig(rig), u, record.sample_time_s / FINE).sensors
    moving = [n for n in record.y if n in rig.sensors and rig.sensors[n].quantity in ("position", "velocity")]
    if rig.only("screw"):  # the modes are those behind it
        moving = [n for n in moving if not rig.elements[rig.sensors[n].of].trait.motor_side]
    return {n: found[n] for n in moving}


def _rms_above(values: Floats, frequency_hz: float, step_s: float) -> float:
    """What a signal holds above a frequency, rms; differenced first, so that its slow parts do not leak."""
    from scipy.signal import welch

    if not np.isfinite(values).all():
        return 0.0
    at, power = welch(np.diff(values), 1.0 / step_s, "blackmanharris", min(len(values) - 1, 4096))
    high = at >= frequency_hz
    return float(np.sqrt(np.sum(power[high] / (2.0 * np.sin(np.pi * at[high] * step_s)) ** 2) * (at[1] - at[0])))
