"""SINDy on the residual acceleration: which terms of a library explain what the nominal equation leaves over (pysindy).

A term is said if it survives the threshold at a body whose residual is well above the noise's. Its name is that of the
vocabulary's effect at this body. The certainty is the share of an ensemble of models that keep it. A body whose
residual no term explains gets ``unlisted``. The prediction is the nominal machine's, as one body is no machine.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from studies.baselines.acceleration import Body, bodies
from studies.baselines.case import Case, Found, simulated

#: term -> its function of position and speed, of standard deviation 1; the effects that it may be, the first that fits
TERMS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "sign(v)": (lambda q, v: np.tanh(v / 0.02), ("coulomb_friction", "ground_friction")),
    "v": (lambda q, v: v, ("viscous_friction",)),
    "|v|": (lambda q, v: np.abs(v), ("asymmetric_friction",)),
    "|v| v": (lambda q, v: np.abs(v) * v, ("quadratic_drag",)),
    "1": (lambda q, v: np.ones_like(v), ("constant_load", "constant_force")),
    "q^3": (lambda q, v: q**3, ("unlisted",)),
}
THRESHOLD, MODELS, ABOVE = 0.15, 20, 2.0
#: share of the residual's mean square that the terms have to explain
EXPLAINED = 0.3


def answer(case: Case) -> Found:
    """Names at the bodies whose residual is above the noise."""
    rows = []
    for body in bodies(case):
        size = float(np.sqrt(np.mean(body.residual**2)))
        if size >= ABOVE * body.floor:
            rows += _names(case, body, size)
    return Found(rows, simulated(case.rig, case.test, case.step_s))


def _names(case: Case, body: Body, size: float) -> list[dict[str, Any]]:
    import pysindy as ps

    q, v = body.position / (body.position.std() or 1.0), body.speed / (body.speed.std() or 1.0)
    features = np.column_stack([term(q, v) for term, _ in TERMS.values()])
    target = (body.residual / size)[:, None]
    least = ps.STLSQ(threshold=THRESHOLD, alpha=1e-3)
    ensemble = ps.EnsembleOptimizer(least, bagging=True, n_models=MODELS)
    np.random.seed(0)  # noqa: NPY002  PySINDy draws its bags from numpy's old state
    ensemble.fit(features, target)
    kept = np.mean([np.abs(np.asarray(c)).ravel() > 0.0 for c in ensemble.coef_list], axis=0)
    coefficients = np.asarray(ensemble.coef_).ravel()
    explained = 1.0 - float(np.mean((target[:, 0] - features @ coefficients) ** 2))
    if explained < EXPLAINED:
        return [{"place": body.place, "effect": "unlisted", "certainty": 0.5}]
    taken = case.rig.takes(body.place)
    rows = []
    for (_, effects), share, coefficient in zip(TERMS.values(), kept, coefficients, strict=True):
        effect = next((e for e in effects if e in taken or e == "unlisted"), None)
        if effect is not None and abs(coefficient) >= THRESHOLD:
            rows.append({"place": body.place, "effect": effect, "certainty": float(share)})
    return rows
