"""Mappings: how a recording's file becomes channels, and where it can be had (``conf/recording/*.yaml``)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from dtbacklash import units, yaml_files
from dtbacklash.config.choices import COMMANDS
from dtbacklash.errors import UserError
from dtbacklash.recording.prepare import TRENDS, Preparation

SUFFIXES = (".yaml", ".yml")
HELD = next(iter(COMMANDS))
NO_MAPPING = "none"  # the option of `dtb run` that says where nothing is saved
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Channel:
    """One channel: the column (name, or number from 0) it is read from, and how it becomes a value in SI.

    ``scale`` times the column plus ``offset`` is the value in ``unit`` (empty: as header and rig say, else SI), or in
    SI where ``si`` names a unit.
    """

    column: str
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    si: str = ""


@dataclass(frozen=True)
class PublicFile:
    """A file of a recording, maybe one that can be had from a public source.

    ``url`` is the file itself or an archive that holds it as ``member``; ``sha256`` and ``size_bytes`` are
    those of the file's content, unpacked; a file of one's own needs none of them. ``about`` says in a few words what
    distinguishes it.
    """

    name: str
    url: str = ""
    sha256: str = ""
    member: str = ""
    size_bytes: int = 0
    about: str = ""


@dataclass(frozen=True)
class Mapping:
    """How to read a recording, as its YAML file states it. ``folder`` : of a mapping of the user's own, else None."""

    name: str
    title: str = ""
    rig: str | None = None
    citation: str = ""
    licence: str = ""
    page: str = ""
    file: str = ""
    files: dict[str, PublicFile] = field(default_factory=dict)
    time: Channel | None = None
    command: str = HELD
    sample_time_s: float | None = None
    channels: dict[str, Channel] = field(default_factory=dict)
    parts: dict[str, tuple[int, int]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    prepare: Preparation | None = None
    folder: Path | None = None


def mapping_names() -> list[str]:
    """The names of the mappings in the packaged ``conf/recording`` and in a ``conf/recording`` here."""
    names = {
        entry.name.removesuffix(".yaml") for entry in resources.files("dtbacklash.conf").joinpath("recording").iterdir()
    }
    mine = Path("conf") / "recording"
    if mine.is_dir():
        names |= {entry.stem for entry in mine.iterdir() if entry.suffix in SUFFIXES}
    return sorted(name for name in names if name != NO_MAPPING and not name.startswith(("_", ".")))


def load_mapping(name: str) -> Mapping:
    """Read the mapping called ``name``, or the one in the YAML file ``name``; a user's own comes first.

    Raises
    ------
    UserError : no such mapping, or a mistake in it.
    """
    own = [Path("conf") / "recording" / f"{name}{suffix}" for suffix in SUFFIXES]
    if name.endswith(SUFFIXES):
        own = [Path(name)]
    for candidate in own:
        if candidate.is_file():
            try:
                return _checked(name, candidate.read_bytes(), candidate.parent)
            except OSError as error:
                raise UserError(
                    "recording", name, f"cannot be read: {(error.strerror or str(error)).lower()}"
                ) from error
    packaged = resources.files("dtbacklash.conf").joinpath("recording", f"{name}.yaml")
    if packaged.is_file() and not name.endswith(SUFFIXES):
        return _checked(name, packaged.read_bytes(), None)
    missing = "no such file: give the path of a mapping, or one of " if name.endswith(SUFFIXES) else "choose one of "
    raise UserError("recording", name, missing + ", ".join(mapping_names()))


def mapping_of(source: str) -> Mapping | None:
    """The mapping that ``recording=source`` means (``name``, ``name:part``, ``file.yaml``), or None for a file of data.

    Raises
    ------
    UserError : a mistake in the mapping.
    """
    name = source.partition(":")[0]
    known = Path(name).suffix in SUFFIXES or (not Path(source).is_file() and name in mapping_names())
    return load_mapping(name) if known else None


def _checked(name: str, content: bytes, folder: Path | None) -> Mapping:
    try:
        data = yaml_files.read(content)
    except yaml_files.Mistake as mistake:
        raise UserError("recording", name, f"the mapping {mistake}") from mistake
    if not isinstance(data, dict):
        raise UserError("recording", name, "the mapping must hold `key: value` lines")
    try:
        for key in data:
            if key not in FIELDS:
                raise UserError(str(key), data[key], "no such key; choose one of " + ", ".join(sorted(FIELDS)))
        said = {key: check(key, data[key]) for key, check in FIELDS.items() if data.get(key) is not None}
        if not said.get("channels"):
            raise UserError("channels", "{}", "name at least one channel: {u: {column: ..., unit: ...}}")
    except UserError as mistake:
        allowed = f"{mistake.allowed} (mapping {name})"
        raise UserError(f"recording.{mistake.key}", mistake.value, allowed) from None
    rig = said.get("rig")
    if rig and folder and rig.endswith(SUFFIXES) and (folder / rig).is_file():
        said["rig"] = str(folder / rig)
    return Mapping(**{"name": Path(name).stem, "file": next(iter(said.get("files", ())), ""), "folder": folder, **said})


def _text(_: str, value: Any) -> str:
    return str(value)


def _texts(key: str, value: Any) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise UserError(key, value, "must be a list of texts")
    return tuple(map(str, value))


def _rig(key: str, value: Any) -> str:
    if not isinstance(value, str):
        raise UserError(key, value, "must be the name of a rig, or the path of its YAML file")
    return value


def _command(key: str, value: Any) -> str:
    if value not in COMMANDS:
        raise UserError(key, value, "choose one of " + ", ".join(COMMANDS))
    return str(value)


def _seconds(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not value > 0:
        raise UserError(key, value, "must be positive s")
    return float(value)


def _each(check: Callable[[str, Any], Any]) -> Callable[[str, Any], dict[str, Any]]:
    """The check of a section: one check for each of its entries."""

    def checked(key: str, value: Any) -> dict[str, Any]:
        if value and not isinstance(value, dict):
            raise UserError(key, value, "must be a mapping")
        for name in value or ():
            if isinstance(name, bool):  # on, off, yes and no are truth values to YAML
                why = "YAML reads on, off, yes, no so: put quotes round the name"
                raise UserError(f"{key}.{name}".lower(), value[name], why)
        return {str(name): check(f"{key}.{name}", value[name]) for name in value or ()}

    return checked


def _channel(key: str, spec: Any) -> Channel:
    if isinstance(spec, (str, int)) and not isinstance(spec, bool):
        return Channel(str(spec))
    known = {"column", "unit", "scale", "offset", "si_unit"}
    if not isinstance(spec, dict) or "column" not in spec or set(spec) - known:
        raise UserError(key, spec, "must be a column's name, or {column, unit, scale, offset}")
    scale, offset = (_number(f"{key}.{name}", spec.get(name, plain)) for name, plain in (("scale", 1), ("offset", 0)))
    if not scale:
        raise UserError(f"{key}.scale", spec["scale"], "must be a number other than 0")
    unit, si = units.in_words(spec.get("unit")), str(spec.get("si_unit") or "")
    if unit and units.find(unit) is None:
        allowed = "choose one of " + ", ".join(units.UNITS) + "; or counts, as {counts: 4096, per: rev}"
        raise UserError(f"{key}.unit", unit, allowed)
    if unit and si:
        raise UserError(f"{key}.si_unit", si, "give `unit` or `si_unit`, not both")
    return Channel(str(spec["column"]), unit, scale, offset, si)


def _number(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise UserError(key, value, "must be a number")
    return float(value)


def _files(key: str, value: Any) -> dict[str, PublicFile]:
    """A list of names, or a mapping name -> what is known of the file."""
    if isinstance(value, list) and all(isinstance(name, str) for name in value):
        value = dict.fromkeys(value)
    if not isinstance(value, dict):
        raise UserError(key, value, "must be a list of names, or a mapping name: {about, url, sha256}")
    return {str(name): _file(f"{key}.{name}", str(name), {} if spec is None else spec) for name, spec in value.items()}


def _file(key: str, name: str, spec: Any) -> PublicFile:
    known = ("url", "member", "sha256", "size_bytes", "about")
    if not isinstance(spec, dict) or set(spec) - set(known):
        raise UserError(key, spec, "must be a mapping with some of " + ", ".join(known))
    if "sha256" in spec and not _SHA256.fullmatch(str(spec["sha256"])):
        raise UserError(f"{key}.sha256", spec["sha256"], "must be 64 hexadecimal digits")
    if "url" in spec and not str(spec["url"]).startswith("https://"):
        raise UserError(f"{key}.url", spec["url"], "must start with https://")
    texts = {k: str(spec.get(k) or "") for k in ("url", "member", "sha256", "about")}
    return PublicFile(name, size_bytes=int(_number(f"{key}.size_bytes", spec.get("size_bytes", 0))), **texts)


def _preparation(key: str, spec: Any) -> Preparation:
    known: dict[str, Callable[[str, Any], Any]] = {
        "from_s": _number,
        "to_s": _number,
        "detrend": _each(_trend),
        "sample_time_s": _seconds,
    }
    if not isinstance(spec, dict) or set(spec) - set(known):
        raise UserError(key, spec, "must be a mapping with some of " + ", ".join(known))
    return Preparation(**{name: known[name](f"{key}.{name}", value) for name, value in spec.items()})


def _trend(key: str, value: Any) -> str:
    if value not in TRENDS:
        raise UserError(key, value, "choose one of " + ", ".join(TRENDS))
    return str(value)


def rows_of(key: str, value: Any) -> tuple[int, int]:
    """A half-open range of rows (raises UserError)."""
    good = isinstance(value, Sequence) and len(value) == 2 and all(type(end) is int for end in value)
    if not good or not 0 <= value[0] < value[1]:
        raise UserError(key, value, "must be [first row, row after the last], counted from 0")
    return value[0], value[1]


#: what a mapping may say, and how that is checked
FIELDS: dict[str, Callable[[str, Any], Any]] = {
    "name": _text, "title": _text, "rig": _rig, "citation": _text, "licence": _text, "page": _text, "file": _text,
    "files": _files, "time": _channel, "sample_time_s": _seconds, "command": _command, "channels": _each(_channel),
    "parts": _each(rows_of), "notes": _texts, "prepare": _preparation,
}  # fmt: skip
