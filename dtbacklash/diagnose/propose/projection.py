"""The mismatch that a fit leaves, with what the nominal parameters could take up taken out of it.

The signatures of the nominal parameters are taken out by regression under the parameters' priors, so that a wrong mass
within its tolerance is not called new physics.
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
    """Rows of residuals about one fitted rig, with the nominal parameters' signatures projected out.

    A nominal parameter at its bound is held there, as it cannot take up anything more; seen :meth:`inward`, it is taken
    out like the others: a candidate may be what drove it there, and then lets it come back.

    residual : (rows,) weighted and projected. q_rows : (rows, parameters) an orthonormal basis of what is taken out.
    """

    def __init__(self, evidence: Evidence, fitted: Fit) -> None:
        self.evidence, self.fitted = evidence, fitted
        self.rig = fitted.rig
        # all of them: the last fit may have moved those of its own blocks only
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
        self._take_out(~bound)

    def _take_out(self, chosen: Mask) -> None:
        self.q_rows = np.linalg.qr(self._columns[:, chosen])[0]
        self.residual = self.project(self._rows)
        self.total = float(self.residual @ self.residual)

    def inward(self) -> Self:
        """The same with the parameters at their bounds taken out as well."""
        other = copy(self)
        other._take_out(np.ones(self._columns.shape[1], dtype=bool))
        return other

    def project(self, rows: Floats) -> Floats:
        """(rows,) without what the nominal parameters could take up."""
        return rows - self.q_rows @ (self.q_rows.T @ rows)

    def stack(self, residuals: Residuals) -> Floats:
        """(rows,) residuals of the training part, weighted, in the order of the blocks; no prior is strained."""
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
