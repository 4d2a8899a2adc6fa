"""The novelty indexes beside the mode's amplitude, on the page of a run and in the terminal."""

from __future__ import annotations

from typing import Any

from dtbacklash.config.run import RunConfig
from dtbacklash.experiment.watch import INDEXES
from dtbacklash.report.kit.numbers import number

#: index -> unit of its column and of its threshold
UNITS = {"frequency": "", "motor": "N m", "structure": "mm"}
#: index -> what the figure calls it
TITLES = {
    "frequency": "frequency of the mode over the believed one",
    "motor": "torque left over on the motor, rms",
    "structure": "output error behind the gap, rms",
}


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


def in_words(config: RunConfig) -> list[str]:
    """What is watched beside the amplitude of the mode."""
    t = config.twin
    said = {
        "frequency": f"the mode's frequency, once it is off by {number(100 * t.frequency_threshold)} % while the mode "
        f"swings by at least {number(t.frequency_amplitude_mm)} mm",
        "motor": f"the torque left over on the motor, above {number(t.motor_threshold_n_m)} N m",
        "structure": f"the output error behind the gap in force, above {number(t.structure_threshold_mm)} mm",
    }
    return ["alarms beside it: " + "; ".join(said[name] for name in said if name in t.indexes)]
