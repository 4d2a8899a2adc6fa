"""The commands that are Hydra applications: what each is called, what can be chosen, how a person writes it.

A command's name is also that of its primary config in ``conf`` and of its jobs (``hydra.job.name``). Light: a help text
needs nothing else.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from functools import cached_property

from dtbacklash.config.groups import RIGS
from dtbacklash.config.setting import OUTPUT, Declared, Setting, declared

#: mappings with free keys: Hydra wants `++` to add to them, which nobody should have to know
OPEN_PARTS = ("effects", "laws", "parameters", "elements", "sensors")
OPEN_MAPPINGS = tuple(f"{group}.{part}." for group in RIGS for part in OPEN_PARTS)
#: settings of Hydra that are paths, and the word for both
RUN_FOLDER, SWEEP_FOLDER, FOLDER_WORD = "hydra.run.dir", "hydra.sweep.dir", "out"
JOBS_KEY = "hydra.launcher.n_jobs"
VERBOSE = ("-v", "--verbose")


@dataclass(frozen=True)
class Grammar:
    """One command: its ``schema`` as ``module:class``, the ``groups`` of ``conf`` that it takes, and its help.

    in_open_loop : whether the reference is the rig's command unless a controller is chosen.
    """

    name: str
    schema_path: str
    groups: tuple[str, ...]
    summary: str
    about: str
    folder: str
    examples: tuple[str, ...]
    after: str = ""
    in_open_loop: bool = False

    @cached_property
    def schema(self) -> type:
        """The dataclass that its configuration becomes."""
        module, _, name = self.schema_path.partition(":")
        found = getattr(importlib.import_module(module), name)
        assert isinstance(found, type)
        return found

    @cached_property
    def settings(self) -> dict[str, Declared]:
        """Dotted key -> setting."""
        return {one.key: one for one in declared(self.schema)}

    @cached_property
    def words(self) -> dict[str, str]:
        """Short word -> dotted key."""
        return {one.about.word: key for key, one in self.settings.items() if one.about.word}

    @cached_property
    def flags(self) -> dict[str, str]:
        """Option -> the override that it stands for."""
        return {one.about.flag: f"{key}=true" for key, one in self.settings.items() if one.about.flag}

    @cached_property
    def open_mappings(self) -> tuple[str, ...]:
        """Prefixes below which keys are free."""
        own = [f"{key}." for key, one in self.settings.items() if one.is_mapping]
        return (*OPEN_MAPPINGS, *(prefix for prefix in own if prefix not in OPEN_MAPPINGS))

    def path_kind(self, key: str) -> str:
        """Whether the value of ``key`` is a path, and of which kind: see :attr:`.Setting.path`."""
        if key in (RUN_FOLDER, SWEEP_FOLDER):
            return OUTPUT
        return self.settings[key].about.path if key in self.settings else ""

    def known_keys(self) -> list[str]:
        """Everything that may be set, as a person writes it."""
        own = [one.word for one in self.settings.values()]
        return own if self.one_file else [*own, FOLDER_WORD, RUN_FOLDER, SWEEP_FOLDER, JOBS_KEY]

    @property
    def one_file(self) -> bool:
        """Whether ``out=`` is its own setting and names a file: there is no folder, and nothing to sweep."""
        return FOLDER_WORD in self.settings


#: what every command takes beside its own settings
COMMON = {
    "out=FOLDER": Setting("where the results go; short for hydra.run.dir, with -m for hydra.sweep.dir"),
    "hydra.launcher.n_jobs=-1": Setting("jobs of a sweep at a time (-1: one a core)"),
    "-v": Setting("say what it is doing"),
    "--cfg job": Setting("show the configuration, run nothing"),
}

RUN = Grammar(
    "run", "dtbacklash.config.run:RunConfig",
    ("experiment", "rig", "model", "controller", "profile", "reference", "twin", "optimizer", "sensors", "solver"),
    "simulate a controller on a rig while its backlash grows",
    "Simulates a controller on a rig while its backlash grows; writes tables, figures and report.html.",
    "outputs/<date>/<time>_run_<controller>",
    (
        "dtb run controller=nimc_twin",
        "dtb run experiment=fig13",
        "dtb run controller=imc profile=constant profile.start_deg=60 duration_s=40",
        "dtb run rig.effects.motor_bearing.coulomb_friction.torque=0.02 controller.internal_model=inner_loop",
        "dtb run -m controller=imc,nimc_fixed profile=s_curve,step twin.delay_s=0,4",
    ),
)  # fmt: skip
DIAGNOSE = Grammar(
    "diagnose", "dtbacklash.config.commands:DiagnoseConfig", ("rig",),
    "say what physics a recording has and a rig lacks, and where",
    "Compares a recording with the simulation of a rig. Says where they differ, names the physics that the rig lacks,\n"
    "adds it to the rig, and shows on data that it was not fitted to whether the fit improves. Writes report.html,\n"
    "diagnosis.json, figures and rig.yaml, the extended rig (dtb run rig=FILE). Without rig= the rig is that of the\n"
    "recording's mapping, else lead_screw.",
    "outputs/<date>/<time>_diagnose_<recording>",
    (
        "dtb run controller=open_loop reference=multisine recording.save=bench.csv",
        "dtb diagnose recording=bench.csv rig=lead_screw rig.parameters.k.value=9500",
        "dtb diagnose recording=emps",
        "dtb diagnose recording=silverbox validation=silverbox:arrow -v",
        "dtb diagnose recording=[slow.csv,fast.csv] rig=my_rig.yaml",
        "dtb diagnose -m recording=a.csv,b.csv",
    ),
    """\
The verdict is one of
  consistent        what is left over is the sensors' noise
  parameters        parameters of the rig are off; no physics is missing
  missing_physics   effects that the rig lacks, with their place, size and 95 % intervals
  unexplained       more than noise is left, beside what was named, if anything; with the force that it would take
""",
)  # fmt: skip
CONCEAL = Grammar(
    "conceal", "dtbacklash.config.commands:ConcealConfig", ("rig",),
    "make recordings with something hidden in them, and seal the answers",
    "Makes recordings of a rig with something hidden in them, and seals what it is: one or several effects of the\n"
    "catalogue, wrong parameters, physics that the catalogue does not have, or nothing. Kind, place, size,\n"
    "excitation, noise, counts, instruments and duration are drawn from the seed. Another integrator than the\n"
    "diagnosis has makes them, with other formulations where a law is not smooth. The rig: any that dtb diagnose\n"
    "takes. A motor with a gear and a screw moves in the project's loop; any other in open loop, or in a PID loop on\n"
    "the position of the body that is driven, with commands, noise and counts in the rig's own scales.\n"
    "machine=lifelike adds three to ten small things, of the catalogue and outside of it, as a real machine has them.",
    "outputs/<date>/<time>_conceal",
    (
        "dtb conceal out=hidden n=5 seed=7",
        "dtb conceal out=play seed=3 effect=gear.backlash instruments=rich",
        "dtb conceal out=swing n=3 rig=pendulum effect=disk.gravity",
        "dtb conceal out=real n=10 rig=pendulum machine=lifelike",
    ),
    """\
Each recording gets a folder with a name that tells nothing:
  FOLDER/<id>/recording.csv.gz   t s, r mm (V in open loop), u V, and the sensors
  FOLDER/<id>/public.json        the rig and the channels
  FOLDER/<id>/sealed.json        what is hidden, encrypted, with a commitment
  FOLDER.key                     opens the seals: keep it apart from the recordings
""",
)  # fmt: skip
PROVE = Grammar(
    "prove", "dtbacklash.config.prove:ProveConfig", ("rig",),
    "diagnose concealed recordings blind, open their seals, and score",
    "Conceals recordings with something hidden in them (or takes a folder of dtb conceal), diagnoses each without the\n"
    "answer, opens the seals, asks an oracle that knows the true structure, and scores. Started again, it does only\n"
    "what is missing. Writes score.json, score.csv (a row a recording), confusion.csv, table.md, figures, report.html.",
    "outputs/prove_<rig>_<seed>_<n>",
    (
        "dtb prove n=20 seed=10000",
        "dtb prove n=500 seed=10000 jobs=8 out=proof docs=docs",
        "dtb prove rig=two_mass_stage n=20 seed=10000",
        "dtb prove machine=lifelike n=20 seed=10000",
        "dtb prove 'rigs=[lead_screw:500,pendulum:75,oscillator:75]' seed=30000",
        "dtb prove folder=bench backend=dask scheduler=tcp://cluster:8786",
        "dtb prove --quick",
    ),
)  # fmt: skip
PAPER = Grammar(
    "paper", "dtbacklash.config.commands:PaperConfig", (),
    "reproduce the figures and check the claims of the paper",
    "Reproduces the figures of the paper (4, 6, 7, 8, 10, 13, 14) and checks its statements in claims.csv.\n"
    "Exit code 0 if every claim holds, 1 if any fails.",
    "outputs/<date>/<time>_paper",
    ("dtb paper", "dtb paper out=paper"),
)  # fmt: skip

ISOLABILITY = Grammar(
    "isolability", "dtbacklash.config.experiments:IsolabilityConfig", ("rig", "controller", "reference", "sensors"),
    "say what a planned experiment would show, and what it would confuse",
    "Simulates a rig on a planned command, before anything is recorded. Says which effects this motion, these sensors\n"
    "and their noise would show, from which size on (five standard errors), and which pairs they would confuse: the\n"
    "sine of the angle between what the two do to the readings, once the rig's parameters have been fitted within\n"
    "their tolerances. 1 is at right angles; at 0 one stands for the other. Writes isolability.json, effects.csv,\n"
    "matrix.csv, figures/matrix.png and report.html.",
    "outputs/<date>/<time>_isolability_<rig>",
    (
        "dtb isolability rig=mine.yaml command=planned.csv",
        "dtb isolability rig=rotary_drive reference.rms_v=3 sensors.noise.theta_m_rad=0.001 record=[theta_m]",
        "dtb isolability rig=lead_screw controller=imc reference=square sensors=encoder",
    ),
    in_open_loop=True,
)  # fmt: skip

DESIGN = Grammar(
    "design", "dtbacklash.config.experiments:DesignConfig", (),
    "look for the experiment that tells apart what a diagnosis left open",
    "Reads the folder of a diagnosis (dtb design FOLDER, or found=FOLDER) and looks for the command whose recording\n"
    "would tell the models apart that it left open, as large as the limits allow: by a sum of sines, a set of moves,\n"
    "or the best of your own files. Says how far apart they would be, in standard errors. Writes command.csv (t, u)\n"
    "for the machine and for dtb run, design.json, figures/command.png and report.html.",
    "outputs/<date>/<time>_design",
    (
        "dtb design found",
        "dtb design found command_max=5 travel='{carriage: 50 mm}' duration_s=20 out=next",
        "dtb design found commands=[slow.csv,fast.csv]",
        "dtb run rig=found/rig.yaml controller=open_loop reference=csv reference.path=next/command.csv duration_s=8",
    ),
)  # fmt: skip

EXPORT = Grammar(
    "export", "dtbacklash.config.commands:ExportConfig", ("rig",),
    "write a rig as an FMU, for other simulation tools",
    "Writes a rig with its effects as an FMI 2.0 co-simulation slave. Inputs: the command and, where there is a gear,\n"
    "a half-gap beside the rig's own; outputs: the true values of its sensors; parameters: those of the rig and of\n"
    "its effects. Its step is the simulation of dtb run. Where it is imported, it needs Python with the same version\n"
    "of dtbacklash.",
    "RIG.fmu",
    (
        "dtb export fmu rig=lead_screw out=lead_screw.fmu",
        "dtb export fmu rig=found/rig.yaml",
        "dtb export fmu rig.effects.motor_bearing.coulomb_friction.torque=0.02 sample_time_s=0.0005",
    ),
)  # fmt: skip

#: the applications of Hydra: a folder of results, sweeps
GRAMMARS = {one.name: one for one in (RUN, PAPER, DIAGNOSE, ISOLABILITY, DESIGN, PROVE, CONCEAL)}


#: what is composed as these are, and writes one file
FILES = {one.name: one for one in (EXPORT,)}


def grammar_of(schema: type) -> Grammar:
    """The command whose configuration is a ``schema``."""
    return next(one for one in (GRAMMARS | FILES).values() if one.schema is schema)
