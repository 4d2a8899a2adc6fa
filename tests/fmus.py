"""Model Exchange FMUs of small machines for tests, 2.0 and 3.0: equations in C, compiled by the system."""

from __future__ import annotations

import re
import shutil
import subprocess
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import pytest

#: all variables are numbers in one array ``m->number``; its place is the value reference
SOURCE = """
#include <stdlib.h>
#include <string.h>
#include <math.h>
#include "fmi{version}Functions.h"
typedef struct {{ double number[{count}]; double t; }} M;
{defines}
static const double start[{count}] = {{ {start} }};
static void equations(M *m) {{
  double t = m->t; (void)t;
{equations}
}}
static void signs(M *m, double *z) {{ {signs} }}
static int event(M *m) {{ double t = m->t; int moved = 0; (void)t; {event} return moved; }}
static int again(M *m) {{ return {again}; }}
static int refuses(M *m) {{ double t = m->t; (void)t; return {refuses}; }}
static double next(M *m) {{ return {clock}; }}
static void *begin(void) {{ M *m = malloc(sizeof(M)); memcpy(m->number, start, sizeof start); m->t = 0.0; return m; }}
#define X(k) (((M *)c)->number[k])
"""
TWO = """
#define OK { return fmi2OK; }
#define S fmi2Status
#define C fmi2Component c
typedef const fmi2ValueReference *R; typedef size_t N;
C0 fmi2Instantiate(fmi2String a, fmi2Type b, fmi2String g, fmi2String r, const fmi2CallbackFunctions *f, fmi2Boolean v,
  fmi2Boolean l) { return begin(); }
void fmi2FreeInstance(C) { free(c); }
S fmi2SetupExperiment(C, fmi2Boolean a, double b, double d, fmi2Boolean e, double f) OK
S fmi2EnterInitializationMode(C) OK
S fmi2ExitInitializationMode(C) OK
S fmi2Terminate(C) OK
S fmi2Reset(C) { memcpy(((M *)c)->number, start, sizeof start); ((M *)c)->t = 0.0; return fmi2OK; }
S fmi2GetReal(C, R r, N n, double *y) { equations(c); for (N i = 0; i < n; i++) y[i] = X(r[i]); return fmi2OK; }
S fmi2SetReal(C, R r, N n, const double *y) { for (N i = 0; i < n; i++) { if (!isfinite(y[i])) return fmi2Error;
  X(r[i]) = y[i]; } return fmi2OK; }
S fmi2EnterEventMode(C) OK
S fmi2NewDiscreteStates(C, fmi2EventInfo *e) { memset(e, 0, sizeof *e);
  e->newDiscreteStatesNeeded = again(c); e->valuesOfContinuousStatesChanged = event(c); e->nextEventTime = next(c);
  e->nextEventTimeDefined = isfinite(e->nextEventTime); return fmi2OK; }
S fmi2GetEventIndicators(C, double *z, N n) { signs(c, z); return fmi2OK; }
S fmi2EnterContinuousTimeMode(C) OK
S fmi2CompletedIntegratorStep(C, fmi2Boolean a, fmi2Boolean *b, fmi2Boolean *d) { *b = *d = 0; return fmi2OK; }
S fmi2SetTime(C, double t) { ((M *)c)->t = t; return fmi2OK; }
S fmi2SetContinuousStates(C, const double *x, N n) { for (N i = 0; i < n; i++) X(STATE[i]) = x[i]; return fmi2OK; }
S fmi2GetDerivatives(C, double *d, N n) { equations(c); for (N i = 0; i < n; i++) d[i] = X(RATE[i]);
  return refuses(c) ? fmi2Error : fmi2OK; }
S fmi2GetNominalsOfContinuousStates(C, double *x, N n) { for (N i = 0; i < n; i++) x[i] = 1.0; return fmi2OK; }
S fmi2GetContinuousStates(C, double *x, N n) { for (N i = 0; i < n; i++) x[i] = X(STATE[i]); return fmi2OK; }
""".replace("C0", "fmi2Component")
THREE = """
#define OK { return fmi3OK; }
#define S fmi3Status
#define C fmi3Instance c
typedef const fmi3ValueReference *R; typedef size_t N; typedef bool B;
fmi3Instance fmi3InstantiateModelExchange(fmi3String a, fmi3String g, fmi3String r, B v, B l,
  fmi3InstanceEnvironment e, fmi3LogMessageCallback f) { return begin(); }
void fmi3FreeInstance(C) { free(c); }
S fmi3EnterInitializationMode(C, B a, double b, double d, B e, double f) OK
S fmi3ExitInitializationMode(C) OK
S fmi3EnterEventMode(C) OK
S fmi3Terminate(C) OK
S fmi3Reset(C) { memcpy(((M *)c)->number, start, sizeof start); ((M *)c)->t = 0.0; return fmi3OK; }
S fmi3GetFloat64(C, R r, N n, double *y, N k) { equations(c); for (N i = 0, a = 0; i < n; i++)
  for (N e = 0; e < SIZE[r[i]]; e++) { if (a >= k) return fmi3Error; y[a++] = X(r[i] + e); } return fmi3OK; }
S fmi3SetFloat64(C, R r, N n, const double *y, N k) { for (N i = 0, a = 0; i < n; i++)
  for (N e = 0; e < SIZE[r[i]]; e++) { if (a >= k || !isfinite(y[a])) return fmi3Error; X(r[i] + e) = y[a++]; }
  return fmi3OK; }
S fmi3UpdateDiscreteStates(C, B *a, B *b, B *d, B *e, B *f, double *g) { *b = *d = 0; *a = again(c); *e = event(c);
  *g = next(c); *f = isfinite(*g); return fmi3OK; }
S fmi3GetEventIndicators(C, double *z, N n) { signs(c, z); return fmi3OK; }
S fmi3EnterContinuousTimeMode(C) OK
S fmi3CompletedIntegratorStep(C, B a, B *b, B *d) { *b = *d = false; return fmi3OK; }
S fmi3SetTime(C, double t) { ((M *)c)->t = t; return fmi3OK; }
S fmi3SetContinuousStates(C, const double *x, N n) { for (N i = 0; i < n; i++) X(STATE[i]) = x[i]; return fmi3OK; }
S fmi3GetContinuousStateDerivatives(C, double *d, N n) { equations(c); for (N i = 0; i < n; i++) d[i] = X(RATE[i]);
  return refuses(c) ? fmi3Error : fmi3OK; }
S fmi3GetNominalsOfContinuousStates(C, double *x, N n) { for (N i = 0; i < n; i++) x[i] = 1.0; return fmi3OK; }
S fmi3GetContinuousStates(C, double *x, N n) { for (N i = 0; i < n; i++) x[i] = X(STATE[i]); return fmi3OK; }
"""
Unit = str


def _in_c(name: str) -> str:
    return re.sub(r"\W", "_", name)


def _compile(sources: Path, library: Path) -> None:
    import fmpy

    if not shutil.which("gcc"):
        pytest.skip("no C compiler (gcc) to build a test FMU with")
    headers = Path(fmpy.__file__).parent / "c-code"
    words = ["gcc", "-shared", "-fPIC", "-O2", "-w", f"-I{headers}", *map(str, sources.glob("*.c")), "-lm"]
    subprocess.run([*words, "-o", str(library)], check=True)


def compiled(name: str, path: Path) -> Path:
    """An FMU that CasADi has exported (``stage``, ``crane``: casadi_machines.py), with a library of this computer."""
    work = path.with_suffix("")
    with zipfile.ZipFile(Path(__file__).parent / "reference" / f"casadi_{name}.zip") as archive:
        archive.extractall(work)
    folder = work / "binaries" / "x86_64-linux"
    folder.mkdir(parents=True)
    _compile(work / "sources", folder / f"{name}.so")
    with zipfile.ZipFile(path, "w") as out:
        for file in [f for f in work.rglob("*") if f.is_file()]:
            out.write(file, str(file.relative_to(work)))
    shutil.rmtree(work)
    return path


def _sizes(names: list[str], arrays: bool) -> dict[str, int]:
    """Elements of the array whose first one a number is; 0 of the others, 1 of a number by itself."""
    whole = [re.sub(r"\[\d+\]$", "[1]", name) if arrays else name for name in names]
    return {name: whole.count(name) for name in names}


@dataclass(frozen=True)
class Machine:
    """A machine as C: ``equations`` set ``D_STATE`` of each state, and outputs; a dot or bracket in a name is ``_``."""

    states: dict[str, tuple[float, Unit]]
    parameters: dict[str, float]
    inputs: dict[str, Unit]
    equations: str
    outputs: dict[str, Unit] = field(default_factory=dict)
    #: numbers that change at events alone; event indicators; what an event does, ``moved = 1`` where it moves states
    discrete: dict[str, float] = field(default_factory=dict)
    signs: tuple[str, ...] = ()
    event: str = ""
    #: when its discrete states want another turn, and when it refuses its derivatives
    again: str = "0"
    refuses: str = "0"
    #: when its clock strikes next
    clock: str = "INFINITY"

    def build(self, path: Path, version: int = 2, arrays: bool = False, **changes: str) -> Path:
        """Write it as an FMU. arrays : ``a[1]``, ``a[2]`` are one variable. changes : texts of its description."""
        import fmpy

        names = [
            *self.states,
            *(f"D_{s}" for s in self.states),
            *self.parameters,
            *self.inputs,
            *self.outputs,
            *self.discrete,
        ]
        n, first = len(self.states), dict.fromkeys(names, 0.0)
        first |= {s: x for s, (x, _) in self.states.items()} | self.parameters | self.discrete
        source = SOURCE.format(
            version=version, count=len(names), start=", ".join(map(repr, first.values())), equations=self.equations,
            signs=" ".join(f"z[{k}] = {sign};" for k, sign in enumerate(self.signs)), event=self.event,
            again=self.again, refuses=self.refuses,
            clock=self.clock,
            defines="\n".join([
                *(f"#define {_in_c(name)} (m->number[{k}])" for k, name in enumerate(names)),
                f"static const int STATE[] = {{ {', '.join(map(str, range(n)))} }};",
                f"static const size_t SIZE[] = {{ {', '.join(map(str, _sizes(names, arrays).values()))} }};",
                f"static const int RATE[] = {{ {', '.join(map(str, range(n, 2 * n)))} }};",
            ]),
        )  # fmt: skip
        work = path.with_suffix("")
        folder = work / "binaries" / ("linux64" if version == 2 else "x86_64-linux")
        folder.mkdir(parents=True)
        undefined = "".join(f"#undef {_in_c(name)}\n" for name in names)
        (work / "model.c").write_text(source + undefined + (TWO if version == 2 else THREE))
        headers = Path(fmpy.__file__).parent / "c-code"
        known = set(re.findall(r"Export\s+\w+TYPE\s+(fmi\d\w+);", (headers / f"fmi{version}Functions.h").read_text()))
        rest = known - set(re.findall(r"fmi\d\w+", TWO if version == 2 else THREE))
        (work / "rest.c").write_text("".join(f"int {name}(void) {{ return 3; }}\n" for name in sorted(rest)))
        _compile(work, folder / "machine.so")
        text = self._description(version, first, arrays)
        for old, new in changes.items():
            assert old in text
            text = text.replace(old, new)
        with zipfile.ZipFile(path, "w") as out:
            out.writestr("modelDescription.xml", text)
            out.write(folder / "machine.so", str((folder / "machine.so").relative_to(work)))
        shutil.rmtree(work)
        return path

    def _description(self, version: int, first: dict[str, float], arrays: bool) -> str:
        units = {s: u for s, (_, u) in self.states.items()} | self.inputs | self.outputs
        lines, n = [], len(self.states)
        sizes = _sizes(list(first), arrays)
        for k, name in enumerate(first):
            if not sizes[name]:
                continue
            kind = ('causality="parameter" variability="tunable"' if name in self.parameters else
                    'causality="input"' if name in self.inputs else
                    'causality="output"' if name in self.outputs else
                    'causality="local" variability="discrete"' if name in self.discrete else
                    'causality="local"')  # fmt: skip
            start = name in self.parameters or name in self.inputs or name in self.states
            numbers = " ".join(map(repr, list(first.values())[k : k + sizes[name]]))
            number = f' start="{numbers}"' * start + f' unit="{units.get(name)}"' * bool(units.get(name))
            exact = ' initial="exact"' * (name in self.states)
            size = sizes[name] if sizes[name] > 1 else 0
            shown = (f"der({name[2:]})" if n <= k < 2 * n else name).replace("[1]", "" if size else "[1]")
            rate = n <= k < 2 * n
            if version == 2:
                number += f' derivative="{k - n + 1}"' * rate
                lines.append(f'<ScalarVariable name="{shown}" valueReference="{k}" {kind}{exact}><Real{number}/>'
                             "</ScalarVariable>")  # fmt: skip
            else:
                number += f' derivative="{k - n}"' * rate
                lines.append(f'<Float64 name="{shown}" valueReference="{k}" {kind}{exact}{number}>'
                             + f'<Dimension start="{size}"/>' * bool(size) + "</Float64>")  # fmt: skip
        names = sorted({u for u in units.values() if u})
        if version == 2:
            told = "".join(f'<Unknown index="{n + k + 1}"/>' for k in range(n))
            structure = f"<Derivatives>{told}</Derivatives>"
            head = '<fmiModelDescription fmiVersion="2.0" modelName="machine" guid="{1}" '
            head += f'numberOfEventIndicators="{len(self.signs)}">'
        else:
            whole = [k for k, name in enumerate(self.states) if sizes[name]]
            structure = "".join(f'<ContinuousStateDerivative valueReference="{n + k}"/>' for k in whole)
            structure += "".join(f'<EventIndicator valueReference="{k}"/>' for k in range(len(self.signs)))
            lines.append(f'<Float64 name="time" valueReference="{len(first)}" causality="independent"/>')
            head = '<fmiModelDescription fmiVersion="3.0" modelName="machine" instantiationToken="{1}">'
        defined = "".join(f'<Unit name="{u}"/>' for u in names)
        variables = "\n".join(lines)
        return (
            f'<?xml version="1.0"?>\n{head}<ModelExchange modelIdentifier="machine"/>'
            f"<UnitDefinitions>{defined}</UnitDefinitions><ModelVariables>\n{variables}\n</ModelVariables>"
            f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
        )


#: ``two_mass_stage`` of the package
STAGE = Machine(
    {"x_c": (0.0, "m"), "x_t": (0.0, "m"), "v_c": (0.0, "m/s"), "v_t": (0.0, "m/s")},
    {"K_f": 12.0, "m_c": 4.0, "m_t": 2.5, "k": 2.5e4, "c": 15.0},
    {"u": "V", "F_c": "N", "F_t": "N"},
    """  double s = k * (x_t - x_c) + c * (v_t - v_c);
  D_x_c = v_c; D_x_t = v_t; D_v_c = (K_f * u + F_c + s) / m_c; D_v_t = (F_t - s) / m_t; pull = s;""",
    {"pull": "N"},
)
#: of a machine of a turning and a sliding joint
COLUMNS = {
    "commands": {"torque": "spin", "push": "rail"},
    "sensors": {
        "angle": {"of": "axle", "quantity": "position", "absolute": True},
        "way": {"of": "rail", "quantity": "position", "absolute": True},
        "shaken": {"of": "rail", "quantity": "acceleration"},
    },
}
#: and it as equations
EQUATIONS = Machine(
    {"rail.s": (0.0, "m"), "rail.v": (0.0, "m/s"), "axle.w": (0.0, "rad/s"), "axle.phi": (0.0, "rad")},
    {"axle.d": 0.2, "cart.m": 3.0, "J": 0.3},
    {"spin": "N.m", "rail": "N", "tau": "N.m", "push": "N"},
    """  D_axle_phi = axle_w; D_axle_w = (2.0 * spin + tau - axle_d * axle_w) / J;
  D_rail_s = rail_v; D_rail_v = (rail + push - 1.5 * rail_v) / cart_m; power = rail * rail_v;""",
    {"power": "W"},
)
JOINTS = {"axle": {"position": "axle.phi", "force": "tau"}, "rail": {"position": "rail.s", "force": "push"}}
EXCHANGED = {**COLUMNS, "joints": JOINTS, "tolerances": {"parameters.axle.d": "20 %", "cart.m": 0.05}}

#: the arm of docs/simulators.md: two links, capsules of the inertias that MuJoCo gives them
ARM = Machine(
    {"q1": (0.0, "rad"), "q2": (0.0, "rad"), "w1": (0.0, "rad/s"), "w2": (0.0, "rad/s")},
    {"m1": 1.5, "m2": 0.8, "d1": 0.3, "d2": 0.15},
    {"u1": "N.m", "u2": "N.m", "tau1": "N.m", "tau2": "N.m"},
    """  double l = 0.4, c1 = 0.2, c2 = 0.15, g = 9.81, P = m2 * (0.0075575 / 0.8 + c2 * c2), M22 = P + 0.01;
  double M12 = P + m2 * l * c2 * cos(q2), h = m2 * l * c2 * sin(q2), G2 = m2 * g * c2 * sin(q1 + q2);
  double M11 = 0.02 + 0.02460591 + m1 * c1 * c1 + P + m2 * (l * l + 2 * l * c2 * cos(q2));
  double T1 = u1 + tau1 - d1 * w1 + h * (2 * w1 * w2 + w2 * w2) - (m1 * c1 + m2 * l) * g * sin(q1) - G2;
  double T2 = u2 + tau2 - d2 * w2 - h * w1 * w1 - G2, D = M11 * M22 - M12 * M12;
  D_q1 = w1; D_q2 = w2; D_w1 = (M22 * T1 - M12 * T2) / D; D_w2 = (M11 * T2 - M12 * T1) / D;""",
)
