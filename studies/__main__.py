"""``python -m studies [NAME ...]``: run the studies, print their tables, write them as CSV and JSON.

``python -m studies gallery FOLDER`` and ``python -m studies real FOLDER`` make pages of the docs instead.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console
from rich.table import Table

from dtbacklash.files import write_json
from studies import (
    aging,
    alternatives,
    bank,
    beliefs,
    benchmark,
    campaign,
    close_the_loop,
    commands,
    controllers,
    crossing,
    diagnosis,
    fleets,
    gallery,
    indexes,
    nimc_forms,
    real,
    remote,
    second_recording,
    simulators,
    speed,
    wrong_models,
)
from studies.measure import Row

#: the rows of a study's table, and sentences below them
Result = tuple[list[Row], list[str]]
console = Console(highlight=False)
console = console if console.is_terminal else Console(highlight=False, width=160)


@dataclass(frozen=True)
class Study:
    """What backs a claim.

    Attributes
    ----------
    title : of its table. run : does it; takes the options. n, seed : cases and first seed unless the options say
        otherwise; None: it draws no cases. asked : takes long, and runs only where it is named.
    """

    title: str
    run: Callable[[argparse.Namespace], Result]
    n: int | None = None
    seed: int | None = None
    asked: bool = False


def _rows(rows: Callable[[], list[Row]], docs: Callable[[list[Row], Path], None] | None = None) -> Any:
    """The function of a study without settings, from what makes its rows and what brings them into its page."""

    def run(options: argparse.Namespace) -> Result:
        made = rows()
        if docs and options.docs:
            docs(made, options.docs)
        return made, []

    return run


def _guard(options: argparse.Namespace) -> Result:
    table = campaign.run_campaign(options.n, options.seed)
    table.to_csv(options.out / "guard_cases.csv", index=False)
    return campaign.guard_rows(table), campaign.guard_words(table, options.seed)


def _wrong_models(options: argparse.Namespace) -> Result:
    table = wrong_models.run_wrong_models(options.n, options.seed)
    table.to_csv(options.out / "wrong_models_cases.csv", index=False)
    return wrong_models.wrong_model_rows(table), wrong_models.wrong_model_words(table, options.seed)


def _crossing(options: argparse.Namespace) -> Result:
    table = crossing.run_crossing(options.n, options.seed)
    table.to_csv(options.out / "crossing_cases.csv", index=False)
    return crossing.crossing_rows(table), crossing.crossing_words(table, options.seed)


def _beliefs(options: argparse.Namespace) -> Result:
    runs = beliefs.run_beliefs()
    runs.to_csv(options.out / "beliefs_runs.csv", index=False)
    rows = beliefs.belief_rows(runs)
    if options.docs:
        beliefs.write_docs(rows, options.docs)
    return rows, []


def _controllers(options: argparse.Namespace) -> Result:
    moves = controllers.run_controllers(options.law)
    moves.to_csv(options.out / "controllers_moves.csv", index=False)
    rows = controllers.controller_rows(moves)
    if options.docs:
        controllers.write_docs(moves, rows, options.docs)
    return rows, []


def _alternatives(options: argparse.Namespace) -> Result:
    rows = alternatives.alternative_rows(options.n, options.seed)
    if options.docs:
        alternatives.write_docs(rows, options.n, options.seed, options.docs)
    return rows, alternatives.alternative_words(rows)


def _close_the_loop(options: argparse.Namespace) -> Result:
    kept = options.out / "closing.json"
    rows = close_the_loop.closing_rows(options.seed, kept)
    if options.docs:
        close_the_loop.write_docs(kept, options.docs)
    return rows, close_the_loop.closing_words(kept)


def _aging(options: argparse.Namespace) -> Result:
    results = aging.run_both()
    rows = aging.aging_rows(results)
    if options.docs:
        aging.write_docs(results, rows, options.docs)
    return rows, []


def _bank(options: argparse.Namespace) -> Result:
    rows = bank.bank_rows(options.seed)
    if options.docs:
        bank.write_docs(rows, options.docs)
    return rows, []


def _second_recording(options: argparse.Namespace) -> Result:
    found = second_recording.rows(options.n, options.seed)
    return found, second_recording.said(found)


def _fleets(options: argparse.Namespace) -> Result:
    found = fleets.fleet_rows(options.n, options.seed, options.out / f"fleets_{options.n}_{options.seed}.csv")
    if options.docs:
        fleets.write_docs(found, options.docs)
    return found, fleets.fleet_words(found)


def _simulators(options: argparse.Namespace) -> Result:
    found = simulators.simulator_rows(options.n, options.seed, options.out / "simulators_cases.csv")
    return found, simulators.simulator_words(found)


def _arms(options: argparse.Namespace) -> Result:
    found = simulators.simulator_rows(options.n, options.seed, options.out / "arms_cases.csv", simulators.OWN)
    return found, simulators.simulator_words(found)


def _nimc_forms(options: argparse.Namespace) -> Result:
    grid = nimc_forms.run_grid(lambda said: console.print(said, style="dim"))
    grid.to_csv(options.out / "nimc_forms_runs.csv", index=False)
    ratios = nimc_forms.ratio_rows()
    if options.docs:
        nimc_forms.write_docs(grid, options.docs)
    return nimc_forms.form_rows(grid), [nimc_forms.in_words(row) for row in ratios]


STUDIES = {
    "loop": Study("200 s of the paper's scenario: our loop beside hand-written ones", _rows(speed.loop_rows)),
    "commands": Study(
        "What whole commands cost, from Enter to the page, in processor time", _rows(commands.command_rows), asked=True
    ),
    "linearity": Study("Time over simulated time", _rows(speed.linearity_rows)),
    "diagnosis": Study(
        "Diagnosing a recording of one effect, two threads; ratio: time per recorded second over that of 15 s",
        _rows(diagnosis.diagnosis_rows),
    ),
    "several": Study(
        "One recording and n of them in one diagnosis: a two-mass stage, 30 s at 1 kHz each",
        lambda options: (diagnosis.several_rows(options.n), []), 2, asked=True,
    ),
    "alternatives": Study(
        "Beside the diagnosis, on concealed recordings: PySINDy on the residual, NARX by sysidentpy (extra compare)",
        _alternatives, 5, 10_000, asked=True,
    ),
    "nimc_forms": Study(
        "The forms of the internal model: wrong estimates of the gap, friction, sensors; the worst run", _nimc_forms
    ),
    "indexes": Study(
        "The novelty indexes on faults of each subsystem: 60 s of a square wave, encoder",
        _rows(indexes.index_rows, indexes.write_docs),
    ),
    "aging": Study("A machine that ages: the paper's twin beside the one that asks the bank", _aging, asked=True),
    "bank": Study(
        "The bank in the loop: twelve changes, with it and without", _bank, seed=0, asked=True
    ),
    "close_the_loop": Study(
        "The loop with each belief, on concealed rigs: recorded, diagnosed, controlled",
        _close_the_loop, seed=50_000, asked=True,
    ),
    "wrong_models": Study(
        "The twin in loops of 100 s whose model is wrong; from estimations on: of the estimates",
        _wrong_models, 1000, 1, asked=True,
    ),
    "controllers": Study(
        "The paper's controllers beside a PID, an LQG and an MPC: main scenario, encoder, at most 12 V", _controllers
    ),
    "beliefs": Study(
        "What is known of a machine, and what its controller does: nominal, by the bank, true", _beliefs, asked=True
    ),
    "second_recording": Study(
        "Pairs that one recording confuses, with a second one: lead of the truth in -2 log likelihood",
        _second_recording, 30, 0, asked=True,
    ),
    "fleets": Study(
        "Concealed fleets of three recordings, and changes between two; sure names have an !",
        _fleets, 8, 91_000, asked=True,
    ),
    "simulators": Study(
        "Concealed recordings on MuJoCo models of gymnasium (extra mujoco): names, those that are sure with an !",
        _simulators, 10, 0, asked=True,
    ),
    "arms": Study(
        "The same on an arm of six joints, 30 s at 500 Hz each", _arms, 7, 0, asked=True,
    ),
    "crossing": Study(
        "The twin's controller beside the paper's on random machines, lives of 100 s", _crossing, 1000, 1, asked=True
    ),
    "remote": Study(
        "Machines on one twin over a broker (extra remote, Mosquitto), all on this computer; the buffers of Figure 13",
        _rows(remote.remote_rows, remote.write_docs), asked=True,
    ),
    "guard": Study(
        "The twin with and without its guard in the closed loop, random starts, noises, gaps and buffers",
        _guard, 1000, 1,
    ),
}  # fmt: skip
#: studies whose result is a page: name -> takes the folder of the docs, and what to make anew in it (default: all)
PAGES: dict[str, Callable[[list[str]], None]] = {
    "gallery": gallery.main, "real": real.main, "benchmark": benchmark.main,
}  # fmt: skip


def main(words: list[str]) -> int:
    """Run what was asked for; exit code 1 if a limit is not met."""
    if words[:1] and words[0] in PAGES:
        PAGES[words[0]](words[1:])
        return 0
    options = _options(words)
    options.out.mkdir(parents=True, exist_ok=True)
    results: dict[str, Any] = {"machine": _machine()}
    for name in options.names:
        study = STUDIES[name]
        chosen = argparse.Namespace(**vars(options))
        chosen.n = study.n if options.n is None else options.n
        chosen.seed = study.seed if options.seed is None else options.seed
        rows, sentences = study.run(chosen)
        console.print(_table(study.title, rows))
        for line in sentences:
            console.print(line, soft_wrap=True)
        console.print()
        pd.DataFrame(rows).to_csv(options.out / f"{name}.csv", index=False)
        results[name] = rows
    write_json(options.out / "studies.json", results)
    failed = [f"{name}: {row['what']}" for name in options.names for row in results[name] if row.get("pass") == "no"]
    console.print(f"written to {options.out}; limits not met: {', '.join(failed) or 'none'}")
    return 1 if failed else 0


def _options(words: list[str]) -> argparse.Namespace:
    def defaults(name: str) -> str:
        return ", ".join(f"{study}: {value}" for study, one in STUDIES.items() if (value := getattr(one, name)))

    parser = argparse.ArgumentParser(prog="python -m studies", description=__doc__)
    quick = [name for name, study in STUDIES.items() if not study.asked]
    parser.add_argument(
        "names", nargs="*", metavar="NAME",
        help=f"of {', '.join(STUDIES)}; default: {', '.join(quick)}",
    )  # fmt: skip
    parser.add_argument("--n", type=int, help=f"cases (default: {defaults('n')})")
    parser.add_argument("--seed", type=int, help=f"of the first case (default: {defaults('seed')})")
    parser.add_argument("--out", type=Path, default=Path("outputs/studies"), help="folder of the results")
    parser.add_argument("--docs", type=Path, help="folder of the docs, where the study's tables are made anew")
    parser.add_argument(
        "--law", type=Path, help="controllers: a law of your own beside them, as controller.file takes it"
    )
    options = parser.parse_args(words)
    if unknown := [name for name in options.names if name not in STUDIES]:
        parser.error(f"no study {unknown[0]!r}; choose of " + ", ".join([*STUDIES, *PAGES]))
    if "guard" in options.names and "wrong_models" not in options.names:
        options.names.append("wrong_models")  # the other half of what is claimed of the guard
    options.names = options.names or quick
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
    sys.exit(main(sys.argv[1:]))
