"""Linear recursions of the predictor and its gains, written out in numpy: as ``diagnose.engine.filter``."""

import numpy as np

#: by so much a covariance that has settled still changes from sample to sample, a share
SETTLED = 1e-9


def whitened(W, g, d, r):
    """Innovation ``r`` of (m,), whitened by those before it."""
    s = 0.0
    for q in range(r + 1):
        s += W[g, r, q] * d[q]
    return s


def correct(K, g, x, d, new):
    """Fill ``new`` (n,) with a state that is corrected by innovations d (m,)."""
    for i in range(x.shape[0]):
        s = x[i]
        for r in range(d.shape[0]):
            s += K[g, i, r] * d[r]
        new[i] = s


def frozen(A, C, K, W, which, drive, Y, x0):
    """Sum of squares of the whitened innovations of a linear recursion, without what laws feel of its corrections.

    drive : (N, n) what is added to the state beside A x. Y : (N, m) readings, NaN where one is missing.
    """
    N, n, m = drive.shape[0], A.shape[0], C.shape[0]
    x = x0.copy()
    d = np.zeros(m)
    new = np.zeros(n)
    total = 0.0
    for k in range(N):
        g = which[k]
        for r in range(m):
            d[r] = 0.0
            if Y[k, r] == Y[k, r]:
                s = Y[k, r]
                for i in range(n):
                    s -= C[r, i] * x[i]
                d[r] = s
        for r in range(m):
            if Y[k, r] == Y[k, r]:
                s = whitened(W, g, d, r)
                total += s * s
        correct(K, g, x, d, new)
        for i in range(n):
            s = drive[k, i]
            for j in range(n):
                s += A[i, j] * new[j]
            x[i] = s
    return total


def driven(A, C, K, W, which, drive, shown, missing):
    """(N m,) by which whitened innovations change with what is added to the state after each sample, and to readings.

    drive (N, n), shown (N, m). missing : (N, m).
    """
    N, n, m = drive.shape[0], A.shape[0], C.shape[0]
    E, x, new, d = np.zeros(N * m), np.zeros(n), np.zeros(n), np.zeros(m)
    for k in range(N):
        g = which[k]
        for r in range(m):
            s = shown[k, r]
            for i in range(n):
                s += C[r, i] * x[i]
            d[r] = 0.0 if missing[k, r] else -s
        for r in range(m):
            if not missing[k, r]:
                E[k * m + r] = whitened(W, g, d, r)
        correct(K, g, x, d, new)
        for i in range(n):
            s = drive[k, i]
            for q in range(n):
                s += A[i, q] * new[q]
            x[i] = s
    return E


def answers(A, C, K, W, which, F, b, c, missing, at_once):
    """(J, N m) by which whitened innovations change with efforts F (J, N).

    b (n,) : what an effort over a sample adds to the state. c (m,) : and to the readings behind it, or (at_once) to
    those of its own sample. missing : (N, m).
    """
    J, N = F.shape
    E, drive, shown = np.zeros((J, missing.size)), np.zeros((N, len(b))), np.zeros((N, len(c)))
    behind = 0 if at_once else 1
    for j in range(J):
        for k in range(N):
            for i in range(len(b)):
                drive[k, i] = b[i] * F[j, k]
            for r in range(len(c) if k >= behind else 0):
                shown[k, r] = c[r] * F[j, k - behind]
        E[j] = driven(A, C, K, W, which, drive, shown, missing)
    return E


def riccati(A, C, Q, R):
    """(n, n) the steady covariance of a predicted state, by the structure-preserving doubling algorithm.

    Source: Chu, Fan, Lin, Linear Algebra Appl. 396 (2005) 55. It doubles the horizon in each step; what does not settle
    in sixty has stopped mattering to what is read.
    """
    a, g, h = A.T.copy(), C.T @ np.linalg.solve(R, C), Q.copy()
    one = np.eye(len(a))
    for _ in range(60):
        w = one + g @ h
        v = np.linalg.solve(w, a)
        aw = np.linalg.solve(w.T.copy(), a.T.copy()).T
        more = a.T @ h @ v
        a, g, h = aw @ a, g + aw @ g @ a.T, h + more
        g, h = 0.5 * (g + g.T), 0.5 * (h + h.T)
        if not np.abs(more).max() > 1e-10 * np.abs(h).max():
            break
    return h


def opening(A, C, Q, R, P, there):
    """Gains (n0, n, m), whitening (n0, m, m) and the sum of log determinants of the first n0 samples.

    P : covariance of the first state. there : (n0, m) whether each reading is. Joseph's form keeps P positive; where it
    has settled, and the same readings are there until the end, so have the gains.
    """
    n, m, n0 = A.shape[0], C.shape[0], there.shape[0]
    K, W = np.zeros((n0, n, m)), np.zeros((n0, m, m))
    logs, one, last, same = 0.0, np.eye(n), P, n0 - 1
    while same > 0 and (there[same - 1] == there[n0 - 1]).all():
        same -= 1
    for k in range(n0):
        gain, white, log = update(C, R, P, there[k])
        K[k], W[k] = gain, white
        logs += log
        if k > same and settled(P, last):
            K[k:], W[k:] = gain, white
            return K, W, logs + (n0 - 1 - k) * log
        last = P
        M = one - gain @ C
        P = A @ (M @ P @ M.T + gain @ R @ gain.T) @ A.T + Q
        P = 0.5 * (P + P.T)
    return K, W, logs


def settled(P, last):
    """Whether a covariance stays as it was, in units of its states."""
    for i in range(P.shape[0]):
        for j in range(i + 1):
            if abs(P[i, j] - last[i, j]) > SETTLED * np.sqrt(P[i, i] * P[j, j]):
                return False
    return True


def update(C, R, P, there):
    """Gain (n, m), whitening (m, m) and log determinant of the readings that are there, for a covariance P."""
    n, m = P.shape[0], C.shape[0]
    K, W = np.zeros((n, m)), np.zeros((m, m))
    rows = np.flatnonzero(there)
    if len(rows) == 0:
        return K, W, 0.0
    Cs = C[rows]
    CP = Cs @ P
    S = CP @ Cs.T
    for a in range(len(rows)):
        for b in range(len(rows)):
            S[a, b] += R[rows[a], rows[b]]
    S = 0.5 * (S + S.T)
    L = np.linalg.cholesky(S)
    gain = np.linalg.solve(S, CP).T
    white = np.tril(np.linalg.inv(L))  # above the diagonal is rounding, which nobody reads
    for a in range(len(rows)):
        for i in range(n):
            K[i, rows[a]] = gain[i, a]
        for b in range(len(rows)):
            W[rows[a], rows[b]] = white[a, b]
    return K, W, 2.0 * np.log(np.diag(L)).sum()
