"""The core beside its oracle: what the simulation and the predictor call is called twice, and compared."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from oracle import passes as oracle_passes

from dtbacklash.diagnosis.engine import rig_simulator
from dtbacklash.physics import simulate as simulation

#: of the largest size in a column; the two differ in the last bit at most, and where a machine does not run away that
#: stays so
TOLERANCE = 1e-12


def assert_alike(ours: np.ndarray, theirs: np.ndarray, tolerance: float = TOLERANCE) -> None:
    """The same shape, the same numbers, but for the last bit of the largest; what is not finite is so in both."""
    assert ours.shape == theirs.shape
    assert np.array_equal(np.isfinite(ours), np.isfinite(theirs))
    if not ours.size:
        return
    ours, theirs = (np.nan_to_num(one, posinf=0.0, neginf=0.0).reshape(len(one), -1) for one in (ours, theirs))
    scale = np.abs(theirs).max(axis=0, initial=0.0)
    last_bit = np.finfo(float).eps * scale.max(initial=0.0)
    assert (np.abs(ours - theirs) <= tolerance * scale + last_bit).all(), np.abs(ours - theirs).max() / max(
        scale.max(), 1e-300
    )


class Twice:
    """Functions that fill arrays, each called by the core and by the oracle; ``calls`` counts them."""

    def __init__(self) -> None:
        self.calls: dict[str, int] = {}

    def filling(self, name: str, ours: Callable[..., None], theirs: Callable[..., None]) -> Callable[..., None]:
        """Of a plant and a state (the first two arguments), with arrays that are filled among the rest."""

        def call(plant: Any, *given: Any) -> None:
            mine = [_copied(one) for one in given]
            theirs(plant, *mine)
            ours(plant, *given)
            for a, b in zip(given, mine, strict=True):
                for one, other in zip(a, b, strict=True) if hasattr(a, "_fields") else [(a, b)]:
                    if isinstance(one, np.ndarray):
                        assert_alike(one.astype(float), other.astype(float))
            self.calls[name] = self.calls.get(name, 0) + 1

        return call


def _copied(one: Any) -> Any:
    if hasattr(one, "_fields"):
        return type(one)(*(array.copy() for array in one))
    return one.copy() if isinstance(one, np.ndarray) else one


@pytest.fixture
def twice(monkeypatch: pytest.MonkeyPatch) -> Twice:
    """The simulation and the passes of a predictor, by the core and its oracle side by side."""
    both = Twice()
    monkeypatch.setattr(simulation, "run", both.filling("run", simulation.run, oracle_passes.run))
    for name, theirs in (("observe", "observe"), ("onwards", "onwards"), ("shown", "shown"), ("amplify", "amplified")):
        ours = getattr(rig_simulator, name)
        monkeypatch.setattr(rig_simulator, name, both.filling(name, ours, getattr(oracle_passes, theirs)))
    return both
