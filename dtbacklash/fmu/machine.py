"""A rig as C: the numbers of its compiled plant, and how they follow from the parameters that an FMU offers.

The assembly of the plant runs once more with numbers that record their arithmetic. So the FMU makes the plant of other
parameters by the operations of Python, in their order, and there is one assembly.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dtbacklash.core import build
from dtbacklash.core.library import ffi
from dtbacklash.errors import UserError
from dtbacklash.fmu.description import Model
from dtbacklash.fmu.interface import INPUT, OUTPUT, PARAMETER, Variable, identifier, values_of, variables
from dtbacklash.fmu.library import read_source, source_of, token_of, write_fmu
from dtbacklash.fmu.recorded import Recorded, text_of
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.slots import ROW_PARAMETERS
from dtbacklash.physics.kernel import structs
from dtbacklash.physics.kernel.laws import Called
from dtbacklash.physics.kernel.plant import Plant, new_state
from dtbacklash.physics.rig import Element, Rig, gear_down
from dtbacklash.physics.simulate import rig_half_gap

#: arrays of a plant that may follow from parameters, and are an instance's own; E, P1 and P2 follow from A and G
OWN = ("A", "G", "link", "circuit", "screw", "law_p")
MADE = ("E", "P1", "P2")
#: an instance can delay commands by at least so many samples
SAMPLES_LATE = 1000
#: commands that an instance remembers where a positioner imposes them, and the one at which a sample begins: the motion
#: between two samples is smooth through their neighbours, so that it is drawn when the second one behind is known
WINDOW, HERE = 4, 1
#: samples by which a positioner follows its command for that reason
LATE_SAMPLES = WINDOW - 1 - HERE
STRUCTS = """
typedef struct {
    const char *name;
    double start, least, most, factor;
    int above; /* the least value itself is none */
} Variable;
"""


def write_machine(
    rig: Rig, sample_time_s: float, substeps: int, event_levels: int, version: int, path: Path, shown: str | None = None
) -> None:
    """Write a rig as an FMU. version : of FMI, 2 or 3. path : of the file. shown : the same as the user has written it.

    Raises
    ------
    UserError : a law that is a function in C; see also :func:`.library.write_fmu`.
    """
    slave = numbers_of(rig, sample_time_s, substeps, event_levels) + "\n" + read_source("machine.c")
    about = f"{rig.config.description or rig.config.name}. Communication steps: multiples of {sample_time_s:g} s."
    core = core_sources()
    token = token_of(slave, *core.values())
    # steps may be any multiples of the sample time, but an importer that shortens one would miss it
    model = Model(identifier(rig), about, token, variables(rig), sample_time_s, any_step=False)
    write_fmu(model, source_of(slave, token, version), core, version, path, shown)


def core_sources() -> dict[str, str]:
    """The files of the core, as ``core.c`` includes them."""
    found = sorted(file for kind in ("*.c", "*.h") for file in build.HERE.glob(kind))
    return {file.name: file.read_text(encoding="utf-8") for file in found}


def numbers_of(rig: Rig, sample_time_s: float, substeps: int, event_levels: int) -> str:
    """The C code of a rig: its plant, its variables, the struct ``Slave``, and what follows from parameters.

    Raises
    ------
    UserError : a law that is a function in C.
    """
    offered = variables(rig)
    decisions: dict[str, bool] = {}
    parameters = [one for one in offered if one.causality == PARAMETER]
    rig = recording(rig, parameters, decisions)
    P = compile_plant(rig, sample_time_s, substeps, event_levels)
    amplifier = rig.only("amplifier")
    late = rig.amount(amplifier.name, slots.Late, "time") if amplifier else 0.0
    commands = max(4 * P.delay_whole, SAMPLES_LATE) + 2
    return "\n".join([
        '#include "core.c"', STRUCTS, *_sizes(P, offered, commands), *_variables(offered), *_laws(rig, P), _plant(P),
        _slave(P), *_assembly(P, decisions, late, rig_half_gap(rig), [one.name for one in parameters]),
    ])  # fmt: skip


def recording(rig: Rig, parameters: list[Variable], decisions: dict[str, bool]) -> Rig:
    """The rig with numbers that record what is made of them, by ``p[k]`` of the k-th parameter."""
    known = {v.path: Recorded(v.start, f"p[{k}]", decisions) for k, v in enumerate(parameters)}
    elements = {}
    for name, element in rig.elements.items():
        spec = rig.config.elements[name]
        values = {field: known["parameters", spec[field]] for field in values_of(element.kind) if field in spec}
        elements[name] = Element(name, element.kind, dict(values), element.neighbours)
    gear_down(elements)
    effects: Any = {
        place: {
            effect: {name: known.get(("effects", place, effect, name), value) for name, value in values.items()}
            for effect, values in there.items()
        }
        for place, there in rig.effects.items()
    }
    return replace(rig, elements=elements, effects=effects, number=object)


def _sizes(P: Plant, offered: list[Variable], commands: int) -> Iterator[str]:
    count = {cause: sum(one.causality == cause for one in offered) for cause in (INPUT, OUTPUT, PARAMETER)}
    sizes = {
        "INPUTS": count[INPUT], "OUTPUTS": count[OUTPUT], "PARAMETERS": count[PARAMETER], "COMMANDS": commands,
        "ENTRIES": len(P.law), "ROW": ROW_PARAMETERS, "RIG_N": P.A.shape[1], "RIG_CHANNELS": P.G.shape[1],
        "WINDOW": WINDOW, "HERE": HERE,
    }  # fmt: skip
    yield "enum { " + ", ".join(f"{name} = {value}" for name, value in sizes.items()) + " };"


def _variables(offered: list[Variable]) -> Iterator[str]:
    rows = [
        f"    {{{_text(one.name)}, " + ", ".join(map(text_of, (one.start, one.least, one.most, one.factor)))
        + f", {int(one.above)}}}"
        for one in offered
    ]  # fmt: skip
    yield "static const Variable VARIABLES[] = {\n" + ",\n".join(rows) + "};"
    yield _array("SHOWN", np.array([one.index for one in offered if one.causality == OUTPUT], dtype=np.int64))


def _text(value: str) -> str:
    """A string of C."""
    return json.dumps(value, ensure_ascii=False)


def _array(name: str, values: np.ndarray) -> str:
    """A constant array; C has none that are empty."""
    kind = "int64_t" if values.dtype.kind == "i" else "double"
    numbers = [str(v) for v in values.ravel()] if kind == "int64_t" else [text_of(float(v)) for v in values.ravel()]
    return f"static const {kind} {name}[{max(values.size, 1)}] = {{{', '.join(numbers) or '0'}}};"


def _laws(rig: Rig, P: Plant) -> Iterator[str]:
    """The array LAWS, and the programs of its formulas."""
    calls, rows = dict(structs.calls(P)), []
    for entry in range(len(P.law)):
        functions, formulas = ["NULL", "NULL"], ["NULL", "NULL"]
        for k, called in enumerate(calls.get(entry, [])):
            if called.name:
                functions[k] = f"(void (*)(void)){called.name}"
            elif called.formula:
                formulas[k] = f"&FORMULA_{entry}_{k}"
                yield from _formula(f"{entry}_{k}", called)
            else:
                raise UserError("rig", rig.config.name, "has a law that is a function in C; a formula can be exported")
        call, formula = ", ".join(functions), ", ".join(formulas)
        rows.append(f"    {{{{{call}}}, {{{formula}}}, NULL, {int(P.law[entry, 1])}}}")
    yield "static const Law LAWS[] = {\n" + (",\n".join(rows) or "    {{NULL, NULL}, {NULL, NULL}, NULL, 0}") + "};"


def _formula(number: str, called: Called) -> Iterator[str]:
    length = called.formula.length
    for name in ("operation", "number", "constant"):
        values = np.array(ffi.unpack(getattr(called.formula, name), length))
        yield _array(f"{name.upper()}_{number}", values)
    inside = f"{length}, OPERATION_{number}, NUMBER_{number}, CONSTANT_{number}"
    yield f"static const Formula FORMULA_{number} = {{{inside}}};"


def _plant(P: Plant) -> str:
    """RIG: the struct with what no parameter changes; the arrays of OWN and MADE are an instance's."""
    fixed = [name for name in structs.ARRAYS if name not in (*OWN, *MADE)]
    values: dict[str, str] = {name: text_of(getattr(P, name)) for name in ("sample_time",)}
    scalars = [name for name in structs.SCALARS if name != "sample_time" and not name.startswith("delay_")]
    values |= {name: str(int(value)) for name, value in structs.sizes(P).items()}
    values |= {name: str(int(getattr(P, name))) for name in scalars} | {name: f"RIG_{name}" for name in fixed}
    inside = ", ".join(f".{name} = {value}" for name, value in values.items())
    arrays = [_array(f"RIG_{name}", np.asarray(getattr(P, name))) for name in fixed]
    return "\n".join([*arrays, f"static const Plant RIG = {{{inside}}};"])


def _slave(P: Plant) -> str:
    """The struct ``Slave``, with room for all that an instance has of its own."""
    room = {name: getattr(P, name).size for name in (*OWN, *MADE)}
    state = new_state(P)._asdict() | {"commands": np.zeros(0)}
    room |= {name: values.size for name, values in state.items() if values.dtype != np.int64}
    room |= {"y": len(P.sensor) + 1, "window": WINDOW, "value": "INPUTS + OUTPUTS + PARAMETERS", "commands": "COMMANDS"}
    whole = {name: values.size for name, values in state.items() if values.dtype == np.int64}
    return "\n".join([
        "typedef struct {", "    Journal journal;", "    Plant P;", "    State S;",
        "    Law law[sizeof LAWS / sizeof LAWS[0]];",
        "    double start, gap, own_gap;", "    int64_t samples;", "    int made, begun;",
        *(f"    double {name}[{size or 1}];" for name, size in room.items()),
        *(f"    int64_t {name}[{size or 1}];" for name, size in whole.items()), "} Slave;",
    ])  # fmt: skip


def _assembly(P: Plant, decisions: dict[str, bool], late: float, own_gap: float, names: list[str]) -> Iterator[str]:
    """assemble(): the numbers of an instance from its parameters, as the assembly in Python made them."""
    for name in OWN:
        yield _array(f"FIRST_{name}", np.array([float(v) for v in getattr(P, name).ravel()]))
    yield "\n/* Write the numbers of a machine with these parameters; returns what makes it another one, or NULL. */"
    yield "static const char *assemble(Slave *s, const double *p, double *delay)\n{\n    (void)p;"
    for condition, answer in decisions.items():
        said = re.sub(r"p\[(\d+)\]", lambda found: names[int(found[1])], condition)
        yield f"    if (({condition}) != {int(answer)})\n        return {_text(said)};"
    for name in OWN:
        yield f"    memcpy(s->{name}, FIRST_{name}, sizeof FIRST_{name});"
        for k, value in enumerate(getattr(P, name).ravel()):
            if isinstance(value, Recorded):
                yield f"    s->{name}[{k}] = {value.text};"
    yield f"    s->own_gap = {text_of(own_gap)};\n    *delay = {text_of(late)};\n    return NULL;\n}}"
