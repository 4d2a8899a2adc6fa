"""The residual of a fit without what the nominal parameters can explain.

Their signatures are projected out by regression with the parameters' priors, so that a wrong mass within its tolerance
is not called new physics.
"""

from copy import copy
from typing import Self

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.candidates import positions
from dtbacklash.diagnose.data.compare import Mask
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.fit.free import all_free, at_limit
from dtbacklash.diagnose.fit.problem import Fit, Problem, weights_for


class Projection:
    """Residual of a fitted rig, with the nominal parameters' signatures projected out.

    A nominal parameter at its bound is not projected out, as it cannot explain more; :meth:`inward` it is, as a
    candidate may have driven it there.

    residual : (rows,) weighted and projected. q_rows : (rows, parameters) orthonormal basis of what is projected out.
    """

    def __init__(self, evidence: Evidence, fitted: Fit) -> None:
        self.evidence, self.fitted = evidence, fitted
        self.rig = fitted.rig
        # all parameters: the last fit may have moved some only
        free, x = all_free(evidence, fitted.rig)
        problem = self._problem = Problem(evidence, fitted.rig, free)
        problem.weights = weights_for(evidence, fitted.residuals)
        self.weights = problem.weights
        self.touched = problem.touched = [b.name for b in evidence.blocks]
        bound = np.array([at_limit(f, at) for f, at in zip(free, x, strict=True)], dtype=bool)
        self.bound = bool(bound.any())
        self._rows = problem.stack(fitted.residuals, x)
        self._columns = problem.differences(x) if free else np.zeros((len(self._rows), 0))
        self._positions: list[dict[str, Floats]] = []
        self.samples = sum(int(r.train.sum()) for r in evidence.records)
        self._project_out(~bound)

    def _project_out(self, chosen: Mask) -> None:
        self.q_rows = np.linalg.qr(self._columns[:, chosen])[0]
        self.residual = self.project(self._rows)
        self.total = float(self.residual @ self.residual)

    def inward(self) -> Self:
        """The same with the parameters at their bounds projected out as well."""
        other = copy(self)
        other._project_out(np.ones(self._columns.shape[1], dtype=bool))
        return other

    def project(self, rows: Floats) -> Floats:
        """(rows,) without what the nominal parameters can explain."""
        return rows - self.q_rows @ (self.q_rows.T @ rows)

    def stack(self, residuals: Residuals) -> Floats:
        """(rows,) weighted residuals of the training part in the order of the blocks; zeros for the priors."""
        return self._problem.stack(residuals, np.zeros(len(self._problem.free)))

    def path(self, place: str, number: int) -> Floats:
        """(N,) position of a body in recording ``number``: measured, or simulated where it is not; rad or m."""
        record = self.evidence.records[number]
        for name, sensor in self.rig.sensors.items():
            if sensor.of == place and sensor.quantity == "position" and name in record.y:
                return record.y[name]
        if not self._positions:
            self._positions = [positions(self.rig, self.evidence.blocks, r) for r in self.evidence.records]
        return self._positions[number].get(place, np.zeros(record.samples))
