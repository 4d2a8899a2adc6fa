"""The novelty indexes during a run: their traces, their alarms, and which subsystem an alarm is about."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, TypedDict

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import Belief
from dtbacklash.control.chain import dominant_frequency
from dtbacklash.experiment.loop import ALARM
from dtbacklash.result_cache import kept
from dtbacklash.twin.bank.equation import motor_equation
from dtbacklash.twin.bank.indexes import FREQUENCY, MOTOR, STRUCTURE, Watch, WatchState, indexes_struct, new_watch
from dtbacklash.twin.bank.indexes import new_watch_state as _new_state
from dtbacklash.twin.gap.observer import twin_model

#: index -> its place, its column of the trace, and what turns its SI value into that column's
INDEXES = {
    "frequency": (FREQUENCY, "frequency_ratio", 1.0),
    "motor": (MOTOR, "motor_torque_n_m", 1.0),
    "structure": (STRUCTURE, "structure_mm", 1e3),
}


class Alarm(TypedDict):
    """An index that has risen above its threshold: when, what it showed, and the subsystem that this speaks for."""

    t_s: float
    index: str
    value: float
    subsystem: str


@dataclass
class Watcher:
    """The indexes of a run.

    values : (N+1, 3) every index, SI. limits : (3,) infinite for those that are not asked for.
    """

    config: RunConfig
    watch: Watch
    state: WatchState
    values: Floats
    limits: Floats
    alarms: list[Alarm] = field(default_factory=list)

    @classmethod
    def prepare(cls, config: RunConfig, belief: Belief, samples: int) -> Watcher | None:
        """Before the first sample; None where no index is asked for.

        Raises UserError: the rig is no screw-driven chain of masses with a motor.
        """
        t, step_s = config.twin, config.sample_time_s
        if not t.indexes:
            return None
        structure = belief.linear().structure
        model = kept(twin_model, structure, t.observer_pole_rad_s, step_s, t.settle)
        watch = new_watch(
            motor_equation(belief, t.observer_pole_rad_s, step_s), model, kept(dominant_frequency, structure), step_s,
            t.frequency_amplitude_mm * 1e-3,
        )  # fmt: skip
        asked = {"frequency": t.frequency_threshold, "motor": t.motor_threshold_n_m,
                 "structure": t.structure_threshold_mm * 1e-3}  # fmt: skip
        limits = np.array([asked[name] if name in t.indexes else math.inf for name in INDEXES])
        return cls(config, watch, _new_state(watch), np.full((samples, len(INDEXES)), math.nan), limits)

    def struct(self) -> Any:
        """The indexes as the loop takes them."""
        return indexes_struct(self.watch, self.state, self.values, self.limits, self.config.twin.index_hysteresis)

    def raised(self, k: int, why: int) -> str:
        """Note an alarm at sample k; returns the index's name."""
        name = list(INDEXES)[why - ALARM]
        value = float(self.values[k, INDEXES[name][0]]) * INDEXES[name][2]
        self.alarms.append({
            "t_s": k * self.config.sample_time_s, "index": name, "value": value, "subsystem": self.subsystem(k, k + 1),
        })  # fmt: skip
        return name

    def subsystem(self, first: int, stop: int) -> str:
        """What the indexes of the samples ``first <= k < stop`` speak for.

        A wrong gap, dry friction, a bent screw all leave the mode's frequency as it is: only fits tell them apart.
        """
        seen = self.values[first:stop]
        off = np.abs(seen - np.array([1.0, 0.0, 0.0])) > self.limits
        if off[:, MOTOR].any():
            return "motor"
        return "structure" if off[:, FREQUENCY].any() else "gap or structure"

    def columns(self) -> dict[str, Floats]:
        """The columns of the trace, of the indexes that are asked for."""
        return {
            column: self.values[:, place] * factor
            for name, (place, column, factor) in INDEXES.items() if name in self.config.twin.indexes
        }  # fmt: skip
