"""The figures and the page of one run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
from omegaconf import OmegaConf

from dtbacklash.metrics import tracking_rms_mm
from dtbacklash.report.numbers import number
from dtbacklash.report.overview import moves_overlay, run_overview
from dtbacklash.report.page import embedded, render
from dtbacklash.report.style import save
from dtbacklash.report.words import describe, plain

ORIGIN = ("versions", "seed", "wall_s")
CAPTIONS = {
    "overview": "The whole run: what was asked and what came out, gap and estimate, control voltage.",
    "moves": "All moves on top of each other, each scaled to go from 0 to 1: what the gap does to them.",
}


def write(result: Any, moves: pd.DataFrame, folder: Path) -> None:
    """Write `figures/*.png` (unless `config.figures` is false) and `report.html` into `folder`.

    Args:
        result: a `RunResult`: `config`, `trace`, `estimates`, `summary`. Of the summary the page uses, where
            they are there, `command` (repeats the run), `versions`, `seed` and `wall_s`.
        moves: `metrics.move_table` of the trace.
        folder: an existing folder.
    """
    figures = _draw(result, moves, folder / "figures") if result.config.figures else {}
    page = render(
        "run.html.j2",
        title=f"{result.config.controller.name} on {result.config.rig.name}",
        tiles=_tiles(result, moves),
        words=describe(result.config),
        moves=moves.to_dict("records"),
        estimates=result.estimates.to_dict("records"),
        figures=[(CAPTIONS[name], embedded(path)) for name, path in figures.items()],
        command=result.summary.get("command"),
        config=_yaml(plain(result.config)),
        origin=_yaml({name: result.summary[name] for name in ORIGIN if name in result.summary}),
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def _draw(result: Any, moves: pd.DataFrame, folder: Path) -> dict[str, Path]:
    """The figures of the run by name."""
    config, trace = result.config, result.trace
    novelty = config.twin.novelty_threshold_mm if config.controller.reconfigure == "novelty" else None
    figures = {"overview": run_overview(trace, result.estimates, moves, novelty)}
    if len(moves):
        figures["moves"] = moves_overlay(trace, moves)
    return {name: save(figure, folder / f"{name}.png") for name, figure in figures.items()}


def _tiles(result: Any, moves: pd.DataFrame) -> list[tuple[str, str]]:
    """The few figures to be read first: (value, what it is)."""
    tiles = []
    if len(moves):
        settled = moves["settling_time_s"]
        tiles += [
            (f"{number(moves['overshoot_pct'].max())} %", "largest overshoot"),
            (f"{number(settled.max())} s", "longest settling time (±1\u00a0%)")
            if settled.notna().all()
            else (f"{int(settled.isna().sum())} of {len(moves)}", "moves that do not settle (±1\u00a0%)"),
        ]
    else:
        tiles.append((f"{number(tracking_rms_mm(result.trace))} mm", "tracking error, rms"))
    tiles.append((f"{number(result.trace['u_v'].abs().max())} V", "peak voltage"))
    if result.config.controller.reconfigure != "never":
        accepted = int(result.estimates["accepted"].sum())
        tiles.append((f"{accepted} of {len(result.estimates)}", "estimates accepted"))
    return tiles


def _yaml(value: Any) -> str:
    return OmegaConf.to_yaml(OmegaConf.create(plain(value)))
