"""The schema of ``dtb export fmu``."""

from __future__ import annotations

from dataclasses import dataclass, field

from dtbacklash.config.rig import RigConfig
from dtbacklash.config.setting import OUTPUT, check, number, setting


@dataclass
class ExportConfig:
    """A rig for other simulation tools."""

    rig: RigConfig = field(default_factory=RigConfig)
    out: str | None = setting(None, "the file, NAME.fmu; null: the rig's name, here", path=OUTPUT)
    sample_time_s: float = setting(
        0.001, "sample time of its simulation; communication steps are multiples of it", above=0, at_most=1
    )
    substeps: int = setting(0, "steps a sample; 0: 1 where that is exact, else 8", at_least=0, at_most=10_000)
    event_levels: int = setting(16, "a contact is located to sample_time_s / substeps / 2^this", at_least=0, at_most=30)

    def __post_init__(self) -> None:
        number("sample_time_s", self.sample_time_s, above=0, unit="s")
        check(self)
