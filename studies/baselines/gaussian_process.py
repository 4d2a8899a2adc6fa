"""A Gaussian process on the residual acceleration over position and speed (scikit-learn): it says where, not what.

The body whose residual it explains best on the last third of the recording is the place. The certainty is that share
of the residual's mean square. The prediction is the nominal machine's.
"""

from __future__ import annotations

import numpy as np

from studies.baselines.acceleration import bodies
from studies.baselines.case import Case, Found, simulated

POINTS, ABOVE, EXPLAINED = 300, 2.0, 0.1


def answer(case: Case) -> Found:
    """The place of what is missing, with the word for physics that has no name."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, WhiteKernel

    shares = {}
    for body in bodies(case):
        size = float(np.sqrt(np.mean(body.residual**2)))
        if size < ABOVE * body.floor:
            continue
        states = np.column_stack([body.position, body.speed])
        states = states / (states.std(axis=0) + 1e-300)
        target, first = body.residual / size, 2 * len(states) // 3
        chosen = np.linspace(0, first - 1, POINTS).astype(int)
        kernel = RBF([1.0, 1.0], (0.05, 20.0)) + WhiteKernel(0.5, (1e-4, 2.0))
        process = GaussianProcessRegressor(kernel, normalize_y=True, random_state=0).fit(states[chosen], target[chosen])
        wrong = target[first:] - process.predict(states[first:])
        shares[body.place] = 1.0 - float(np.mean(wrong**2) / np.mean(target[first:] ** 2))
    predicted = simulated(case.rig, case.test, case.step_s)
    if not shares:
        return Found([], predicted)
    place = max(shares, key=lambda name: shares[name])
    if shares[place] < EXPLAINED:
        return Found([], predicted)
    return Found([{"place": place, "effect": "unlisted", "certainty": min(0.95, max(0.5, shares[place]))}], predicted)
