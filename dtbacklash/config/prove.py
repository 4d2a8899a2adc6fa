"""The schema of ``dtb prove``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dtbacklash.config.commands import COUNT_MAX, JOBS_MAX, MACHINES, SEED_MAX
from dtbacklash.config.rig import RigConfig
from dtbacklash.config.setting import INPUT, OUTPUT, check, setting
from dtbacklash.errors import UserError

BACKENDS = ("loky", "dask")
COUNT, SEED = 500, 10_000
QUICK = (6, 20)  # recordings of a quick proof


@dataclass
class ProveConfig:
    """Recordings to conceal and to diagnose blind, or a folder of such; and who does the work."""

    rig: RigConfig = field(default_factory=RigConfig)
    rigs: list[str] = setting(
        list, "several rigs instead of one: [NAME, NAME:COUNT, ...], COUNT recordings of it instead of n", shown="[]"
    )
    n: int = setting(COUNT, "recordings of each rig", at_least=1, at_most=COUNT_MAX)
    seed: int = setting(
        SEED, "seed of the first; scoring seeds begin at 10000, the tool is tuned on those below", at_least=0,
        at_most=SEED_MAX,
    )  # fmt: skip
    machine: str = setting(
        MACHINES[0], "lifelike: small things beside what is hidden, as dtb conceal machine=lifelike makes them",
        choices=MACHINES,
    )  # fmt: skip
    folder: str | None = setting(None, "recordings that dtb conceal made, instead of n and seed", path=INPUT)
    key: str | None = setting(None, "what opens their seals (default: FOLDER.key)", path=INPUT)
    jobs: int = setting(2, "recordings at once", at_least=1, at_most=JOBS_MAX)
    backend: str = setting("loky", "loky: the cores of this machine; dask: a Dask cluster", choices=BACKENDS)
    scheduler: str | None = setting(
        None, "ADDRESS of a Dask scheduler that runs already (default: one is started here)", path=INPUT
    )
    docs: str | None = setting(None, "folder: also bring the score into FOLDER/proof.md, with its figures", path=OUTPUT)
    known: str | None = setting(
        None, "FILE of cases that the same code has finished (docs=FOLDER writes FOLDER/proof/cases.json.gz); they "
        "are not done again", path=INPUT,
    )  # fmt: skip
    quick: bool = setting(
        False,
        "a fixed set of 20 scoring seeds, or with n=6 of 6; exit code 1 if the score is below what was reached",
        flag="--quick",
    )

    def __post_init__(self) -> None:
        check(self)
        chosen: dict[str, tuple[object, object]] = {
            "n": (self.n, COUNT), "seed": (self.seed, SEED), "folder": (self.folder, None), "key": (self.key, None),
            "docs": (self.docs, None), "rigs": (self.rigs, []), "known": (self.known, None),
            "machine": (self.machine, MACHINES[0]),
        }  # fmt: skip
        for key, (value, default) in chosen.items():
            if value == default:
                continue
            if self.quick and not (key == "n" and value in QUICK):
                raise UserError(key, value, "does not go with --quick")
            if self.folder is not None and key in ("n", "seed", "rigs", "known", "machine"):
                raise UserError(key, value, "does not go with folder")
        if self.key is not None and self.folder is None:
            raise UserError("key", self.key, "belongs to folder=FOLDER")
        self.counts()

    def quick_count(self) -> int:
        """How many recordings a quick proof has."""
        return self.n if self.n in QUICK else QUICK[-1]

    def counts(self) -> dict[str, int]:
        """How many recordings of each of several rigs.

        Raises
        ------
        UserError : a count that is none, a rig that is named twice.
        """
        found: dict[str, int] = {}
        for word in self.rigs:
            name, _, count = word.partition(":")
            if name in found:
                raise UserError("rigs", word, "names a rig twice")
            if count and not (count.isascii() and count.isdigit() and 1 <= int(count) <= COUNT_MAX):
                raise UserError("rigs", word, f"write NAME or NAME:COUNT, COUNT from 1 to {COUNT_MAX}")
            found[name] = int(count) if count else self.n
        return found


def folder_name(
    quick: bool, folder: str | None, rig: str, seed: int, n: int, rigs: Sequence[str] = (), machine: str = MACHINES[0]
) -> str:
    """The folder of a proof, unless the user names one: the same proof finds its folder again."""
    prove = "prove" if machine == MACHINES[0] else f"prove_{machine}"
    if folder is not None:
        return f"prove_{Path(folder).name}"
    if rigs:
        names = "_".join(Path(word.partition(":")[0]).stem for word in rigs)
        return f"{prove}_{names}_{seed}"
    few = f"_{n}" if n == QUICK[0] else ""
    return f"prove_quick_{rig}{few}" if quick else f"{prove}_{rig}_{seed}_{n}"
