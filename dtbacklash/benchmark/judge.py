"""Score a folder of answers against a benchmark: read both, open the seals, count."""

from __future__ import annotations

from pathlib import Path

from dtbacklash.benchmark import answers, files
from dtbacklash.benchmark.score import Score, error_ratio, score
from dtbacklash.errors import UserError


def judge(folder: Path, bench: Path, key_file: Path | None, split: str, tool: str) -> Score:
    """The score of the answers in a folder; split : ``all``, or that of the cases that count.

    Raises UserError: no benchmark, no answers, no key where one is needed, a file that was changed.
    """
    said = {case.name: files.case_of(case) for case in files.case_folders(bench)}
    machines = {name: str(one["machine"]) for name, one in said.items()}
    given = answers.read(folder, machines, files.places_of(bench))
    wanted = [name for name in given.cases if split in ("all", said[name]["split"])]
    if not wanted:
        raise UserError("split", split, "has no case that the tool worked on")
    truths, ratios = [], {}
    for name in wanted:
        truth = files.truth_of(bench / files.CASES / name, key_file)
        samples = {channel: len(values) for channel, values in truth.test.items()}
        predicted, problem = answers.prediction(folder, name, samples) if samples else (None, "")
        given.problems += [f"{problem}; the prediction is left out"] if problem else []
        truths.append(truth)
        ratios[name] = error_ratio(truth, predicted)
    return score(tool, truths, given, ratios)
