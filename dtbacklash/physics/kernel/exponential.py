"""Exact propagation of a linear plant over a step and its halves: matrix exponentials and their integrals."""

from functools import lru_cache

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.core.library import buffer, lib

#: plants whose propagation is kept: rigs that are compared mostly differ by their laws, and share the linear part
KEPT = 256


def discretise(A: Floats, G: Floats, step_s: float, levels: int) -> tuple[Floats, Floats, Floats]:
    """Transition matrices and input responses (all transposed) for steps ``step_s / 2**level``.

    A (modes, n, n), G (modes, channels, n). ``E = e^{Ah}``, ``P1 = h phi_1(Ah) G``, ``P2 = h phi_2(Ah) G``: (modes,
    levels, n or channels, n), read-only. Source: ``core/exponential.c``.
    """
    return _discretised(A.tobytes(), A.shape, G.tobytes(), G.shape, step_s, levels)


@lru_cache(KEPT)
def _discretised(
    a: bytes, of_a: tuple[int, ...], g: bytes, of_g: tuple[int, ...], step_s: float, levels: int
) -> tuple[Floats, Floats, Floats]:
    """a, g : A and G, whose shapes are given."""
    modes, channels, n = of_g
    E = np.empty((modes, levels, n, n))
    P1, P2 = np.empty((2, modes, levels, channels, n))
    A, G = np.frombuffer(a), np.frombuffer(g)
    lib.dtb_discretise(
        modes, n, channels, levels, buffer(A, A.size), buffer(G, G.size), step_s,
        buffer(E), buffer(P1), buffer(P2), buffer(np.empty((5, n, n))),
    )  # fmt: skip
    for M in (E, P1, P2):
        M.setflags(write=False)
    return E, P1, P2
