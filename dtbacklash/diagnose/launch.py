"""A block's state at the first sample of a recording that begins in motion: from its vector, guessed, fitted.

The vector holds the plant's state (current, positions, speeds, memories) and the motor's place in its play.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.settings import settings
from dtbacklash.diagnose.starts import Beginning, first_state, local
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.plant import Plant, State, new_state

#: the motor's place in its play, as a share of it, from which it leans on a flank
ON_FLANK = 1.0 - 1e-6


@dataclass(frozen=True)
class Launch:
    """What is known of a block where its recording begins.

    Attributes
    ----------
    bodies : names in the order of the state, with the element that each is, or sits on, and the axis that it moves on.
    half_gap : of the gear, rad. angle : (n,) what is imposed, rad (V of a positioner), or nothing.
    u : (n,) command, V. command_size : its standard deviation, V.
    seen : channel -> body and (n,) what its sensor looks at, for positions and for speeds.
    measured : (n, channels) of the channels in ``columns`` of what the block shows, SI. noise : (channels,).
    skip : the first samples, which a delay keeps from being known.
    """

    plant: Plant
    bodies: dict[str, tuple[str, str]]
    half_gap: float
    angle: Floats | None
    u: Floats
    command_size: float
    positions: dict[str, tuple[str, Floats]]
    speeds: dict[str, tuple[str, Floats]]
    measured: Floats
    columns: list[int]
    noise: Floats
    begins: Beginning
    skip: int

    def fitted(self, run: Callable[[State, int], Floats]) -> State:
        """The state that fits the beginning best. ``run`` : simulates so many samples from a state, which it moves."""
        guess = self._guess()
        spread = self._spread(guess, run)
        reach = np.full(len(guess), np.inf)
        reach[-1] = self.half_gap

        def shown(vector: Floats) -> Floats:
            return run(self.state(vector), len(self.measured))[self.skip :, self.columns]

        measured = self.measured[self.skip :]
        if self.half_gap > 0.0:
            guess = min(self._sides(guess), key=lambda v: _left(shown(v), measured, self.noise))
        return self.state(first_state(shown, measured, self.noise, guess, spread, reach))

    def state(self, vector: Floats) -> State:
        """The state of a vector; a late command is taken for the first one, and contacts slip as their ends move."""
        plant, z = self.plant, float(vector[-1])
        state = new_state(plant)
        state.x[:] = vector[:-1]
        state.commands[:] = self.u[0]
        rotor = plant.position + plant.rotor
        first, rate = 0.0, 0.0
        if self.angle is not None:
            first, rate = float(self.angle[0]), float(self.angle[1] - self.angle[0]) / plant.sample_time
        elif plant.rotor >= 0:
            first, rate = float(state.x[rotor]), float(state.x[rotor + plant.n_bodies])
        if plant.has_base:
            state.gear[0] = first - z
        leans = self.half_gap == 0.0 or (abs(z) >= ON_FLANK * self.half_gap and z * rate > 0.0)
        if self.half_gap > 0.0 and not plant.imposed:
            state.mode[0] = (pl.PLUS if z > 0.0 else pl.MINUS) if leans else pl.FREE
        base_rate = plant.screw[pl.S_LEAD] * rate if leans else 0.0
        ends = {pl.GROUND: 0.0, pl.BASE: base_rate}
        for c, (a, b) in enumerate(plant.friction_ends.tolist()):
            va, vb = (ends[e] if e in ends else state.x[plant.position + plant.n_bodies + e] for e in (a, b))
            state.mode[1 + c] = int(np.sign(vb - va))
        return state

    def _guess(self) -> Floats:
        """Positions and speeds as measured, where they are; elsewhere those of what drives the body, or its like."""
        plant, step = self.plant, self.plant.sample_time
        places, rates = self._read(self.positions), self._read(self.speeds)
        at = {body: (value, slope) for body, (value, slope) in places.items()}
        for body, (value, _) in rates.items():
            at[body] = (at.get(body, (0.0, 0.0))[0], value)
        if self.angle is not None:
            first, rate = local(self.angle[: min(len(self.angle), 24)], step)
        else:
            rotor = next((b for j, b in enumerate(self.bodies) if j == plant.rotor), "")
            first, rate = at.get(rotor, (0.0, 0.0))
        vector = np.zeros(plant.A.shape[1] + 1)
        for j, (element, axis) in enumerate(self.bodies.values()):
            like = next((at[b] for b in at if self.bodies[b][1] == axis), (0.0, 0.0))
            value, slope = at.get(element, like)
            if plant.has_base and j != plant.rotor:
                value, slope = plant.screw[pl.S_LEAD] * first, plant.screw[pl.S_LEAD] * rate
            vector[plant.position + j], vector[plant.position + plant.n_bodies + j] = value, slope
        if plant.current >= 0:  # as if it had settled
            driven = vector[plant.position + plant.n_bodies + plant.driven]
            eats = plant.A[0, 0, plant.position + plant.n_bodies + plant.driven] * driven
            vector[0] = -(plant.G[0, pl.CH_V, 0] * self.u[0] + eats) / plant.A[0, 0, 0]
        vector[-1] = np.sign(rate) * self.half_gap
        return vector

    def _read(self, channels: dict[str, tuple[str, Floats]]) -> dict[str, tuple[float, float]]:
        """Body -> value and slope of its channel at the first sample."""
        step, window = self.plant.sample_time, self.begins.window
        return {body: local(v[: window[c]], step) for c, (body, v) in channels.items() if c in window}

    def _spread(self, guess: Floats, run: Callable[[State, int], Floats]) -> Floats:
        """(states + 1,) how far the guess may be off: as much as the states usually are from their middles."""
        plant = self.plant
        spread = np.zeros(len(guess))
        for j, (body, (element, _)) in enumerate(self.bodies.items()):
            more = 1.0 if body == element else settings().beginning_hidden_ratio
            size = self.begins.sizes.get(element, (0.0, 0.0))
            spread[plant.position + j], spread[plant.position + plant.n_bodies + j] = more * size[0], more * size[1]
        if plant.current >= 0:
            spread[0] = self.command_size * plant.G[0, pl.CH_V, 0] / -plant.A[0, 0, 0]
        memories = slice(plant.position + 2 * plant.n_bodies, len(guess) - 1)
        if memories.start < memories.stop:
            after = self.state(guess)
            run(after, len(self.measured))
            spread[memories] = settings().beginning_memory_ratio * np.abs(np.nan_to_num(after.x[memories]))
        # a motor that hits what it carries loses speed: there the side is chosen, and nothing between
        if plant.imposed or plant.screw[pl.S_SHARE] == 0.0:
            spread[-1] = self.half_gap
        return spread

    def _sides(self, guess: Floats) -> list[Floats]:
        """The guess with the motor on either flank, and amid its play."""
        return [np.append(guess[:-1], z) for z in (guess[-1], -guess[-1], 0.0)]


def _left(shown: Floats, measured: Floats, noise: Floats) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        left = float(np.sum(((measured - shown) / noise) ** 2))
    return left if np.isfinite(left) else np.inf
