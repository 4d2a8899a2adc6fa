"""How fast the loop is; each function gives the rows of one table."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.experiment.run import run_scenario
from studies.hand_written import HandWritten
from studies.measure import Row, interleaved_s, verdict
from studies.scenario import PAPER, ours, prepare

#: the loop's time over that of a hand-written loop which records as much
LOOP_RATIO_MAX = 12.0
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
