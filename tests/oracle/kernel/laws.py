"""Laws in plain Python: one function a slot, which calls the law that an entry's code stands for."""

import math
from collections.abc import Callable
from functools import cache
from types import FunctionType, SimpleNamespace
from typing import Any

import numpy as np

from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.slots import ROW, Slot
from dtbacklash.physics.kernel.dispatch import Call, calls_of, listed, other_of


def as_in_c(name: str) -> Callable[[float], float]:
    """A function of ``math`` that gives infinity or no number where Python's raises an error."""
    plain, other = getattr(math, name), getattr(np, name)

    def call(x: float) -> float:
        try:
            return plain(x)
        except (OverflowError, ValueError):
            return float(other(x))

    return call


MATH = SimpleNamespace(**{name: as_in_c(name) for name in ("sin", "cos", "exp", "expm1", "sqrt")}, pi=math.pi)


@cache
def unfailing(function: Any) -> Any:
    """A law, with the functions of its module that it calls, whose ``math`` is MATH."""
    if not isinstance(function, FunctionType):
        return function
    names = {n: function.__globals__.get(n) for n in function.__code__.co_names}
    space = {**function.__globals__, **{n: unfailing(f) for n, f in names.items() if isinstance(f, FunctionType)}}
    space["math"] = MATH
    return FunctionType(function.__code__, space, function.__name__, function.__defaults__, function.__closure__)


@cache
def _calls(slot: type[Slot], code: int) -> dict[str, Call]:
    calls = calls_of(other_of(code)) if code < 0 else listed(slot)[code]
    return {field: (unfailing(function), names) for field, (function, names) in calls.items()}


def _of(slot: type[Slot], field: str) -> Callable[..., float]:
    """(code, states..., p, e) -> the value of the law of entry e, whose parameters are a row of p."""
    places = {name: place for place, name in enumerate(slot.states)}

    def call(code: int, *given: Any) -> float:
        *states, p, e = given
        function, names = _calls(slot, int(code))[field]
        return function(*(p[e, n] if isinstance(n, int) else p[e] if n == ROW else states[places[n]] for n in names))

    return call


body_effort = _of(slots.BodyEffort, "law")
remembered_effort = _of(slots.BodyMemory, "effort")
memory_rate = _of(slots.BodyMemory, "rate")
friction_level = _of(slots.Contact, "level")
spring_force = _of(slots.SpringForce, "law")
spring_stretch = _of(slots.SpringPlay, "law")
memory_after = _of(slots.SpringMemory, "after")
memory_force = _of(slots.SpringMemory, "force")
amplified = _of(slots.Command, "law")
winding_rate = _of(slots.WindingMemory, "rate")
winding_voltage = _of(slots.WindingMemory, "voltage")
motor_torque = _of(slots.MotorTorque, "law")
lead_error = _of(slots.Lead, "law")
lead_slope = _of(slots.Lead, "slope")
shown = _of(slots.Reading, "law")
