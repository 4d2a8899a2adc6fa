"""A run in tables and lines, for the terminal and for ``print(result)``."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd
from rich.console import RenderableType
from rich.text import Text

from dtbacklash.report.kit import tables
from dtbacklash.report.kit.numbers import number
from dtbacklash.report.run.indexes import alarms

#: compiling for longer than this is told, s
WORTH_TELLING_S = 1.0


def lines(summary: dict[str, Any], moves: pd.DataFrame, estimates: pd.DataFrame) -> list[RenderableType]:
    """The moves, the estimates, one line that sums them up, and what helps where the run does not settle."""
    told: list[RenderableType] = []
    for table, frame in ((tables.moves, moves), (tables.estimates, estimates)):
        if len(frame):
            told += [table(frame), ""]
    alarmed = [f"alarm at {text}" for text in alarms(summary)]
    return [*told, Text(summary_line(summary)), *map(Text, alarmed), *map(Text, summary.get("advice", []))]


def summary_line(summary: dict[str, Any]) -> str:
    """Largest overshoot, longest settling, peak voltage, estimates, time."""
    parts = [f"peak {number(summary.get('peak_voltage_v'))} V"]
    if summary.get("n_moves"):
        longest = summary.get("settling_time_s_max")
        settles = longest is not None and not math.isnan(longest)
        parts.insert(0, f"overshoot at most {number(summary.get('overshoot_pct_max'))} %")
        parts.insert(1, f"settling at most {number(longest)} s" if settles else "not every move settles")
    if summary.get("n_estimations"):
        parts.append(f"{summary.get('n_accepted')} of {summary.get('n_estimations')} estimates accepted")
    parts.append(_time(summary.get("seconds_simulated"), summary.get("wall_s", {})))
    return f"{summary.get('controller')}: " + ", ".join(parts)


def _time(seconds: float | None, wall: dict[str, float]) -> str:
    text = f"{number(seconds)} s simulated in {number(wall.get('simulate', 0.0) + wall.get('estimate', 0.0))} s"
    compiled = wall.get("compile", 0.0)
    return text if compiled < WORTH_TELLING_S else f"{text}, after {number(compiled)} s of compiling, once"
