"""The cases of the benchmark: which machines, kinds and seeds. A seed here has been used for nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

VERSION = "1.0"
#: the first seed of the published benchmark
SEED = 971_000
MACHINES = ("lead_screw", "two_mass_stage", "rotary_drive", "pendulum", "oscillator")
#: of each machine: (kind, lifelike, how many, how many of these are for development)
COUNTS = (
    ("nothing", False, 2, 1), ("parameters", False, 2, 1), ("single", False, 5, 1), ("several", False, 2, 0),
    ("unlisted", False, 2, 1), ("change", False, 2, 1),
    ("nothing", True, 1, 0), ("parameters", True, 1, 0), ("single", True, 4, 1), ("several", True, 1, 0),
    ("unlisted", True, 1, 0), ("change", True, 1, 0),
)  # fmt: skip


@dataclass(frozen=True)
class Planned:
    """One case to make: its number, seed, machine, what kind of thing it hides, and for which split it is."""

    number: str
    seed: int
    machine: str
    kind: str
    lifelike: bool
    split: str


def planned(seed: int = SEED, per_machine: int | None = None) -> list[Planned]:
    """The concealed cases of a benchmark by their numbers; the order tells nothing of what is hidden.

    per_machine : only the first so many of each machine's list, for a smaller benchmark. None: all 24.
    """
    kinds = [
        (kind, lifelike, "development" if j < open_ones else "scored")
        for kind, lifelike, count, open_ones in COUNTS for j in range(count)
    ][:per_machine]  # fmt: skip
    every = [(machine, *kind) for machine in MACHINES for kind in kinds]
    order = np.random.default_rng([seed, len(every)]).permutation(len(every))
    return [
        Planned(f"{n + 1:03d}", seed + n, machine, kind, lifelike, split)
        for n, (machine, kind, lifelike, split) in enumerate(every[j] for j in order)
    ]
