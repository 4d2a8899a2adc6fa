"""A designed controller as C99: the core's own law, with matrices and constants as numbers, and what calls it."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.control.handover import rests
from dtbacklash.control.laws import Controller, control_step, law_fields, new_controller_state

HEAD = """/* {about}
 *
{use} * r in m, y = (measured angle rad, measured output m), u in V, |u| <= {limit:g}
 * A value that is not finite or above {sane:g} is held at the last good one, and counted in c.held.
 */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
"""
#: how the controller is called
USE = """ * controller c;  controller_start(&c, y);  then every {sample_time:g} s: double u = controller_step(&c, r, y);
 * controller_set_gap(&c, half_gap, growth, seconds): a new estimate; controller_reset(&c, y): at rest anew, where y is.
"""
#: runs the vector of the file beside it
TEST = """/* The law of {name} beside the voltages of the run's: cc -std=c99 {name_test} -lm && ./a.out
 * The vector is of controller_step() with one gap: of the law, without a twin.
 */
#include <stdio.h>
#include "{name}"

static const double VECTOR[{rows}][4] = {{ /* r, measured angle, measured output, voltage */
{vector}
}};

int main(void) {{
    controller c;
    double worst = 0.0;
    controller_start(&c, (const double[2]){{0.0, 0.0}});
    for (int i = 0; i < {rows}; i++) {{
        double off = fabs(controller_step(&c, VECTOR[i][0], VECTOR[i] + 1) - VECTOR[i][3]);
        if (!(off <= worst)) worst = off;
    }}
    printf("largest difference: %.3g V\\n", worst);
    return worst < 1e-9 ? 0 : 1;
}}
"""
#: behind this the core's file is for Python alone
PYTHON = "/* ---- for Python ---- */"
#: no measured angle, rad, output or reference, m, is larger
SANE = 1e6
#: of the test vector
ROWS = 400


def c_source(controller: Controller, first_half_gap_rad: float, about: str, use: str = USE) -> str:
    """The whole C file of a controller: the core's own law with its numbers.

    first_half_gap_rad : that it believes in after a reset. about : one line on what it is, for its head.
    use : how it is called, in lines of that comment; ``{sample_time:g}`` in it becomes the sample time, s.
    """
    C = controller
    w_unit, s_unit, x_rest = rests(C)
    fields = law_fields(C)
    arrays = {name.upper(): value for name, value in fields.items() if isinstance(value, np.ndarray)}
    rest = {"W_UNIT": w_unit, "S_UNIT": s_unit, "X_REST": x_rest}
    # C has no empty arrays: what a form does not use has one 0
    sizes = {"NW": len(C.wb), "NM": len(C.mb), "NS": len(C.sb), "NL": len(C.lc), "NP": len(C.lh)}
    sizes = {name: max(size, 1) for name, size in sizes.items()}
    state = new_controller_state(C)
    sizes |= {"NSPARE": len(state.spare), "NLINE": state.lines.shape[1]}
    numbers = {"LIMIT": C.limit, "SAMPLE_TIME": C.sample_time, "FIRST_HALF_GAP": first_half_gap_rad, "SANE": SANE}
    lines = ["enum { " + ", ".join(f"{name} = {value}" for name, value in sizes.items()) + " };"]
    lines += [f"static const double {name} = {_number(value)};" for name, value in numbers.items()]
    lines += [
        f"static const double {name}[{max(v.size, 1)}] = {row(v.ravel())};" for name, v in (arrays | rest).items()
    ]
    inside = (f".{name} = {_entry(name, value)}" for name, value in fields.items())
    law = [core_file("arithmetic.h"), core_file("control.h"), core_file("control.c", PYTHON)]
    own = files("dtbacklash.control").joinpath("controller.c").read_text(encoding="utf-8")
    use = use.format(sample_time=C.sample_time)
    head = HEAD.format(about=about.replace("*/", "* /"), use=use, limit=C.limit, sane=SANE)
    values = "static const Controller LAW = {" + ", ".join(inside) + "};"
    return "\n".join([head, *law, *lines, values, "", own])


def core_file(name: str, before: str | None = None) -> str:
    """A file of the core without what it includes, up to a line."""
    text = files("dtbacklash.core").joinpath(name).read_text(encoding="utf-8")
    text = text if before is None else text.partition(before)[0]
    return "\n".join(line for line in text.splitlines() if not line.startswith("#include")) + "\n"


def _entry(name: str, value: Any) -> str:
    if isinstance(value, np.ndarray):
        return name.upper()
    return _number(value) if isinstance(value, float) else str(int(value))


def c_test(controller: Controller, first_half_gap_rad: float, name: str) -> str:
    """A C file with a test vector of the controller in the file ``name`` and a main that runs it."""
    k = np.arange(ROWS)
    r = np.where(k // 100 % 2 == 0, 1e-3, -1e-3)
    q3 = 0.8e-3 * np.sin(k / 40.0) + 1e-4 * np.cos(k / 3.0)
    theta_m = 3.0 * np.sin(k / 37.0) + 0.02 * np.sin(1.7 * k)
    state = new_controller_state(controller)
    u = [control_step(controller, state, *one, first_half_gap_rad)[0] for one in zip(r, theta_m, q3, strict=True)]
    vector = ",\n".join(map(row, np.column_stack([r, theta_m, q3, u])))
    return TEST.format(name=name, name_test=name.replace(".c", "_test.c"), rows=ROWS, vector=vector)


def row(values: Floats) -> str:
    return "{" + (", ".join(map(_number, values)) or "0.0") + "}"


def _number(value: float) -> str:
    """The shortest text that is read as the same number."""
    return repr(float(np.float64(value))).replace("inf", "INFINITY")
