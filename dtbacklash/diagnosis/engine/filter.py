"""Linear recursions of the predictor, and the gains of a linear plant whose forces are not all known, by the core."""

from typing import Any

import numpy as np

from dtbacklash.arrays import Floats, Ints
from dtbacklash.core.library import buffer, copied, ffi, lib


def frozen(A: Floats, C: Floats, K: Floats, W: Floats, which: Ints, drive: Floats, Y: Floats, x0: Floats) -> float:
    """Sum of squares of the whitened innovations of a linear recursion, without what laws feel of its corrections.

    drive : (N, n) what is added to the state beside A x. Y : (N, m) readings, NaN where one is missing.
    """
    (N, n), m = drive.shape, len(C)
    sum_of_squares: float = lib.dtb_frozen(
        N, n, m, *_recursion(A, C, K, W, which), copied(drive), copied(Y, N, m), buffer(x0.copy(), n), _room(n, m)
    )
    return sum_of_squares


def driven(
    A: Floats, C: Floats, K: Floats, W: Floats, which: Ints, drive: Floats, shown: Floats, missing: np.ndarray
) -> Floats:
    """(N m,) by which whitened innovations change with what is added to the state after each sample, and to readings.

    drive (N, n), shown (N, m). missing : (N, m).
    """
    (N, n), m = drive.shape, len(C)
    E = np.empty(N * m)
    lib.dtb_driven(
        N, n, m, *_recursion(A, C, K, W, which), copied(drive), copied(shown, N, m), _flags(missing, N, m), buffer(E),
        _room(n, m),
    )  # fmt: skip
    return E


def answers(
    A: Floats, C: Floats, K: Floats, W: Floats, which: Ints, F: Floats, b: Floats, c: Floats, missing: np.ndarray,
    at_once: bool,
) -> Floats:  # fmt: skip
    """(J, N m) by which whitened innovations change with efforts F (J, N).

    b (n,) : what an effort over a sample adds to the state. c (m,) : and to the readings behind it, or (at_once) to
    those of its own sample. missing : (N, m).
    """
    N, n, m = F.shape[1], len(A), len(C)
    E, recursion, room = np.empty((len(F), N * m)), _recursion(A, C, K, W, which), _room(n, m)
    entry = copied(b, n), copied(c, m), _flags(missing, N, m), bool(at_once)
    for effort, found in zip(F, E, strict=True):
        lib.dtb_answer(N, n, m, *recursion, copied(effort), *entry, buffer(found), room)
    return E


def riccati(A: Floats, C: Floats, Q: Floats, R: Floats) -> Floats:
    """(n, n) the steady covariance of a predicted state, by the structure-preserving doubling algorithm.

    Raises numpy.linalg.LinAlgError: a matrix on the way is singular.
    """
    n, m = len(A), len(C)
    H = np.empty((n, n))
    _check(lib.dtb_riccati(n, m, *_model(A, C, Q, R), buffer(H), _room(n, m)))
    return H


def opening(A: Floats, C: Floats, Q: Floats, R: Floats, P: Floats, there: np.ndarray) -> tuple[Floats, Floats, float]:
    """Gains (n0, n, m), whitening (n0, m, m) and the sum of log determinants of the first n0 samples.

    P : covariance of the first state. there : (n0, m) whether each reading is. Joseph's form keeps P positive; where it
    has settled, and the same readings are there until the end, so have the gains.

    Raises numpy.linalg.LinAlgError: the covariance of the readings is not positive.
    """
    n0, n, m = len(there), len(A), len(C)
    K, W, logs = np.empty((n0, n, m)), np.empty((n0, m, m)), ffi.new("double *")
    first = buffer(np.array(P, dtype=float, order="C"), n, n)
    _check(
        lib.dtb_opening(
            n0, n, m, *_model(A, C, Q, R), first, _flags(there, n0, m), buffer(K), buffer(W), logs, _room(n, m)
        )
    )
    return K, W, logs[0]


def update(C: Floats, R: Floats, P: Floats, there: np.ndarray) -> tuple[Floats, Floats, float]:
    """Gain (n, m), whitening (m, m) and log determinant of the readings that are there, for a covariance P.

    Raises numpy.linalg.LinAlgError: the covariance of the readings is not positive.
    """
    n, m = len(P), len(C)
    K, W, log = np.empty((n, m)), np.empty((m, m)), ffi.new("double *")
    given = copied(C, m, n), copied(R, m, m), copied(P, n, n), _flags(there, m)
    _check(lib.dtb_update(n, m, *given, buffer(K), buffer(W), log, _room(n, m)))
    return K, W, log[0]


def _recursion(A: Floats, C: Floats, K: Floats, W: Floats, which: Ints) -> tuple[Any, ...]:
    """A linear recursion as the core takes it."""
    n, m, g = len(A), len(C), len(K)
    return copied(A, n, n), copied(C, m, n), copied(K, g, n, m), copied(W, g, m, m), buffer(which)


def _model(A: Floats, C: Floats, Q: Floats, R: Floats) -> tuple[Any, ...]:
    """A linear plant with the covariances of its forces and readings as the core takes them."""
    n, m = len(A), len(C)
    return copied(A, n, n), copied(C, m, n), copied(Q, n, n), copied(R, m, m)


def _flags(array: np.ndarray, *shape: int) -> Any:
    return buffer(np.ascontiguousarray(array, dtype=np.bool_), *shape)


def _room(n: int, m: int) -> Any:
    """Memory to work in with n states and m readings."""
    return buffer(np.empty(lib.dtb_room(n, m)))


def _check(status: int) -> None:
    if status < 0:
        raise np.linalg.LinAlgError("a matrix is singular or not positive")
