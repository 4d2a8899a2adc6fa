"""A designed controller as an FMU for co-simulation: its C file in a thin wrapper, compiled for this computer."""

from __future__ import annotations

import hashlib
import platform
import shutil
import subprocess
import tempfile
import zipfile
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree as xml

from dtbacklash.errors import UserError
from dtbacklash.fmu.interface import BASES
from dtbacklash.version import __version__

#: version of FMI -> folder of the library in the FMU, by operating system and processor
PLATFORMS = {
    2: {"Linux": "linux64", "Darwin": "darwin64", "Windows": "win64"},
    3: {"Linux": "{}-linux", "Darwin": "{}-darwin", "Windows": "{}-windows"},
}
PROCESSORS = {"amd64": "x86_64", "arm64": "aarch64"}
LIBRARY = {"Linux": ".so", "Darwin": ".dylib", "Windows": ".dll"}
COMPILERS = ("cc", "gcc", "clang")
#: in the order of the value references of controller.c: name, unit, causality, variability, what it is
VARIABLES = (
    ("r", "m", "input", "continuous", "reference of the output"),
    ("theta_m", "rad", "input", "continuous", "measured angle of the motor"),
    ("q3", "m", "input", "continuous", "measured output"),
    ("half_gap", "rad", "parameter", "tunable", "half-gap that the controller believes in"),
    ("u", "V", "output", "continuous", "voltage"),
    ("held", "1", "output", "continuous", "samples in which the last good value stood for one that was not finite"),
)


def write_fmu(
    source: str, name: str, first_half_gap_rad: float, sample_time_s: float, version: int, path: Path
) -> None:
    """Write the FMU of a controller's C file.

    Parameters
    ----------
    source : the C file. name : an identifier of C. first_half_gap_rad : that it believes in first.
    version : of FMI, 2 or 3. path : of the new file.

    Raises
    ------
    UserError : there is no C compiler, or this computer is none that FMI has a name for.
    """
    compiler = next(filter(None, map(shutil.which, COMPILERS)), None)
    system, processor = platform.system(), platform.machine().lower()
    if compiler is None or system not in LIBRARY:
        raise UserError("out", str(path), f"an FMU needs a C compiler ({', '.join(COMPILERS)}); a .c file does not")
    wrapper = files("dtbacklash.fmu").joinpath("controller.c").read_text(encoding="utf-8")
    token = hashlib.sha256(source.encode()).hexdigest()[:32]
    head = f'#define FMI {version}\n#define TOKEN "{token}"\n#include <stdbool.h>\n'
    folder = PLATFORMS[version][system].format(PROCESSORS.get(processor, processor))
    with tempfile.TemporaryDirectory() as scratch:
        file, library = Path(scratch, f"{name}.c"), Path(scratch, name + LIBRARY[system])
        file.write_text(head + source + wrapper, encoding="utf-8")
        subprocess.run([compiler, "-std=c99", "-O2", "-shared", "-fPIC", file, "-o", library, "-lm"], check=True)
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as fmu:
            fmu.writestr("modelDescription.xml", _described(name, token, first_half_gap_rad, sample_time_s, version))
            fmu.write(library, f"binaries/{folder}/{library.name}")
            fmu.write(file, f"sources/{file.name}")
            if version == 3:
                build = xml.Element("fmiBuildDescription", fmiVersion="3.0")
                built = xml.SubElement(build, "BuildConfiguration", modelIdentifier=name)
                xml.SubElement(xml.SubElement(built, "SourceFileSet", language="C99"), "SourceFile", name=file.name)
                fmu.writestr("sources/buildDescription.xml", _text(build))


def _described(name: str, token: str, first_half_gap_rad: float, sample_time_s: float, version: int) -> bytes:
    two = version == 2
    root = xml.Element("fmiModelDescription", {"guid" if two else "instantiationToken": token}, modelName=name)
    root.set("fmiVersion", f"{version}.0")
    root.set("generationTool", f"dtbacklash {__version__}")
    state = "state" if two else "State"
    can = {f"canGetAndSetFMU{state}": "true", f"canSerializeFMU{state}": "true"}
    run = xml.SubElement(root, "CoSimulation", can, modelIdentifier=name)
    run.set("canHandleVariableCommunicationStepSize", "true")
    if two:
        xml.SubElement(xml.SubElement(run, "SourceFiles"), "File", name=f"{name}.c")
    else:
        run.set("fixedInternalStepSize", repr(sample_time_s))
    units = xml.SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(unit for _, unit, *_ in VARIABLES):
        base = {name: str(power) for name, power in BASES[unit].items()}
        xml.SubElement(xml.SubElement(units, "Unit", name=unit), "BaseUnit", base)
    xml.SubElement(root, "DefaultExperiment", stepSize=repr(sample_time_s))
    variables = xml.SubElement(root, "ModelVariables")
    for k, (one, unit, causality, variability, description) in enumerate(VARIABLES):
        what = {"name": one, "valueReference": str(k), "causality": causality, "variability": variability,
                "description": description}  # fmt: skip
        start = {} if causality == "output" else {"start": repr(first_half_gap_rad if one == "half_gap" else 0.0)}
        if two:
            xml.SubElement(xml.SubElement(variables, "ScalarVariable", what), "Real", start, unit=unit)
        else:
            xml.SubElement(variables, "Float64", what | start, unit=unit)
    structure = xml.SubElement(root, "ModelStructure")
    outputs = [k for k, v in enumerate(VARIABLES) if v[2] == "output"]
    if two:
        for group in ("Outputs", "InitialUnknowns"):
            within = xml.SubElement(structure, group)
            for k in outputs:
                xml.SubElement(within, "Unknown", index=str(k + 1))
    else:
        time = {"name": "time", "valueReference": str(len(VARIABLES)), "causality": "independent"}
        xml.SubElement(variables, "Float64", time, variability="continuous")
        for group in ("Output", "InitialUnknown"):
            for k in outputs:
                xml.SubElement(structure, group, valueReference=str(k))
    return _text(root)


def _text(root: xml.Element) -> bytes:
    xml.indent(root)
    return xml.tostring(root, encoding="utf-8", xml_declaration=True)
