"""Where a simulation leaves the states that a table, or a law found in a recording, was made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.physics.bodies import take_apart
from dtbacklash.physics.effects import slots
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import Response, rig_half_gap, simulate


@dataclass(frozen=True)
class Beyond:
    """A state that went beyond what a law covers, SI.

    covered, reached : lowest and highest. share : of the samples that lie beyond.
    """

    location: str
    effect: str
    state: str
    covered: tuple[float, float]
    reached: tuple[float, float]
    share: float

    @property
    def words(self) -> str:
        """What a run says of it."""
        low, high = self.covered
        return (
            f"{self.location}.{self.effect} covers a {self.state.replace('_', ' ')} from {low:.4g} to {high:.4g} (SI); "
            f"the run went from {self.reached[0]:.4g} to {self.reached[1]:.4g}, {100.0 * self.share:.3g} % of the time "
            "beyond: nothing is known of the law there"
        )


def beyond(rig: Rig, u: Floats, gap_rad: Floats, sample_time_s: float) -> list[Beyond]:
    """What left its range in a run.

    Parameters
    ----------
    u : (N+1,) command, V (m or rad of a servo). gap_rad : (N+1,) half-gap, the rig's own with it, rad.

    The run is simulated once more, for the states that no sensor shows, as the rig is at its start; where no law has a
    range nothing is.
    """
    ranges = [
        (place, effect, state, effect.covered(values)[state])
        for place in rig.effects
        for effect, values in rig.active(place, slots.Slot)
        for state in effect.covered(values)
    ]
    if not ranges:
        return []
    response = simulate(rig, u[:-1], sample_time_s, gap_rad - rig_half_gap(rig))
    found = []
    for place, effect, state, (low, high) in ranges:
        values = _states(rig, place, u, response)[state]
        outside = (values < low) | (values > high)
        if outside.any():
            reached = float(values.min()), float(values.max())
            found.append(Beyond(place, effect.name, state, (low, high), reached, float(outside.mean())))
    return found


def _states(rig: Rig, place: str, u: Floats, run: Response) -> dict[str, Floats]:
    """(N+1,) states at a place, by the names that laws have for them."""
    parts, x = take_apart(rig, rig.only("positioner") is not None), run.states
    names = parts.bodies.names
    first = 1 if rig.only("motor_circuit") else 0
    q = {name: x[:, first + j] for j, name in enumerate(names)} | {"ground": np.zeros(len(x))}
    v = {name: x[:, first + len(names) + j] for j, name in enumerate(names)} | {"ground": np.zeros(len(x))}
    if parts.base:
        screw, positioner = rig.only("screw"), rig.only("positioner")
        lead = screw.values["lead"] if screw else 0.0
        q[parts.base] = positioner.values["travel"] * u if positioner else lead * run.theta_d_rad
        v[parts.base] = np.gradient(q[parts.base], run.t_s)
    element = rig.elements.get(place)
    if element is None or element.trait.trait == slots.AMPLIFIER:
        return {"command": u}
    if element.trait.trait == slots.SPRING:
        a, b = element.neighbours["between"]
        stretch = q[b] - element.lever * q[a]
        for effect, values in rig.active(place, slots.SpringPlay):
            assert isinstance(effect.slot, slots.SpringPlay)
            law, own = effect.slot.law, [values[p.name] for p in effect.parameters]
            stretch = np.array([law(s, *own) for s in stretch])  # laws see what is left of it
        return {"stretch": stretch, "stretch_rate": v[b] - element.lever * v[a]}
    body = place if place in q else element.neighbours["drives"]
    found = {"position": q[body], "velocity": v[body], "slip_speed": np.abs(v[body]), "command": u}
    return found | {"current": x[:, 0]} if element.trait.trait == slots.WINDING else found
