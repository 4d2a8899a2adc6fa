"""A stepwise ARX test of the nominal machine's residual by sysidentpy: is there anything, and in which sensor first?

FROLS adds terms of a polynomial ARX of the residual, driven by the command, as long as the Bayesian criterion falls. If
the model predicts the residual better than its own mean on the last third, something is missing at the body of the
sensor whose residual is largest beside its noise. It has no word for it. The prediction is the nominal machine's.
"""

from __future__ import annotations

import numpy as np

from studies.baselines.case import Case, Found, simulated

RATE_HZ, LAGS, ABOVE, CERTAINTY = 100.0, 3, 3.0, 0.5


def answer(case: Case) -> Found:
    """The sensor with the largest residual, if an ARX explains it."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    table = case.recordings[-1]
    u, every = table["u"].to_numpy(), max(1, round(1.0 / RATE_HZ / case.step_s))
    shown = simulated(case.rig, u, case.step_s)
    left = {c: (table[c].to_numpy() - shown[c]) / case.noise[c] for c in case.said["predict"]}
    name = max(left, key=lambda c: float(np.std(left[c])))
    predicted = simulated(case.rig, case.test, case.step_s)
    residual, x = left[name][::every, None], u[::every, None]
    if float(np.std(residual)) < ABOVE:
        return Found([], predicted)
    first = 2 * len(residual) // 3
    model = FROLS(
        order_selection=True, n_info_values=8, ylag=LAGS, xlag=LAGS, info_criteria="bic", estimator=LeastSquares(),
        basis_function=Polynomial(degree=1),
    )  # fmt: skip
    scale = float(np.std(residual))
    model.fit(X=x[:first], y=residual[:first] / scale)
    onwards = model.predict(X=x[first:], y=residual[first:] / scale, steps_ahead=1)[:, 0]
    truth = residual[first:, 0] / scale
    if np.mean((onwards - truth) ** 2) > 0.5 * np.var(truth):
        return Found([], predicted)
    place = case.rig.sensors[name].of
    return Found([{"place": place, "effect": "unlisted", "certainty": CERTAINTY}], predicted)
