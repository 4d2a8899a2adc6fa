"""Exact propagation of a linear plant over a step and its halves: matrix exponentials and their integrals."""

import math
from functools import lru_cache

import numpy as np

from dtbacklash.arrays import Floats

#: terms of the Taylor series of the matrix functions: the first one left out is below 1e-19 at |A| h = 1/2
TAYLOR_TERMS = 16
#: plants whose propagation is kept: rigs that are compared mostly differ by their laws, and share the linear part
KEPT = 256


def discretise(A: Floats, G: Floats, step_s: float, levels: int) -> tuple[Floats, Floats, Floats]:
    """Transition matrices and input responses (all transposed) for steps ``step_s / 2**level``.

    ``E = e^{Ah}``, ``P1 = h phi_1(Ah) G``, ``P2 = h phi_2(Ah) G`` by their Taylor series where ``|A| h < 1/2``, and
    by doubling for longer steps (scaling and squaring; Higham, Functions of Matrices (2008), ch. 10).
    What comes out is read-only.
    """
    return _discretised(A.tobytes(), A.shape, G.tobytes(), G.shape, step_s, levels)


@lru_cache(KEPT)
def _discretised(
    a: bytes, of_a: tuple[int, ...], g: bytes, of_g: tuple[int, ...], step_s: float, levels: int
) -> tuple[Floats, Floats, Floats]:
    """a, g : A and G, whose shapes are given."""
    A, G = np.frombuffer(a).reshape(of_a), np.frombuffer(g).reshape(of_g)
    norm = float(np.abs(A).sum(axis=1).max())
    smallest = max(0, math.ceil(math.log2(max(norm * step_s, 1e-300) / 0.5)))
    depth = max(levels, smallest + 1)
    h = step_s * 0.5 ** np.arange(depth)
    modes, n = A.shape[:2]
    E, F1, F2 = (np.zeros((modes, depth, n, n)) for _ in range(3))
    power = np.broadcast_to(np.eye(n), A.shape)
    for k in range(TAYLOR_TERMS):
        scale = h**k / math.factorial(k)
        term = scale[None, :, None, None] * power[:, None]
        E += term
        F1 += term / (k + 1)
        F2 += term / ((k + 1) * (k + 2))
        power = power @ A
    B = np.swapaxes(G, -1, -2)[:, None]
    scaled = h[None, :, None, None]
    P1, P2 = scaled * (F1 @ B), scaled * (F2 @ B)
    for level in range(smallest - 1, -1, -1):
        e, p1, p2 = E[:, level + 1], P1[:, level + 1], P2[:, level + 1]
        E[:, level] = e @ e
        P1[:, level] = p1 + e @ p1
        P2[:, level] = 0.5 * (e @ p2 + p1 + p2)
    E, P1, P2 = (np.ascontiguousarray(np.swapaxes(M[:, :levels], -1, -2)) for M in (E, P1, P2))
    for M in (E, P1, P2):
        M.setflags(write=False)
    return E, P1, P2
