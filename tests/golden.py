"""The golden set: recordings by seed, what each hides, and what a diagnosis has to say of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from dtbacklash.diagnose.result import Diagnosis
from dtbacklash.physics.rig import Rig
from dtbacklash.prove.conceal import csv_gz, nominal_rig, recording_table
from dtbacklash.prove.draw import draw, record
from dtbacklash.prove.secret import Secret
from dtbacklash.recording import Recording, read_recording

Key = tuple[str, str]


@dataclass(frozen=True)
class Golden:
    """A recording. kind : what is hidden; or the effect, ``location.effect``. sure : whether its name has to be."""

    rig: str
    seed: int
    kind: str
    machine: str = "clean"
    sure: bool = True

    def __str__(self) -> str:
        return "-".join([self.rig, str(self.seed), self.kind, *([] if self.machine == "clean" else [self.machine])])

    def secret(self) -> Secret:
        """What it hides."""
        kind, effect = ("single", self.kind) if "." in self.kind else (self.kind, None)
        return draw(self.seed, rig_of(self.rig), kind, effect, None, self.machine)


GOLDEN = tuple(
    Golden(rig, seed, kind, machine)
    for rig, seed, kind, machine in [
        ("pendulum", 3001, "nothing", "clean"), ("oscillator", 3002, "nothing", "clean"),
        ("two_mass_stage", 3003, "nothing", "clean"), ("rotary_drive", 3004, "nothing", "clean"),
        ("pendulum", 3005, "parameters", "clean"), ("oscillator", 3006, "parameters", "clean"),
        ("two_mass_stage", 3007, "parameters", "clean"),
        ("pendulum", 3008, "disk.gravity", "clean"), ("pendulum", 3009, "disk.coulomb_friction", "clean"),
        ("pendulum", 3010, "disk.viscous_friction", "clean"), ("pendulum", 3011, "amplifier.dead_zone", "clean"),
        ("pendulum", 3012, "amplifier.saturation", "clean"), ("pendulum", 3013, "disk.asymmetric_friction", "clean"),
        ("oscillator", 3014, "spring.cubic_stiffness", "clean"), ("oscillator", 3015, "spring.quadratic_damping", "clean"),
        ("oscillator", 3016, "spring.backlash", "clean"), ("oscillator", 3017, "mass.ground_friction", "clean"),
        ("two_mass_stage", 3018, "carriage.coulomb_friction", "clean"),
        ("two_mass_stage", 3019, "carriage.stribeck_friction", "clean"), ("two_mass_stage", 3020, "table.absorber", "clean"),
        ("two_mass_stage", 3021, "support.cubic_stiffness", "clean"), ("rotary_drive", 3022, "load.coulomb_friction", "clean"),
        ("pendulum", 3023, "several", "clean"), ("oscillator", 3024, "several", "clean"),
        ("pendulum", 3025, "unknown", "clean"), ("oscillator", 3026, "unknown", "clean"),
        ("two_mass_stage", 3027, "unknown", "clean"),
        ("pendulum", 3028, "disk.gravity", "lifelike"), ("pendulum", 3029, "disk.coulomb_friction", "lifelike"),
        ("oscillator", 3030, "spring.cubic_stiffness", "lifelike"), ("oscillator", 3031, "nothing", "lifelike"),
        ("two_mass_stage", 3032, "carriage.coulomb_friction", "lifelike"), ("pendulum", 3033, "parameters", "lifelike"),
    ]
)  # fmt: skip


@cache
def rig_of(name: str) -> Rig:
    """A nominal rig."""
    return nominal_rig(name)


def recorded(secret: Secret, rig: Rig, folder: Path) -> Recording:
    """The recording of a secret, as its file is read."""
    file = folder / "recording.csv.gz"
    file.write_bytes(csv_gz(recording_table(secret, rig, *record(secret, rig))))
    return read_recording(file, rig=rig)


def said(d: Diagnosis) -> tuple[object, ...]:
    """All that somebody would act on: verdict, names and how sure, what they may be as well, what moved, checks."""
    names = {(f.location, f.effect, f.confidence, tuple((a.location, a.effect) for a in f.also_fits)) for f in d.findings}
    return d.verdict, frozenset(names), frozenset(d.recalibrated), tuple((c.check, c.passed) for c in d.checks)

#: number that decides -> a recording of which it decides what is said, and a factor that changes that
MOVED: dict[str, tuple[Golden, float]] = {}
