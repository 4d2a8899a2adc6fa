"""The groups of ``conf`` and their options. Reads the folders itself, so that a help text needs no Hydra."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from string import Template

LAUNCHER, LAUNCHER_NAMES = "hydra/launcher", ["joblib", "basic", "submitit_local", "submitit_slurm"]
#: group -> what is chosen by it
GROUPS = {
    "experiment": "a whole scenario, e.g. a figure of the paper",
    "rig": "the machine; also the path of a YAML file",
    "model": "what controller and twin believe of the rig, a rig as well; null: its own parameters, without effects",
    "controller": "the controller",
    "profile": "the gap over time",
    "reference": "the reference over time",
    "twin": "the digital twin and its link",
    "optimizer": "the twin's search for the gap",
    "sensors": "noise and quantisation",
    "solver": "accuracy of the simulation",
    LAUNCHER: "who runs the jobs of a sweep",
}
#: groups whose options are those of another one
FOLDERS = {"model": "rig"}
#: groups whose options are names of rigs, or paths of YAML files
RIGS = ("rig", "model")
LAUNCHERS = ", ".join(LAUNCHER_NAMES) + " (submitit: an extra)"
PACKAGED = Path(__file__).parents[1] / "conf"
SUFFIXES = (".yaml", ".yml")
#: rigs to begin with, by what the machine is: files that a user changes, beside this one
MACHINES = ("screw", "belt", "stage", "drive", "servo", "pendulum", "oscillator")
NO_RECORDING = "none"  # the option of `dtb run` that says where nothing is saved


def options(group: str) -> list[str]:
    """The options of a folder of ``conf``, packaged and of a ``conf`` folder here, sorted as people count."""
    folder = FOLDERS.get(group, group)
    mine = Path("conf") / folder
    return _names([PACKAGED / folder, *([mine] if mine.is_dir() else [])])


def has_own() -> bool:
    """True if the ``conf`` folder here is a user's; that of the repository is a link to the package's."""
    return Path("conf").is_dir() and not PACKAGED.samefile("conf")


def packaged_options(group: str) -> list[str]:
    """The options of a group of its own that come with the package, sorted as people count."""
    if group in FOLDERS:
        return []
    return _names([PACKAGED / group])


def recordings() -> list[str]:
    """The recordings that have a mapping, packaged or of a ``conf`` folder here."""
    return [name for name in options("recording") if name != NO_RECORDING]


def _names(folders: list[Path]) -> list[str]:
    names = {entry.stem for folder in folders for entry in folder.iterdir() if entry.suffix in SUFFIXES}
    return sorted((name for name in names if not name.startswith(("_", "."))), key=_numbers_last)


def _numbers_last(name: str) -> tuple[str, int]:
    """Sort fig4 before fig10."""
    stem = name.rstrip("0123456789")
    return stem, int(name[len(stem) :] or 0)


def new_rig(machine: str, name: str, file: str) -> str:
    """The YAML text of a rig to begin with; its first line says what the machine is."""
    found = Path(__file__).with_name("machines") / f"{machine}.yaml"
    return Template(found.read_text(encoding="utf-8")).substitute(name=json.dumps(name), file=shlex.quote(file))
