"""Run the baselines on a benchmark: ``python -m studies benchmark --bench bench [--tools ...] [--split development]``.

The answers and predictions go to ``--out``; answers to the whole development split are kept in
``studies/baselines/answers/TOOL``. All tools with answers in ``--out`` are scored; ``--tools`` without
a name runs none.
"""

from __future__ import annotations

import argparse
import importlib
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from dtbacklash.benchmark.files import case_folders
from dtbacklash.benchmark.score import Figure, Score, score_folder
from dtbacklash.campaign.progress import duration
from dtbacklash.files import write_text
from dtbacklash.report.components.markdown import between, table
from dtbacklash.report.components.numbers import number, percent
from studies.baselines.case import Case, Found, load, write

#: tool -> what it is
TOOLS = {
    "nominal": "nothing: the nominal model",
    "calibration": "calibration alone (scipy)",
    "sindy": "SINDy on the residual acceleration (pysindy)",
    "gaussian_process": "Gaussian process on it (scikit-learn)",
    "arx": "stepwise ARX test (sysidentpy)",
    "diagnose": "`dtb diagnose`",
}
#: what needs minutes a case runs only where it is named
CHEAP = tuple(name for name in TOOLS if name != "diagnose")
SPLITS = "development", "scored", "all"
ANSWERS = Path(__file__).with_name("baselines") / "answers"
BEGIN, END = "<!-- baselines: begin, made by python -m studies benchmark -->", "<!-- baselines: end -->"
SHOWN = "named", "place", "nothing", "false_names", "no_false_name", "size", "coverage", "prediction"


def run(tool: str, cases: Sequence[Case]) -> dict[str, tuple[Case, Found]]:
    """The answers of a tool; a case in which it fails has no answer, and is told."""
    adapter, begin = importlib.import_module(f"studies.baselines.{tool}"), time.monotonic()
    found = {}
    for j, case in enumerate(cases):
        try:
            found[case.number] = case, adapter.answer(case)
        except ImportError as error:
            raise SystemExit(f"{tool} needs {error.name}: pip install 'dtbacklash[compare]'") from None
        except Exception as error:  # a tool that fails has said nothing
            print(f"{tool}: case {case.number}: {type(error).__name__}: {error}", file=sys.stderr)
            found[case.number] = case, Found()
        left = (len(cases) - j - 1) / (j + 1) * (time.monotonic() - begin)
        print(f"{tool}: {j + 1} of {len(cases)} cases, about {duration(left)} left", file=sys.stderr, flush=True)
    return found


def main(words: Sequence[str]) -> None:
    """Run the tools, keep their answers, score them, and write the table of the docs."""
    parser = argparse.ArgumentParser(prog="python -m studies benchmark", description=__doc__)
    parser.add_argument("--bench", type=Path, default=Path("bench"), help="folder of dtb benchmark make")
    parser.add_argument("--key", type=Path, help="the key of its answers (default: none, for the development split)")
    parser.add_argument("--split", default="development", choices=SPLITS, help="default: development")
    parser.add_argument("--tools", nargs="*", default=CHEAP, choices=list(TOOLS), help=f"default: {', '.join(CHEAP)}")
    parser.add_argument("--first", type=int, help="only so many cases")
    parser.add_argument("--out", type=Path, default=Path("outputs/benchmark"), help="folder of the predictions")
    parser.add_argument("--docs", type=Path, help="folder of the docs, where the table is made anew")
    options = parser.parse_args(words)
    every = [case for case in map(load, case_folders(options.bench)) if case is not None]
    cases = [case for case in every if options.split in ("all", case.said["split"])][: options.first]
    for tool in options.tools:
        write(options.out / tool, run(tool, cases))
        if options.split == "development" and options.first is None:
            keep(options.out / tool, tool)
    scores = {
        tool: score_folder(options.out / tool, options.bench, options.key, options.split, tool)
        for tool in TOOLS if (options.out / tool / "cases.txt").is_file()
    }  # fmt: skip
    print(text(scores))
    if options.docs:
        page = options.docs / "benchmark.md"
        write_text(page, between(page.read_text(encoding="utf-8"), BEGIN, END, text(scores)))


def keep(folder: Path, tool: str) -> None:
    """Keep the answers of a tool in the repository; its predictions are too large."""
    for name in ("answers.csv", "cases.txt"):
        (ANSWERS / tool).mkdir(parents=True, exist_ok=True)
        shutil.copy(folder / name, ANSWERS / tool / name)


def text(scores: dict[str, Score]) -> str:
    """The scores side by side: a row a tool, with counts and 95 % intervals."""
    heads = ["tool", "cases", *(name.replace("_", " ") for name in SHOWN)]
    rows = [
        [TOOLS[tool], str(score.cases), *(_cell(score.figure(name)) for name in SHOWN)]
        for tool, score in scores.items()
    ]  # fmt: skip
    return table(heads, rows)


def _cell(one: Figure) -> str:
    if not one.of:
        return "-"
    if one.right is None:
        return f"{number(one.value)} ({number(one.low)} to {number(one.high)}; {one.of})"
    return f"{percent(one.value)} ({percent(one.low)} to {percent(one.high)}; {one.right}/{one.of})"
