"""A linear law from a user's file: the state space of a controller that somebody else designed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dtbacklash.control.linear_law import LinearLaw
from dtbacklash.errors import UserError
from dtbacklash.yaml_files import Mistake, read

KEY = "controller.file"


def read_law(path: str | None) -> LinearLaw:
    """The law of a YAML file with A (n, n), B (n, 3), C (n), D (3) and, if the limit is led back, E (n).

    ``x[k+1] = A x + B y + E u, u = limited(C x + D y)``, y = (reference m, motor's angle rad, output m), u in V.

    Raises
    ------
    UserError : no such file, a matrix that is missing, has another shape, or is not of finite numbers.
    """
    if path is None:
        raise UserError(KEY, "null", "give a YAML file with the matrices A, B, C, D of the controller")
    try:
        content: Any = read(Path(path).read_bytes())
    except OSError as error:
        raise UserError(KEY, path, "is not a file that can be read; give a YAML file") from error
    except Mistake as error:
        raise UserError(KEY, path, str(error)) from error
    if not isinstance(content, dict) or not {"A", "B", "C", "D"} <= set(content) <= {"A", "B", "C", "D", "E"}:
        raise UserError(KEY, path, "must have the matrices A, B, C, D and, if it needs it, E, and nothing else")
    n = len(content["C"]) if isinstance(content["C"], list) else 0
    shapes = {"A": (n, n), "B": (n, 3), "C": (n,), "D": (3,), "E": (n,)}
    found = []
    for name, shape in shapes.items():
        try:
            matrix = np.array(content.get(name, np.zeros(n)), dtype=float).reshape(shape)
        except (TypeError, ValueError):
            raise UserError(KEY, path, f"{name} must have the shape {shape}, as C has {n} states") from None
        if not np.all(np.isfinite(matrix)):
            raise UserError(KEY, path, f"{name} must be of finite numbers")
        found.append(np.ascontiguousarray(matrix))
    return LinearLaw(*found)
