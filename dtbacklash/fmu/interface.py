"""The variables of a rig's FMU: inputs, outputs and parameters, with units."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from dtbacklash import units
from dtbacklash.experiment.sensors import column, trace_factor
from dtbacklash.physics import catalogue
from dtbacklash.physics.element_kinds import KINDS
from dtbacklash.physics.rig import MAY_BE_ZERO, SENSOR_PREFIX, Rig

INPUT, OUTPUT, PARAMETER = "input", "output", "parameter"
COMMAND, GAP, SCREW = "u_v", "gap_deg", "theta_d_rad"
GAP_MOST_DEG = 360.0

#: SI units by the exponents of the base units of FMI 2.0
BASES: dict[str, dict[str, int]] = {
    "kg": {"kg": 1}, "m": {"m": 1}, "s": {"s": 1}, "A": {"A": 1}, "rad": {"rad": 1}, "1": {}, "rev": {},
    "N": {"kg": 1, "m": 1, "s": -2}, "V": {"kg": 1, "m": 2, "s": -3, "A": -1}, "W": {"kg": 1, "m": 2, "s": -3},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2}, "H": {"kg": 1, "m": 2, "s": -2, "A": -2}, "Hz": {"s": -1},
}  # fmt: skip


@dataclass(frozen=True)
class Variable:
    """One variable: its name in the FMU, its unit (empty: none), its causality, what it is, and where it begins.

    path : of a parameter, where it stands in the rig: ``("parameters", name)`` or ``("effects", place, effect, name)``.
    least, most : between which an input or a parameter may be; above : but not at the least. tunable : a parameter that
    may be set at any time. index, factor : of an output, its place among the machine's values, and what makes its unit
    of SI.
    """

    name: str
    unit: str
    causality: str
    description: str
    start: float = 0.0
    path: tuple[str, ...] = ()
    least: float = -math.inf
    most: float = math.inf
    above: bool = False
    tunable: bool = False
    index: int = 0
    factor: float = 1.0

    @property
    def variability(self) -> str:
        """As FMI calls it."""
        fixed = "tunable" if self.tunable else "fixed"
        return fixed if self.causality == PARAMETER else "continuous"


def identifier(rig: Rig) -> str:
    """The rig's name as an identifier of C."""
    return re.sub(r"\W", "_", rig.config.name, flags=re.ASCII).lstrip("0123456789_") or "rig"


def variables(rig: Rig) -> list[Variable]:
    """All variables of a rig's FMU, in order: inputs, outputs, parameters."""
    return [*_inputs(rig), *_outputs(rig), *_parameters(rig)]


def _inputs(rig: Rig) -> Iterator[Variable]:
    yield Variable(COMMAND, "V", INPUT, "command, held over the communication step")
    if rig.only("gear"):
        about = "half-gap beside the rig's own, reached at the end of the step's first sample (0 to 360)"
        yield Variable(GAP, "deg", INPUT, about, least=0.0, most=GAP_MOST_DEG)


def _outputs(rig: Rig) -> Iterator[Variable]:
    names = set()
    for j, sensor in enumerate(rig.sensors.values()):
        about = f"{sensor.quantity} of {sensor.of}, true value"
        names.add(column(sensor))
        yield Variable(column(sensor), units.shown(sensor.unit)[0], OUTPUT, about, index=j, factor=trace_factor(sensor))
    if rig.only("gear") and rig.motor_rotor() and SCREW not in names:
        yield Variable(SCREW, "rad", OUTPUT, "angle behind the gear, true value", index=len(rig.sensors))


def _parameters(rig: Rig) -> Iterator[Variable]:
    fields = [(spec[f], f) for spec in rig.config.elements.values() for f in values_of(spec["kind"]) if f in spec]
    used, above = {name for name, _ in fields}, {name for name, field in fields if not field.endswith(MAY_BE_ZERO)}
    for name, parameter in rig.config.parameters.items():
        path, value, about = ("parameters", name), float(parameter.value), parameter.description
        least = 0.0 if name in used else -math.inf
        yield Variable(_dotted(path), parameter.unit, PARAMETER, about, value, path, least, above=name in above)
    for place, there in rig.effects.items():
        if place.startswith(SENSOR_PREFIX):  # true values do not show what a sensor makes of them
            continue
        known = catalogue.effects_of(rig.kind_at(place))
        for effect, values in there.items():
            declared = {one.name: one for one in known[effect].parameters}
            for name, value in values.items():
                where = ("effects", place, effect, name)
                about = f"{effect.replace('_', ' ')} at {place}: {known[effect].law}"
                one = declared[name]
                yield Variable(_dotted(where), one.unit, PARAMETER, about, value, where, one.low, one.high)


def values_of(kind: str) -> list[str]:
    """The fields of a kind of element that name a parameter."""
    return [*KINDS[kind].required, *KINDS[kind].optional]


def _dotted(path: tuple[str, ...]) -> str:
    """A path as a structured name of FMI 2.0: a part that is not an identifier stands in quotes."""
    plain = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
    return ".".join(part if plain.fullmatch(part) else "'" + part.replace("'", "\\'") + "'" for part in path)


def base_unit(unit: str) -> dict[str, float] | None:
    """A unit by the exponents of the base units, with its ``factor``; None of a unit that is not known.

    Written as in ``N m s^2/rad``: factors with blanks, powers with ``^``, one bar.
    """
    found = units.find(unit)
    if found is not None and found.si != unit:
        base = base_unit(found.si)
        return None if base is None else {**base, "factor": found.factor}
    total: dict[str, float] = {}
    for side, sign in zip(unit.split("/"), (1, -1), strict=False):
        for factor in side.split():
            name, _, power = factor.partition("^")
            if name not in BASES or not re.fullmatch(r"-?\d*", power):
                return None
            for base_name, exponent in BASES[name].items():
                total[base_name] = total.get(base_name, 0) + sign * exponent * int(power or 1)
    return {name: exponent for name, exponent in total.items() if exponent}
