"""Score a folder of answers against a benchmark: read both, open the seals, count."""

from __future__ import annotations

from pathlib import Path

from dtbacklash.benchmark import answers, files
from dtbacklash.benchmark.score import Score, error_ratio, score
from dtbacklash.errors import UserError


def judge(folder: Path, bench: Path, key_file: Path | None, split: str, tool: str) -> Score:
    """The score of the answers in a folder; split : ``all``, or that of the cases that count.

    A real recording of which the benchmark has no copy counts only where the tool names the case.

    Raises UserError: no benchmark, no answers, no key where one is needed, a file that was changed.
    """
    said = {case.name: files.case_of(case) for case in files.case_folders(bench)}
    machines = {name: str(one["machine"]) for name, one in said.items()}
    given = answers.read(folder, machines, files.places_of(bench))
    chosen = set(given.rows) if not (folder / answers.CASES).is_file() else set(given.cases)
    there = [n for n in given.cases if n in chosen or said[n]["split"] != "real" or "recordings" in said[n]]
    wanted = [name for name in there if split in ("all", said[name]["split"])]
    if not wanted:
        splits = ", ".join(dict.fromkeys(said[name]["split"] for name in there))
        raise UserError("split", split, f"has no case that the tool worked on; it has such of {splits or 'none'}")
    truths, ratios = [], {}
    for name in wanted:
        truth = files.truth_of(bench / files.CASES / name, key_file)
        samples = {channel: len(values) for channel, values in truth.test.items()}
        predicted, problem = answers.prediction(folder, name, samples) if samples else (None, "")
        given.problems += [f"{problem}; the prediction is left out"] if problem else []
        given.problems += [
            f"case {name}: {row.unit[:answers.SHOWN]!r} is no unit for {row.place} {row.effect} ({hidden.unit or 1}); "
            "its size counts as wrong"
            for row in given.rows.get(name, ()) for hidden in truth.hidden
            if (row.place, row.effect, row.size is None) == (hidden.place, hidden.effect, False)
            and hidden.size is not None and row.size_in(hidden.unit)[0] is None
        ]  # fmt: skip
        truths.append(truth)
        ratios[name] = error_ratio(truth, predicted)
    return score(tool, truths, given, ratios)
