"""Calibration alone: nonlinear least squares over the uncertain parameters, by scipy.

The machine is simulated freely from the recorded commands. A body that nothing holds drifts, and the drift would
decide: so the residual of each channel is high-passed (second-order Butterworth at ``HIGH_PASS_HZ``, forward). The
tolerances hold the parameters as a prior. A parameter is said to be wrong if its value leaves the tolerance by ``FAR``
standard deviations, or lies ``SURE`` of its own standard errors and half a tolerance away.
"""

from __future__ import annotations

from statistics import NormalDist
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import butter, sosfilt

from dtbacklash.arrays import Floats
from studies.baselines.case import Case, Found, simulated

HIGH_PASS_HZ, EVERY = 0.3, 10
#: seconds of a recording that are fitted
LENGTH_S = 6.0
EVALUATIONS = 5
FAR, SURE = 0.5, 3.0


def answer(case: Case) -> Found:
    """The parameters that are off, and the calibrated machine's prediction."""
    known = {name: p for name, p in case.rig.config.parameters.items() if p.tolerance > 0.0}
    names, tolerances = list(known), np.array([p.tolerance for p in known.values()])
    each = [fit(case, k, names, tolerances) for k in range(len(case.recordings))]
    z, error = each[-1]
    values = dict(zip(names, [known[n].value * (1.0 + t * x) for n, t, x in zip(names, tolerances, z, strict=True)],
                      strict=True))  # fmt: skip
    moved = z if len(each) == 1 else each[1][0] - each[0][0]
    spread = error if len(each) == 1 else np.hypot(each[0][1], each[1][1])
    rows = []
    for name, tolerance, by, own in zip(names, tolerances, moved, spread, strict=True):
        if abs(by) < FAR or abs(by) < SURE * own:
            continue
        half = 1.96 * known[name].value * tolerance * own
        # of two parameters that the fit cannot tell apart, each is half as likely
        certainty = float(np.clip(2.0 * NormalDist().cdf(abs(by) / max(own, 0.3)) - 1.0, 0.0, 0.95))
        rows.append({
            "place": name, "effect": "wrong_parameter", "size": values[name], "unit": known[name].unit,
            "low": values[name] - half, "high": values[name] + half, "certainty": certainty,
        })  # fmt: skip
    return Found(rows, simulated(case.rig.with_parameters(values), case.test, case.step_s))


def fit(case: Case, which: int, names: list[str], tolerances: Floats) -> tuple[Floats, Floats]:
    """Parameters in tolerances from their nominal values, and their standard errors; (parameters,) each."""
    table = case.recordings[which].iloc[: round(LENGTH_S / case.step_s)]
    u = table["u"].to_numpy()
    high = butter(2, HIGH_PASS_HZ, "high", fs=1.0 / case.step_s, output="sos")
    values = np.array([case.rig.config.parameters[name].value for name in names])

    def residuals(z: Floats) -> Floats:
        rig = case.rig.with_parameters(dict(zip(names, values * (1.0 + tolerances * z), strict=True)))
        shown = simulated(rig, u, case.step_s)
        wrong = [
            sosfilt(high, table[c].to_numpy() - shown[c])[::EVERY] / spread[c] for c in case.said["predict"]
        ]  # fmt: skip
        return np.concatenate([*wrong, z])

    spread = dict.fromkeys(case.said["predict"], 1.0)
    nominal = residuals(np.zeros(len(names)))[: -len(names)].reshape(len(spread), -1)
    # what the model cannot say is its noise: a tenth of the nominal residual, but not less than the sensor's
    spread = {c: max(case.noise[c], 0.1 * float(np.std(r))) for c, r in zip(spread, nominal, strict=True)}
    found: Any = least_squares(residuals, np.zeros(len(names)), x_scale=1.0, max_nfev=EVALUATIONS, diff_step=[1e-3])
    rest = found.fun[: -len(names)]
    inflation = max(1.0, float(np.mean(rest**2)))
    information = found.jac[: -len(names)].T @ found.jac[: -len(names)] / inflation + np.eye(len(names))
    return found.x, np.sqrt(np.diag(np.linalg.inv(information)))
