"""Mappings: how a recording's file becomes channels, and where it can be had (``conf/recording/*.yaml``)."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from dtbacklash.errors import UserError
from dtbacklash.recording import units
from dtbacklash.recording.command import COMMANDS, HELD

SUFFIXES = (".yaml", ".yml")
NO_MAPPING = "none"  # the option of `dtb run` that says where nothing is saved
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Channel:
    """One channel: the column (name, or number from 0) it is read from, its SI unit and the factor to it."""

    column: str
    unit: str
    scale: float


@dataclass(frozen=True)
class PublicFile:
    """A file that can be had from a public source.

    ``url`` is the file itself or an archive that holds it as ``member``; ``sha256`` and ``size_bytes`` are
    those of the file's content, unpacked. ``about`` says in a few words what distinguishes it.
    """

    name: str
    url: str
    sha256: str
    member: str = ""
    size_bytes: int = 0
    about: str = ""


@dataclass(frozen=True)
class Mapping:
    """How to read a recording, as its YAML file states it."""

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
    candidates: list[Any] = [Path("conf") / "recording" / f"{name}{suffix}" for suffix in SUFFIXES]
    candidates.append(resources.files("dtbacklash.conf").joinpath("recording", f"{name}.yaml"))
    if name.endswith(SUFFIXES):
        candidates = [Path(name)]
    for candidate in candidates:
        if candidate.is_file():
            return _checked(name, candidate.read_bytes())
    raise UserError("recording", name, "choose one of " + ", ".join(mapping_names()) + ", or the path of a file")


def _checked(name: str, content: bytes) -> Mapping:
    import yaml

    try:
        data = yaml.safe_load(content)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UserError("recording", name, "the mapping is not valid YAML") from error
    if not isinstance(data, dict):
        raise UserError("recording", name, "the mapping must hold `key: value` lines")
    try:
        return _build(Path(name).stem, data)
    except _Mistake as mistake:
        raise UserError(f"recording.{mistake.key}", mistake.value, f"{mistake.allowed} (mapping {name})") from None


class _Mistake(Exception):
    def __init__(self, key: str, value: object, allowed: str) -> None:
        super().__init__(key)
        self.key, self.value, self.allowed = key, value, allowed


def _build(name: str, data: dict[str, Any]) -> Mapping:
    known = {
        "name", "title", "rig", "citation", "licence", "page", "file", "files", "time", "sample_time_s", "command",
        "channels", "parts", "notes",
    }  # fmt: skip
    for key, value in data.items():
        if key not in known:
            raise _Mistake(str(key), value, "no such key; choose one of " + ", ".join(sorted(known)))
    channels = _section(data, "channels")
    if not channels:
        raise _Mistake("channels", "{}", "name at least one channel: {u: {column: ..., unit: ...}}")
    command = data.get("command", HELD)
    if command not in COMMANDS:
        raise _Mistake("command", command, "choose one of " + ", ".join(COMMANDS))
    step = data.get("sample_time_s")
    if step is not None and not (isinstance(step, (int, float)) and not isinstance(step, bool) and step > 0):
        raise _Mistake("sample_time_s", step, "must be positive s")
    texts = {key: str(data.get(key) or "") for key in ("title", "citation", "licence", "page", "file")}
    return Mapping(
        name=str(data.get("name") or name),
        rig=data.get("rig"),
        command=command,
        files={str(key): _file(str(key), value) for key, value in _section(data, "files").items()},
        time=_channel("time", data["time"]) if data.get("time") else None,
        sample_time_s=float(step) if step is not None else None,
        channels={str(key): _channel(f"channels.{key}", value) for key, value in channels.items()},
        parts={str(key): _range(f"parts.{key}", value) for key, value in _section(data, "parts").items()},
        notes=tuple(str(note) for note in data.get("notes") or ()),
        **texts,
    )


def _section(data: dict[str, Any], key: str) -> dict[str, Any]:
    value = data.get(key) or {}
    if not isinstance(value, dict):
        raise _Mistake(key, value, "must be a mapping")
    return value


def _channel(key: str, spec: Any) -> Channel:
    if not isinstance(spec, dict) or "column" not in spec or set(spec) - {"column", "unit", "scale", "si_unit"}:
        raise _Mistake(key, spec, "must be {column, unit} or {column, scale, si_unit}")
    column = str(spec["column"])
    if "scale" in spec:
        scale = spec["scale"]
        if isinstance(scale, bool) or not isinstance(scale, (int, float)) or not scale:
            raise _Mistake(f"{key}.scale", scale, "must be a number other than 0")
        return Channel(column, str(spec.get("si_unit", "")), float(scale))
    unit = units.find(str(spec.get("unit", "")))
    if unit is None:
        raise _Mistake(f"{key}.unit", spec.get("unit"), "choose one of " + ", ".join(units.UNITS))
    return Channel(column, *unit)


def _range(key: str, value: Any) -> tuple[int, int]:
    good = isinstance(value, list) and len(value) == 2 and all(type(end) is int for end in value)
    if not good or not 0 <= value[0] < value[1]:
        raise _Mistake(key, value, "must be [first row, row after the last], counted from 0")
    return value[0], value[1]


def _file(name: str, spec: Any) -> PublicFile:
    if not isinstance(spec, dict) or not {"url", "sha256"} <= set(spec):
        raise _Mistake(f"files.{name}", spec, "must be a mapping with `url` and `sha256`")
    if not _SHA256.fullmatch(str(spec["sha256"])):
        raise _Mistake(f"files.{name}.sha256", spec["sha256"], "must be 64 hexadecimal digits")
    if not str(spec["url"]).startswith("https://"):
        raise _Mistake(f"files.{name}.url", spec["url"], "must start with https://")
    size = spec.get("size_bytes", 0)
    return PublicFile(
        name,
        str(spec["url"]),
        str(spec["sha256"]),
        str(spec.get("member", "")),
        int(size),
        str(spec.get("about", "")),
    )
