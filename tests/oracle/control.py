"""One sample of a controller and of the motor's equation, in Python: as ``control.c`` has it."""

import math

import numpy as np

from dtbacklash.control.laws import (
    BARE,
    CATCHING_MOST,
    EXACT,
    INNER_LOOP,
    INVERSE,
    LINEAR,
    MEASURED,
    NEAR_RAD,
    NIMC,
    OPEN_LOOP,
    SMALL_GAP_RAD,
)
from dtbacklash.control.linear_law import FOUND_V, SEARCH_STEPS
from dtbacklash.twin.bank.equation import REST_RAD_S


def play(theta_d, theta_m, half_gap):
    return min(max(theta_d, theta_m - half_gap), theta_m + half_gap)


def advance_model(A, B, u, x, spare):
    n = x.shape[0]
    for i in range(n):
        total = B[i] * u
        for j in range(n):
            total += A[i, j] * x[j]
        spare[i] = total
    for i in range(n):
        x[i] = spare[i]


def output(C, x):
    total = 0.0
    for i in range(x.shape[0]):
        total += C[i] * x[i]
    return total


def limited(C, u):
    return min(max(u, -C.limit), C.limit)


def _planned(C, X, forward):
    last, ahead = X.moves[0], X.moves[1]
    n = last.shape[0]
    for i in range(n):
        ahead[i] = last[i]
        X.spare[i] = output(C.lf[i], X.law)
    for _ in range(SEARCH_STEPS):
        changed = 0.0
        for i in range(n):
            X.spare[n + i] = ahead[i] - C.search[0] * (output(C.lh[i], ahead) + X.spare[i])
        for i in range(n):
            found = min(max(X.spare[n + i], -C.limit - forward), C.limit - forward)
            changed = max(changed, abs(found - last[i]))
            ahead[i] = found + C.search[1] * (found - last[i])
            last[i] = found
        if changed < FOUND_V:
            break
    return last[0]


def linear_step(C, X, r, theta_m, q3, forward):
    x = X.law
    if C.lh.shape[0] > 0:
        u = _planned(C, X, forward) + forward
    else:
        u = limited(C, output(C.lc, x) + C.ld[0] * r + C.ld[1] * theta_m + C.ld[2] * q3 + forward)
    for i in range(x.shape[0]):
        total = C.lb[i, 0] * r + C.lb[i, 1] * theta_m + C.lb[i, 2] * q3 + C.le[i] * (u - forward)
        for j in range(x.shape[0]):
            total += C.la[i, j] * x[j]
        X.spare[i] = total
    for i in range(x.shape[0]):
        x[i] = X.spare[i]
    return u


def _late(line, samples, value):
    if samples <= 0.0:
        return value
    for i in range(line.shape[0] - 1, 0, -1):
        line[i] = line[i - 1]
    line[0] = value
    whole = int(samples)
    share = samples - whole
    return (1.0 - share) * line[whole] + share * line[whole + 1]


def _predict(C, X):
    return _late(X.lines[2], C.late[2], output(C.sc, X.s))


def feed_forward(C, X, theta_m):
    f = C.forward
    # the model's speed is smooth; an encoder's counts would be differentiated
    speed = X.m[1] if C.model in (BARE, INNER_LOOP, INVERSE) else (theta_m - X.angle[0]) / C.sample_time
    X.angle[0] = theta_m
    return f[3] * speed - f[0] * math.sin(f[1] * theta_m + f[2]) - f[4]


def _grow(X, growth):
    if growth == 0.0:
        return
    before = X.inverse[2]
    X.inverse[2] = max(before + growth, 0.0)
    if X.inverse[2] > 0.0:
        X.inverse[0] = min(max(X.inverse[0] * before / X.inverse[2], -1.0), 1.0)


def _reseat(C, X, gap):
    if gap == X.inverse[2]:
        return
    gained = X.inverse[0] * (gap - X.inverse[2])
    X.inverse[2] = gap
    X.theta_d[0] -= gained
    for i in range(X.s.shape[0]):
        X.s[i] -= gained * C.s_rest[i]
    for i in range(X.lines.shape[1]):
        X.lines[2, i] -= gained * output(C.sc, C.s_rest)
    for i in range(X.w.shape[0]):
        X.w[i] -= gained * C.w_rest[i]


def _set_out(C, X, gap, toward):
    if C.crossing_step > 0.0 and gap > 0.0:
        left = (1.0 - X.inverse[0] * toward) * gap
        X.inverse[0] += toward * min(left, C.crossing_step) / gap


def crossing_samples(C, gap):
    return math.ceil(2.0 * gap / C.crossing_step) + C.arriving if C.crossing_step > 0.0 else 0


def _held(C, X, r, gap):
    jump = r - X.inverse[3]
    if C.crossing_step > 0.0 and gap > SMALL_GAP_RAD and abs(jump) > C.jump:
        side = 1.0 if jump > 0.0 else -1.0
        left = (1.0 - X.inverse[0] * side) * gap
        X.inverse[0] += side * min(left, C.crossing_step) / gap
        if left > C.crossing_step:
            X.inverse[4] = C.arriving + C.patience
            return X.inverse[3]
        if X.inverse[4] > 0.0:
            X.inverse[4] -= 1.0
            if X.inverse[4] > C.patience or (X.inverse[4] > 0.0 and abs(X.servo[2]) > NEAR_RAD):
                return X.inverse[3]
    X.inverse[3], X.inverse[4] = r, 0.0
    return r


def _catch_up(C, X, apart):
    if X.inverse[4] == 0.0:  # always, with `inner_loop`
        X.servo[1] = apart
        return
    X.servo[2] = X.servo[1] - apart
    X.servo[0] = min(max(X.servo[0] + C.catching * X.servo[2], -CATCHING_MOST), CATCHING_MOST)


def _taken_in(C, X, r, gap, growth, toward):
    if C.model != INVERSE:
        return r
    _reseat(C, X, gap - growth if gap > 0.0 else 0.0)  # first: what has grown from nothing forgets which tooth pushed
    _grow(X, growth)
    if toward != 0.0:
        _set_out(C, X, gap, toward)
        X.inverse[3], X.inverse[4] = r, 0.0
        return r
    return _held(C, X, r, gap)


def _inverse(C, X, r, error, gap):
    ahead = output(C.wc, X.w_r) + C.wd * r
    advance_model(C.wa, C.wb, r, X.w_r, X.spare)
    moved = C.crossing_ratio * (ahead - X.inverse[1]) + C.crossing_rate * C.sample_time * error
    if X.inverse[4] == 0.0:  # else it is on its way, or waits there
        X.inverse[0] = min(max(X.inverse[0] + moved / max(gap, SMALL_GAP_RAD), -1.0), 1.0)
    X.inverse[1] = ahead
    return X.inverse[0] * gap


def control_step(C, X, r, theta_m, q3, gap_hat, growth=0.0, toward=0.0):
    if C.structure == OPEN_LOOP:
        return r, 0.0
    gap = gap_hat if C.structure == NIMC else 0.0
    forward = feed_forward(C, X, theta_m) if C.forwards else 0.0
    if C.structure == LINEAR:
        return linear_step(C, X, r, theta_m, q3, forward), 0.0
    r = _taken_in(C, X, r, gap, growth, toward)
    eps = q3 - _predict(C, X)
    error = r - eps
    theta_ref = output(C.wc, X.w) + C.wd * error
    advance_model(C.wa, C.wb, error, X.w, X.spare)
    if C.model == EXACT:
        u = limited(C, C.gain * (theta_ref - theta_m) + forward)
        advance_model(C.sa, C.sb, _late(X.lines[0], C.late[0], u - forward), X.s, X.spare)
        return u, eps
    if C.model == BARE:
        theta_d = X.theta_d[0] if C.structure == NIMC else X.m[2]
    elif C.model == MEASURED:
        X.theta_d[0] = play(X.theta_d[0], theta_m, gap)
        theta_d = X.theta_d[0]
    else:
        X.theta_d[0] = play(X.theta_d[0], X.m[2], gap)
        theta_d = X.theta_d[0]
    feedback = theta_m
    if C.model == INVERSE:
        feedback = theta_m - _inverse(C, X, r, theta_ref - theta_d, gap) - X.servo[0]
    elif C.structure == NIMC:
        # the inner loop acts on the screw's angle; the complete model has its own, so the loop takes the measured one
        X.theta_d[1] = play(X.theta_d[1], theta_m, gap)
        feedback = X.theta_d[1] if C.model == INNER_LOOP else theta_d
    u = limited(C, C.gain * (theta_ref - feedback) + forward)
    advance_model(C.sa, C.sb, theta_d, X.s, X.spare)
    if C.model == BARE:
        if C.structure == NIMC:  # Eqs (16)-(17) with the sampled sG1's speed, integrated forward
            z, omega = theta_m - X.theta_d[0], X.m[1]
            if (omega > 0.0 and z >= gap) or (omega < 0.0 and z <= -gap):
                X.theta_d[0] += omega * C.sample_time
        advance_model(C.ma, C.mb, _late(X.lines[0], C.late[0], u - forward), X.m, X.spare)
    elif C.model in (INNER_LOOP, INVERSE):
        ahead, own = (X.inverse[0] * gap, X.m[2]) if C.model == INVERSE else (0.0, theta_d)
        own = _late(X.lines[1], C.late[1], own)
        _catch_up(C, X, theta_m - own)
        own_u = limited(C, C.gain * (theta_ref + ahead - own))
        advance_model(C.ma, C.mb, _late(X.lines[0], C.late[0], own_u), X.m, X.spare)
    return u, eps


def residual_torque(E, past, lags, theta, u):
    difference = E.a[0] * theta
    for i in range(3):
        difference += E.a[i + 1] * past[i] - E.b[i + 1] * past[4 + i]
    speed = (theta - past[0]) / E.sample_time
    for i in range(2, 0, -1):
        past[i], past[4 + i] = past[i - 1], past[3 + i]
    past[0], past[4] = theta, u
    known = E.known[1] + E.known[2] * np.sin(E.known[3] * theta + E.known[4])
    share = 1.0 - E.keep
    mean, spread = 0.0, E.known[0]
    fast = E.keep * E.keep * E.keep * E.keep
    lags[8] = fast * lags[8] + (1.0 - fast) * speed
    if abs(lags[8]) > REST_RAD_S:
        mean, spread = (-spread if lags[8] > 0.0 else spread), 0.0
    news = (difference / E.scale - known, speed, mean, spread)
    for i in range(4):
        lags[2 * i] = E.keep * lags[2 * i] + share * news[i]
        lags[2 * i + 1] = E.keep * lags[2 * i + 1] + share * lags[2 * i]
    left = lags[1] - lags[5]
    return left - min(max(left, -lags[7]), lags[7]), lags[3]
