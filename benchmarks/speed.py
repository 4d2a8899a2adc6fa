"""What the speed benchmarks measure; each function gives the rows of one table."""

from __future__ import annotations

import math
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.hand_written import HandWritten
from benchmarks.libraries import python_control, scipy_ivp
from benchmarks.measure import Row, interleaved_s, median, times_s, verdict
from benchmarks.scenario import PAPER, SHORT, ours, prepare
from dtbacklash.arrays import Floats
from dtbacklash.config.compose import compose
from dtbacklash.config.run import OptimizerConfig
from dtbacklash.experiment.run import run_scenario
from dtbacklash.twin.estimate import OPTIMIZERS, Estimate, Problem, default_start, estimate_gap
from dtbacklash.twin.guard import Attempt, guarded_estimates
from dtbacklash.twin.observer import TwinModel, twin_model

Buffer = tuple[Floats, Floats]

#: the loop's time over that of a hand-written loop which records as much
LOOP_RATIO_MAX = 12.0
ESTIMATE_MAX_S = 0.020
RUN_MAX_S = 4.0
HELP_MAX_S = 0.5
#: time per simulated second of the longest run over that of the shortest: 1 is linear
LINEARITY_MAX = 1.3


def loop_rows(repeats: int = 40) -> list[Row]:
    """The paper's 200 s by our compiled loop and by hand-written ones, in turn in one process."""
    scenario = prepare(*PAPER)
    contestants: dict[str, Callable[[], Floats]] = {
        "hand-written loop": HandWritten(scenario),
        "hand-written, everything recorded": HandWritten(scenario, everything=True),
        "dtbacklash": partial(ours, scenario),
    }
    times = interleaved_s(list(contestants.values()), repeats)
    rows: list[Row] = []
    for (name, contestant), seconds in zip(contestants.items(), times, strict=True):
        rows.append({
            "what": name, "simulated_s": scenario.seconds, "wall_s": seconds, "ratio": seconds / times[0],
            "ratio_to_everything": seconds / times[1],
            "difference_mm": 1e3 * float(np.max(np.abs(contestant() - scenario.q3_m))),
            "ratio_max": LOOP_RATIO_MAX if name == "dtbacklash" else None,
        })  # fmt: skip
    rows[-1]["pass"] = verdict(rows[-1]["ratio_to_everything"], LOOP_RATIO_MAX)
    return rows


def library_rows() -> list[Row]:
    """python-control and SciPy on four seconds, beside both compiled loops; times per 200 simulated seconds."""
    scenario = prepare(*SHORT)
    hand, own = HandWritten(scenario), partial(ours, scenario)
    hand_s, ours_s = interleaved_s([hand, own], 40)
    timed: list[tuple[str, float, Callable[[], Floats]]] = [
        ("hand-written loop", hand_s, hand), ("dtbacklash", ours_s, own),
    ]  # fmt: skip
    for name, function in (("python-control", python_control), ("SciPy solve_ivp", scipy_ivp)):
        contestant = partial(function, scenario)
        timed.append((name, min(times_s(contestant, 2)), contestant))
    return [
        {
            "what": name, "simulated_s": scenario.seconds, "wall_s": seconds,
            "wall_s_per_200_s": seconds * 200.0 / scenario.seconds, "ratio": seconds / hand_s,
            "difference_mm": 1e3 * float(np.max(np.abs(function() - scenario.q3_m))),
        }
        for name, seconds, function in timed
    ]  # fmt: skip


def estimate_rows(repeats: int = 5) -> list[Row]:
    """One estimate of the gap by each optimiser, on the nine buffers of the paper; the best of some repeats.

    The limit is for one estimate; ``guarded`` shows what the guard's checks and further attempts add.
    """
    scenario = prepare(*PAPER)
    config, trace = scenario.config, scenario.result.trace
    model = twin_model(scenario.structure, config.twin.observer_pole_rad_s, config.sample_time_s, config.twin.settle)
    theta_m, q3 = trace["theta_m_rad"].to_numpy(), trace["q3_mm"].to_numpy() * 1e-3
    rows: list[Row] = []
    for name in OPTIMIZERS:
        settings = compose(f"optimizer={name}").optimizer
        plain, guarded, errors = [], [], []
        for event in scenario.result.estimates["t_event_s"]:
            first = round(event / config.sample_time_s)
            window = slice(first, first + config.twin.buffer)
            gap = float(scenario.gap_hat_rad[first])

            buffer = theta_m[window], q3[window]
            plain.append(min(times_s(partial(_plain, buffer, model, settings, gap), repeats)))
            guarded.append(min(times_s(partial(_guarded, buffer, model, settings, gap), repeats)))
            found = _plain(buffer, model, settings, gap).gap_rad
            errors.append(abs(math.degrees(found - scenario.gap_rad[first + config.twin.buffer // 2])))
        rows.append({
            "what": name, "plain_median_ms": 1e3 * median(plain), "plain_worst_ms": 1e3 * max(plain),
            "guarded_median_ms": 1e3 * median(guarded), "guarded_worst_ms": 1e3 * max(guarded),
            "worst_error_deg": max(errors), "limit_ms": 1e3 * ESTIMATE_MAX_S,
            "pass": verdict(max(plain), ESTIMATE_MAX_S),
        })  # fmt: skip
    return rows


def _plain(buffer: Buffer, model: TwinModel, settings: OptimizerConfig, gap_rad: float) -> Estimate:
    problem = Problem(*buffer, model)
    return estimate_gap(problem, settings, default_start(problem, gap_rad))


def _guarded(buffer: Buffer, model: TwinModel, settings: OptimizerConfig, gap_rad: float) -> list[Attempt]:
    return guarded_estimates(Problem(*buffer, model), settings, gap_rad)


def linearity_rows(repeats: int = 7) -> list[Row]:
    """The compiled loop and the whole scenario (without the files) for 50 to 400 s of the same experiment."""
    lengths = (50.0, 100.0, 200.0, 400.0)
    scenarios = [prepare(*PAPER, f"duration_s={seconds:g}") for seconds in lengths]
    loops = interleaved_s([partial(ours, scenario) for scenario in scenarios], repeats)
    wholes = interleaved_s([partial(run_scenario, scenario.config) for scenario in scenarios], 3)
    rows: list[Row] = []
    for seconds, loop_s, whole_s in zip(lengths, loops, wholes, strict=True):
        rows.append({
            "what": f"{seconds:g} s", "simulated_s": seconds, "loop_s": loop_s, "scenario_s": whole_s,
            "loop_us_per_s": 1e6 * loop_s / seconds,
        })  # fmt: skip
    for row in rows:
        row["ratio"] = row["loop_us_per_s"] / rows[0]["loop_us_per_s"]
    rows[-1]["ratio_max"] = LINEARITY_MAX
    rows[-1]["pass"] = verdict(rows[-1]["ratio"], LINEARITY_MAX)
    return rows


def process_rows(repeats: int = 5) -> list[Row]:
    """Whole processes: ``dtb run`` with its files and figures, ``dtb --help``; wall and processor time."""
    commands = (
        ("dtb run controller=nimc_twin", ["run", "controller=nimc_twin"], RUN_MAX_S),
        ("dtb run, figures=false", ["run", "controller=nimc_twin", "figures=false"], None),
        ("dtb --help", ["--help"], HELP_MAX_S),
    )
    rows: list[Row] = []
    for name, words, at_most in commands:
        runs = [_process(words) for _ in range(repeats + 1)][1:]  # the first fills the caches
        wall = [run[0] for run in runs]
        rows.append({
            "what": name, "best_s": min(wall), "median_s": median(wall), "cpu_s": median([run[1] for run in runs]),
            "limit_s": at_most, "pass": verdict(median(wall), at_most),
        })  # fmt: skip
    return rows


def _process(words: list[str]) -> tuple[float, float]:
    """Wall and processor time [s] of one ``dtb`` in a folder of its own."""
    dtb = Path(sys.executable).with_name("dtb")
    with tempfile.TemporaryDirectory() as folder:
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run([str(dtb), *words], cwd=folder, check=True, stdout=subprocess.DEVNULL, timeout=300)
        wall = time.perf_counter() - begin
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
