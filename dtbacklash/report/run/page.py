"""The figures and the page of one run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure as Drawn

from dtbacklash.config.run import RunConfig
from dtbacklash.report.components.blocks import Block, Code, Figure, Items, Table, Tiles
from dtbacklash.report.components.intervals import scaled, unit_in_signs
from dtbacklash.report.components.numbers import number
from dtbacklash.report.components.page import embedded, render
from dtbacklash.report.components.style import save, save_png
from dtbacklash.report.run import loop as loop_page
from dtbacklash.report.run.methods import methods
from dtbacklash.report.run.overview import band_figure, moves_overlay, open_overview, run_overview
from dtbacklash.report.run.text import alarms, estimates_table, indexes_drawn, moves_table, network, pace_in_words
from dtbacklash.report.run.words import as_yaml, describe, has_gear, is_open, subjects
from dtbacklash.result_cache import kept

ORIGIN = ("versions", "seed", "wall_s")
SIGNALS = ("signal", "what it is", "lowest#", "highest#", "rms#", "unit")
NO_MOVE = "The reference never holds still before and after a change: there is no move to measure."
#: of a figure: what it shows, and what to see in it
OPEN = (
    "The whole run: the command, and what each sensor shows.",
    "In a good recording every signal moves well above its sensor's noise and reverses often. A position that runs "
    "away or a signal that stays at zero shows that the command does not suit the rig.",
)
MOVES = (
    "All moves on top of each other, each scaled to go from 0 to 1: what the gap does to them.",
    "If the controller copes with the gap, all curves lie on top of each other and stay within the grey band once they "
    "have entered it.",
)
BAND = (
    "What is simulated, within the 95 % band of what the rig's parameters may be off by.",
    "The band knows nothing of what the model lacks, nor of noise: a recording that leaves it shows one or the other.",
)
ONE_MOVE = (
    "The move, scaled to go from 0 to 1.",
    "A good move rises without ringing and stays within the grey band once it has entered it.",
)


def write(result: Any, moves: pd.DataFrame, folder: Path) -> None:
    """Write `figures/*.png` (unless `config.figures` is false) and `report.html` into `folder`.

    result: a `RunResult`: `config`, `trace`, `estimates`, `summary`, `design`. Of the summary the page uses
        `tracking_rms_mm`, `peak_voltage_v`, `signals`, `n_accepted`, `n_attempts` and, where they are there,
        `command` (repeats the run), `versions`, `seed` and `wall_s`.
    moves: `metrics.move_table` of the trace.
    folder: an existing folder.
    """
    opened = is_open(result.config)
    figures = _draw(result, moves, folder / "figures") if result.config.figures else {}
    loop, name, rig = ("open", "open loop", result.config.rig.name) if opened else (
        "closed", result.config.controller.name, result.config.rig.name,
    )  # fmt: skip
    shown = [
        Figure(embedded(path), *_caption(n, result.config, len(moves))) for n, path in figures.items() if n != "loop"
    ]
    of_loop = [Figure(embedded(figures["loop"]), *loop_page.CAPTION)] if "loop" in figures else []
    summary = result.summary
    margins = loop_page.rows(result.design) if result.design else []
    origin = as_yaml({name: summary[name] for name in ORIGIN if name in summary})
    signals = summary["signals"] if opened else []
    page = render(f"{name} on {rig}", f"One {loop}-loop run of dtbacklash.", [
        Tiles(_tiles(result, moves)),
        *summary.get("advice", []),
        Block("What happened", shown, id="figures"),
        Block("Signals", [Table(SIGNALS, [_row(_in_its_unit(s)) for s in signals])], id="signals"),
        Block("Moves", [] if opened else [moves_table(moves) if len(moves) else NO_MOVE], id="moves"),
        Block("Estimates of the digital twin", [estimates_table(result.estimates)], id="estimates"),
        Block("Margins of the design", [Table(("margin", "value#", "meaning"), margins), *of_loop], id="margins"),
        Block("Alarms of the novelty indexes", [Items(alarms(summary))], id="alarms"),
        Block("Deadlines", [Items(pace_in_words(summary))], id="pace"),
        Block("Over the network", [Items(network(summary))], id="network"),
        Block("What was run", [subjects(describe(result.config))], folded=True, id="setup"),
        Block("Methods", methods(result.config), folded=True, id="methods"),
        Block("Run it again, and all settings", [
            Code(summary.get("command") or ""),
            Block("Configuration, resolved", [Code(as_yaml(result.config))], folded=True),
            Block("Versions, seed and times", [Code(origin)], folded=True),
        ], folded=True, id="repeat"),
    ])  # fmt: skip
    (folder / "report.html").write_text(page, encoding="utf-8")


def _caption(name: str, config: RunConfig, moves: int) -> tuple[str, str]:
    """What a figure shows, and what to see in it."""
    if name == "uncertainty":
        return BAND
    if name == "moves":
        return MOVES if moves > 1 else ONE_MOVE
    if is_open(config):
        return OPEN
    shown, good = ["reference and output"], ["the output lies on the reference but for short transients"]
    if config.controller.reconfigure != "never":
        shown.append("gap and estimate")
        good.append("the estimate follows the gap in steps")
    elif has_gear(config.rig):
        shown.append("gap")
    if config.controller.reconfigure == "novelty":
        shown.append("novelty index")
        good.append("the index crosses its threshold only where the gap has grown since the last estimate")
    shown += [f"{name} index" for name in config.twin.indexes]
    return (
        f"The whole run: {', '.join(shown)}, control voltage.",
        f"In a good run {', '.join(good)}, and the voltage spikes at moves only.",
    )


def overview(result: Any, moves: pd.DataFrame) -> Drawn:
    """Everything over time, as the page shows it first. result: a `RunResult`; moves: `metrics.move_table`."""
    config = result.config
    if is_open(config):
        return open_overview(result.channels, result.summary["signals"])
    novelty = config.twin.novelty_threshold_mm if config.controller.reconfigure == "novelty" else None
    return run_overview(result.trace, result.estimates, moves, novelty, indexes_drawn(config))


def _draw(result: Any, moves: pd.DataFrame, folder: Path) -> dict[str, Path]:
    """The figures of the run by name."""
    figures = {"overview": save(overview(result, moves), folder / "overview.png")}
    if len(moves):
        figures["moves"] = save(moves_overlay(result.trace, moves), folder / "moves.png")
    if banded := list(result.summary.get("uncertainty", {}).get("half_width_max", {})):
        figures["uncertainty"] = save(band_figure(result.channels, banded), folder / "uncertainty.png")
    if result.design is not None:  # many runs share a design: what it looks like is drawn once
        figures["loop"] = save_png(kept(loop_page.loop_png, result.design), folder / "loop.png")
    return figures


def _tiles(result: Any, moves: pd.DataFrame) -> list[tuple[str, str]]:
    """The few figures to be read first: (value, what it is)."""
    summary = result.summary
    if is_open(result.config):
        _command, *sensors = summary["signals"]
        shown = [_in_its_unit(s) for s in sensors if s["rms"] is not None]
        return [
            (f"{number(summary['peak_voltage_v'])} V", "largest command"),
            *((f"{number(s['rms'])} {s['unit']}", f"{s['quantity']} of {s['of']}, rms") for s in shown[:3]),
        ]
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
        tiles.append((f"{number(summary['tracking_rms_mm'])} mm", "tracking error, rms"))
    tiles.append((f"{number(summary['peak_voltage_v'])} V", "peak voltage"))
    if result.config.controller.reconfigure != "never":
        tiles.append((f"{summary['n_accepted']} of {summary['n_attempts']}", "estimates accepted"))
    return tiles


def _row(signal: dict[str, Any]) -> list[str]:
    """A row of the table of signals."""
    what = signal["quantity"] + (f" of {signal['of']}" if signal["of"] else "")
    return [signal["signal"], what, *(number(signal[x]) for x in ("lowest", "highest", "rms")), signal["unit"]]


def _in_its_unit(signal: dict[str, Any]) -> dict[str, Any]:
    """A row of the summary's signals, its figures in a unit of their size: 0.12 mA, not 0.00012 A."""
    factor, unit = scaled(signal["unit"], signal["rms"] or 0.0)
    ranges = {name: None if (x := signal[name]) is None else x / factor for name in ("lowest", "highest", "rms")}
    return {**signal, **ranges, "unit": unit_in_signs(unit)}
