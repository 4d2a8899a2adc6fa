"""The wave numbers that are worth a regression, by a spectrum over the position.

The residual is correlated with the responses to forces ``sin(n q)`` of all wave numbers n at once: it is whitened,
filtered back to the force, and Fourier transformed over the position, on which the samples are spread unevenly
(gridding: A. Dutt and V. Rokhlin, SIAM J. Sci. Comput. 14 (1993) 1368). The energy of the responses changes smoothly
with the wave number and is interpolated.
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.responses import Path, Response, wave_responses

#: grid cells per wave of the highest number
CELLS = 16
#: order of the whitening autoregression
ORDER = 8
#: variance of the white noise that is added to the residual, relative to it
RIDGE = 1e-6
#: number of waves whose responses are simulated
SIMULATED = 40


@dataclass(frozen=True)
class Passage:
    """The data of one recording.

    path : of the waves. rows : (channels, n) weighted residual at each ``every``-th sample, 0 where it does not train.
    """

    path: Path
    rows: Floats


def likely_waves(waves: Floats, passages: list[Passage], response: Response, every: int, count: int) -> Floats:
    """The wave numbers of the highest peaks and their neighbours, at most ``count`` in all.

    Parameters
    ----------
    waves : (n,) all wave numbers, evenly spaced. response : from the force to the channels, weighted as the rows are,
    with a sample as long as ``every`` of the recording's.
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
    likely: Floats = waves[chosen]
    return likely


def _whitened(rows: Floats, response: Response) -> tuple[Floats, Response]:
    """The rows whitened by a Yule-Walker autoregression, and the response with the same filter.

    Rows are 0 after a stretch that does not train until the filter has passed its end.
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
    """(waves,) complex: the residual's correlation with the responses to a cosine (real) and a sine (imaginary)."""
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
    """(waves,) sum of the squared response over the training samples, the mean of a sine's and a cosine's."""
    kept = np.any(rows != 0.0, axis=0)
    some = np.geomspace(waves[0], waves[-1], SIMULATED)
    energy = np.zeros(SIMULATED)
    with np.errstate(over="ignore", invalid="ignore"):  # along a simulated path that ran away
        for shape in (0, 1):
            energy += 0.5 * np.sum(wave_responses(some, shape, [path], response, every)[:, :, kept] ** 2, axis=(0, 2))
    energy = np.log(np.clip(np.nan_to_num(energy, nan=0.0), 1e-300, 1e300))
    between: Floats = np.exp(np.interp(np.log(waves), np.log(some), energy))
    return between
