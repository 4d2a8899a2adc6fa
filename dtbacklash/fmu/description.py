"""``modelDescription.xml`` of an FMU for co-simulation, of FMI 2.0 or 3.0, and the description of its build."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree as xml

from dtbacklash.fmu.interface import OUTPUT, Variable, base_unit
from dtbacklash.version import __version__


@dataclass(frozen=True)
class Model:
    """What an FMU says of itself.

    name : an identifier of C. about : one line. token : of these sources. variables : in the order of their value
    references. sample_time_s : of which communication steps are multiples. any_step : whether one may be shorter than
    the importer's others.
    """

    name: str
    about: str
    token: str
    variables: list[Variable]
    sample_time_s: float
    any_step: bool = True


#: the file of an FMU that is compiled: no file of the core has its name, whatever the model's name is
SOURCE = "slave.c"


def described(model: Model, version: int) -> bytes:
    """The model's description. version : of FMI, 2 or 3."""
    two = version == 2
    root = xml.Element("fmiModelDescription", {"guid" if two else "instantiationToken": model.token})
    root.set("fmiVersion", f"{version}.0")
    root.set("modelName", model.name)
    root.set("description", model.about)
    root.set("generationTool", f"dtbacklash {__version__}")
    state = "state" if two else "State"
    can = {f"canGetAndSetFMU{state}": "true", f"canSerializeFMU{state}": "true"}
    run = xml.SubElement(root, "CoSimulation", can, modelIdentifier=model.name)
    run.set("canHandleVariableCommunicationStepSize", "true" if model.any_step else "false")
    if two:
        xml.SubElement(xml.SubElement(run, "SourceFiles"), "File", name=SOURCE)
    else:
        run.set("fixedInternalStepSize", repr(model.sample_time_s))
    _units(root, model.variables)
    xml.SubElement(xml.SubElement(root, "LogCategories"), "Category", name="logStatusError")
    xml.SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=repr(model.sample_time_s))
    _variables(root, model.variables, two)
    _structure(root, [k for k, v in enumerate(model.variables) if v.causality == OUTPUT], two)
    return _text(root)


def build_description(name: str) -> bytes:
    """How FMI 3.0 wants to know which file is compiled."""
    build = xml.Element("fmiBuildDescription", fmiVersion="3.0")
    built = xml.SubElement(build, "BuildConfiguration", modelIdentifier=name)
    xml.SubElement(xml.SubElement(built, "SourceFileSet", language="C99"), "SourceFile", name=SOURCE)
    return _text(build)


def _units(root: xml.Element, variables: list[Variable]) -> None:
    units = xml.SubElement(root, "UnitDefinitions")
    for name in sorted({_unit(one) for one in variables} - {""}):
        unit, base = xml.SubElement(units, "Unit", name=name), base_unit(name)
        if base is not None:
            xml.SubElement(unit, "BaseUnit", {key: repr(value) for key, value in base.items()})


def _unit(one: Variable) -> str:
    return "" if one.unit == "1" else one.unit


def _variables(root: xml.Element, variables: list[Variable], two: bool) -> None:
    within = xml.SubElement(root, "ModelVariables")
    for k, one in enumerate(variables):
        said = {"name": one.name, "valueReference": str(k), "causality": one.causality, "variability": one.variability}
        said |= {"description": one.description} if one.description else {}
        value = {} if one.causality == OUTPUT else {"start": repr(float(one.start))}
        value |= {"unit": _unit(one)} if _unit(one) else {}
        if two:
            xml.SubElement(xml.SubElement(within, "ScalarVariable", said), "Real", value)
        else:
            xml.SubElement(within, "Float64", said | value)
    if not two:
        time = {"name": "time", "valueReference": str(len(variables)), "causality": "independent"}
        xml.SubElement(within, "Float64", time, variability="continuous")


def _structure(root: xml.Element, outputs: list[int], two: bool) -> None:
    structure = xml.SubElement(root, "ModelStructure")
    for group in ("Output", "InitialUnknown"):
        within = xml.SubElement(structure, group + "s") if two else structure
        for k in outputs:
            found = {"index": str(k + 1)} if two else {"valueReference": str(k)}
            xml.SubElement(within, "Unknown" if two else group, found)


def _text(root: xml.Element) -> bytes:
    xml.indent(root)
    return xml.tostring(root, encoding="utf-8", xml_declaration=True)
