"""The twin as C99, for a controller that estimates the gap by itself: the core's files, with the numbers of a run."""

from __future__ import annotations

import math
from importlib.resources import files

import numpy as np

from dtbacklash.config.run import RunConfig
from dtbacklash.control.c99 import core_file, row
from dtbacklash.errors import UserError
from dtbacklash.twin.gap.guard import GuardSettings, scan_of
from dtbacklash.twin.gap.model_error import model_terms
from dtbacklash.twin.gap.novelty import NoveltyDesign
from dtbacklash.twin.gap.observer import Lags, Path, TwinModel

#: how a controller with its twin is called: lines of the file's first comment
USE = """ * twin_controller t;  twin_start(&t, y);  then every {sample_time:g} s, where the samples are taken:
 * double u = twin_step(&t, r, y);   and in the background, as often as you like:  twin_estimate(&t);
 * which returns 1 when it has made an estimate of the gap, t.found: twin_step() puts it in force.
 * The controller c is t.c. twin_step() sets its gap at every sample: controller_set_gap() has no effect.
"""
#: the core's files, each up to the line from which on it is for `dtb run` alone
PARTS = {
    "twin.h": None, "loop.h": None, "adaptation.h": None, "twin.c": "/* ---- the simulated twin ---- */",
    "bfgs.c": None, "estimate.c": "/* ---- for Python ---- */", "wrong_model.c": None,
    "guard.c": "/* ---- for Python ---- */", "adaptation.c": None, "indexes.c": "/* Amplitudes",
}  # fmt: skip


def refuse(config: RunConfig) -> None:
    """Raise UserError where the twin of a configuration, settled, cannot be exported."""
    c, t = config.controller, config.twin
    if c.reconfigure == "never":
        allowed = "one with a twin, as nimc_twin or nimc_novelty: this one never asks for an estimate"
        raise UserError("controller", c.name, allowed)
    if config.optimizer.name != "bfgs":
        raise UserError("optimizer.name", config.optimizer.name, "bfgs: the others are SciPy's, and no C")
    for key, only in (("method", "linear"), ("on_alarm", "estimate"), ("where", "local")):
        if (value := getattr(t, key)) != only:
            raise UserError(f"twin.{key}", value, f"{only}, with the twin in the controller")
    if t.indexes:
        raise UserError("twin.indexes", t.indexes, "none, with the twin in the controller")


def twin_source(config: RunConfig, model: TwinModel, novelty: NoveltyDesign, ask: GuardSettings) -> str:
    """What makes a controller of :func:`.control.c99.c_source` one with its own twin: goes behind that.

    config : settled. ask : what the guard asks for.
    """
    t, terms, delay = config.twin, model_terms(model), round(config.twin.delay_s / config.sample_time_s)
    masses, order, scan = len(model.structure.masses_kg), model.lags.b.size, scan_of(ask)
    whole = {
        "SAMPLES": t.buffer, "DELAY": delay, "SLOTS": delay // t.buffer + 2, "SCANS": scan.size,
        "ATTEMPTS": ask.attempts, "SECTIONS": len(novelty.sos), "LOCK_STATES": novelty.initial_state().size,
        "GUARDED": int(t.guard), "ON_CHANGE": int(config.controller.reconfigure == "reference_change"),
        "ONSETS": int(config.reference.kind == "trajectory"), "EVALUATIONS": config.optimizer.max_evaluations,
    }  # fmt: skip
    numbers = {
        "GROWS_S": t.growth_s or 0.0, "GAP_BOUND": math.radians(t.gap_max_deg),
        "THRESHOLD": t.novelty_threshold_mm * 1e-3, "TOLERANCE": config.optimizer.tolerance,
        "COS_STEP": novelty.cos_step, "SIN_STEP": novelty.sin_step,
    }  # fmt: skip
    paths: dict[str, Path | Lags] = {"Q3": model.from_q3, "THETA_D": model.from_theta_d, "LAG": model.lags}
    growth = np.radians(ask.tolerances.growth_deg_s)
    arrays = {
        **{f"{of}_{name.upper()}": value for of, path in paths.items() for name, value in path._asdict().items()
           if name != "d" or of == "LAG"},
        "SOS": novelty.sos, "SCAN": scan, "TERMS": np.array(list(terms.values())),
        "DEVIATIONS": np.concatenate([[np.inf, np.inf, growth], ask.tolerances.deviations(masses)]),
    }  # fmt: skip
    powers = ", ".join(str(power) for kind in terms for power in kind)
    known = _list(model.sample_time_s, model.pitch_m_per_rad, model.pole_rad_s, model.noise_colour)
    angles = np.radians([ask.agreement_deg, ask.precise_deg, ask.travel_deg, ask.resolution_deg])
    asks = _list(math.radians(ask.gap_max_deg), ask.significance, ask.shading, *angles)
    inside = ", ".join(
        f"{{{order}, {_list(float(paths[of].d))}, {of}_PHI, {of}_B, {of}_START}}" for of in ("Q3", "THETA_D")
    )
    lags = "LAG_PHI, LAG_B, LAG_D, LAG_START, LAG_B_OF, LAG_START_OF, LAG_D_OF"
    wrong = f"{masses}, {len(terms)}, POWERS, TERMS, DEVIATIONS, {_list(ask.tolerances.presliding_m)}"
    lines = [
        *(f"#define {name} {value}" for name, value in whole.items()),
        *(f"static const double {name} = {_list(value)};" for name, value in numbers.items()),
        *(f"static const double {name}[{value.size}] = {row(value.ravel())};" for name, value in arrays.items()),
        f"static const int64_t POWERS[{5 * len(terms)}] = {{{powers}}};",
        f"static const TwinModel MODEL = {{{inside}, {model.settle}, {known}}};",
        f"static const ModelError WRONG = {{{{{order}, {lags}}}, {wrong}}};",
        f"static const GuardSettings ASK = {{{asks}, {ask.attempts}, {scan.size}, SCAN}};",
    ]
    core = [f"#define MASSES_MOST {masses}", *(core_file(name, before) for name, before in PARTS.items())]
    own = files("dtbacklash.twin").joinpath("twin_controller.c").read_text(encoding="utf-8")
    return "\n".join(["", *core, *lines, "", own])


def _list(*values: float) -> str:
    """Numbers as C has them, with commas between them."""
    return row(np.array(values))[1:-1]
