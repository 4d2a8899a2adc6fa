"""The slave that pythonfmu calls: variables of the rig in, a machine behind them.

It is loaded where the FMU is imported, by the Python there; pythonfmu itself comes inside of the FMU.
"""

from __future__ import annotations

import ctypes
import math
import sys
import uuid
from collections.abc import Callable
from functools import partial, wraps
from pathlib import Path
from typing import Any, TypeVar
from xml.etree.ElementTree import Element, SubElement

from pythonfmu.default_experiment import DefaultExperiment
from pythonfmu.enums import Fmi2Causality, Fmi2Variability
from pythonfmu.fmi2slave import Fmi2Slave
from pythonfmu.variables import Real

from dtbacklash import source_hash
from dtbacklash.fmu import interface
from dtbacklash.fmu.interface import COMMAND, GAP, GAP_MOST_DEG, INPUT, OUTPUT, PARAMETER, Export, Variable
from dtbacklash.fmu.machine import Machine

#: the file in the FMU that says which rig it is
CONTENT = "rig.json"
#: by how much of a sample a communication point may lie beside the sample that it means: importers add up their steps
SLACK = 1e-3

Result = TypeVar("Result")

_CAUSALITY = {
    INPUT: (Fmi2Causality.input, Fmi2Variability.continuous),
    OUTPUT: (Fmi2Causality.output, Fmi2Variability.continuous),
    PARAMETER: (Fmi2Causality.parameter, Fmi2Variability.fixed),
}


class _Real(Real):
    """A real variable with its unit, and with all digits of the value where it begins."""

    def __init__(self, variable: Variable, **access: Any) -> None:
        causality, variability = _CAUSALITY[variable.causality]
        about = variable.description or None
        super().__init__(variable.name, causality=causality, variability=variability, description=about, **access)
        self.unit = variable.unit if variable.unit not in ("", "1") else ""

    def to_xml(self) -> Element:
        found = super().to_xml()
        real = found.find("Real")
        assert real is not None
        if self.start is not None:
            real.set("start", repr(float(self.start)))
        if self.unit:
            real.set("unit", self.unit)
        return found


def told(step: Callable[..., Result]) -> Callable[..., Result]:
    """What pythonfmu's library calls: a mistake in it goes to stderr as well, and ends the slave, not the process.

    The library gives up its references to the slave when an exception leaves it, and once more when the importer frees
    it; importers show the log on demand only.
    """

    @wraps(step)
    def call(slave: RigSlave, *arguments: Any) -> Result:
        try:
            return step(slave, *arguments)
        except Exception as mistake:
            print(f"{slave.modelName}.fmu: {mistake}", file=sys.stderr, flush=True)
            for one in (slave, type(slave), slave.log_queue):
                ctypes.pythonapi.Py_IncRef(ctypes.py_object(one))
            raise

    return call


class RigSlave(Fmi2Slave):
    """A rig as a co-simulation slave: at rest when it is instantiated or reset.

    Raises
    ------
    RuntimeError : the FMU was exported by another version of the package.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)
        text = (Path(self.resources) / CONTENT).read_text(encoding="utf-8")
        try:
            self._export = export = Export.of(text)
        except Exception as mistake:
            print(f"{arguments['instance_name']}: {mistake}", file=sys.stderr, flush=True)
            raise
        self.guid = uuid.uuid5(uuid.NAMESPACE_OID, f"{source_hash.digest()} {text}")
        self.modelName, self.version = export.identifier, export.version
        self.description = about(export)
        self.default_experiment = DefaultExperiment(start_time=0.0, step_size=export.sample_time_s)
        self._start_s, self._running = 0.0, False
        self._machine: Machine | None = None
        self._variables = interface.variables(export.rig)
        self._values = {one.name: one.start for one in self._variables}
        for one in self._variables:
            self.register_variable(_Real(one, getter=partial(self._value, one), setter=partial(self._take, one)))

    set_real = told(Fmi2Slave.set_real)
    get_real = told(Fmi2Slave.get_real)

    def setup_experiment(
        self, start_time: float, stop_time: float | None = None, tolerance: float | None = None
    ) -> None:
        """The time at which it begins, s."""
        self._start_s = start_time
        self._machine = None

    @told
    def exit_initialization_mode(self) -> None:
        """From here on the parameters are what they are.

        Raises
        ------
        UserError : a parameter that the rig may not have.
        """
        self._now()
        self._running = True

    @told
    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance by ``step_size`` seconds from ``current_time``.

        Raises
        ------
        ValueError : the step is no multiple of the sample time; the point is not where the last step ended; an input is
            no number, or a gap that cannot be. RuntimeError : the rig has run away.
        """
        machine, sample_s = self._now(), self._export.sample_time_s
        samples = round(step_size / sample_s)
        if samples < 1 or abs(step_size - samples * sample_s) > SLACK * sample_s:
            step = f"communication step {step_size:g} s"
            raise ValueError(f"{step}: must be a multiple of the sample time {sample_s:g} s")
        if not abs(current_time - machine.t_s) <= SLACK * sample_s:
            at = f"communication point {current_time:.9g} s"
            raise ValueError(f"{at}: must be {machine.t_s:.9g} s, where the last step has ended; none is repeated")
        machine.advance(samples, self._input(COMMAND), math.radians(self._gap_deg()))
        if not machine.is_finite():
            raise RuntimeError(f"the rig has run away before t = {machine.t_s:.9g} s")
        return True

    def _now(self) -> Machine:
        """The machine; before the first step the one that the values so far would give."""
        if self._machine is None:
            export = self._export
            changed = {
                one.path: self._values[one.name] for one in self._variables
                if one.path and self._values[one.name] != one.start
            }  # fmt: skip
            self._machine = Machine(
                interface.changed(export.rig, changed), export.sample_time_s, export.substeps, export.event_levels,
                self._start_s, self._input(COMMAND), math.radians(self._gap_deg()),
            )  # fmt: skip
        return self._machine

    def _input(self, name: str) -> float:
        value = self._values.get(name, 0.0)
        if not math.isfinite(value):
            raise ValueError(f"{name}={value}: must be finite")
        return value

    def _gap_deg(self) -> float:
        value = self._input(GAP)
        if not 0.0 <= value <= GAP_MOST_DEG:
            raise ValueError(f"{GAP}={value:g}: must be at least 0 and at most {GAP_MOST_DEG:g} deg")
        return value

    def _value(self, one: Variable) -> float:
        """The value of a variable."""
        return float(self._now().y[one.index]) * one.factor if one.causality == OUTPUT else self._values[one.name]

    def _take(self, one: Variable, value: float) -> None:
        if one.causality == OUTPUT:
            raise ValueError(f"{one.name}={value:g}: is an output")
        if one.causality == PARAMETER and self._running:
            raise ValueError(f"{one.name}={value:g}: is fixed; set it before the initialization ends")
        self._values[one.name] = float(value)
        if not self._running:
            self._machine = None

    def to_xml(self, model_options: dict[str, str] | None = None) -> Element:
        """The model description: pythonfmu's, with units and what is unknown at the start."""
        root: Element = super().to_xml(model_options or {})
        names = sorted({one.unit for one in self.vars.values() if one.unit})
        defined = Element("UnitDefinitions")
        for name in names:
            unit, base = SubElement(defined, "Unit", name=name), interface.base_unit(name)
            if base is not None:
                SubElement(unit, "BaseUnit", {key: repr(value) for key, value in base.items()})
        root.insert([child.tag for child in root].index("CoSimulation") + 1, defined)
        structure = root.find("ModelStructure")
        assert structure is not None
        unknown = SubElement(structure, "InitialUnknowns")
        for output in structure.findall("Outputs/Unknown"):
            SubElement(unknown, "Unknown", output.attrib)
        return root


def about(export: Export) -> str:
    """The description in the FMU."""
    config = export.rig.config
    needs = f"Needs Python 3.11 to 3.13 with dtbacklash {export.version} where it is imported"
    step = f"communication steps: multiples of {export.sample_time_s:g} s"
    return f"{config.description or config.name}. {needs} (pip install dtbacklash=={export.version}); {step}."
