"""The steps of the simulation as numba compiles them."""

import numpy as np

from dtbacklash.physics.kernel.numba_laws import addressed


def with_addresses(plant):
    """A plant as loops that numba compiles take it."""
    if not (plant.law[:, 0] < 0).any():
        return plant
    return plant._replace(law=np.column_stack([addressed(plant.law[:, 0]), plant.law[:, 1]]))
