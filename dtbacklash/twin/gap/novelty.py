"""The novelty index: instantaneous amplitude of the dominant mode in the prediction error, eqs (19)-(21).

The error is multiplied by cosine and sine of omega_d t, both products pass the same third-order low-pass
filter, and the magnitude of the two is the amplitude. The multiplication moves a constant error to omega_d.
The paper asks for a third-order IIR filter with its cut-off at omega_d/2 and a stopband of 40 dB at omega_d. The
elliptic filter of 3 dB ripple and a 40 dB stopband ('ellip') has both: -3 dB at 0.500 omega_d, -40.9 dB at omega_d;
with 1 dB of ripple it would be 28 dB down there. Chebyshev II ('cheby2') keeps the 40 dB with a flat passband, and has
its cut-off at 0.33 omega_d.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtbacklash.config.choices import NOVELTY_FILTERS
from dtbacklash.core.library import buffer, lib, struct
from dtbacklash.errors import UserError

Array = NDArray[np.float64]

ORDER = 3
STOPBAND_DB = 40.0
#: of the elliptic filter's passband: its edge is then the usual -3 dB cut-off, and 40 dB are reached before twice that
RIPPLE_DB = 3.0


@dataclass(frozen=True)
class NoveltyDesign:
    """The low-pass filter's second-order sections, (sections, 6), and the oscillator's step exp(i w_d Ts).

    Sections and not one polynomial: at 1 kHz and a cut-off of a few hertz all poles lie next to z = 1.
    """

    sos: Array
    cos_step: float
    sin_step: float

    def initial_state(self) -> Array:
        """State of :func:`novelty_index` at t = 0: oscillator at phase 0, filters at rest; at its end both channels."""
        state = np.zeros(2 + 4 * self.sos.shape[0] + 2)
        state[0] = 1.0
        return state


def novelty_design(kind: str, frequency_rad_s: float, sample_time_s: float) -> NoveltyDesign:
    """The lock-in filter at omega_d = frequency_rad_s.

    kind 'ellip': elliptic, 3 dB ripple up to its edge omega_d/2, 40 dB stopband from below omega_d on; 'cheby2':
    Chebyshev II, 40 dB from omega_d on. UserError for another kind, or if sampling is too slow.
    """
    from scipy.signal import cheby2, ellip

    nyquist = np.pi / sample_time_s
    if not 0.0 < frequency_rad_s < nyquist:
        allowed = f"sampling above twice the dominant mode's {frequency_rad_s / (2 * np.pi):.3g} Hz"
        raise UserError("sample_time_s", sample_time_s, allowed)
    if kind == "ellip":
        sos = ellip(ORDER, RIPPLE_DB, STOPBAND_DB, 0.5 * frequency_rad_s / nyquist, output="sos")
    elif kind == "cheby2":
        sos = cheby2(ORDER, STOPBAND_DB, frequency_rad_s / nyquist, output="sos")
    else:
        raise UserError("twin.novelty_filter", kind, "one of " + ", ".join(NOVELTY_FILTERS))
    phase = frequency_rad_s * sample_time_s
    return NoveltyDesign(np.ascontiguousarray(sos), float(np.cos(phase)), float(np.sin(phase)))


def lock_in_struct(state: Array, sos: Array, cos_step: float, sin_step: float) -> Any:
    """The lock-in filter and its state, from :meth:`NoveltyDesign.initial_state`, as the core takes them."""
    n = len(sos)
    arrays = {"sos": buffer(sos, n, 6), "state": buffer(state, 2 + 4 * n + 2)}
    return struct("LockIn", sections=n, cos_step=cos_step, sin_step=sin_step, **arrays)


def novelty_index(errors: Array, sos: Array, cos_step: float, sin_step: float, state: Array) -> Array:
    """(N,) amplitudes of the mode along a record (N,) of prediction errors, in their unit.

    state : from :meth:`NoveltyDesign.initial_state`, changed in place: the next record goes on from there.
    """
    errors = np.ascontiguousarray(errors, dtype=float)
    out = np.empty_like(errors)
    lib.dtb_lock_in(lock_in_struct(state, sos, cos_step, sin_step), len(errors), buffer(errors), buffer(out))
    return out
