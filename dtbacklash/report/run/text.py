"""A run in tables and lines, for the terminal, for ``print(result)`` and for the page."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd
from rich.console import RenderableType
from rich.text import Text

from dtbacklash.config.run import RunConfig
from dtbacklash.experiment.novelty_monitor import INDEXES
from dtbacklash.report.components import tables
from dtbacklash.report.components.blocks import Table
from dtbacklash.report.components.numbers import fixed, number

MOVE = ("move#", "at [s]#", "from [mm]#", "to [mm]#", "overshoot [%]#", "settling time [s]#", "peak voltage [V]#")
ESTIMATE = ("event [s]#", "applied [s]#", "gap [deg]#", "true gap [deg]#", "verdict", "reason")
#: index -> unit of its column and of its threshold
UNITS = {"frequency": "", "motor": "N m", "structure": "mm"}
#: index -> what the figure calls it
TITLES = {
    "frequency": "frequency of the mode over the believed one",
    "motor": "torque left over on the motor, rms",
    "structure": "output error behind the gap, rms",
}
#: a run in real time that keeps fewer of its deadlines was none (share)
IN_REAL_TIME_SHARE = 0.99


def lines(summary: dict[str, Any], moves: pd.DataFrame, estimates: pd.DataFrame) -> list[RenderableType]:
    """The moves, the estimates, one line that sums them up, and what helps where the run does not settle."""
    told: list[RenderableType] = []
    for table in (moves_table(moves), estimates_table(estimates)):
        told += [tables.of(table), ""] if table.rows else []
    alarmed = [f"alarm at {text}" for text in alarms(summary)]
    said = [summary_line(summary), *pace_in_words(summary), *network(summary), *alarmed, *summary.get("advice", [])]
    return [*told, *map(Text, said)]


def moves_table(moves: pd.DataFrame) -> Table:
    """A row a move."""
    return Table(MOVE, [
        [str(m["move"]), fixed(m["t_s"], 1), fixed(m["from_mm"], 2), fixed(m["to_mm"], 2), fixed(m["overshoot_pct"], 2),
         fixed(m["settling_time_s"], 3, "not settled"), fixed(m["peak_voltage_v"], 2)]
        for m in moves.to_dict("records")
    ], "Moves of the reference")  # fmt: skip


def estimates_table(estimates: pd.DataFrame) -> Table:
    """A row an estimation, with the reason of each that was rejected."""
    told = "subsystem" in estimates
    return Table((*ESTIMATE, *["subsystem"] * told), [
        [fixed(e["t_event_s"], 2), fixed(e["t_applied_s"], 2), fixed(e["gap_deg"], 2), fixed(e["true_gap_deg"], 2),
         "accepted" if e["accepted"] else "rejected", number(e["reason"], missing=""),
         *[str(e.get("subsystem"))] * told]
        for e in estimates.to_dict("records")
    ], "Estimates of the twin")  # fmt: skip


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
    slow = [] if pace["met_share"] >= IN_REAL_TIME_SHARE else [
        f"this was no real time: {100.0 - share:.3g} % of the deadlines were missed; a longer sample_time_s or a "
        "machine with a core to spare keeps them"
    ]  # fmt: skip
    return [kept, *late, *slow]


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
    seconds, wall = summary.get("seconds_simulated"), summary.get("wall_s", {})
    parts.append(f"{number(seconds)} s simulated in {number(wall.get('simulate', 0.0) + wall.get('estimate', 0.0))} s")
    return f"{summary.get('controller')}: " + ", ".join(parts)


def indexes_drawn(config: RunConfig) -> list[tuple[str, str, list[float], str]]:
    """Title, column of the trace, thresholds and unit of each index that was asked for."""
    t = config.twin
    limits = {
        "frequency": [1 - t.frequency_threshold, 1 + t.frequency_threshold],
        "motor": [t.motor_threshold_n_m],
        "structure": [t.structure_threshold_mm],
    }
    return [(TITLES[name], INDEXES[name][1], limits[name], UNITS[name]) for name in limits if name in t.indexes]


def alarms(summary: dict[str, Any]) -> list[str]:
    """A sentence for each alarm: when, which index, what it showed, the subsystem that this speaks for."""
    return [
        f"{number(a['t_s'])} s: {a['index']} index at {number(a['value'])} {UNITS[a['index']]}".rstrip()
        + f", which speaks for: {a['subsystem']}"
        for a in summary.get("alarms", [])
    ]


def indexes_in_words(config: RunConfig) -> list[str]:
    """What is watched beside the amplitude of the mode."""
    t = config.twin
    said = {
        "frequency": f"the mode's frequency, once it is off by {number(100 * t.frequency_threshold)} % while the mode "
        f"swings by at least {number(t.frequency_amplitude_mm)} mm",
        "motor": f"the torque left over on the motor, above {number(t.motor_threshold_n_m)} N m",
        "structure": f"the output error behind the gap in force, above {number(t.structure_threshold_mm)} mm",
    }
    return ["alarms beside it: " + "; ".join(said[name] for name in said if name in t.indexes)]


def network(summary: dict[str, Any]) -> list[str]:
    """A sentence on the requests, one for each reason for no answer, and one for each kind of dropped message.

    Empty for a run whose twin was in its own process.
    """
    remote = summary.get("remote")
    if not remote:
        return []
    head = f"twin at {remote['broker']}, machine {remote['machine']}: "
    head += f"{remote['answered']} of {remote['requests']} requests answered"
    median_s, most_s = remote["delay_s"]["median"], remote["delay_s"]["p99"]
    if median_s is not None:
        head += f", after {number(1e3 * median_s)} ms in the median, {number(1e3 * most_s)} ms at most in 99 %"
    told = [head]
    told += [f"no answer, {_times(n)}: {reason}" for reason, n in remote["unanswered"].items()]
    return told + [f"message dropped, {_times(n)}: {reason}" for reason, n in remote["dropped"].items()]


def _times(n: int) -> str:
    return "once" if n == 1 else f"{n} times"
