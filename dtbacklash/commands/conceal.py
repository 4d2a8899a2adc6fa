"""``dtb conceal``: recordings with something hidden in them, and sealed answers, to put a diagnosis to the proof."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash.campaign.application import Application
from dtbacklash.config.commands import ConcealConfig
from dtbacklash.config.grammar import RUN_FOLDER
from dtbacklash.config.load import settings_hash
from dtbacklash.errors import UserError
from dtbacklash.files import forget_empty, json_text, note_missing, run_folder

if TYPE_CHECKING:
    from dtbacklash.api.progress import Tell

MARK = "concealed.json"
FIGURES = ("recordings",)
SHOWN = 3


def do(config: ConcealConfig, folder: Path, command: str, tell: Tell | None) -> tuple[Any, dict[str, Any]]:
    """Make the recordings; gives their names with what ``rig=`` takes to diagnose them, and how many there are."""
    names, rig = make(config, folder, tell)
    return (names, rig), {"recordings": len(names)}


def make(config: ConcealConfig, folder: Path, tell: Tell | None = None) -> tuple[list[str], str]:
    """Write the folder, complete or not at all.

    Returns the names of the recordings; what ``rig=`` takes to diagnose them.

    Raises UserError: a folder with something in it, a choice that cannot be, a key that cannot be used.
    """
    from dtbacklash.api import rigs
    from dtbacklash.physics.rig import build_rig
    from dtbacklash.physics.rig_file import rig_yaml
    from dtbacklash.prove.conceal import conceal
    from dtbacklash.prove.draw import check_choices

    rig = build_rig(config.rig)
    if not folder.name:
        raise UserError(RUN_FOLDER, folder, "give a folder of its own")
    key = key_file(config, folder)
    _check_places(folder, key)
    check_choices(rig, config.kind, config.effect, config.instruments)
    name = rigs.called(config.rig)
    names = []
    # no file is the mark of an earlier run: a folder with anything in it is refused
    with _key(key), run_folder(folder, RUN_FOLDER, mark="", known=frozenset()) as scratch:
        scratch.rmdir()  # `conceal` makes it with the first case
        for j in range(config.n):
            if tell:
                tell(j / config.n)
            case = conceal(
                config.seed + j, rig, scratch, kind=config.kind, effect=config.effect, instruments=config.instruments,
                key_file=key, called=name or f"../{rigs.FILE}", machine=config.machine,
            )  # fmt: skip
            names.append(case.name)
        if name is None:
            (scratch / rigs.FILE).write_text(rig_yaml(rig), encoding="utf-8")
        # in an order that tells nothing of the seeds
        (scratch / MARK).write_text(json_text({"recordings": sorted(names)}), encoding="utf-8")
    return names, name or str(folder / rigs.FILE)


def key_file(config: ConcealConfig, folder: Path) -> Path:
    """Where the key is: as chosen, else beside the folder."""
    from dtbacklash.prove.seal import key_path

    return Path(config.key).absolute() if config.key is not None else key_path(folder)


def _check_places(folder: Path, key: Path) -> None:
    if (folder / MARK).exists() or next(folder.glob("*/sealed.json"), None):
        allowed = "holds recordings of an earlier dtb conceal, which are not replaced, as their answers would be lost; "
        raise UserError(RUN_FOLDER, folder, f"{allowed}give a new folder (out=FOLDER), or remove this one first")
    if folder == key or folder in key.parents:
        raise UserError("key", key, "a file outside the folder of the recordings")


@contextmanager
def _key(path: Path) -> Iterator[None]:
    """A key that was made for recordings that did not come to be goes with them."""
    there = path.exists()
    note_missing(path.parent)
    try:
        yield
    except BaseException:
        if not there:
            with suppress(OSError):  # where it could not be made it cannot be removed either
                path.unlink(missing_ok=True)
            forget_empty(path.parent)
        raise


def show(made: tuple[list[str], str], config: ConcealConfig, folder: Path) -> int:
    """Print what can be done next; returns the exit code."""
    from dtbacklash.commands.console import shown_path
    from dtbacklash.prove.seal import RECORDING

    names, rig = made
    here = shown_path(folder)
    rig = shown_path(Path(rig)) if rig.endswith(".yaml") else rig
    print(f"{len(names)} concealed recording{'s' * (len(names) > 1)} in {here}")
    print(f"the key: {shown_path(key_file(config, folder))}; keep it apart until the diagnoses are written")
    for name in names[:SHOWN]:
        print(shlex.join(["dtb", "diagnose", f"recording={Path(here) / name / RECORDING}", f"rig={rig}"]))
    if len(names) > SHOWN:
        print(f"... and {len(names) - SHOWN} more")
    return 0


APPLICATION = Application("conceal", settings_hash, do, show, MARK, FIGURES, "concealing")
