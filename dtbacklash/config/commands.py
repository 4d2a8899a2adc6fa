"""The schemas of all commands but ``dtb run`` and ``twin``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dtbacklash.config.choices import COMMANDS, SEARCHES
from dtbacklash.config.groups import recordings
from dtbacklash.config.rig import RigConfig
from dtbacklash.config.run import SEED_MAX as RUN_SEED_MAX
from dtbacklash.config.run import ControllerConfig, ReferenceConfig, SensorsConfig
from dtbacklash.config.setting import INPUT, OUTPUT, check, number, setting
from dtbacklash.errors import UserError

JOBS_MAX = 256
#: what a recording may hide, and the sensors that it may have
KINDS = ("nothing", "parameters", "single", "several", "unknown")
INSTRUMENTS = ("minimal", "rich")
#: what there is beside that: nothing, or what a real machine has besides
MACHINES = ("clean", "lifelike")
COUNT_MAX, TRIES_MAX, SEED_MAX = 100_000, 100_000, 2**53
BACKENDS = ("loky", "dask")
COUNT, SEED = 500, 10_000
QUICK = (6, 20)  # recordings of a quick proof


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
    compare: str | None = setting(
        None, "change: what changed in a machine from the first of two recordings to the second, whatever else the rig "
        "lacks", word="compare", choices=("change",),
    )  # fmt: skip
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
    given: Any = setting(
        None, "what is known to differ between recordings, e.g. given={b: {carriage.mass: 3.2 kg}}", word="given"
    )
    search: str = setting(
        "full",
        "how much is looked for: everything; quick: what is large; none: the rig is calibrated as it is",
        choices=tuple(SEARCHES),
    )
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
    fmi: int = setting(2, "version of FMI", at_least=2, at_most=3)
    substeps: int = setting(0, "steps a sample; 0: 1 where that is exact, else 8", at_least=0, at_most=10_000)
    event_levels: int = setting(16, "a contact is located to sample_time_s / substeps / 2^this", at_least=0, at_most=30)

    def __post_init__(self) -> None:
        number("sample_time_s", self.sample_time_s, above=0, unit="s")
        check(self)


@dataclass
class PaperConfig:
    """Nothing to choose but the folder."""


@dataclass
class IsolabilityConfig:
    """A planned experiment on a rig."""

    rig: RigConfig = field(default_factory=RigConfig)
    controller: ControllerConfig = field(
        default_factory=lambda: ControllerConfig(name="open_loop", structure="open_loop", reconfigure="never")
    )
    reference: ReferenceConfig = field(default_factory=lambda: ReferenceConfig(kind="multisine"))
    sensors: SensorsConfig = field(default_factory=SensorsConfig)
    command: str | None = setting(
        None, "FILE: CSV of the planned command with the columns t [s] and u, as in a recording; null: the reference",
        path=INPUT,
    )  # fmt: skip
    record: list[str] = setting(list, "the sensors that are to be recorded (default: all of the rig)", shown="[]")
    unknown: float | None = setting(
        None, "unknown force at each body, as a share of the force that moves it: what no model of a machine explains "
        "(default: `unexplained_attention` of the settings of the diagnosis, 0.01)", above=0, at_most=1,
    )  # fmt: skip
    duration_s: float = setting(20.0, "length of the experiment; of a file, its own", above=0)
    sample_time_s: float = setting(0.001, "sample time of the recording; of a file, its own", above=0)
    seed: int = setting(0, "seed of the noise and of a random reference", at_least=0, at_most=RUN_SEED_MAX)

    def __post_init__(self) -> None:
        check(self)
        for name in self.record:
            if name not in self.rig.sensors:
                raise UserError("record", name, f"no such sensor; choose of {', '.join(self.rig.sensors)}")
        if self.command is not None and self.controller.structure != "open_loop":
            raise UserError("command", self.command, "is the rig's input; it goes with controller=open_loop alone")


@dataclass
class DesignConfig:
    """The experiment that tells apart what a diagnosis left open."""

    found: str | None = setting(
        None, "FOLDER: of the diagnosis, as dtb diagnose out=FOLDER writes it", path=INPUT, shown="FOLDER"
    )
    commands: list[str] = setting(
        list, "CSV files with the columns t [s] and u to choose from, instead of looking for one", shown="[]"
    )
    command_max: float | None = setting(
        None, "largest absolute command, in the unit of the rig's command (default: as recorded)", above=0
    )
    travel: dict[str, str] = setting(
        dict, "body -> how far it may go from where it begins, e.g. travel={carriage: 50 mm} (default: as recorded)",
        word="travel",
    )  # fmt: skip
    speed: dict[str, str] = setting(
        dict, "body -> how fast it may be, e.g. speed={carriage: 0.2 m/s} (default: as recorded)", word="speed"
    )
    duration_s: float | None = setting(
        None, "length of the experiment (default: of the longest recording, at most 10 s)", above=0
    )
    tries: int = setting(40, "commands that are tried", at_least=2, at_most=TRIES_MAX)
    seed: int = setting(0, "seed of the search", at_least=0, at_most=RUN_SEED_MAX)

    def __post_init__(self) -> None:
        check(self)
        if not self.found:
            raise UserError("found", "(missing)", "give the folder of a diagnosis: dtb design FOLDER")


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

        Raises UserError: a count that is none, a rig that is named twice.
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
