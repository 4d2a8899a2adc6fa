"""The variables of a rig's FMU: inputs, outputs and parameters, with units; needs no FMI library."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from dtbacklash import units
from dtbacklash.experiment.sensors import column, trace_factor
from dtbacklash.physics import catalogue
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.physics.rig_file import rig_of
from dtbacklash.version import __version__

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
    index, factor : of an output, its place among the machine's values, and what makes its unit of SI.
    """

    name: str
    unit: str
    causality: str
    description: str
    start: float = 0.0
    path: tuple[str, ...] = ()
    index: int = 0
    factor: float = 1.0


@dataclass(frozen=True)
class Export:
    """The data in an FMU beside its description: all that its step needs, and the version that wrote it."""

    rig: Rig
    sample_time_s: float = 1e-3
    substeps: int = 0
    event_levels: int = 16
    version: str = __version__

    @property
    def identifier(self) -> str:
        """The rig's name as an identifier of C."""
        return re.sub(r"\W", "_", self.rig.config.name, flags=re.ASCII).lstrip("0123456789_") or "rig"

    def text(self) -> str:
        """The export as JSON; numbers with all their digits."""
        content = {name: getattr(self, name) for name in ("version", "sample_time_s", "substeps", "event_levels")}
        return json.dumps(content | {"rig": asdict(self.rig.config)}, indent=1, allow_nan=False)

    @classmethod
    def of(cls, text: str) -> Export:
        """The export whose :meth:`text` this is.

        Raises
        ------
        RuntimeError : another version of the package wrote it.
        """
        content: dict[str, Any] = json.loads(text)
        if content["version"] != __version__:
            have = f"this Python has dtbacklash {__version__}, and the FMU was exported by {content['version']}"
            raise RuntimeError(f"{have}: pip install dtbacklash=={content['version']}, or export it anew")
        return cls(rig=rig_of(content.pop("rig")), **content)


def variables(rig: Rig) -> list[Variable]:
    """All variables of a rig's FMU, in order: inputs, outputs, parameters."""
    return [*_inputs(rig), *_outputs(rig), *_parameters(rig)]


def _inputs(rig: Rig) -> Iterator[Variable]:
    yield Variable(COMMAND, "V", INPUT, "command, held over the communication step")
    if rig.only("gear"):
        about = "half-gap beside the rig's own, reached at the end of the step's first sample (0 to 360)"
        yield Variable(GAP, "deg", INPUT, about)


def _outputs(rig: Rig) -> Iterator[Variable]:
    names = set()
    for j, sensor in enumerate(rig.sensors.values()):
        about = f"{sensor.quantity} of {sensor.of}, true value"
        names.add(column(sensor))
        yield Variable(column(sensor), units.shown(sensor.unit)[0], OUTPUT, about, index=j, factor=trace_factor(sensor))
    if rig.only("gear") and rig.motor_rotor() and SCREW not in names:
        yield Variable(SCREW, "rad", OUTPUT, "angle behind the gear, true value", index=len(rig.sensors))


def _parameters(rig: Rig) -> Iterator[Variable]:
    for name, parameter in rig.config.parameters.items():
        path = ("parameters", name)
        yield Variable(_dotted(path), parameter.unit, PARAMETER, parameter.description, float(parameter.value), path)
    for place, there in rig.effects.items():
        if place.startswith(SENSOR_PREFIX):  # true values do not show what a sensor makes of them
            continue
        known = catalogue.effects_of(rig.kind_at(place))
        for effect, values in there.items():
            declared = {one.name: one for one in known[effect].parameters}
            for name, value in values.items():
                where = ("effects", place, effect, name)
                about = f"{effect.replace('_', ' ')} at {place}: {known[effect].law}"
                yield Variable(_dotted(where), declared[name].unit, PARAMETER, about, value, where)


def _dotted(path: tuple[str, ...]) -> str:
    """A path as a structured name of FMI 2.0: a part that is not an identifier stands in quotes."""
    plain = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
    return ".".join(part if plain.fullmatch(part) else "'" + part.replace("'", "\\'") + "'" for part in path)


def changed(rig: Rig, values: dict[tuple[str, ...], float]) -> Rig:
    """The rig with other values of its parameters, by their paths.

    Raises
    ------
    UserError : a value that the rig may not have.
    """
    own = {path[1]: value for path, value in values.items() if path[0] == "parameters"}
    rig = rig.with_parameters(own) if own else rig
    effects: dict[tuple[str, str], dict[str, float]] = {}
    for path, value in values.items():
        if path[0] == "effects":
            place, effect, name = path[1:]
            effects.setdefault((place, effect), dict(rig.effects[place][effect]))[name] = value
    for (place, effect), leaves in effects.items():
        rig = rig.with_effect(place, effect, leaves)
    return rig


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
