"""A designed controller as C99: its matrices and constants as numbers, and the law of ``controller.c``."""

from __future__ import annotations

import math
from importlib.resources import files

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.control.laws import CATCHING_MOST, FOUND_V, NEAR_RAD, SEARCH_STEPS, SMALL_GAP_RAD, Controller

HEAD = """/* {about}
 *
 * controller c;  controller_reset(&c);  then every {sample_time:g} s:
 * double u = controller_step(&c, r, y);   r in m, y = (measured angle rad, measured output m), u in V
 * The gap in force is c.half_gap, rad, to each side; a twin may set it before any step.
 */
#include <math.h>
#include <string.h>
"""


def c_source(controller: Controller, first_half_gap_rad: float, about: str) -> str:
    """The whole C file of a controller.

    first_half_gap_rad : that it believes in after a reset. about : one line on what it is, for its head.
    """
    C = controller
    matrices = {"WA": C.wa, "MA": C.ma, "SA": C.sa, "LA": C.la, "LB": C.lb, "LH": C.lh, "LF": C.lf}
    vectors = {
        "WB": C.wb, "WC": C.wc, "MB": C.mb, "SB": C.sb, "SC": C.sc, "LC": C.lc, "LE": C.le, "S_REST": C.s_rest,
        "W_REST": C.w_rest, "LD": C.ld, "LATE": C.late, "FORWARD": C.forward, "SEARCH": C.search,
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
    lines += [f"static const double {name}[{max(v.size, 1)}] = {_row(v)};" for name, v in vectors.items()]
    lines += [_matrix(name, a) for name, a in matrices.items()]
    law = files("dtbacklash.control").joinpath("controller.c").read_text(encoding="utf-8")
    about = about.replace("*/", "* /")
    return "\n".join([HEAD.format(about=about, sample_time=C.sample_time), *lines, "", law])


def _matrix(name: str, a: Floats) -> str:
    rows, columns = max(a.shape[0], 1), max(a.shape[1], 1)
    inside = ", ".join(map(_row, a)) or "{0.0}"
    return f"static const double {name}[{rows}][{columns}] = {{{inside}}};"


def _row(values: Floats) -> str:
    return "{" + (", ".join(map(_number, values)) or "0.0") + "}"


def _number(value: float) -> str:
    """The shortest text that is read as the same number."""
    return "INFINITY" if math.isinf(value) else repr(float(np.float64(value)))
