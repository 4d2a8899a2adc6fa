"""The schema of ``dtb diagnose``."""

from __future__ import annotations

from dataclasses import dataclass, field

from dtbacklash.config.groups import recordings
from dtbacklash.config.rig import RigConfig
from dtbacklash.config.setting import INPUT, check, setting
from dtbacklash.errors import UserError

JOBS_MAX = 256


@dataclass
class RecordingInConfig:
    """The recording: what to read, and in which units."""

    source: str | None = setting(
        None,
        "FILE: CSV, Parquet, .mat, .npz, also gzip, with the columns t, u and the rig's sensors; or NAME[:PART]: a "
        "recording that has a mapping (`dtb recordings` lists them, conf/recording adds to them)",
        word="recording", path=INPUT, shown="FILE",
    )  # fmt: skip
    path: str | None = setting(
        None, "where the file of a mapping is, if it is not in $DTB_RECORDINGS or fetched", path=INPUT
    )
    units: dict[str, str] = setting(
        dict, "units of columns whose file does not say them, e.g. units={q3: mm, theta_m: deg}", word="units"
    )
    trust_units: bool = setting(False, "true: take the units as given, without asking whether they are plausible")


@dataclass
class DiagnoseConfig:
    """One recording, compared with one rig."""

    rig: RigConfig = field(default_factory=RigConfig)
    recording: RecordingInConfig = field(default_factory=RecordingInConfig)
    validation: str | None = setting(
        None,
        "FILE or NAME[:PART]: the recording to choose and to judge on (default: 40 % of the recording; 25 % choose "
        "the structure, the last 15 % judge it)",
        path=INPUT,
    )
    jobs: int | None = setting(
        None, "threads that share the work (default: one for each core)", at_least=1, at_most=JOBS_MAX
    )

    def __post_init__(self) -> None:
        check(self)
        if not self.recording.source:
            raise UserError("recording", "(missing)", "give a file or one of " + ", ".join(recordings()))
