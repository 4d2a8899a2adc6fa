"""One case as an adapter gets it, and what it gives back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from dtbacklash.arrays import Floats
from dtbacklash.benchmark.files import nominal, text_of
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate


@dataclass(frozen=True)
class Case:
    """The public files of a case, all in SI.

    rig : the nominal machine. recordings : tables with ``t``, ``u`` and the channels. test : (N,) the test's command.
    noise : channel -> standard deviation. columns : channel -> factor from SI to the unit of its column.
    """

    number: str
    rig: Rig
    said: dict[str, Any]
    recordings: list[pd.DataFrame]
    test: Floats
    noise: dict[str, float]
    columns: dict[str, float]

    @property
    def step_s(self) -> float:
        """The sample time."""
        return float(self.said["sample_time_s"])


@dataclass
class Found:
    """What is answered. rows : place, effect, size, unit, low, high, certainty. predicted : channel -> SI, or None."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    predicted: Mapping[str, Floats] | None = None


def load(folder: Path) -> Case | None:
    """A case of a benchmark; None where its recording is not there."""
    said = json.loads((folder / "case.yaml").read_text(encoding="utf-8"))
    if "test" not in said:
        return None
    rig = nominal(said["machine"])
    factors = {name: rig.sensors[name].per_si for name in said["predict"]}
    tables = [pd.read_csv(folder / name) for name in said["recordings"]]
    recordings = [table.assign(**{name: table[name] / factor for name, factor in factors.items()}) for table in tables]
    test = pd.read_csv(folder / said["test"])["u"].to_numpy()
    noise = {
        name: float(np.hypot(one["noise"], one["count"] / np.sqrt(12.0))) / factors[name]
        for name, one in said["instruments"].items()
    }
    return Case(folder.name, rig, said, recordings, test, noise, factors)


def simulated(rig: Rig, u: Floats, step_s: float) -> dict[str, Floats]:
    """Channel -> (N,) what a machine's sensors show at commands u (N,), from rest at 0, SI."""
    return {name: values[: len(u)] for name, values in simulate(rig, u, step_s).sensors.items()}


def write(folder: Path, answers: Mapping[str, tuple[Case, Found]]) -> None:
    """Write the answers of a tool as the benchmark reads them."""
    folder.mkdir(parents=True, exist_ok=True)
    columns = ["case", "place", "effect", "size", "unit", "low", "high", "certainty"]
    rows = [{"case": number, **row} for number, (_, found) in answers.items() for row in found.rows]
    table = pd.DataFrame(rows, columns=columns)
    table.to_csv(folder / "answers.csv", index=False, float_format="%.6g")
    (folder / "cases.txt").write_text("\n".join(answers) + "\n", encoding="utf-8")
    for number, (case, found) in answers.items():
        if found.predicted is not None:
            shown = {name: found.predicted[name] * case.columns[name] for name in case.said["predict"]}
            (folder / f"{number}.csv").write_text(text_of(pd.DataFrame(shown)), encoding="utf-8")
