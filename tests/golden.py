"""The golden set: recordings by seed, what each hides, and what a diagnosis has to say of it."""

from dataclasses import dataclass
from pathlib import Path

from nominal import nominal_rig

from dtbacklash.diagnosis.result import Diagnosis
from dtbacklash.physics.rig import Rig
from dtbacklash.prove.conceal import csv_gz, recording_table
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
        return draw(self.seed, nominal_rig(self.rig), kind, effect, None, self.machine)


#: of these the law or the place stays open, and the truth is listed
#: (3015: a quadratic damper to the ground and a drag of the mass are one law)
OPEN = {("oscillator", 3015), ("oscillator", 3017), ("two_mass_stage", 3020)}
GOLDEN = tuple(
    Golden(rig, seed, kind, machine, (rig, seed) not in OPEN)
    for machine, of_machine in {
        "clean": {
            "pendulum": {
                3001: "nothing", 3041: "parameters", 3008: "disk.gravity", 3009: "disk.coulomb_friction",
                3010: "disk.viscous_friction", 3011: "amplifier.dead_zone", 3012: "amplifier.saturation",
                3013: "disk.asymmetric_friction", 3023: "several", 3025: "unknown",
            },
            "oscillator": {
                3002: "nothing", 3006: "parameters", 3014: "spring.cubic_stiffness", 3015: "spring.quadratic_damping",
                3016: "spring.backlash", 3017: "mass.ground_friction", 3024: "several",
            },
            "two_mass_stage": {
                3003: "nothing", 3007: "parameters", 3018: "carriage.coulomb_friction", 3020: "table.absorber",
                3027: "unknown",
            },
            "rotary_drive": {3004: "nothing", 3022: "load.coulomb_friction"},
        },
        "lifelike": {
            "pendulum": {3028: "disk.gravity", 3029: "disk.coulomb_friction"},
            "oscillator": {3030: "spring.cubic_stiffness"},
        },
    }.items()
    for rig, seeds in of_machine.items()
    for seed, kind in seeds.items()
)  # fmt: skip


def recorded(secret: Secret, rig: Rig, folder: Path) -> Recording:
    """The recording of a secret, as its file is read."""
    file = folder / "recording.csv.gz"
    file.write_bytes(csv_gz(recording_table(secret, rig, *record(secret, rig))))
    return read_recording(file, rig=rig)


def said(d: Diagnosis) -> tuple[object, ...]:
    """All that somebody would act on: verdict, names and how sure, what they may be as well, what moved, checks."""
    names = {
        (f.location, f.effect, f.confidence, tuple((a.location, a.effect) for a in f.also_fits)) for f in d.findings
    }
    modelled = d.modelled and (
        d.modelled.location,
        d.modelled.state,
        tuple(f.law for f in d.modelled.formulas if f.chosen),
    )
    return (
        d.verdict,
        frozenset(names),
        frozenset(d.recalibrated),
        tuple((c.check, c.passed) for c in d.checks),
        modelled,
    )


#: number that decides -> a recording of which it decides what is said, and a factor that changes that
MOVED = {
    "held_out_share": (Golden("pendulum", 3010, "disk.viscous_friction"), 0.1),
    "min_gain": (Golden("oscillator", 3030, "spring.cubic_stiffness", "lifelike"), 1e4),
    "min_gain_if_clearing": (Golden("pendulum", 3010, "disk.viscous_friction"), 1e4),
    "clearing_ratio": (Golden("oscillator", 3030, "spring.cubic_stiffness", "lifelike"), 1e-4),
    "unexplained_attention": (Golden("oscillator", 3030, "spring.cubic_stiffness", "lifelike"), 1e3),
    "max_unexplained": (Golden("oscillator", 3030, "spring.cubic_stiffness", "lifelike"), 1e-4),
    "min_t": (Golden("oscillator", 3014, "spring.cubic_stiffness"), 10.0),
    "min_shift": (Golden("oscillator", 3006, "parameters"), 10.0),
}
