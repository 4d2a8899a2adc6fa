"""Slots: the places of the equations of motion where an effect may act, and what its law sees and gives there.

A slot that holds laws names the states that they may ask for. A law is one small function; those of its
arguments that bear a state's name are given that state, the others are the effect's parameters (by name, ``size``
for the first, where all of them are such names, else all parameters in their order); ``row`` is all parameters in
their order, as one array. Laws of the package are functions of Python here and of C in the core; those of others are
formulas as text, or a :class:`.c_law.CLaw`. A slot without a law names the parameter that the linear plant, a delay or
the gear takes.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.physics.effects.declare import Effect
    from dtbacklash.physics.effects.formula import Formula

#: a function of floats; of arrays, too, where it only calculates
Law = Callable[..., Any]

#: parameters that a law of one's own has at most, and what a law is given at most
LAW_PARAMETERS, ROW_PARAMETERS = 6, 33
#: the argument of a law that is given all parameters at once
ROW = "row"

#: what an effect acts on: a body, a spring between two bodies, the amplifier, the motor's winding, an ideal actuator, a
#: drive with a position loop, the gear, the screw, a sensor, an actuator of a simulator's model. An element's kind says
#: which of these it is.
BODY, SLIDING_BODY, SPRING, AMPLIFIER, WINDING, ACTUATOR, SERVO, GEAR, SCREW, SENSOR, JOINT_DRIVE = (
    "body", "sliding body", "spring", "amplifier", "winding", "actuator", "servo", "gear", "screw", "sensor",
    "joint drive",
)  # fmt: skip


@dataclass(frozen=True)
class Slot:
    """A place in the equations of motion.

    states : what a law may ask for, SI. on : the traits of elements that have such a place. delays : whether what is
    there makes a signal late. proportional : whether what a small amount does grows as the amount does. adds_states :
    whether the linear plant has more states with it.
    """

    states: ClassVar[tuple[str, ...]] = ()
    on: ClassVar[tuple[str, ...]] = ()
    delays: ClassVar[bool] = False
    proportional: ClassVar[bool] = True
    adds_states: ClassVar[bool] = False

    def laws(self) -> dict[str, Law]:
        """The laws that stand in it, by field."""
        return {f.name: getattr(self, f.name) for f in fields(self) if callable(getattr(self, f.name))}

    def named(self) -> dict[str, str]:
        """The parameters that it names, by field."""
        said = {f.name: getattr(self, f.name) for f in fields(self)}
        return {field: name for field, name in said.items() if isinstance(name, str) and name}

    def read(self, parameters: Sequence[str], key: str) -> Self:
        """The slot with functions in place of laws that are text or in C.

        Raises
        ------
        UserError : one is no formula, or asks for what there is not.
        """
        from dtbacklash.physics.effects.c_law import CLaw
        from dtbacklash.physics.effects.formula import Formula

        made: dict[str, Law] = {}
        for f in fields(self):
            law, mine = getattr(self, f.name), f"{key}.{f.name}"
            if f.type == "Law" and isinstance(law, str):
                made[f.name] = Formula(law, self.states, parameters, mine).function()
            elif isinstance(law, CLaw):
                made[f.name] = law.function(self.states, parameters, mine)
        return replace(self, **made) if made else self

    def check(self, effect: Effect) -> None:
        """Refuse a law whose arguments are neither states nor the effect's parameters, and names of no parameter.

        Raises
        ------
        UserError : in the name of the effect.
        """
        for law in self.laws().values():
            arguments(law, self.states, effect)
        for name in self.named().values():
            if name not in [p.name for p in effect.parameters]:
                raise UserError(f"effect {effect.name}", name, "its slot names a parameter that it does not have")


@dataclass(frozen=True)
class BodyEffort(Slot):
    """An effort on a single body: N on one that slides, N m on one that turns; positive along its motion.

    ``command`` : what its drive is given, V; only a body that an actuator or a motor's winding drives has one.
    """

    law: Law
    states: ClassVar = ("position", "velocity", "time", "command")
    on: ClassVar = (BODY,)


@dataclass(frozen=True)
class BodyMemory(Slot):
    """An effort on a single body that depends on a state of its own, ``memory``, which begins at 0.

    effort : as of :class:`BodyEffort`. rate : of the memory, 1/s times its unit.
    """

    effort: Law
    rate: Law
    states: ClassVar = ("memory", "position", "velocity", "time")
    on: ClassVar = (BODY,)


@dataclass(frozen=True)
class BodyDamping(Slot):
    """A viscous damping of a body against the ground; it is linear and becomes part of the exact plant."""

    coefficient: str
    on: ClassVar = (BODY,)


@dataclass(frozen=True)
class Contact(Slot):
    """Dry friction, of a body against the ground or across a spring: the level that it holds against, >= 0.

    The levels of several effects at one place add up. ``slip_speed`` >= 0; ``direction`` is 1 or -1; ``load`` is the
    effort of the drive on the body (0 where none drives it), or the spring's force.
    """

    level: Law
    states: ClassVar = ("slip_speed", "direction", "load")
    on: ClassVar[tuple[str, ...]] = (BODY, SPRING)


@dataclass(frozen=True)
class Passing(Contact):
    """Dry friction of what passes on an effort: it brakes the body that a drive moves, or that moves a transmission.

    ``load`` : the effort that is passed on, seen at this body.
    """

    on: ClassVar = (SERVO, ACTUATOR, WINDING, SCREW, SPRING, JOINT_DRIVE)


@dataclass(frozen=True)
class SpringForce(Slot):
    """A force (or torque) of a spring beyond its linear part; positive pulls the ends together."""

    law: Law
    states: ClassVar = ("stretch", "stretch_rate", "time", "spring_stiffness", "spring_damping")
    on: ClassVar = (SPRING,)


@dataclass(frozen=True)
class SpringPlay(Slot):
    """What is left of a spring's stretch: the linear spring and all other laws see that instead."""

    law: Law
    states: ClassVar = ("stretch",)
    on: ClassVar = (SPRING,)
    proportional: ClassVar = False


@dataclass(frozen=True)
class SpringMemory(Slot):
    """A spring with a state of its own, ``memory``, which follows the stretch and not the time.

    after : what it is once the stretch has gone on to one side by ``change``, however far. force : that it makes.
    reach : the parameter that is the displacement after a reversal over which it remembers.
    """

    after: Law
    force: Law
    reach: str
    states: ClassVar = ("memory", "change")
    on: ClassVar = (SPRING,)


@dataclass(frozen=True)
class Command(Slot):
    """What the amplifier makes of the command, in the order of ``stage``. V -> V."""

    law: Law
    stage: int = 0
    states: ClassVar = ("command",)
    on: ClassVar = (AMPLIFIER, JOINT_DRIVE)


@dataclass(frozen=True)
class Clipping(Command):
    """The same of what takes a part of the command away, small or large."""

    proportional: ClassVar = False


@dataclass(frozen=True)
class Late(Slot):
    """A pure delay, of the amplifier or of a sensor; names the parameter that is the time, s."""

    time: str
    on: ClassVar = (AMPLIFIER, SENSOR, JOINT_DRIVE)
    proportional: ClassVar = False
    delays: ClassVar = True


@dataclass(frozen=True)
class Lag(Slot):
    """A first-order lag of an actuator's effort behind the command; names the parameter that is its time constant, s.

    It is linear and becomes part of the exact plant.
    """

    time: str
    on: ClassVar = (ACTUATOR,)
    proportional: ClassVar = False
    adds_states: ClassVar = True


@dataclass(frozen=True)
class Filter(Slot):
    """A linear filter before what a sensor shows.

    transfer : values -> numerator and denominator of its transfer function, highest power of s (rad/s) first: of lower
    degree, and equal at s = 0. It becomes part of the exact plant. as_late : seconds -> values of one that is as late.
    """

    transfer: Callable[[dict[str, float]], tuple[Sequence[float], Sequence[float]]]
    as_late: Callable[[float], dict[str, float]]
    on: ClassVar = (SENSOR,)
    proportional: ClassVar = False
    adds_states: ClassVar = True

    def laws(self) -> dict[str, Law]:
        """None: it is no law of states."""
        return {}

    def late(self, values: dict[str, float]) -> float:
        """How late it shows what changes slowly, s."""
        above, below = self.transfer(values)
        return float(below[-2] - (above[-2] if len(above) > 1 else 0.0)) / float(below[-1])


@dataclass(frozen=True)
class ShownPlay(Slot):
    """A gap between a body and the sensor of its position; names its whole width, m or rad."""

    width: str
    on: ClassVar = (SENSOR,)
    proportional: ClassVar = False


@dataclass(frozen=True)
class SpeedLimit(Slot):
    """The largest speed that a servo's position loop asks for; names the parameter, m/s or rad/s."""

    speed: str
    on: ClassVar = (SERVO,)
    proportional: ClassVar = False


@dataclass(frozen=True)
class EffortLimit(Slot):
    """The largest effort of a servo; names the parameter, N or N m."""

    effort: str
    on: ClassVar = (SERVO,)
    proportional: ClassVar = False


@dataclass(frozen=True)
class WindingMemory(Slot):
    """A state of the winding, ``memory``: its rate beside the linear decay, and the voltage that it eats.

    decay : the parameter whose inverse is the rate at which the state falls by itself.
    """

    rate: Law
    voltage: Law
    decay: str
    states: ClassVar = ("memory", "current", "resistance")
    on: ClassVar = (WINDING,)


@dataclass(frozen=True)
class MotorTorque(Slot):
    """An effort that the motor makes beyond its constant times the current."""

    law: Law
    states: ClassVar = ("current", "position", "torque_constant")
    on: ClassVar = (WINDING,)


@dataclass(frozen=True)
class Lead(Slot):
    """A displacement of what the screw carries beyond its lead, m, and its derivative by the angle, m/rad."""

    law: Law
    slope: Law
    states: ClassVar = ("angle",)
    on: ClassVar = (SCREW,)


@dataclass(frozen=True)
class Yielding(Slot):
    """A spring in series with the screw; names the parameter that is its compliance, m/N."""

    compliance: str
    on: ClassVar = (SCREW,)
    adds_states: ClassVar = True


@dataclass(frozen=True)
class Reaction(Slot):
    """The structure pushes back on the motor; names the parameter that is the share of the full reaction."""

    share: str
    on: ClassVar = (SCREW,)


@dataclass(frozen=True)
class GearPlay(Slot):
    """A gap of the gear to each side; names the parameter, rad."""

    half_gap: str
    on: ClassVar = (GEAR,)
    proportional: ClassVar = False


@dataclass(frozen=True)
class JointPlay(Slot):
    """A gap between a joint of a MuJoCo model and what its actuator turns; names its whole width, m or rad.

    The actuator turns the joint's armature, with the joint's damping and friction; behind the gap is all else.
    """

    width: str
    on: ClassVar = (BODY,)
    proportional: ClassVar = False


@dataclass(frozen=True)
class HiddenBody(Slot):
    """A body that nobody drew, on a spring and a damper; names the parameters for kg, Hz and the damping ratio."""

    mass: str
    frequency: str
    damping_ratio: str
    on: ClassVar = (SLIDING_BODY,)
    adds_states: ClassVar = True


@dataclass(frozen=True)
class Reading(Slot):
    """What a sensor shows of what it looks at, in the order of ``stage``; ``inverse`` : what it looked at (NumPy)."""

    law: Law
    inverse: Law
    stage: int = 0
    states: ClassVar = ("reading",)
    on: ClassVar = (SENSOR,)

    def laws(self) -> dict[str, Law]:
        """The one that it has."""
        return {"law": self.law}


def formula_of(law: Law) -> Formula | None:
    """The formula that a law was made of; None where it is a function of Python."""
    return getattr(law, "formula", None)


def asked(effect: Effect) -> set[str]:
    """The states that the laws of an effect ask for."""
    slot = effect.slot
    return {a for law in slot.laws().values() for a in arguments(law, slot.states, effect) if isinstance(a, str)}


def arguments(law: Law, states: tuple[str, ...], effect: Effect) -> list[str | int]:
    """What each argument of a law is: the name of a state, ROW, or the index of a parameter.

    Raises
    ------
    UserError : the law asks for what is neither.
    """
    names, states = list(inspect.signature(law).parameters), (*states, ROW)
    known = [p.name for p in effect.parameters]
    rest = [name for name in names if name not in states]
    if all(name in known or name == "size" for name in rest):
        places = {name: known.index(name) if name in known else 0 for name in rest}
    elif len(rest) == len(known):
        places = {name: j for j, name in enumerate(rest)}
    else:
        raise UserError(
            f"effect {effect.name}", ", ".join(rest),
            f"a law's arguments are states ({', '.join(states)}) and the parameters {', '.join(known)}",
        )  # fmt: skip
    return [name if name in states else places[name] for name in names]
