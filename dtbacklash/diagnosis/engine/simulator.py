"""What a predictor asks of a simulator: its linear model, a pass with corrections, and where states lead.

This is the whole contract between the diagnosis and what simulates. :mod:`.rig_simulator` fulfils it by the compiled
rig.
"""

from dataclasses import dataclass, field
from typing import Protocol, Self

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.resampling import Samples
from dtbacklash.physics.rig import Rig

#: a mode that so nearly stays where it is (eigenvalue of a sample), and of which a sensor shows so much (share)
STAYS, SHOWN = 1e-6, 1e-9


@dataclass(frozen=True)
class Linear:
    """The linear part of a rig, for one sample; two modes: the gear out of contact, and in contact (or no gear).

    A (2, n, n), B (2, n, bodies) : what a force at each body adds within a sample. C (2, m, n), D (m, bodies) : what
    readings show of states, and of the forces of the sample before at once. states : their names. bodies : in order.
    volt (2, n), volt_at_once (m,) : the same of the voltage. inertia : (bodies,) force by acceleration. speed : index
    of the first body's speed. drives : actuator of a simulator's model -> what a unit of its command does, as
    :meth:`force`.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    volt: Floats
    volt_at_once: Floats
    states: tuple[str, ...]
    bodies: tuple[str, ...]
    inertia: Floats
    speed: int
    drives: dict[str, tuple[Floats, Floats]] = field(default_factory=dict)

    @property
    def drifts(self) -> bool:
        """Whether the sensors show a motion that nothing pulls back, or that grows."""
        modes, shapes = np.linalg.eig(self.A[1])
        shown = np.abs(self.C[1] @ shapes).max(axis=0) > SHOWN * np.abs(shapes).max(axis=0)
        return bool((np.abs(modes[shown]) > 1.0 - STAYS).any())

    def index(self, body: str) -> int:
        """Of a body's speed among the states."""
        return self.speed + self.bodies.index(body)

    def force(self, channel: int) -> tuple[Floats, Floats]:
        """(n,) and (m,) what a force at a body does within a sample, and shows at once, in contact."""
        return self.B[1][:, channel].copy(), self.D[:, channel].copy()


@dataclass(frozen=True)
class Pass:
    """One pass: whitened innovations E, innovations D (N, m), states X (N, n) before each correction, first state."""

    E: Floats
    D: Floats
    X: Floats
    first: Floats


class Simulator(Protocol):
    """What simulates rigs on one stretch of a recording.

    A rig says which places there are, which laws act there and with what values; what becomes of it is up to the
    simulator. Any method raises UserError for values that a rig cannot have.

    Attributes
    ----------
    readings : the stretch. finely : whether a sample is simulated in fine steps.
    """

    readings: Samples
    finely: bool

    def on(self, readings: Samples) -> Self:
        """The same on other readings."""

    def linear(self, rig: Rig) -> Linear:
        """The linear part of a rig for one sample, as its laws do nothing."""

    def observe(self, rig: Rig, K: Floats, W: Floats, opening: int, which: np.ndarray | None = None) -> Pass:
        """Predict each sample, compare it with what was read, and correct the state by that.

        K (modes, g, n, m), W (modes, g, m, m) : gains and whitening of the states of :meth:`linear`, of the first
        ``opening`` samples and then of each set of readings, see :class:`.predictor.Gains`. which : (N,) the number of
        the gains of each sample instead.
        """

    def onwards(self, rig: Rig, Z: Floats) -> Floats:
        """(N, n) where one sample leads from each of the states Z (N, n); the last row is 0."""

    def shown(self, rig: Rig, Z: Floats) -> Floats:
        """(N, m) what the sensors show of the states Z (N, n) at once."""

    def loads(self, rig: Rig, Z: Floats) -> Floats:
        """(N, bodies) what actuators exert on each joint of a simulator's model at states Z (N, n), N or N m."""

    def there(self, rig: Rig) -> np.ndarray:
        """(N, m) whether each reading is, where those of late sensors are moved in time."""

    def as_read(self, rig: Rig, D: Floats) -> Floats:
        """(N, m) innovations D of a pass at the samples at which they were read; NaN where there is none."""
