"""Which wave numbers are worth a regression, of all that the travel tells apart: a spectrum over the position.

What a residual says of a force ``sin(n q)`` is its correlation with the response to it. The response is a filter: so
the residual is filtered back to the force once, and correlated with all waves at once by a Fourier transform over the
position, of samples that are spread over it unevenly (gridding: A. Dutt and V. Rokhlin, SIAM J. Sci. Comput. 14 (1993)
1368). How large a response is changes smoothly with the wave number: that of a few tells. What else is left is slow
and large: it is whitened, and the responses alike.
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.responses import Path, Response, wave_responses

#: a wave of the highest number has so many cells of the grid over the position
CELLS = 16
#: order of the autoregression that whitens
ORDER = 8
#: white noise, relative to the residual, below which nothing is told apart
RIDGE = 1e-6
#: the responses to so many waves are simulated; their sizes between are interpolated
SIMULATED = 40


@dataclass(frozen=True)
class Passage:
    """What a recording says of waves.

    path : the position that they are over. rows : (channels, n) the residual at every ``every``-th sample, weighted, 0
    where it is not fitted to.
    """

    path: Path
    rows: Floats


def likely_waves(waves: Floats, passages: list[Passage], response: Response, every: int, count: int) -> Floats:
    """The wave numbers of the highest peaks, and those beside them, ``count`` at most in all.

    Parameters
    ----------
    waves : (n,) all that the travel tells apart, evenly spaced. response : from the force to the channels, weighted as
    the rows are, of a sample as long as ``every`` of the recording's.
    """
    along, across = np.zeros(len(waves), dtype=complex), np.zeros(len(waves))
    for passage in passages:
        rows, filters = _whitened(passage.rows, response)
        along += _correlation(waves, passage.path, rows, filters, every)
        across += _energy(waves, passage.path, rows, filters, every)
    gain = np.abs(along) ** 2 / np.maximum(across, 1e-12 * max(float(across.max()), 1e-300))
    ends = np.concatenate([[-np.inf], gain, [-np.inf]])
    peaks = np.flatnonzero((gain >= ends[:-2]) & (gain >= ends[2:]))
    highest = peaks[np.argsort(-gain[peaks])][: count // 3]
    chosen = np.unique(np.clip(np.concatenate([highest - 1, highest, highest + 1]), 0, len(waves) - 1))
    found: Floats = waves[chosen]
    return found


def _whitened(rows: Floats, response: Response) -> tuple[Floats, Response]:
    """The rows made white, and the response filtered alike.

    The autoregression is that of Yule and Walker. What follows a stretch that is not fitted to is left out until the
    filter has forgotten the jump.
    """
    numerators, denominator = response
    kept = np.any(rows != 0.0, axis=0)
    sure = np.convolve(kept, np.ones(ORDER + 1), "full")[: len(kept)] > ORDER + 0.5
    white, filters = np.zeros_like(rows), np.zeros((len(numerators), numerators.shape[1] + ORDER))
    length = next_fast_len(2 * len(kept), real=True)
    for j, row in enumerate(rows):
        covariance = irfft(np.abs(rfft(row, length)) ** 2, length)[: ORDER + 1]
        whitening = np.ones(ORDER + 1)
        if covariance[0] > 0.0:
            covariance[0] *= 1.0 + RIDGE
            whitening[1:] = -solve_toeplitz(covariance[:-1], covariance[1:])
        white[j] = np.where(sure, np.convolve(row, whitening)[: len(row)], 0.0)
        filters[j] = np.convolve(numerators[j], whitening)
    return white, (filters, denominator)


def _correlation(waves: Floats, path: Path, rows: Floats, response: Response, every: int) -> Floats:
    """(waves,) complex: the residual's correlation with the responses to a cosine and, imaginary, to a sine."""
    (numerators, denominator), (q, w, counted) = response, path
    back = np.zeros(rows.shape[1])
    for b, row in zip(numerators, rows, strict=True):
        back += np.asarray(lfilter(b, denominator, row[::-1]))[::-1]
    force = np.repeat(back / every, every)
    n = len(force)
    q, force = q[:n], force * w[:n]
    cell = 2.0 * np.pi / (CELLS * float(waves[-1]))
    length = next_fast_len(max(int(np.ptp(q) / cell) + 2, int(4.0 * np.pi / (float(waves[1] - waves[0]) * cell))))
    at = (q - q.min()) / cell
    below = at.astype(int)
    share = at - below
    grid = np.bincount(below, force * (1.0 - share), length) + np.bincount(below + 1, force * share, length)
    spectrum = np.conj(rfft(grid[:length]))
    spaced = 2.0 * np.pi / (length * cell)
    found: Floats = spectrum[np.clip(np.round(waves / spaced).astype(int), 0, len(spectrum) - 1)]
    if counted:
        found = found * np.exp(1j * waves * float(q.min())) - force.sum()
    return found


def _energy(waves: Floats, path: Path, rows: Floats, response: Response, every: int) -> Floats:
    """(waves,) sum of the squared response to a wave over what is fitted to, the mean of a sine's and a cosine's."""
    kept = np.any(rows != 0.0, axis=0)
    some = np.geomspace(waves[0], waves[-1], SIMULATED)
    energy = np.zeros(SIMULATED)
    with np.errstate(over="ignore", invalid="ignore"):  # along a simulated path that ran away
        for shape in (0, 1):
            energy += 0.5 * np.sum(wave_responses(some, shape, [path], response, every)[:, :, kept] ** 2, axis=(0, 2))
    energy = np.log(np.clip(np.nan_to_num(energy, nan=0.0), 1e-300, 1e300))
    between: Floats = np.exp(np.interp(np.log(waves), np.log(some), energy))
    return between
