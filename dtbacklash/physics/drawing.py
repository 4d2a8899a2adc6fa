"""How the law of an effect is drawn: its effort against the one state on which it depends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Effect, Role, Values
from dtbacklash.physics.effects.slots import Law, arguments
from dtbacklash.physics.effects.spring import play
from dtbacklash.physics.effects.table import SHAPES, table_of, weights
from dtbacklash.physics.element_kinds import KINDS

#: points of a drawn curve, and of each half of a loop
POINTS = 401
#: laps of a loop; the last one is drawn, when the law has forgotten the beginning
LAPS = 3
#: names of the states in drawings
NAMES = {
    "position": "position", "velocity": "speed", "stretch": "stretch", "stretch_rate": "stretch rate", "time": "time",
    "command": "command", "angle": "angle",
}  # fmt: skip


@dataclass(frozen=True)
class Drawing:
    """How the law of one effect is drawn.

    Attributes
    ----------
    state : the place's state over which it is drawn: ``speed``, ``position``, ``stretch``, ``stretch rate``,
        ``command``, ``angle`` or ``time``.
    effort : (the effect's values, its element's values, (M,) states, SI) -> (M,) efforts. Of a loop the states are a
        sweep to and fro, and the law remembers.
    shape : a ``curve``, one ``wave`` of what is periodic, or a ``loop``.
    wave : of a wave, the parameter that counts radians per unit of the state; empty: one radian each.
    width : of a loop, the travel after a reversal in which the law remembers, in the state's unit.
    times : a second state that multiplies the effort, or empty.
    effort_unit : where it is not the unit of the effort at the place.
    effort_label : what the effort is called, where it is not what is missing at the place.
    stroke : of a loop, half the sweep, in widths; 0 takes the recording's own.
    """

    state: str
    effort: Callable[[Values, Values, Floats], Floats]
    shape: Literal["curve", "wave", "loop"] = "curve"
    wave: str = ""
    width: Callable[[Values], float] | None = None
    times: str = ""
    effort_unit: str = ""
    effort_label: str = ""
    stroke: float = 0.0


def drawing_of(effect: Effect) -> Drawing | None:
    """How the law of an effect is drawn; None where it depends on more than one state."""
    slot = effect.slot
    if effect.is_table:
        shape = SHAPES[effect.name]
        return Drawing(shape.over, _tabled, times=shape.times, effort_unit=effect.size.unit if shape.times else "",
                       effort_label=f"missing effort by {shape.times}" if shape.times else "")  # fmt: skip
    if isinstance(slot, slots.Contact) and "load" in slots.asked(effect):
        return None
    for kind, drawn in _DRAWN.items():
        if isinstance(slot, kind):
            return drawn(effect, slot)
    return None


def law_curve(
    drawing: Drawing, values: Values, element: Values, state_range: tuple[float, float]
) -> tuple[Floats, Floats]:
    """A law over a range of its state.

    Parameters
    ----------
    values : the effect's. element : the parameters of its element, SI. state_range : lowest and highest state, SI.

    Returns
    -------
    (M,) states and (M,) efforts; of a loop the first half leads up and the second half back.
    """
    low, high = state_range
    if drawing.shape == "loop":
        lap = np.concatenate([np.linspace(low, high, POINTS), np.linspace(high, low, POINTS)])
        return lap, drawing.effort(values, element, np.tile(lap, LAPS))[-len(lap) :]
    grid = np.linspace(low, high, POINTS)
    if low < 0.0 < high:  # what jumps at rest jumps there, and nowhere else
        near = 1e-9 * (high - low)
        grid = np.sort(np.concatenate([grid[grid != 0.0], [-near, 0.0, near]]))
    return grid, drawing.effort(values, element, grid)


def effort_over(effect: Effect, values: Values, state: str, times: str, grid: Floats) -> Floats:
    """(M,) efforts of a table, or of a law of one's own, over a state (as drawings name it); ``times`` stands at 1."""
    if effect.is_table:
        return _tabled(values, {}, grid)
    names = {drawn: name for name, drawn in NAMES.items()}
    others = {name: float(drawn == times) for name, drawn in NAMES.items() if drawn != state}
    (law,) = effect.slot.laws().values()
    efforts = _along(effect, law, names[state], **others)(values, {}, grid)
    return efforts - grid if state == "command" else efforts


def _tabled(values: Values, element: Values, grid: Floats) -> Floats:
    """The values of a table at these states."""
    knots, efforts = table_of(values)
    return weights(grid, knots) @ efforts


def _called(effect: Effect, law: Law, values: Values, **states: float) -> float:
    """A law at one point, in plain Python."""
    given = list(values.values())
    names = arguments(law, effect.slot.states, effect)
    return float(law(*(states[n] if isinstance(n, str) else given[n] for n in names)))


def _asks_for(effect: Effect, law: Law) -> set[str]:
    """The states among the arguments of a law."""
    return {name for name in arguments(law, effect.slot.states, effect) if isinstance(name, str)}


def _along(effect: Effect, law: Law, state: str, **others: float) -> Callable[[Values, Values, Floats], Floats]:
    """A law without memory over one of its states, the others constant."""

    def effort(values: Values, element: Values, grid: Floats) -> Floats:
        more = {"spring_stiffness": element.get("stiffness", 0.0), "spring_damping": element.get("damping", 0.0)}
        states = {**more, **others}
        return np.array([_called(effect, law, values, **{**states, state: float(s)}) for s in grid])

    return effort


def _wave(effect: Effect, state: str, effort: Callable[[Values, Values, Floats], Floats]) -> Drawing:
    """A wave where a parameter of the law is a phase, else a curve."""
    if effect.of_role(Role.ANGLE) is None:
        return Drawing(NAMES[state], effort)
    wave = effect.of_role(Role.WAVE)
    return Drawing(NAMES[state], effort, "wave", wave.name if wave else "")


def _body_effort(effect: Effect, slot: Any) -> Drawing:
    asked = _asks_for(effect, slot.law)
    state = next((s for s in ("position", "velocity") if s in asked), "time")
    return _wave(effect, state, _along(effect, slot.law, state, position=0.0, velocity=0.0, time=0.0, command=0.0))


def _damping(effect: Effect, slot: Any) -> Drawing:
    return Drawing("speed", lambda values, element, v: -values[slot.coefficient] * v)


def _contact(effect: Effect, slot: Any) -> Drawing:
    spring = effect.kind in KINDS and KINDS[effect.kind].trait == slots.SPRING
    sign = 1.0 if spring else -1.0

    def level(values: Values, v: float) -> float:
        return _called(effect, slot.level, values, slip_speed=abs(v), direction=float(np.sign(v)))

    def effort(values: Values, element: Values, rate: Floats) -> Floats:
        return np.array([sign * np.sign(v) * level(values, float(v)) for v in rate])

    return Drawing("stretch rate" if spring else "speed", effort)


def _spring_force(effect: Effect, slot: Any) -> Drawing:
    asked = _asks_for(effect, slot.law)
    if {"time", "stretch"} <= asked:  # a stiffness that changes
        stiffness = KINDS[effect.kind].required["stiffness"]
        return Drawing(
            "time", _along(effect, slot.law, "time", stretch=1.0, stretch_rate=0.0), times="stretch",
            effort_unit=str(stiffness), effort_label="missing stiffness",
        )  # fmt: skip
    state = "stretch" if "stretch" in asked else "stretch_rate"
    return Drawing(NAMES[state], _along(effect, slot.law, state, stretch=0.0, stretch_rate=0.0, time=0.0))


def _spring_play(effect: Effect, slot: Any) -> Drawing:
    held = _along(effect, slot.law, "stretch")
    return Drawing("stretch", lambda values, element, s: element["stiffness"] * (held(values, element, s) - s))


def _spring_memory(effect: Effect, slot: Any) -> Drawing:
    """Force over a sweep of the stretch; the law does not depend on the sweep's speed."""

    def effort(values: Values, element: Values, sweep: Floats) -> Floats:
        z, out = 0.0, np.zeros(len(sweep))
        for k in range(1, len(sweep)):
            z = _called(effect, slot.after, values, memory=z, change=float(sweep[k] - sweep[k - 1]))
            out[k] = _called(effect, slot.force, values, memory=z)
        return out

    return Drawing("stretch", effort, "loop", width=lambda values: 2.0 * values[slot.reach])


def _command(effect: Effect, slot: Any) -> Drawing:
    passed = _along(effect, slot.law, "command")
    return Drawing("command", lambda values, element, u: passed(values, element, u) - u)


def _lead(effect: Effect, slot: Any) -> Drawing:
    """The law less its mean, since a recording's positions start anywhere."""
    law = _along(effect, slot.law, "angle")
    wave = effect.of_role(Role.WAVE)

    def effort(values: Values, element: Values, angle: Floats) -> Floats:
        turn = 2.0 * np.pi / (values[wave.name] if wave else 1.0)
        mean = float(np.mean(law(values, element, np.linspace(0.0, turn, POINTS)[:-1])))
        return law(values, element, angle) - mean

    return _wave(effect, "angle", effort)


def _play(effect: Effect, slot: Any) -> Drawing:
    """Position behind the gap over a sweep of that before it."""
    of_gear = isinstance(slot, slots.GearPlay)
    state, name, part = ("angle", slot.half_gap, 1.0) if of_gear else ("position", slot.width, 0.5)

    def effort(values: Values, element: Values, sweep: Floats) -> Floats:
        function, out = play, np.empty(len(sweep))
        last = float(sweep[0])
        for k, angle in enumerate(sweep):
            last = out[k] = function(last, float(angle), part * values[name])
        return out

    return Drawing(
        state, effort, "loop", width=lambda values: 2.0 * part * values[name], stroke=1.5,
        effort_unit=effect.size.unit, effort_label=f"{state} behind the gap",
    )  # fmt: skip


_DRAWN: dict[type[slots.Slot], Callable[[Effect, Any], Drawing]] = {
    slots.BodyEffort: _body_effort, slots.BodyDamping: _damping, slots.Contact: _contact,
    slots.SpringForce: _spring_force, slots.SpringPlay: _spring_play, slots.SpringMemory: _spring_memory,
    slots.Command: _command, slots.Lead: _lead, slots.GearPlay: _play,
    slots.JointPlay: _play,
}  # fmt: skip
