"""The schema of ``dtb conceal``."""

from __future__ import annotations

from dataclasses import dataclass, field

from dtbacklash.config.rig import RigConfig
from dtbacklash.config.setting import OUTPUT, check, setting

#: what a recording may hide, and the sensors that it may have
KINDS = ("nothing", "parameters", "single", "several", "unknown")
INSTRUMENTS = ("minimal", "rich")
COUNT_MAX, SEED_MAX = 100_000, 2**53


@dataclass
class ConcealConfig:
    """Recordings to make, each with something hidden in it."""

    rig: RigConfig = field(default_factory=RigConfig)
    n: int = setting(1, "how many recordings, with the seeds from `seed` on", at_least=1, at_most=COUNT_MAX)
    seed: int = setting(
        0, "below 10000 for development; from 10000 on for proofs that count", at_least=0, at_most=SEED_MAX
    )
    kind: str | None = setting(None, "hide this kind of thing, instead of drawing it", choices=KINDS)
    effect: str | None = setting(None, "PLACE.NAME: hide this effect alone, e.g. gear.backlash")
    instruments: str | None = setting(
        None, "minimal: the fewest that will do, those of the loop; rich: every sensor of the rig; null: drawn",
        choices=INSTRUMENTS,
    )  # fmt: skip
    key: str | None = setting(
        None, "file of the key (default: beside the folder, FOLDER.key); one that is there is used again", path=OUTPUT
    )

    def __post_init__(self) -> None:
        check(self)
