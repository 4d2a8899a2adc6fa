"""The schemas of ``dtb diagnose``, ``conceal``, ``export fmu`` and ``paper``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from dtbacklash.config.choices import COMMANDS, SEARCHES
from dtbacklash.config.groups import recordings
from dtbacklash.config.rig import RigConfig
from dtbacklash.config.setting import INPUT, OUTPUT, check, number, setting
from dtbacklash.errors import UserError

JOBS_MAX = 256
#: what a recording may hide, and the sensors that it may have
KINDS = ("nothing", "parameters", "single", "several", "unknown")
INSTRUMENTS = ("minimal", "rich")
#: what there is beside that: nothing, or what a real machine has besides
MACHINES = ("clean", "lifelike")
COUNT_MAX, SEED_MAX = 100_000, 2**53


@dataclass
class RecordingInConfig:
    """The recording: what to read, and in which units."""

    source: str | None = setting(
        None,
        "FILE: CSV, Parquet, .mat, .npz, also gzip, with the columns t, u and the rig's sensors; or NAME[:PART]: a "
        "recording that has a mapping (`dtb recordings` lists them, conf/recording adds to them); several together: "
        "[a.csv,b.csv] or a pattern, 'data/*.csv'",
        word="recording", path=INPUT, shown="FILE",
    )  # fmt: skip
    path: str | None = setting(
        None, "where the file of a mapping is, if it is not in $DTB_RECORDINGS or fetched", path=INPUT
    )
    units: dict[str, str] = setting(
        dict, "units of columns whose file does not say them, e.g. units={q3: mm, theta_m: deg}", word="units"
    )
    sample_time_s: float | None = setting(None, "time between two samples of a file without times", above=0)
    rows: list[int] | None = setting(None, "which of its rows: [first, after the last], from 0 (default: all)")
    trust_units: bool = setting(False, "true: take the units as given, without asking whether they are plausible")
    command: str | None = setting(
        None, "what the command does between two samples (default: as the mapping says, else held); none: nothing was "
        "commanded, and a column u is not needed", choices=tuple(COMMANDS),
    )  # fmt: skip


@dataclass
class DiagnoseConfig:
    """One recording, or several together, compared with one rig."""

    rig: RigConfig = field(default_factory=RigConfig)
    recording: RecordingInConfig = field(default_factory=RecordingInConfig)
    validation: str | None = setting(
        None,
        "FILE or NAME[:PART]: the recording to judge on (default: the last 20 % of each recording); of several "
        "recordings, the number (from 1) or name of one",
        path=INPUT,
    )
    hold_out: str | None = setting(
        None,
        "which of several recordings judges: turns: each in turn (default from three on); ends: the last 20 % of each; "
        "or the name or number (from 1) of one",
        word="hold_out",
    )
    enough: dict[str, str] = setting(
        dict, "what is good enough, per channel, e.g. enough={x2: 0.05 mm} or a share of its motion (2 %): such a rest "
        "is accepted", word="enough"
    )  # fmt: skip
    own: Any = setting(
        None,
        "of several recordings, the parameters and effects that are free in each, own=[carriage.mass], or in one, "
        "own={b: [carriage.mass]}",
        word="own",
    )
    given: dict[str, Any] = setting(
        dict, "what is known to differ between recordings, e.g. given={b: {carriage.mass: 3.2 kg}}", word="given"
    )
    search: str = setting(
        "full",
        "how much is looked for: everything; quick: what is large; none: the rig is calibrated as it is",
        choices=tuple(SEARCHES),
    )
    keep: str | None = setting(
        None, "partial: Ctrl-C writes what is known so far, marked as stopped early; a second one ends it",
        choices=("partial",),
    )  # fmt: skip
    jobs: int | None = setting(
        None, "threads that share the work (default: one for each core)", at_least=1, at_most=JOBS_MAX
    )

    def __post_init__(self) -> None:
        check(self)
        if not self.recording.source:
            raise UserError("recording", "(missing)", "give a file or one of " + ", ".join(recordings()))


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
        None, "minimal: only the sensors that the loop needs; rich: every sensor of the rig; null: drawn",
        choices=INSTRUMENTS,
    )  # fmt: skip
    machine: str = setting(
        MACHINES[0], "lifelike: three to ten small things beside what is hidden, of the catalogue and outside of it",
        choices=MACHINES,
    )  # fmt: skip
    key: str | None = setting(
        None, "file of the key (default: beside the folder, FOLDER.key); an existing key is used again", path=OUTPUT
    )

    def __post_init__(self) -> None:
        check(self)


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


@dataclass
class PaperConfig:
    """Nothing to choose but the folder."""
