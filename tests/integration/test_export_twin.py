"""`dtb export controller with_twin=true`: the C file estimates the gap as the run that it was made for does."""

import ctypes
import math
import shutil
import subprocess

import numpy as np
import pytest
from steady_twin import SteadyTwin
from told import refusal

from dtbacklash import cli
from dtbacklash.config.compose import compose
from dtbacklash.experiment.run import run_scenario

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler")

STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror",
          "-fsanitize=undefined", "-fno-sanitize-recover")  # fmt: skip
MOVES = ("controller.limit_v=12", "profile=ramp", "profile.t_start_s=0", "profile.t_end_s=25",
         "profile.start_deg=10", "profile.end_deg=90")  # fmt: skip
ENCODER = "sensors=encoder"
CASES = {
    "at every change": ("controller=nimc_twin", "twin=edge", "reference.period_s=8", "duration_s=15"),
    "held, growing": ("controller=nimc_twin", "controller.crossing=hold", "twin.delay_s=1.3", "twin.growth_s=6",
                      "reference.period_s=8", "duration_s=23", ENCODER),
    "a buffer before the answer": ("controller=nimc_twin", "twin.delay_s=2.5", "reference.period_s=3", "duration_s=12"),
    "a trajectory": ("controller=nimc_twin", "twin.delay_s=0", "reference=trajectory", "reference.period_s=6",
                     "duration_s=14"),
    "unguarded": ("controller=nimc_twin", "twin=unguarded", "twin.delay_s=0.2", "reference.period_s=8",
                  "duration_s=18"),
    "novelty": ("controller=nimc_novelty", "twin.delay_s=0.5", "reference.period_s=8", "duration_s=23"),
    "novelty, rejected": ("controller=nimc_novelty", "twin.delay_s=0.5", "twin.novelty_threshold_mm=0.004",
                          "twin.buffer=450", "reference.period_s=8", "duration_s=12", ENCODER),
}  # fmt: skip
#: what shows the last estimate, and puts another one in its place
SHOWS = r"""
#include "it.c"
const unsigned long size = sizeof(twin_controller);
double shows(const twin_controller *t, int what)
{
    const GapEstimate *e = &t->found.estimate;
    const double all[] = {GUARDED ? e->gap : e->fit_gap, e->std, e->cost, (double)e->evaluations,
                          (double)t->found.accepted, t->found.applied};
    return all[what];
}
int says(twin_controller *t, double gap)
{
    if (t->state != REQUESTED)
        return 0;
    t->found = (GapAttempt){{gap, gap, 0.0, 0.0, 0.0, 0.0, INFINITY, 1, 1, 0}, 1, 0, 0, BETTER, 0.0, gap};
    t->state = ANSWERED;
    return 1;
}
"""


def exported(folder, monkeypatch, *words):
    """The library of an exported controller with its twin."""
    monkeypatch.chdir(folder)
    assert cli.main(["export", "controller", "with_twin=true", "out=it.c", *words]) == 0
    head = (folder / "it.c").read_text().partition("*/")[0]
    assert all(f"{name}(&t" in head for name in ("twin_start", "twin_step", "twin_estimate"))
    (folder / "shows.c").write_text(SHOWS)
    subprocess.run([COMPILER, *STRICT, "-shared", "-fPIC", "shows.c", "-o", "it.so", "-lm"], check=True, cwd=folder)
    library = ctypes.CDLL(str(folder / "it.so"))
    for one in (library.twin_step, library.shows, library.controller_lead):
        one.restype = ctypes.c_double
    return library


def replayed(library, seen, says=None, ahead=False):
    """The voltage of every sample, and a row an estimate, from the readings of a run.

    says : instead of an estimate. ahead : the reference is known ahead.
    """
    state = ctypes.create_string_buffer(ctypes.c_ulong.in_dll(library, "size").value)
    library.twin_start(state, (ctypes.c_double * 2)())
    u, estimates = [], []
    moving = np.sign(np.diff(seen["r"], append=seen["r"][-1])) if ahead else ()
    for k, (r, theta_m, q3) in enumerate(zip(seen["r"], seen["theta_m"], seen["q3"], strict=True)):
        if ahead:
            then = min(k + round(1e3 * library.controller_lead(state)), len(moving) - 1)
            library.controller_set_out(state, int(moving[then]))
        u.append(library.twin_step(state, ctypes.c_double(r), (ctypes.c_double * 2)(theta_m, q3)))
        if library.twin_estimate(state) if says is None else library.says(state, ctypes.c_double(says)):
            estimates.append([library.shows(state, i) for i in range(6)])
    return np.array(u), estimates


QUICK = ("at every change", "novelty")


@pytest.mark.parametrize(
    "case", [pytest.param(name, marks=[] if name in QUICK else pytest.mark.check) for name in CASES]
)
def test_the_twin_inside_estimates_and_controls_as_the_run(tmp_path, monkeypatch, case):
    words = (*MOVES, *CASES[case])
    run = run_scenario(compose(*words))
    u, estimates = replayed(exported(tmp_path, monkeypatch, *words), run.seen, ahead="trajectory" in case)
    assert np.array_equal(u, run.seen["u"])
    table = run.estimates.sort_values(["accepted", "cost"], ascending=[False, True]).groupby("t_event_s").first()
    columns = ["gap_deg", "std_deg", "cost", "evaluations", "accepted", "applied_deg"]
    units = [math.degrees(1.0), math.degrees(1.0), 1e6, 1.0, 1.0, math.degrees(1.0)]
    assert len(table) > 1
    assert run.trace["gap_hat_deg"].nunique() > 1
    np.testing.assert_array_equal(np.array(estimates) * units, table[columns].to_numpy(dtype=float))
    assert table["accepted"].all() == ("rejected" not in case)


def test_a_gap_in_which_the_loop_goes_round_is_taken_back_as_in_the_run(tmp_path, monkeypatch):
    words = ("controller=nimc_twin", "controller.internal_model=inner_loop", "profile=constant", "profile.start_deg=5",
             "controller.gap_hat_deg=5", "reference.period_s=20", "duration_s=39", "twin.delay_s=0.5",
             "controller.limit_v=12")  # fmt: skip
    gap = math.radians(60)
    run = run_scenario(compose(*words), service=SteadyTwin(gap))
    u, estimates = replayed(exported(tmp_path, monkeypatch, *words), run.seen, gap)
    assert "taken back" in run.estimates["reason"].iloc[0]
    assert "not put in force" in run.estimates["reason"].iloc[1]
    assert np.array_equal(u, run.seen["u"])
    assert len(estimates) == len(run.estimates)


@pytest.mark.check
@pytest.mark.parametrize(
    "chosen", [("controller=nimc_novelty", "twin=edge"), ("controller=nimc_twin", "twin=unguarded")]
)
def test_whatever_the_sensors_say_the_voltage_stays_within_its_limit(tmp_path, monkeypatch, chosen):
    """A tenth of the values is not finite or beyond reason; the library is compiled to stop where C is not defined."""
    words = (*chosen, "twin.delay_s=0", "twin.buffer=450", "controller.limit_v=12")
    rng, n = np.random.default_rng(5), 9000
    seen = {"r": 1e-3 * np.sign(np.sin(np.arange(n) / 300.0)), "theta_m": rng.normal(0.0, 3.0, n),
            "q3": rng.normal(0.0, 1e-3, n)}  # fmt: skip
    for values in seen.values():
        off = rng.random(n) < 0.1
        values[off] = rng.choice([np.nan, np.inf, -np.inf, 1e300, 1e5, -1e5], off.sum())
    u, estimates = replayed(exported(tmp_path, monkeypatch, *words), seen)
    assert np.abs(u).max() <= 12.0
    assert len(estimates) > 3


def test_what_cannot_be_exported_is_refused_in_one_line(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bent = ("model=lead_screw", "+model.effects.mass_3.ground_friction.force=0.5")
    for words in (
        ["controller=nimc_fixed"],
        ["optimizer=lbfgsb"],
        ["twin.on_alarm=bank"],
        ["twin.method=simulate"],
        ["twin.indexes=[motor]"],
        ["with_twin=maybe"],
        [*bent, "twin.method"],
    ):
        *given, last = words
        key, _, value = last.partition("=")
        given += [last] * bool(value)
        said = refusal(capsys, "export", "controller", "with_twin=true", "controller=nimc_twin", *given)
        assert key in said
    assert list(tmp_path.iterdir()) == []
