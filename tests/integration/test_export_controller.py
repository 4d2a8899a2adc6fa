"""`dtb export controller`: the C file, compiled, gives the voltages of the run that it was made for."""

import ctypes
import math
import shutil
import subprocess

import numpy as np
import pytest

from dtbacklash import cli
from dtbacklash.config.compose import compose
from dtbacklash.experiment.run import run_scenario

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler")

SHORT = ("duration_s=4", "reference.period_s=2", "profile=ramp", "profile.t_start_s=0.5", "profile.t_end_s=3.5",
         "profile.end_deg=60")  # fmt: skip
KNOWN = ("model=lead_screw", "+model.effects.amplifier.delay.time=0.0025", "+model.effects.sensor_q3.delay.time=0.0015",
         "+model.effects.amplifier.saturation.limit=9", "+model.effects.motor_bearing.cogging.torque=0.01",
         "controller.internal_model=inner_loop")  # fmt: skip
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


@pytest.fixture
def compiled(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def make(*words):
        """step(r, theta_m, q3, half_gap, growth) of the exported controller, at rest."""
        assert cli.main(["export", "controller", "out=it.c", *words]) == 0
        library = tmp_path / "it.so"
        strict = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-Wno-unused-const-variable", "-shared", "-fPIC")
        subprocess.run([COMPILER, *strict, "it.c", "-o", library, "-lm"], check=True)
        found = ctypes.CDLL(str(library))
        found.controller_step.restype = ctypes.c_double
        state = ctypes.create_string_buffer(1 << 16)
        found.controller_reset(state)
        gap = ctypes.cast(state, ctypes.POINTER(ctypes.c_double))  # half_gap and growth stand first

        def step(r, theta_m, q3, half_gap, growth=0.0):
            gap[0], gap[1] = half_gap, growth
            y = (ctypes.c_double * 2)(theta_m, q3)
            return found.controller_step(state, ctypes.c_double(r), y)

        return step

    return make


@pytest.mark.parametrize("case", CASES)
def test_the_compiled_controller_gives_the_voltages_of_the_run(compiled, case):
    run = run_scenario(compose(*SHORT, *CASES[case]))
    step, gap = compiled(*SHORT, *CASES[case]), np.radians(run.trace["gap_hat_deg"].to_numpy())
    seen = zip(run.seen["r"], run.seen["theta_m"], run.seen["q3"], gap, strict=True)
    u = np.array([step(*one) for one in seen])
    assert np.abs(run.seen["u"]).max() > 1.0
    assert np.abs(u - run.seen["u"]).max() < 1e-9


def test_a_gap_that_a_twin_sets_is_taken_as_in_the_run(compiled):
    words = ("controller=nimc_twin", "profile=constant", "profile.start_deg=40", "duration_s=30",
             "reference.period_s=20", "twin.delay_s=1")  # fmt: skip
    run = run_scenario(compose(*words))
    step, gap = compiled(*words), np.radians(run.trace["gap_hat_deg"].to_numpy())
    u = [step(*one) for one in zip(run.seen["r"], run.seen["theta_m"], run.seen["q3"], gap, strict=True)]
    assert np.ptp(gap) > math.radians(10)
    assert np.abs(np.array(u) - run.seen["u"]).max() < 1e-9


def test_mistakes_are_one_line(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["export", "controller", "controller=open_loop"]) == 2
    assert cli.main(["export", "controller", "out=it.txt"]) == 2
    assert capsys.readouterr().err.count("\n") == 2
    assert list(tmp_path.iterdir()) == []
