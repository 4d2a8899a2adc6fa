"""Fewer points for drawing, with every peak kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def envelope(t: ArrayLike, y: ArrayLike, bins: int = 1200) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The smallest and the largest sample of each of `bins` equal stretches, in the order of time.

    On paper a line through them cannot be told from a line through all samples, as long as a bin is no wider
    than a pixel or two.

    Args:
        t: times, shape (n,).
        y: values, shape (n,). A NaN in a bin stays a NaN there, which leaves a gap in the line.
        bins: number of stretches.

    Returns:
        Times and values, at most 2*bins + 2 of each; first and last sample are kept. With n <= 2*bins: all.
    """
    times, values = np.asarray(t, dtype=float), np.asarray(y, dtype=float)
    n = times.size
    if n <= 2 * bins:
        return times, values
    size = -(-n // bins)
    full = n // size
    blocks = values[: full * size].reshape(full, size)
    offsets = np.arange(full) * size
    picked = np.concatenate([offsets + blocks.argmin(axis=1), offsets + blocks.argmax(axis=1), [0, n - 1]])
    if full * size < n:
        rest = values[full * size :]
        picked = np.append(picked, [full * size + int(rest.argmin()), full * size + int(rest.argmax())])
    keep = np.unique(picked)
    return times[keep], values[keep]
