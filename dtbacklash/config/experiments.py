"""The schemas of ``dtb isolability`` and ``dtb design``: experiments before they are made."""

from __future__ import annotations

from dataclasses import dataclass, field

from dtbacklash.config.rig import RigConfig
from dtbacklash.config.run import SEED_MAX, ControllerConfig, ReferenceConfig, SensorsConfig
from dtbacklash.config.setting import INPUT, check, setting
from dtbacklash.errors import UserError


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
        "(default: `much` of the settings of the diagnosis, 0.01)", above=0, at_most=1,
    )  # fmt: skip
    duration_s: float = setting(20.0, "length of the experiment; of a file, its own", above=0)
    sample_time_s: float = setting(0.001, "sample time of the recording; of a file, its own", above=0)
    seed: int = setting(0, "seed of the noise and of a random reference", at_least=0, at_most=SEED_MAX)

    def __post_init__(self) -> None:
        check(self)
        for name in self.record:
            if name not in self.rig.sensors:
                raise UserError("record", name, f"no such sensor; choose of {', '.join(self.rig.sensors)}")
        if self.command is not None and self.controller.structure != "open_loop":
            raise UserError("command", self.command, "is the rig's input; it goes with controller=open_loop alone")


TRIES_MAX = 100_000


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
    seed: int = setting(0, "seed of the search", at_least=0, at_most=SEED_MAX)

    def __post_init__(self) -> None:
        check(self)
        if not self.found:
            raise UserError("found", "(missing)", "give the folder of a diagnosis: dtb design FOLDER")
