"""`dtb export controller`: the C file, compiled, gives the voltages of the run that it was made for."""

import contextlib
import ctypes
import math
import shutil
import subprocess
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from told import refusal

from dtbacklash import cli
from dtbacklash.commands.export import LIMIT_V
from dtbacklash.config.compose import compose
from dtbacklash.control.belief import beliefs_of, design_for, settled
from dtbacklash.control.c99 import row
from dtbacklash.control.laws import build_controller, control_step, crossing_samples, feed_forward, new_controller_state
from dtbacklash.control.observer import plant
from dtbacklash.experiment.run import run_scenario

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler")

SHORT = ("duration_s=4", "reference.period_s=2", "profile=ramp", "profile.t_start_s=0.5", "profile.t_end_s=3.5",
         "profile.end_deg=60")  # fmt: skip
KNOWN = ("model=lead_screw", "+model.effects.amplifier.delay.time=0.0025", "+model.effects.sensor_q3.delay.time=0.0015",
         "+model.effects.amplifier.saturation.limit=9", "+model.effects.motor_bearing.cogging.torque=0.01",
         "controller.internal_model=inner_loop", "controller.limit_v=30")  # fmt: skip
LEAD_M_PER_RAD = 2e-3 / (2 * math.pi)
STORM = r"""
#include <stdio.h>
#include <stdlib.h>
#include "it.c"
int main(void) {
    controller c;
    double y[2] = {0.0, 0.0}, after = 0.0;
    unsigned long seed = 1;
    controller_start(&c, y);
    for (long i = 0; i < 1000000; i++) {
        double v[3];
        for (int j = 0; j < 3; j++) {
            seed = (seed * 1103515245ul + 12345ul) & 0x7fffffff;
            unsigned long kind = (seed >> 8) % 40;
            double x = (double)(seed >> 4) / 67108864.0 - 1.0;
            v[j] = (j == 1 ? 10.0 : 2e-3) * x;
            if (kind == 0) v[j] = NAN;
            if (kind == 1) v[j] = x > 0.0 ? INFINITY : -INFINITY;
            if (kind == 2) v[j] = x * 1e300;
            if (kind == 3) v[j] = x * 1e5;
        }
        double u = controller_step(&c, v[0], v + 1);
        if (!(fabs(u) <= LIMIT)) return 1;
    }
    double x[N] = {0.0}, u = 0.0;
    for (long i = 0; i < 60000; i++) {
        double next[N];
        for (int k = 0; k < 2; k++) {
            y[k] = 0.0;
            for (int j = 0; j < N; j++) y[k] += PC[k][j] * x[j];
        }
        u = controller_step(&c, 1e-3, y);
        if (!(fabs(u) <= LIMIT)) return 2;
        for (int k = 0; k < N; k++) {
            next[k] = PB[k] * u;
            for (int j = 0; j < N; j++) next[k] += PA[k][j] * x[j];
        }
        memcpy(x, next, sizeof x);
        if (i > 50000 && fabs(u) > after) after = fabs(u);
    }
    printf("%lu %.17g %.17g", c.held, after, fabs(y[1] - 1e-3));
    return 0;
}
"""
CASES = {
    "bare": ("controller=nimc_fixed", "controller.gap_hat_deg=30", "controller.internal_model=bare"),
    "linear": ("controller=imc", "controller.internal_model=measured"),
    "exact": ("controller=imc", "controller.internal_model=exact"),
    "held": ("controller=nimc_fixed", "controller.gap_hat_deg=30", "controller.crossing=hold"),
    "known": ("controller=nimc_fixed", "controller.gap_hat_deg=30", *KNOWN),
    "pid": ("controller=pid", "controller.limit_v=12"),
    "lqg": ("controller=lqg", "controller.limit_v=12"),
    "offset": ("controller=offset", "controller.limit_v=12"),
    "mpc": ("controller=mpc", "controller.limit_v=3"),
}


STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The folder with the C files of a controller and their library: words -> folder; each is made once."""

    @cache
    def make(*words):
        folder = tmp_path_factory.mktemp("exported")
        with contextlib.chdir(folder):
            assert cli.main(["export", "controller", "out=it.c", *words]) == 0
        build = [COMPILER, *STRICT, "-shared", "-fPIC", "it.c", "-o", "it.so", "-lm"]
        subprocess.run(build, check=True, cwd=folder)
        return folder

    return make


def matrix(name, a):
    """A matrix as C has it."""
    rows, columns = max(a.shape[0], 1), max(a.shape[1], 1)
    inside = ", ".join(map(row, a)) or "{0.0}"
    return f"static const double {name}[{rows}][{columns}] = {{{inside}}};"


def loaded(folder):
    """The library of the exported controller, its state at the start, and step(r, theta_m, q3)."""
    found = ctypes.CDLL(str(folder / "it.so"))
    found.controller_step.restype = ctypes.c_double
    state = ctypes.create_string_buffer(1 << 16)
    found.controller_start(state, (ctypes.c_double * 2)())

    def step(r, theta_m, q3):
        return found.controller_step(state, ctypes.c_double(r), (ctypes.c_double * 2)(theta_m, q3))

    return found, state, step


def designed(*words):
    """The controller as it is exported, and its state at the start."""
    config = compose(*words)
    beliefs = beliefs_of(config)
    config = settled(config, beliefs)
    controller = replace(config.controller, limit_v=config.controller.limit_v or LIMIT_V)
    forward = beliefs.design.feed_forward(tuple(controller.compensate))
    found = build_controller(controller, design_for(config, beliefs.design), forward)
    return found, new_controller_state(found)


def set_gap(library, state, *numbers):
    return library.controller_set_gap(state, *(ctypes.c_double(x) for x in numbers))


@pytest.mark.parametrize("case", CASES)
def test_the_compiled_controller_gives_the_voltages_of_the_run(exported, tmp_path, case):
    words = (*SHORT, *CASES[case])
    limited = () if any("limit_v" in word for word in words) else (f"controller.limit_v={LIMIT_V}",)
    run, folder = run_scenario(compose(*words, *limited)), exported(*words)
    step = loaded(folder)[2]
    u = np.array([step(*one) for one in zip(run.seen["r"], run.seen["theta_m"], run.seen["q3"], strict=True)])
    assert np.abs(run.seen["u"]).max() > 1.0
    assert np.array_equal(u, run.seen["u"])
    subprocess.run([COMPILER, *STRICT, "it_test.c", "-o", tmp_path / "it", "-lm"], check=True, cwd=folder)
    assert "largest difference" in subprocess.run([tmp_path / "it"], check=True, capture_output=True, text=True).stdout


def test_a_gap_that_a_twin_sets_goes_on_growing_as_in_the_run(exported):
    library, state, step = loaded(exported("controller=nimc_twin"))
    C, X = designed("controller=nimc_twin")
    gap, growth, until, side = 0.0, 0.0, 0, 0
    for k in range(3000):
        if k in (500, 1500):
            gap, growth, until = 0.4 + k / 5000, 3e-5, k + 800
            assert set_gap(library, state, gap, growth / 1e-3, 0.8) == 1
        elif growth:
            gap, growth = gap + growth, growth if k < until else 0.0
        y = 1e-3 * (-1) ** (k // 400), 4 * math.sin(k / 90), 1e-3 * math.sin(k / 70)
        side = {2400: 1, 2700: -1, 2900: 0}.get(k, side)
        library.controller_set_out(state, side)
        assert step(*y) == control_step(C, X, *y, gap, growth, float(side))[0]
    library.controller_lead.restype = ctypes.c_double
    assert library.controller_lead(state) == pytest.approx(1e-3 * crossing_samples(C, gap))
    for refused in ((-1.0, 0.0, 0.0), (math.nan, 0.0, 0.0), (7.0, 0.0, 0.0), (0.5, 10.0, 1.0), (0.5, math.inf, 0.0)):
        assert set_gap(library, state, *refused) == 0
    assert ctypes.cast(state, ctypes.POINTER(ctypes.c_double))[0] == pytest.approx(gap)


@pytest.mark.parametrize("case", CASES)
def test_at_rest_anywhere_the_first_voltage_is_what_is_fed_forward_and_nothing_moves(exported, case):
    library, state, step = loaded(exported(*SHORT, *CASES[case]))
    C, X = designed(*SHORT, *CASES[case])
    for r, behind in ((0.5e-3, 0.1), (-0.8e-3, -0.2), (2e-3, 0.0)):
        theta_m = r / LEAD_M_PER_RAD + behind
        library.controller_reset(state, (ctypes.c_double * 2)(theta_m, r))
        forward = feed_forward(C, X, theta_m) if C.forwards else 0.0
        assert [step(r, theta_m, r) for _ in range(300)] == pytest.approx([forward] * 300, abs=1e-6)


@pytest.mark.parametrize("case", CASES)
def test_whatever_the_sensors_say_the_voltage_is_finite_within_its_limit_and_comes_back(exported, tmp_path, case):
    """A million values, a tenth of them not finite or beyond reason, then the machine at 0: no undefined behaviour."""
    folder = exported(*SHORT, *CASES[case])
    linear = beliefs_of(compose("controller=imc")).design.linear()
    a, b, c = plant(linear.motor, linear.structure, 1e-3)
    arrays = (matrix("PA", a), f"static const double PB[{b.size}] = {row(b)};", matrix("PC", c))
    (tmp_path / "storm.c").write_text("\n".join((f"enum {{ N = {b.size} }};", *arrays, STORM)))
    harder = ("-fsanitize=undefined", "-fno-sanitize-recover", f"-I{folder}")
    subprocess.run([COMPILER, *STRICT, *harder, "storm.c", "-o", "storm", "-lm"], check=True, cwd=tmp_path)
    said = subprocess.run([tmp_path / "storm"], check=True, capture_output=True, text=True).stdout
    held, after, off = map(float, said.split())
    assert 1e5 < held < 4e5
    assert after < 1e-3
    assert off < 1e-6 or case == "exact"  # its model integrates the voltage, and has lost the motor's angle


@pytest.mark.parametrize("version", [2, 3])
def test_as_an_fmu_it_gives_the_voltages_of_the_law(tmp_path, monkeypatch, version):
    fmpy = pytest.importorskip("fmpy")
    from fmpy.simulation import instantiate_fmu
    from fmpy.validation import validate_fmu

    monkeypatch.chdir(tmp_path)
    words = ("controller=nimc_fixed", "controller.gap_hat_deg=30")
    assert cli.main(["export", "controller", "out=it.fmu", f"fmi={version}", *words]) == 0
    assert validate_fmu("it.fmu") == []
    described, folder = fmpy.read_model_description("it.fmu"), fmpy.extract("it.fmu")
    which = {v.name: v.valueReference for v in described.modelVariables}
    fmu = instantiate_fmu(folder, described, "CoSimulation")
    put, show = (fmu.setReal, fmu.getReal) if version == 2 else (fmu.setFloat64, fmu.getFloat64)
    if version == 2:
        fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    C, X = designed(*words)
    gap = math.radians(30)
    for k in range(1500):
        y = 1e-3 * (-1) ** (k // 400), 4 * math.sin(k / 90), 1e-3 * math.sin(k / 70)
        if k == 1000:
            gap = 0.4
            put([which["half_gap"]], [gap])
        put([which[name] for name in ("r", "theta_m", "q3")], y)
        if k == 700:  # what is kept, and brought back after other steps, is the same controller
            kept = fmu.getFMUState()
            fmu.doStep(k * 1e-3, 0.05)
            fmu.setFMUState(kept)
            fmu.freeFMUState(kept)
        assert show([which["u"]])[0] == control_step(C, X, *y, gap, 0.0, 0.0)[0]
        fmu.doStep(k * 1e-3, 1e-3)
    put([which["q3"]], [math.nan])
    fmu.doStep(1.5, 2e-3)
    assert show([which["held"]]) == [2.0]
    with pytest.raises(fmpy.fmi1.FMICallException):
        fmu.doStep(1.502, 0.5e-3)
    with pytest.raises(fmpy.fmi1.FMICallException):
        put([which["half_gap"]], [-1.0])
    fmu.terminate()
    fmu.freeInstance()
    fmpy.simulate_fmu("it.fmu", stop_time=0.1, output_interval=1e-3)  # an importer's own loop takes it


def test_mistakes_are_one_line(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for words in (["controller=open_loop"], ["out=it.txt"], ["out=it.fmu", "fmi=1"]):
        assert words[-1].partition("=")[0] in refusal(capsys, "export", "controller", *words)
    for words, allowed in {
        "fmi=3": "out=(missing): must end in .fmu with fmi=3",
        "fmi=3 out=it.c": "out=it.c: must end in .fmu with fmi=3",
        "out=it.fmu with_twin=true": "out=it.fmu: a file that ends in .c with with_twin=true",
        "with_twins=true": "with_twins=true: no such setting; did you mean with_twin?",
        "fmu=3": "fmu=3: no such setting; did you mean fmi?",
    }.items():
        assert refusal(capsys, "export", "controller", *words.split()) == f"{allowed}\n"
    others = refusal(capsys, "export", "controller", "xyzzy=1").partition("choose one of ")[2].split(", ")
    assert {"controller", "fmi", "with_twin"} < set(map(str.strip, others))
    monkeypatch.setattr("dtbacklash.core.build.compiler", list)
    refusal(capsys, "export", "controller", "out=it.fmu")
    assert list(tmp_path.iterdir()) == []
