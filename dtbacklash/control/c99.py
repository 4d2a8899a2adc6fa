"""A designed controller as C99: its matrices and constants as numbers, and the law of ``controller.c``."""

from __future__ import annotations

import math
from importlib.resources import files

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.control.handover import rests
from dtbacklash.control.laws import (
    CATCHING_MOST,
    NEAR_RAD,
    SMALL_GAP_RAD,
    Controller,
    control_step,
    new_controller_state,
)
from dtbacklash.control.linear_law import FOUND_V, SEARCH_STEPS

HEAD = """/* {about}
 *
 * controller c;  controller_start(&c, y);  then every {sample_time:g} s:
 * double u = controller_step(&c, r, y);   r in m, y = (measured angle rad, measured output m), u in V, |u| <= {limit:g}
 * controller_set_gap(&c, half_gap, growth, seconds): a new estimate; controller_reset(&c, y): at rest anew, where y is.
 * A value that is not finite or above {sane:g} is held at the last good one, and counted in c.held.
 */
#include <math.h>
#include <string.h>
"""
#: runs the vector of the file beside it
TEST = """/* The law of {name} beside the voltages of the run's: cc -std=c99 {name_test} -lm && ./a.out */
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
#: of the test vector
ROWS = 400


def c_source(controller: Controller, first_half_gap_rad: float, about: str) -> str:
    """The whole C file of a controller.

    first_half_gap_rad : that it believes in after a reset. about : one line on what it is, for its head.
    """
    C = controller
    w_unit, s_unit, x_rest = rests(C)
    matrices = {"WA": C.wa, "MA": C.ma, "SA": C.sa, "LA": C.la, "LB": C.lb, "LH": C.lh, "LF": C.lf, "X_REST": x_rest}
    vectors = {
        "WB": C.wb, "WC": C.wc, "MB": C.mb, "SB": C.sb, "SC": C.sc, "LC": C.lc, "LE": C.le, "S_REST": C.s_rest,
        "W_REST": C.w_rest, "W_UNIT": w_unit, "S_UNIT": s_unit, "LD": C.ld, "LATE": C.late, "FORWARD": C.forward,
        "SEARCH": C.search,
    }  # fmt: skip
    numbers = {
        "WD": C.wd, "GAIN": C.gain, "LIMIT": C.limit, "SAMPLE_TIME": C.sample_time, "JUMP": C.jump,
        "CROSSING_RATIO": C.crossing_ratio, "CROSSING_RATE": C.crossing_rate, "CROSSING_STEP": C.crossing_step,
        "SMALL_GAP": SMALL_GAP_RAD, "FIRST_HALF_GAP": first_half_gap_rad, "NEAR": NEAR_RAD, "FOUND": FOUND_V,
        "CATCHING": C.catching, "CATCHING_MOST": CATCHING_MOST,
    }  # fmt: skip
    # C has no empty arrays: what a form does not use has one 0
    sizes = {"NW": len(C.wb), "NM": len(C.mb), "NS": len(C.sb), "NL": len(C.lc), "NP": len(C.lh)}
    sizes = {name: max(size, 1) for name, size in sizes.items()}
    whole = {
        "STRUCTURE": C.structure, "MODEL": C.model, "FORWARDS": int(C.forwards), "ARRIVING": C.arriving,
        "PATIENCE": C.patience, "PREDICTIVE": int(len(C.lh) > 0), "SEARCH_STEPS": SEARCH_STEPS, **sizes,
        "NMAX": max(sizes.values()), "NLINE": math.ceil(C.late.max()) + 2,
    }  # fmt: skip
    lines = ["enum { " + ", ".join(f"{name} = {value}" for name, value in whole.items()) + " };"]
    lines += [f"static const double {name} = {_number(value)};" for name, value in numbers.items()]
    lines += [f"static const double {name}[{max(v.size, 1)}] = {row(v)};" for name, v in vectors.items()]
    lines += [matrix(name, a) for name, a in matrices.items()]
    law = files("dtbacklash.control").joinpath("controller.c").read_text(encoding="utf-8")
    about = about.replace("*/", "* /")
    return "\n".join([HEAD.format(about=about, sample_time=C.sample_time, limit=C.limit, sane=1e6), *lines, "", law])


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


def matrix(name: str, a: Floats) -> str:
    rows, columns = max(a.shape[0], 1), max(a.shape[1], 1)
    inside = ", ".join(map(row, a)) or "{0.0}"
    return f"static const double {name}[{rows}][{columns}] = {{{inside}}};"


def row(values: Floats) -> str:
    return "{" + (", ".join(map(_number, values)) or "0.0") + "}"


def _number(value: float) -> str:
    """The shortest text that is read as the same number."""
    return repr(float(np.float64(value)))
