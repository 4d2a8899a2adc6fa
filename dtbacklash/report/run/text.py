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
from dtbacklash.report.run.network import network

#: compiling for longer than this is told, s
WORTH_TELLING_S = 1.0


def lines(summary: dict[str, Any], moves: pd.DataFrame, estimates: pd.DataFrame) -> list[RenderableType]:
    """The moves, the estimates, one line that sums them up, and what helps where the run does not settle."""
    told: list[RenderableType] = []
    for table, frame in ((tables.moves, moves), (tables.estimates, estimates)):
        if len(frame):
            told += [table(frame), ""]
    alarmed = [f"alarm at {text}" for text in alarms(summary)]
    said = [summary_line(summary), *pace_in_words(summary), *network(summary), *alarmed, *summary.get("advice", [])]
    return [*told, *map(Text, said)]


def pace_in_words(summary: dict[str, Any]) -> list[str]:
    """How a run in real time kept its deadlines, and which answers of the twin came late; nothing of any other run."""
    pace = summary.get("pace")
    if pace is None:
        return []
    share = 100.0 * pace["met_share"]
    kept = (
        f"real time: {pace['deadlines'] - pace['missed']} of {pace['deadlines']} deadlines of "
        f"{number(pace['deadline_ms'])} ms met ({share:.4g} %, {pace['missed']} missed); a sample was done "
        f"{number(pace['median_ms'])} ms after its instant (median), {number(pace['most_ms'])} ms (99.9 %), "
        f"{number(pace['worst_ms'])} ms (worst)"
    )
    late = [
        f"real time: the twin's answer to the event at {number(one['t_event_s'])} s came {number(one['late_s'])} s late"
        for one in pace["late_answers"]
    ]
    return [kept, *late]


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
