"""The settings of the parts of ``dtb benchmark``, read as those of ``dtb twin``: Hydra does not compose them."""

from __future__ import annotations

from dataclasses import dataclass

from dtbacklash.config.commands import JOBS_MAX, SEED_MAX
from dtbacklash.config.setting import INPUT, OUTPUT, check, setting
from dtbacklash.config.twin import Part

SPLITS = ("all", "development", "scored", "real")


@dataclass
class MakeConfig:
    """A benchmark to write."""

    out: str = setting("bench", "the folder; what is there of the same benchmark is kept", path=OUTPUT)
    key: str | None = setting(None, "file of the key (default: FOLDER.key, beside the folder)", path=OUTPUT)
    seed: int = setting(
        971_000, "the published benchmark; with any other number, the cases follow from it and the key",
        at_least=0, at_most=SEED_MAX,
    )  # fmt: skip
    per_machine: int | None = setting(
        None, "concealed cases of each machine, for a smaller one (default: all 24)", at_least=1, at_most=24
    )
    jobs: int = setting(2, "processes that share the work", at_least=1, at_most=JOBS_MAX)

    def __post_init__(self) -> None:
        check(self)


@dataclass
class ScoreConfig:
    """Answers to score."""

    key: str | None = setting(None, "file of the key; needed for cases whose answers are sealed", path=INPUT)
    out: str | None = setting(None, "folder of the score (default: outputs/<date>/<time>_score_<answers>)", path=OUTPUT)
    split: str = setting("scored", "which cases count; the answers of the others are open", choices=SPLITS)
    tool: str | None = setting(None, "name of the tool (default: that of the folder of its answers)")

    def __post_init__(self) -> None:
        check(self)


PARTS = {
    "make": Part(
        MakeConfig, "write a benchmark: cases with sealed answers, and all that it takes to enter\n"
        "Writes README.md, machines, cases, the vocabulary and hashes. It needs about six minutes on two free cores.\n"
        "Started again, it does only what is missing."
    ),
    "score": Part(
        ScoreConfig, "score a tool's answers: dtb benchmark score ANSWERS BENCH [key=value ...]\n"
        "ANSWERS holds answers.csv and predictions NNN.csv. Writes score.csv, reliability.csv and report.html."
    ),
}  # fmt: skip
