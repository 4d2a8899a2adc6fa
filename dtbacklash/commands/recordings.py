"""``dtb recordings``: the public recordings that have a mapping; ``dtb recordings fetch NAME`` gets one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.recording.mapping import Mapping


def main(words: Sequence[str]) -> int:
    """Run ``dtb recordings``; returns the exit code."""
    if not words:
        _list()
        return 0
    if words[0] == "check":
        for line in check(words[1:]):
            print(line)
        return 0
    if words[0] != "fetch":
        raise UserError("argument", words[0], "dtb recordings takes nothing, fetch NAME, or check FILE")
    if not 2 <= len(words) <= 3:
        raise UserError("argument", " ".join(words), "write dtb recordings fetch NAME [FILE]")
    _fetch(words[1], words[2] if len(words) == 3 else None)
    return 0


def check(words: Sequence[str]) -> list[str]:
    """What a recording holds, read as a diagnosis reads it: ``FILE|MAPPING [rig=RIG] [out=FOLDER]``; it is drawn, too.

    The figure is ``NAME_recording.png`` in the folder, or here.
    """
    from dtbacklash.api.recordings import plot_recording
    from dtbacklash.api.rigs import load_rig
    from dtbacklash.commands.console import shown_path
    from dtbacklash.files import write_bytes
    from dtbacklash.recording import mapping_of, read_recording
    from dtbacklash.report.components.style import png

    settings = dict(word.split("=", 1) for word in words if "=" in word)
    names = [word for word in words if "=" not in word]
    unknown = next((key for key in settings if key not in ("rig", "out")), None)
    if unknown is not None:
        raise UserError(
            unknown, settings[unknown], "no such setting; dtb recordings check takes rig=RIG and out=FOLDER"
        )
    if len(names) != 1:
        raise UserError("argument", " ".join(names) or "(missing)", "write dtb recordings check FILE")
    mapping = mapping_of(names[0])
    rig = settings.get("rig") or (mapping.rig if mapping else None)
    recording = read_recording(names[0], rig=load_rig(rig) if rig else None)
    file = Path(settings.get("out", ".")).expanduser().absolute() / f"{Path(names[0]).stem}_recording.png"
    write_bytes(file, png(plot_recording(recording)), "out", settings.get("out", "."))
    return [*str(recording).splitlines(), f"drawn in {shown_path(file)}"]


def _list() -> None:
    from rich.markup import escape

    from dtbacklash.commands.console import stdout_console
    from dtbacklash.recording.mapping import load_mapping, mapping_names

    console = stdout_console()
    for name in mapping_names():
        mapping = load_mapping(name)
        rig, title = escape(mapping.rig or "-"), escape(mapping.title)
        console.print(f"[bold]{escape(mapping.name)}[/bold] (rig={rig}): {title}", soft_wrap=True)
        for line in _files_lines(mapping):
            console.print(line, soft_wrap=True)
        if mapping.parts:
            parts = ", ".join(f"recording={mapping.name}:{part}" for part in mapping.parts)
            console.print(f"  parts    {escape(parts)}", soft_wrap=True)
        for label, value in (("licence", mapping.licence), ("cite", mapping.citation), ("page", mapping.page)):
            console.print(f"  {label:<8} {escape(value or '-')}", soft_wrap=True)
        console.print()


def _files_lines(mapping: Mapping) -> Iterator[str]:
    """Two lines a file: name, size and what it is; then where it was found, unbroken so that it can be copied."""
    from rich.markup import escape

    from dtbacklash.commands.console import shown_path
    from dtbacklash.recording import locate

    names = list(mapping.files) or [mapping.file or "(recording.path=FILE)"]
    for name in names:
        public = mapping.files.get(name)
        place = locate.find(mapping, name)
        about = public.about if public else ""
        if name == mapping.file and len(mapping.files) > 1:
            about += " (the default)"
        known = public.size_bytes if public else 0  # of a file of one's own nothing is known but what is there
        size_bytes = known or (place.stat().st_size if place else 0)
        size = f"{size_bytes / 1000:.0f} kB" if size_bytes >= 1000 else f"{size_bytes} B" if size_bytes else "-"
        yield f"  {escape(name):<{max(map(len, names))}}  {size:>8}  {escape(about)}"
        yield f"    [green]{escape(shown_path(place))}[/]" if place else "    [yellow]missing[/]"


def _fetch(name: str, only: str | None) -> None:
    from dtbacklash.api.progress import progress
    from dtbacklash.commands.console import shown_path
    from dtbacklash.recording.fetch import fetch
    from dtbacklash.recording.mapping import load_mapping, mapping_names

    if name not in mapping_names():
        raise UserError("recordings", name, "choose one of " + ", ".join(mapping_names()))
    mapping = load_mapping(name)
    if not mapping.files:
        raise UserError("recordings", name, "its mapping names no public source")
    if only is not None and only not in mapping.files:
        raise UserError("recordings", only, "choose one of " + ", ".join(mapping.files))
    for file in mapping.files.values():
        if only is None or file.name == only:
            with progress(f"fetching {file.name}") as tick:
                print(shown_path(fetch(mapping, file, tick)))
    print(f"licence: {mapping.licence or '-'}")
    print(f"cite: {mapping.citation or '-'}")
