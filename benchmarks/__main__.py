"""``python -m benchmarks [name ...]``: run the benchmarks, print their tables, write them as CSV and JSON."""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console
from rich.table import Table

from benchmarks import ablation, aging, bank, close_the_loop, indexes, nimc_forms, remote, speed
from benchmarks.alternatives import alternative_rows, alternative_words, check_docs, write_docs
from benchmarks.campaign import run_campaign
from benchmarks.diagnosis import diagnosis_rows
from benchmarks.guard import guard_rows, guard_words
from benchmarks.measure import Row
from benchmarks.wrong_models import run_wrong_models, wrong_model_rows, wrong_model_words
from dtbacklash.files import write_json

TITLES = {
    "loop": "200 s of the paper's scenario: our loop beside hand-written ones",
    "libraries": "The loop with a constant gap, 4 s: general libraries beside both compiled loops",
    "estimate": "One estimate of the gap (1000 samples), nine buffers of the paper's scenario",
    "linearity": "Time over simulated time",
    "process": "Whole processes, warm caches",
    "diagnosis": "Diagnosing a recording of one effect, two threads; ratio: time per recorded second over that of 15 s",
    "alternatives": "Beside the diagnosis, on concealed recordings: PySINDy on the residual, NARX by sysidentpy",
    "ablation": "Each setting of the diagnosis halved and doubled, on concealed recordings",
    "nimc_forms": "The forms of the internal model: wrong estimates of the gap, friction, sensors; the worst run",
    "indexes": "The novelty indexes on faults of each subsystem: 60 s of a square wave, encoder",
    "aging": "A machine that ages: the paper's twin beside the one that asks the bank",
    "bank": "The twin's bank on random machines: what it says of one change, from 1.5 s",
    "close_the_loop": "The loop with each belief, on concealed rigs: recorded, diagnosed, controlled",
    "wrong_models": "The twin in loops of 100 s whose model is wrong; from estimations on: of the estimates",
    "remote": "Machines on one twin over a broker, all on this computer; the buffers of Figure 13",
    "guard": "The twin with and without its guard in the closed loop, random starts, noises, gaps and buffers",
}
#: what a benchmark finds: rows, and sentences below them
Found = tuple[list[Row], list[str]]
#: run only when asked for (``guard`` asks for ``wrong_models``): they take long; ``alternatives`` needs the extra
#: ``compare``, ``remote`` the extra ``remote`` and Mosquitto
ASKED = ("alternatives", "ablation", "wrong_models", "close_the_loop", "bank", "aging", "remote")
SPEED: dict[str, Callable[[], list[Row]]] = {
    "loop": speed.loop_rows,
    "libraries": speed.library_rows,
    "estimate": speed.estimate_rows,
    "linearity": speed.linearity_rows,
    "process": speed.process_rows,
    "diagnosis": diagnosis_rows,
    "indexes": indexes.index_rows,
    "remote": remote.remote_rows,
}
#: what brings the rows of a benchmark into its page
WRITE_DOCS: dict[str, Callable[[list[Row], Path], None]] = {
    "indexes": indexes.write_docs,
    "remote": remote.write_docs,
}


def main() -> int:
    """Run what was asked for; exit code 1 if a limit is not met."""
    options = _options()
    names = options.names or [name for name in TITLES if name not in ASKED]
    if "guard" in options.names and "wrong_models" not in names:
        names = [*names, "wrong_models"]  # the guard's other half
    console = Console(highlight=False)
    console = console if console.is_terminal else Console(highlight=False, width=160)
    options.out.mkdir(parents=True, exist_ok=True)
    results: dict[str, Any] = {"machine": _machine()}
    for name in names:
        rows, words = CAMPAIGNS[name](options, console) if name in CAMPAIGNS else (_plain(name, options.docs), [])
        console.print(_table(TITLES[name], rows))
        for line in words:
            console.print(line, soft_wrap=True)
        console.print()
        pd.DataFrame(rows).to_csv(options.out / f"{name}.csv", index=False)
        results[name] = rows
    write_json(options.out / "benchmarks.json", results)
    failed = [f"{name}: {row['what']}" for name in names for row in results[name] if row.get("pass") == "no"]
    console.print(f"written to {options.out}; beyond their limits: {', '.join(failed) or 'none'}")
    return 1 if failed else 0


def _plain(name: str, docs: Path | None) -> list[Row]:
    """A benchmark without settings; into its page where asked for."""
    rows = SPEED[name]()
    if docs and name in WRITE_DOCS:
        WRITE_DOCS[name](rows, docs)
    return rows


def _guard(options: argparse.Namespace, console: Console) -> Found:
    n, seed = _campaign(options, 1000, 1)
    table = run_campaign(n, seed)
    table.to_csv(options.out / "guard_cases.csv", index=False)
    return guard_rows(table), guard_words(table, seed)


def _wrong_models(options: argparse.Namespace, console: Console) -> Found:
    n, seed = _campaign(options, 1000, 1)
    table = run_wrong_models(n, seed)
    table.to_csv(options.out / "wrong_models_cases.csv", index=False)
    return wrong_model_rows(table), wrong_model_words(table, seed)


def _alternatives(options: argparse.Namespace, console: Console) -> Found:
    n, seed = _campaign(options, 5, 10_000)
    if options.docs:
        check_docs(options.docs)
    rows = alternative_rows(n, seed)
    if options.docs:
        write_docs(rows, n, seed, options.docs)
    return rows, alternative_words(rows)


def _closing(options: argparse.Namespace, console: Console) -> Found:
    kept = options.out / "closing.json"
    rows = close_the_loop.closing_rows(_campaign(options, 0, 50_000)[1], kept)
    if options.docs:
        close_the_loop.write_docs(kept, options.docs)
    return rows, close_the_loop.closing_words(kept)


def _aging(options: argparse.Namespace, console: Console) -> Found:
    results = aging.run_both()
    rows = aging.aging_rows(results)
    if options.docs:
        aging.write_docs(results, rows, options.docs)
    return rows, []


def _bank(options: argparse.Namespace, console: Console) -> Found:
    n, seed = _campaign(options, 6, 3000)
    cases = bank.run_bank(n, seed)
    cases.to_csv(options.out / "bank_cases.csv", index=False)
    rows, words = bank.bank_rows(cases), bank.bank_words(cases, seed)
    if options.docs:
        bank.write_docs(rows, words, options.docs)
    return rows, words


def _ablation(options: argparse.Namespace, console: Console) -> Found:
    # with --docs the committed results are gone on from
    kept = options.docs / ablation.ROWS if options.docs else options.out / "ablation.json"
    rows = ablation.ablation_rows(_campaign(options, 3, 0)[0], options.settings, options.minutes, kept)
    if options.docs:
        ablation.write_docs(kept, options.docs)
    return rows, []


def _forms(options: argparse.Namespace, console: Console) -> Found:
    """The grid of the forms, with the ratios of the inverse below it; both into the docs where asked for."""
    grid = nimc_forms.run_grid(lambda said: console.print(said, style="dim"))
    grid.to_csv(options.out / "nimc_forms_runs.csv", index=False)
    ratios = nimc_forms.ratio_rows()
    if options.docs:
        nimc_forms.write_docs(grid, ratios, options.docs)
    return nimc_forms.form_rows(grid), [nimc_forms.in_words(row) for row in ratios]


#: those that draw cases or bring tables into the docs
CAMPAIGNS: dict[str, Callable[[argparse.Namespace, Console], Found]] = {
    "guard": _guard,
    "wrong_models": _wrong_models,
    "alternatives": _alternatives,
    "nimc_forms": _forms,
    "close_the_loop": _closing,
    "ablation": _ablation,
    "bank": _bank,
    "aging": _aging,
}


def _campaign(options: argparse.Namespace, n: int, seed: int) -> tuple[int, int]:
    """Cases and first seed of a campaign: as asked for, else these."""
    return (n if options.n is None else options.n), (seed if options.seed is None else options.seed)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="name", help="of " + ", ".join(TITLES))
    parser.add_argument(
        "--n",
        type=int,
        help="cases of a campaign (guard, wrong_models: 1000, alternatives: 5, ablation: 3 recordings, "
        "bank: 6 machines of a kind)",
    )
    parser.add_argument(
        "--seed",
        type=int,
        help="its first (guard, wrong_models: 1, bank: 3000, alternatives: 10000, close_the_loop: 50000)",
    )
    parser.add_argument("--out", type=Path, default=Path("outputs/benchmarks"), help="folder of the results")
    parser.add_argument("--docs", type=Path, help="of those that have tables in the docs: remake them")
    parser.add_argument("--settings", nargs="*", default=[], help="ablation: these settings first and alone")
    parser.add_argument(
        "--minutes", type=float, default=600.0, help="ablation: stop after so long; a repeated run goes on"
    )
    options = parser.parse_args()
    if unknown := [name for name in options.names if name not in TITLES]:
        parser.error(f"no benchmark {unknown[0]!r}; choose of " + ", ".join(TITLES))
    return options


def _machine() -> dict[str, Any]:
    return {
        "python": platform.python_version(),
        "system": platform.platform(),
        "processors": os.cpu_count(),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
    }


def _table(title: str, rows: list[Row]) -> Table:
    """The rows as a table for people: three significant digits, units in the heads."""
    table = Table(title=title, title_justify="left")
    columns = list(dict.fromkeys(key for row in rows for key in row))
    for column in columns:
        table.add_column(column.replace("_", " "), justify="left" if column in ("what", "pass") else "right")
    for row in rows:
        table.add_row(*(_cell(row.get(column)) for column in columns))
    return table


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    sys.exit(main())
