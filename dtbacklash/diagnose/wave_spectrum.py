"""Which wave numbers are worth a regression, of all that the travel tells apart: a spectrum over the position.

What a residual says of a force ``sin(n q)`` is its correlation with the response to it. The response is a filter: so
the residual is filtered back to the force once, and correlated with all waves at once by a Fourier transform over the
position, of samples that are spread over it unevenly (gridding: A. Dutt and V. Rokhlin, SIAM J. Sci. Comput. 14 (1993)
1368). How large a response is follows from how fast the waves are passed. Along a chirp that is a rough measure, good
enough to choose what is regressed.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import solve_toeplitz
from scipy.signal import freqz, lfilter

from dtbacklash.arrays import Floats

#: a wave of the highest number has so many cells of the grid over the position
CELLS = 16
#: order of the autoregression that whitens
ORDER = 8
#: white noise, relative to the residual, below which nothing is told apart
RIDGE = 1e-6
#: speeds, from this share of the fastest on, are told apart in so many classes: short waves show where a motion turns
SLOW, SPEEDS = 1e-5, 100


@dataclass(frozen=True)
class Passage:
    """What a recording says of waves.

    q, w : (N,) the position, and what the wave is multiplied by. counted : whether waves are counted from 0.
    rows : (channels, n) the residual at every ``every``-th sample, weighted, 0 where it is not fitted to.
    weights : (channels,) of the responses.
    """

    q: Floats
    w: Floats
    counted: bool
    rows: Floats
    weights: Floats


def likely_waves(
    waves: Floats, passages: list[Passage], response: tuple[Floats, Floats], every: int, count: int
) -> Floats:
    """The wave numbers of the highest peaks, and those beside them, ``count`` at most in all.

    Parameters
    ----------
    waves : (n,) all that the travel tells apart, evenly spaced. response : numerators (channels, order + 1) and
    denominator, from the force to the channels, of a sample as long as ``every`` of the recording's.
    """
    along, across = np.zeros(len(waves), dtype=complex), np.zeros(len(waves))
    for passage in passages:
        white, filters = _whitened(passage, response[0])
        along += _correlation(waves, white, (filters, response[1]), every)
        across += _energy(waves, white, (filters, response[1]), every)
    gain = np.abs(along) ** 2 / np.maximum(across, 1e-12 * max(float(across.max()), 1e-300))
    ends = np.concatenate([[-np.inf], gain, [-np.inf]])
    peaks = np.flatnonzero((gain >= ends[:-2]) & (gain >= ends[2:]))
    highest = peaks[np.argsort(-gain[peaks])][: count // 3]
    chosen = np.unique(np.clip(np.concatenate([highest - 1, highest, highest + 1]), 0, len(waves) - 1))
    found: Floats = waves[chosen]
    return found


def _whitened(passage: Passage, numerators: Floats) -> tuple[Passage, Floats]:
    """A passage whose residual is white, and the numerators (channels, order + 1) of responses that are filtered alike.

    The autoregression is that of Yule and Walker. What follows a stretch that is not fitted to is left out until the
    filter has forgotten the jump.
    """
    kept = np.any(passage.rows != 0.0, axis=0)
    sure = np.convolve(kept, np.ones(ORDER + 1), "full")[: len(kept)] > ORDER + 0.5
    rows, filters = np.zeros_like(passage.rows), np.zeros((len(numerators), numerators.shape[1] + ORDER))
    length = next_fast_len(2 * len(kept), real=True)
    for j, row in enumerate(passage.rows):
        covariance = irfft(np.abs(rfft(row, length)) ** 2, length)[: ORDER + 1]
        whitening = np.ones(ORDER + 1)
        if covariance[0] > 0.0:
            covariance[0] *= 1.0 + RIDGE
            whitening[1:] = -solve_toeplitz(covariance[:-1], covariance[1:])
        rows[j] = np.where(sure, np.convolve(row, whitening)[: len(row)], 0.0)
        filters[j] = np.convolve(numerators[j], whitening)
    return replace(passage, rows=rows), filters


def _correlation(waves: Floats, passage: Passage, response: tuple[Floats, Floats], every: int) -> Floats:
    """(waves,) complex: the residual's correlation with the responses to a cosine and, imaginary, to a sine."""
    numerators, denominator = response
    back = np.zeros(passage.rows.shape[1])
    for b, row, weight in zip(numerators, passage.rows, passage.weights, strict=True):
        back += weight * np.asarray(lfilter(b, denominator, row[::-1]))[::-1]
    force = np.repeat(back / every, every)
    n = len(force)
    q, force = passage.q[:n], force * passage.w[:n]
    cell = 2.0 * np.pi / (CELLS * float(waves[-1]))
    length = next_fast_len(max(int(np.ptp(q) / cell) + 2, int(4.0 * np.pi / (float(waves[1] - waves[0]) * cell))))
    at = (q - q.min()) / cell
    below = at.astype(int)
    share = at - below
    grid = np.bincount(below, force * (1.0 - share), length) + np.bincount(below + 1, force * share, length)
    spectrum = np.conj(rfft(grid[:length]))
    spaced = 2.0 * np.pi / (length * cell)
    found: Floats = spectrum[np.clip(np.round(waves / spaced).astype(int), 0, len(spectrum) - 1)]
    if passage.counted:
        found = found * np.exp(1j * waves * float(q.min())) - force.sum()
    return found


def _energy(waves: Floats, passage: Passage, response: tuple[Floats, Floats], every: int) -> Floats:
    """(waves,) mean square of the response to a wave, times the samples: each is passed at the speed of its sample."""
    numerators, denominator = response
    kept = np.any(passage.rows != 0.0, axis=0)
    n = len(kept) * every
    speed = np.abs(np.gradient(passage.q))[:n:every][kept]
    size = (passage.w[:n:every][kept]) ** 2
    fastest = max(float(speed.max(initial=0.0)), 1e-300)
    edges = np.concatenate([[0.0], np.geomspace(SLOW * fastest, fastest, SPEEDS)])
    often = np.histogram(speed, edges, weights=size)[0]
    total = np.zeros(len(waves))
    for middle, weight in zip(0.5 * (edges[1:] + edges[:-1]), often, strict=True):
        if weight > 0.0:
            turned = np.minimum(waves * middle * every, np.pi)
            averaged = np.sinc(waves * middle * every / (2.0 * np.pi)) ** 2
            for b in numerators * passage.weights[:, None]:
                total += 0.5 * weight * averaged * np.abs(freqz(b, denominator, turned)[1]) ** 2
    return total
