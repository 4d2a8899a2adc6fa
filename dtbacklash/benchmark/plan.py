"""The cases of the benchmark: which machines, kinds and seeds. A published seed has been used for nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from operator import ne

import numpy as np

from dtbacklash.prove.seal import keyed_hash

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
#: a smaller benchmark takes the kinds in turn
TURNS = ("single", "nothing", "change", "parameters", "unlisted", "several")
#: bytes of a seed that follows from a key
SEED_BYTES = 16


@dataclass(frozen=True)
class CasePlan:
    """One case to make: its number, seed, machine, what kind of thing it hides, and for which split it is."""

    number: str
    seed: int
    machine: str
    kind: str
    lifelike: bool
    split: str


def plan_cases(seed: int = SEED, per_machine: int | None = None, key: bytes = b"") -> list[CasePlan]:
    """The concealed cases of a benchmark by their numbers; the order tells nothing of what is hidden.

    per_machine : so many cases of each machine, for a smaller benchmark. None: all 24.
    key : that of the seals. The cases of any seed but the published one follow from it as well: who lacks the key
    cannot find them by trying seeds.
    """
    kinds = [
        (kind, lifelike, "development" if j < open_ones else "scored")
        for kind, lifelike, many, open_ones in COUNTS for j in range(many)
    ]  # fmt: skip
    if per_machine is not None:
        kinds = [kinds[j] for j in _take_in_turn(kinds, per_machine)]
    every = [(machine, *kind) for machine in MACHINES for kind in kinds]
    start = seed if seed == SEED else _seed_from_key(seed, "order", key)
    order = np.random.default_rng([start, len(every)]).permutation(len(every))
    seeds = [seed + n if seed == SEED else _seed_from_key(seed, n, key) for n in range(len(every))]
    return [CasePlan(f"{n + 1:03d}", seeds[n], *every[j]) for n, j in enumerate(order)]


def commitment(seed: int, cases: int, key: bytes) -> str:
    """A keyed hash of seed and size, hexadecimal; tells nothing without the key."""
    return keyed_hash(key, f"benchmark {seed} {cases}").hex()


def _seed_from_key(seed: int, what: int | str, key: bytes) -> int:
    return int.from_bytes(keyed_hash(key, f"seed {seed} {what}")[:SEED_BYTES], "big")


def _take_in_turn(kinds: list[tuple[str, bool, str]], many: int) -> list[int]:
    """The indexes of ``many`` of a machine's cases: its kinds, both splits, clean and lifelike ones in turn."""
    left, taken, turn = list(range(len(kinds))), list[int](), 0
    while left and len(taken) < many:
        lap, i = divmod(turn, len(TURNS))
        wanted = bool(lap % 2), ("scored", "development")[(i + lap) % 2]
        if of_kind := [j for j in left if kinds[j][0] == TURNS[i]]:
            best = min(of_kind, key=lambda j: sum(map(ne, kinds[j][1:], wanted)))
            left.remove(best)
            taken.append(best)
        turn += 1
    return sorted(taken)
