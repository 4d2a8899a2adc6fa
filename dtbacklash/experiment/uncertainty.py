"""The band of a prediction: what a run would show, were the rig's parameters off by what a diagnosis leaves open.

The covariance of the fitted parameters is that of ``calibration`` in ``diagnosis.json``. Along each of its principal
directions the rig is simulated one standard error to both sides; the mean squares of what that changes add up.

So do those of a force at each body that the rig lacks, as large as the recording needed it on average over a stretch
(``slow`` in ``observed``). It is simulated as a constant one; stretches are taken as independent, so that after n of
them a force that adds up changes 1 / sqrt(n) of that. Controller and twin stay as they are: they know nothing of it.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import beliefs_of
from dtbacklash.errors import Diverged, UserError
from dtbacklash.experiment.result import RunResult
from dtbacklash.experiment.run import run_scenario
from dtbacklash.files import read_json
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig, build_rig

#: standard errors to each side of a 95 % interval
NORMAL95 = 1.96
#: directions of less of the correlations' largest eigenvalue change nothing (share)
NEGLIGIBLE = 1e-9
#: a parameter of the rig keeps its sign (share of its value that is left)
LEAST_SHARE = 1e-2

#: title -> by how much a parameter is moved
Step = dict[str, float]


def with_band(result: RunResult, folder: str, progress: Callable[[float], None] | None = None) -> None:
    """Add the columns ``NAME_low`` and ``NAME_high`` for each sensor to a run's trace.

    progress : called with the share done, 0 to 1.

    Raises UserError: no folder of a diagnosis with intervals; parameters that the rig of the run does not have; a
    machine that diverges within the band.
    """
    config, rig = result.config, result.rig
    found = _found(folder)
    steps = list(_steps(found["calibration"], rig, folder))
    forces, stretch_s = list(_forces(found.get("observed") or {}, rig)), (found.get("observed") or {}).get("stretch_s")
    own = [c["column"] for c in result.summary["signals"] if c["signal"] != "u"]
    columns = [result.own[name] for name in own]
    here, time_s = result.trace[columns].to_numpy(), result.trace["t_s"].to_numpy()
    beliefs, squares = beliefs_of(config), np.zeros_like(here)
    for k, step in enumerate([*steps, *forces]):
        changed = np.zeros_like(here)
        for side in (-1.0, 1.0):
            moved = _moved(rig, {title: side * by for title, by in step.items()})
            try:
                there = run_scenario(_of(config, moved), beliefs=beliefs).trace[columns].to_numpy()
            except Diverged as error:
                off = "within what the diagnosis leaves open the machine diverges, so that there is no band"
                raise UserError("uncertainty", folder, off) from error
            changed += 0.5 * (there - here) ** 2
        if k >= len(steps):  # another force in each stretch
            changed *= np.minimum(1.0, stretch_s / np.maximum(time_s - time_s[0], 1e-9))[:, None]
            changed = np.maximum.accumulate(changed, axis=0)
        squares += changed
        if progress:
            progress((k + 1) / (len(steps) + len(forces)))
    half = NORMAL95 * np.sqrt(squares)
    ends = {"low": here - half, "high": here + half}
    bands = {f"{name}_{end}": v[:, j] for j, name in enumerate(columns) for end, v in ends.items()}
    result.trace = result.trace.assign(**bands)
    result.summary["uncertainty"] = {
        "folder": folder, "directions": len(steps), "unknown_forces": len(forces),
        "half_width_max": dict(zip(own, half.max(axis=0).tolist(), strict=True)),
    }  # fmt: skip


def _found(folder: str) -> Mapping[str, Any]:
    file = Path(folder) / "diagnosis.json"
    if not file.is_file():
        raise UserError("uncertainty", folder, "must be the folder of a diagnosis, with diagnosis.json")
    found = read_json(file)
    if not (found.get("calibration") or {}).get("parameters"):
        raise UserError("uncertainty", folder, "holds a diagnosis without intervals of parameters (calibration)")
    assert isinstance(found, dict)
    return found


def _forces(observed: Mapping[str, Any], rig: Rig) -> Iterator[Step]:
    """A constant force at each body that can have one, of the size that is unknown there."""
    for body, size in observed.get("slow", {}).items():
        constant = {"constant_force", "constant_load"} & set(rig.takes(body)) if body in rig.places else set()
        if constant and size:
            effect = rig.takes(body)[constant.pop()]
            yield {f"{body}.{effect.name}.{effect.size.name}": size}


def _steps(calibration: Mapping[str, Any], rig: Rig, folder: str) -> Iterator[Step]:
    """One standard error along each principal direction of the parameters' covariance."""
    rows, correlation = calibration["parameters"], calibration["correlation"]
    titles = [t for t, row in rows.items() if _is_open(row)]
    for title in titles:
        if not _has(rig, title):
            raise UserError(
                "uncertainty", folder, f"fitted {title}, which the rig of this run has not; take its rig.yaml"
            )
    errors = np.array([0.5 * (rows[t]["ci95"][1] - rows[t]["ci95"][0]) / NORMAL95 for t in titles])
    together: Floats = np.array([[correlation[a][b] if a != b else 1.0 for b in titles] for a in titles], dtype=float)
    sizes, directions = np.linalg.eigh(np.nan_to_num(together.reshape(len(titles), len(titles))))
    for size, direction in zip(sizes, directions.T, strict=True):
        if size > NEGLIGIBLE * sizes[-1]:
            yield dict(zip(titles, (math.sqrt(size) * direction * errors).tolist(), strict=True))


def _is_open(row: Mapping[str, Any]) -> bool:
    low, high = row["ci95"]
    return low is not None and high is not None and math.isfinite(high - low) and high > low


def _has(rig: Rig, title: str) -> bool:
    if title in rig.config.parameters:
        return True
    place, _, rest = title.partition(".")
    effect, _, name = rest.partition(".")
    return name in (rig.effect(place, effect) or {})


def _moved(rig: Rig, step: Step) -> Rig:
    """The rig with its parameters moved, within their bounds."""
    values: dict[tuple[str, ...], float] = {}
    for title, by in step.items():
        if title in rig.config.parameters:
            known = rig.config.parameters[title].value
            least, value = LEAST_SHARE * known, known + by
            values[title,] = max(value, least) if known > 0.0 else min(value, least)
            continue
        place, effect, name = title.split(".", 2)
        bounds = next(p for p in find(rig.kind_at(place), effect, place).parameters if p.name == name)
        there = rig.effect(place, effect)
        if there is None:
            rig = rig.with_effect(place, effect, {name: by})
        else:
            values[place, effect, name] = min(max(there[name] + by, bounds.low), bounds.high)
    return build_rig(rig.config.with_values(values))


def _of(config: RunConfig, rig: Rig) -> RunConfig:
    """The run of another rig, that says what it shows without noise's help: the trace is the truth."""
    return replace(config, rig=rig.config, uncertainty=None, pace="free")
