"""Rigs in and out: by name, from a file, from a mapping."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import yaml

from dtbacklash import yaml_files
from dtbacklash.config.compose import compose
from dtbacklash.config.groups import SUFFIXES, options
from dtbacklash.config.rig import RigConfig, of_the_model
from dtbacklash.config.run import RunConfig
from dtbacklash.errors import UserError
from dtbacklash.files import reason, written
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.rig_file import plain_numbers, rig_yaml

#: a checked rig, the name of one in ``conf/rig``, a YAML file, or what such a file holds
RigLike: TypeAlias = "Rig | str | Path | Mapping[str, Any]"

#: the file beside results in which they leave their rig, where it is none that has a name
FILE = "rig.yaml"


def load_rig(rig: RigLike, *changes: str) -> Rig:
    """Load and check a rig.

    Parameters
    ----------
    rig : a name (``"lead_screw"``), the path of a YAML file, or a mapping with what such a file holds; SI.
    changes : as on the command line, e.g. ``"rig.parameters.k.value=9000"`` or
        ``"rig.effects.motor_bearing.coulomb_friction.torque=0.02"``.

    Raises
    ------
    UserError : no such rig, or a mistake in it; the error names the key, the value and what is allowed.

    Examples
    --------
    >>> import dtbacklash as dtb
    >>> rig = dtb.load_rig("pendulum", "rig.effects.disk.coulomb_friction.torque=0.02")
    >>> list(rig.sensors), list(rig.effects["disk"])
    (['theta', 'omega'], ['coulomb_friction'])
    """
    for word in changes:
        if not isinstance(word, str) or not word.lstrip("+").startswith("rig."):
            raise UserError("argument", word, "write rig.KEY=VALUE")
    if isinstance(rig, Rig) and not changes:
        return rig
    return build_rig(composed(["controller=open_loop", *changes], rig).rig)


def save_rig(rig: Rig, path: str | Path) -> Path:
    """Write a rig as a YAML file, which ``rig=FILE`` and :func:`load_rig` take; returns its path.

    Raises
    ------
    UserError : the file cannot be written, or its name is not that of a YAML file.

    Examples
    --------
    >>> import dtbacklash as dtb
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     file = dtb.save_rig(dtb.load_rig("pendulum"), f"{folder}/mine.yaml")
    ...     dtb.load_rig(file).config.name
    'pendulum'
    """
    if not isinstance(path, (str, Path)):
        raise UserError("path", path, "must be the path of a YAML file")
    target = Path(path).expanduser()
    if target.suffix not in SUFFIXES:
        raise UserError("path", path, f"must end in {' or '.join(SUFFIXES)}")
    with written(target.absolute(), "path", path, parents=False) as scratch:
        scratch.write_text(rig_yaml(rig), encoding="utf-8")
    return target


def called(rig: RigConfig) -> str | None:
    """Return the option of ``rig=`` that equals this rig; None if there is none."""
    if rig.name in options("rig") and compose("controller=open_loop", f"rig={rig.name}").rig == rig:
        return rig.name
    return None


def composed(words: list[str], rig: RigLike | None, model: RigLike | None = None) -> RunConfig:
    """Compose the configuration of ``dtb run`` with these words, on this rig (None: that of the words or the default).

    model : the rig that controller and twin believe in.

    Raises
    ------
    UserError : a word or the rig is wrong; a rig is given twice; a folder, which is for :meth:`Run.save`.
    """
    for word in words:
        if not isinstance(word, str):
            raise UserError("argument", word, "must be text, KEY=VALUE; of a list of words write run(*words)")
        key, _, value = word.partition("=")
        if key in ("out", "hydra.run.dir"):
            raise UserError(key, value, "a run from Python writes nothing by itself; call save(folder) on its result")
    contents: dict[str, Mapping[str, Any]] = {}
    for group, given in (("rig", rig), ("model", model)):
        if given is None:
            continue
        twice = next((word for word in words if word.partition("=")[0] == group), None)
        if twice is not None:
            raise UserError(group, twice.partition("=")[2], f"is given twice: as a word and as {group}=")
        try:
            if isinstance(given, (str, Path)) and not _is_file(given):
                words = [f"{group}={given}", *words]
            else:
                contents[group] = description(given)
        except UserError as mistake:
            raise of_the_model(mistake) if group == "model" else mistake from mistake
    return compose(*words, rig=contents.get("rig"), model=contents.get("model"))


def description(rig: RigLike) -> Mapping[str, Any]:
    """Return the content of the YAML file of a rig: plain numbers, texts, lists and mappings.

    Raises
    ------
    UserError : the file cannot be read, or holds no mapping; the rig is of another kind.
    """
    if isinstance(rig, Rig):
        found: Any = yaml.safe_load(rig_yaml(rig))
    elif isinstance(rig, RigConfig):
        found = yaml.safe_load(rig_yaml(build_rig(rig)))
    elif isinstance(rig, Mapping):
        found = _from_mapping(rig)
    elif isinstance(rig, (str, Path)):
        found = _from_file(Path(rig).expanduser())
    else:
        raise UserError("rig", rig, "must be a rig, a name, the path of a YAML file or a mapping")
    if not isinstance(found, Mapping):
        raise UserError("rig", rig, "must be a YAML file that describes a rig")
    return found


def _is_file(rig: str | Path) -> bool:
    """Whether this is a file's path and not the name of an option; a missing file is told as such."""
    path = Path(rig).expanduser()
    if path.suffix not in SUFFIXES:
        return False
    if not path.is_file():
        raise UserError("rig", rig, "no such file")
    return True


def _from_mapping(rig: Mapping[str, Any]) -> Any:
    """By the rules of a file: numbers, texts, lists and mappings, and nothing to be resolved."""
    try:
        text = yaml.safe_dump(plain_numbers(dict(rig)), sort_keys=False, allow_unicode=True)
        return yaml_files.rig_content(yaml_files.read(text))
    except yaml_files.Mistake as mistake:
        raise UserError("rig", "a mapping", str(mistake)) from mistake
    except yaml.YAMLError as error:
        raise UserError("rig", "a mapping", f"must hold numbers, texts, lists and mappings ({error})") from error


def _from_file(path: Path) -> Any:
    try:
        return yaml_files.rig_content(yaml_files.read(path.read_bytes()), path)
    except yaml_files.Mistake as mistake:
        raise UserError("rig", path, str(mistake)) from mistake
    except OSError as error:
        raise UserError("rig", path, f"cannot be read: {reason(error)}") from error
