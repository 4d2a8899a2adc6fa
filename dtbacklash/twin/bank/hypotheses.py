"""What may have changed on a machine: each hypothesis is the believed rig with one thing of it set.

A hypothesis has one to three parameters. It sets them in a rig; simulation, motor equation and design then read the
changed rig as they read any other. Stiffness, damping and gains are sought by the logarithm of what they become of the
believed value, levels of friction and lengths by the logarithm of the level: none changes its sign.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from dtbacklash.control.belief import Belief
from dtbacklash.control.chain import driven_chain
from dtbacklash.physics.effects.declare import Values
from dtbacklash.physics.rig import Rig, build_rig

#: of a link's stiffness or damping where all links share one parameter
ALL_LINKS = "all links"


@dataclass(frozen=True)
class Value:
    """A parameter as fitted, SI, with its standard error, and what was believed of it before."""

    name: str
    value: float
    std: float
    unit: str
    believed: float = 0.0

    def __str__(self) -> str:
        if self.believed and self.unit != "rad":
            return f"{100.0 * (self.value / self.believed - 1.0):+.3g} %"
        return f"{self.value:.3g} {self.unit.removeprefix('1')}".rstrip()


#: sets parameters, SI, in a rig
Setter = Callable[[Rig, tuple[float, ...]], Rig]


@dataclass(frozen=True)
class Hypothesis:
    """One kind of change at one place.

    names, units : of its parameters. believed : their values before, SI; 0 for what the belief has not.
    starts : from which the fit begins, SI. typical : (n,) sizes by which a parameter that is fitted as it is, and not
    by its logarithm, is measured; 0 for a logarithm. sets : the change. effect : the catalogue's name of an effect that
    is set. periods : of cogging, a radian; its torque is fitted by sine and cosine. twins : what the signals cannot
    tell from it. like : kinds that they can hardly tell from it.
    """

    kind: str
    place: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    believed: tuple[float, ...]
    starts: tuple[tuple[float, ...], ...]
    typical: tuple[float, ...]
    sets: Setter
    effect: str = ""
    periods: float = 0.0
    twins: tuple[str, ...] = ()
    like: tuple[str, ...] = ()

    def from_fit(self, x: tuple[float, ...]) -> tuple[float, ...]:
        """Values, SI, of the fit's variables."""
        return tuple(
            v * size if size else math.exp(min(max(v, -40.0), 40.0)) for v, size in zip(x, self.typical, strict=True)
        )

    def to_fit(self, values: tuple[float, ...]) -> tuple[float, ...]:
        """The fit's variables of values, SI."""
        return tuple(v / size if size else math.log(v) for v, size in zip(values, self.typical, strict=True))

    def longest(self) -> tuple[float, ...]:
        """By how much a variable of the fit may change in a step: a logarithm not by far."""
        return tuple(math.inf if size else 1.2 for size in self.typical)

    def spread(self, value: float, i: int, std: float) -> float:
        """Standard error, SI, of parameter i from that of the fit's variable."""
        return std * (self.typical[i] or value)

    def changed(self, rig: Rig, x: tuple[float, ...]) -> Rig:
        """The believed rig with the change at the fit's variables ``x``."""
        return self.sets(rig, self.from_fit(x))


def structural(belief: Belief) -> list[Hypothesis]:
    """What may have changed behind the gear.

    Raises
    ------
    UserError : the rig is no screw-driven chain of masses (:func:`.chain.driven_chain`).
    """
    rig = belief.rig
    masses, links = driven_chain(rig)
    found = []
    for field in ("stiffness", "damping"):
        found += _of_links(rig, field, [e.name for e in links])
    screw = rig.only("screw")
    assert screw is not None
    stiffness = links[0].values["stiffness"]
    found.append(
        _effect(
            rig,
            "compliance",
            screw.name,
            "compliance",
            ("compliance",),
            ("m/N",),
            [(0.02 / stiffness,), (0.15 / stiffness,)],
        )
    )
    yields = rig.effect(screw.name, "compliance") is not None
    sliding = [screw.neighbours["carries"]] * yields + [e.name for e in masses]
    for name in sliding:
        found.append(
            _effect(rig, "ground friction", name, "ground_friction", ("force",), ("N",), [(0.03,), (0.1,), (0.3,)])
        )
    for link in links:
        found.append(_effect(
            rig, "hysteresis", link.name, "hysteresis", ("force", "displacement"), ("N", "m"),
            [(0.05, 1e-5), (0.3, 1e-5), (0.2, 5e-5)],
        ))  # fmt: skip
    return found


def of_the_motor(belief: Belief) -> list[Hypothesis]:
    """What may have changed of the motor; cogging has to be given its periods (:func:`cogging`)."""
    rig = belief.rig
    rotor, circuit, amplifier = rig.motor_rotor(), rig.only("motor_circuit"), rig.only("amplifier")
    assert rotor is not None
    assert circuit is not None
    # a weaker motor follows the voltage later by tenths of a millisecond, as a late one does
    constant = _parameter(rig, "torque constant", circuit.name, "torque_constant", "N m/A",
                          twins=(f"the resistance of the {circuit.name} or the inertia of the {rotor.name}, inversely",)
                          )  # fmt: skip
    found = [
        _effect(rig, "Coulomb friction", rotor.name, "coulomb_friction", ("torque",), ("N m",), [(0.02,)],
                twins=(f"dead zone of the {amplifier.name}",) if amplifier else ()),
        _effect(rig, "viscous friction", rotor.name, "viscous_friction", ("coefficient",), ("N m s/rad",), [(5e-4,)],
                twins=(f"a larger back-emf constant of the {circuit.name}",
                       "asymmetric friction, if it turned one way")),
        _effect(rig, "constant load", rotor.name, "constant_load", ("torque",), ("N m",), [(0.0,)], (0.01,)),
        replace(constant, like=("delay",)),
    ]  # fmt: skip
    if amplifier:
        found.append(_effect(rig, "gain", amplifier.name, "gain_error", ("relative",), ("1",), [(0.0,)], (0.1,)))
        late = _effect(rig, "delay", amplifier.name, "delay", ("time",), ("s",), [(4e-4,), (2e-3,)],
                       twins=(f"a delay of the sensor of the {rotor.name}",))  # fmt: skip
        found.append(replace(late, like=("torque constant",)))
    return found


def cogging(belief: Belief, periods: float) -> Hypothesis:
    """Cogging with these periods a radian, by torque and phase; the fit's variables are those of sine and cosine."""
    rotor = belief.rig.motor_rotor()
    assert rotor is not None
    there = belief.rig.effect(rotor.name, "cogging") or {}

    def sets(rig: Rig, values: tuple[float, ...]) -> Rig:
        sine, cosine = values
        filled = {"torque": math.hypot(sine, cosine), "periods": periods, "phase": math.atan2(cosine, sine)}
        return rig.with_effect(rotor.name, "cogging", filled)

    torque, phase = there.get("torque", 0.0), there.get("phase", 0.0)
    if there.get("periods", 0.0) != periods:
        torque = 0.0
    start = torque * math.cos(phase), torque * math.sin(phase)
    return Hypothesis(
        "cogging",
        rotor.name,
        ("torque (sine)", "torque (cosine)"),
        ("N m", "N m"),
        start,
        (start,),
        (0.01, 0.01),
        sets,
        "cogging",
        periods,
    )


def _effect(
    rig: Rig, kind: str, place: str, name: str, parameters: tuple[str, ...], units: tuple[str, ...],
    starts: list[tuple[float, ...]], typical: tuple[float, ...] | None = None, twins: tuple[str, ...] = (),
) -> Hypothesis:  # fmt: skip
    """An effect that takes a value, or another one than believed."""
    there: Values = rig.effect(place, name) or {}

    def sets(changed: Rig, values: tuple[float, ...]) -> Rig:
        return changed.with_effect(place, name, {**there, **dict(zip(parameters, values, strict=True))})

    believed = tuple(there.get(p, 0.0) for p in parameters)
    if there:
        starts = [believed, *starts]
    return Hypothesis(
        kind,
        place,
        parameters,
        units,
        believed,
        tuple(starts),
        typical or (0.0,) * len(parameters),
        sets,
        name,
        0.0,
        twins,
    )


def _parameter(rig: Rig, kind: str, element: str, field: str, unit: str, twins: tuple[str, ...] = ()) -> Hypothesis:
    """A field of an element that is off."""
    believed = rig.elements[element].values[field]
    return Hypothesis(kind, element, (field,), (unit,), (believed,), ((believed,),), (0.0,),
                      partial(_set_fields, ((element, field),)), twins=twins)  # fmt: skip


def _of_links(rig: Rig, field: str, links: list[str]) -> list[Hypothesis]:
    """Stiffness or damping of a single link; and of all that share one parameter."""
    unit = {"stiffness": "N/m", "damping": "N s/m"}[field]
    there = [name for name in links if rig.elements[name].values.get(field, 0.0) > 0.0]
    found = [_parameter(rig, field, name, field, unit) for name in there]
    shared = {rig.config.elements[name][field] for name in there}
    if len(there) > 1 and len(shared) == 1:
        (parameter,) = shared
        believed = rig.config.parameters[parameter].value

        def sets(changed: Rig, values: tuple[float, ...]) -> Rig:
            return changed.with_parameters({parameter: values[0]})

        found.insert(0, Hypothesis(field, ALL_LINKS, (field,), (unit,), (believed,), ((believed,),), (0.0,), sets))
    return found


def _set_fields(fields: tuple[tuple[str, str], ...], rig: Rig, values: tuple[float, ...]) -> Rig:
    """A rig in which fields of elements have values of their own, even where they shared a parameter with others."""
    parameters, elements = dict(rig.config.parameters), {name: dict(spec) for name, spec in rig.config.elements.items()}
    for (element, field), value in zip(fields, values, strict=True):
        name = elements[element][field]
        sharing = sum(spec_name == name for spec in elements.values() for spec_name in spec.values()
                      if isinstance(spec_name, str))  # fmt: skip
        own = name if sharing == 1 else f"{name}_{element}"
        parameters[own] = replace(parameters[name], value=float(value))
        elements[element][field] = own
    return build_rig(replace(rig.config, parameters=parameters, elements=elements))
