"""``dtb conceal``: recordings with something hidden in them, and sealed answers, to put a diagnosis to the proof."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from dtbacklash.commands.words import SEED_MOST, read_words, whole
from dtbacklash.errors import UserError

HELP = """\
usage: dtb conceal out=FOLDER [n=1] [seed=0] [key=value ...]

Makes recordings of a rig with something hidden in them, and seals what it is: one or several effects of the
catalogue, wrong parameters, physics that the catalogue does not have, or nothing. Kind, place, size, excitation,
noise, counts, instruments and duration are drawn from the seed. Another integrator than the diagnosis has makes them,
with other formulations where a law is not smooth. Each recording gets a folder with a name that tells nothing:

  FOLDER/<id>/recording.csv.gz   t s, r mm (V in open loop), u V, and the sensors
  FOLDER/<id>/public.json        the rig and the channels
  FOLDER/<id>/sealed.json        what is hidden, encrypted, with a commitment
  FOLDER.key                     opens the seals: keep it apart from the recordings

  out=FOLDER          a new folder for the recordings
  n=1                 how many, with the seeds from seed= on
  seed=0              below 10000 for development; from 10000 on for proofs that count
  kind=KIND           hide nothing, parameters, single, several or unknown, instead of drawing it
  effect=PLACE.NAME   hide this effect alone, e.g. gear.backlash
  instruments=SET     minimal (the motor's angle and the last mass) or rich (every sensor of the rig)
  rig=NAME|FILE       default: lead_screw; a motor with a gear and a screw that moves a chain of masses
  key=FILE            another place for the key; a key that is there already is used again

examples:
  dtb conceal out=hidden n=5 seed=7
  dtb conceal out=play seed=3 effect=gear.backlash instruments=rich"""

KEYS = ("out", "n", "seed", "kind", "effect", "instruments", "rig", "key")
MOST = 100_000
SHOWN = 3


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line."""

    out: Path
    n: int
    seed: int
    kind: str | None
    effect: str | None
    instruments: str | None
    rig: str
    key: Path


def main(words: Sequence[str]) -> int:
    """Run ``dtb conceal``; returns the exit code."""
    if any(word in ("-h", "--help", "help") for word in words):
        print(HELP)
        return 0
    request = parse(words)
    from dtbacklash.commands.console import progress
    from dtbacklash.prove.conceal import conceal, nominal_rig
    from dtbacklash.prove.draw import check_choices
    from dtbacklash.runfolder import run_folder

    rig = nominal_rig(request.rig)
    check_choices(rig, request.kind, request.effect, request.instruments)
    names = []
    # no file is the mark of an earlier run: a folder with anything in it is refused
    with _key(request.key), run_folder(request.out, key="out", mark="", known=frozenset()) as scratch:
        scratch.rmdir()  # `conceal` makes it with the first case
        with progress("concealing") as tick:
            for j in range(request.n):
                tick(j / request.n)
                case = conceal(
                    request.seed + j, request.rig, scratch, kind=request.kind, effect=request.effect,
                    instruments=request.instruments, key_file=request.key,
                )  # fmt: skip
                names.append(case.name)
    _show(request, names)
    return 0


def parse(words: Sequence[str]) -> Request:
    """Read the command line.

    Raises
    ------
    UserError : an unknown word, a key without a value or twice, no folder, a number that is none, the key's file in
        the folder of the recordings.
    """
    from dtbacklash.prove.seal import key_path

    given = read_words(words, KEYS, (), "choose --help, or write key=value").given
    if "out" not in given:
        raise UserError("out", "(missing)", "give a new folder for the recordings")
    out = Path(given["out"]).absolute()
    if not out.name:
        raise UserError("out", given["out"], "give a new folder for the recordings")
    key_file = Path(given["key"]).absolute() if "key" in given else key_path(out)
    if out == key_file or out in key_file.parents:
        raise UserError("key", given["key"], "a file outside the folder of the recordings")
    return Request(
        out, whole("n", given.get("n", "1"), 1, MOST), whole("seed", given.get("seed", "0"), 0, SEED_MOST),
        given.get("kind"), given.get("effect"), given.get("instruments"), given.get("rig", "lead_screw"), key_file,
    )  # fmt: skip


@contextmanager
def _key(path: Path) -> Iterator[None]:
    """A key that was made for recordings that did not come to be goes with them."""
    from dtbacklash.runfolder import forget_empty, note_missing

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


def _show(request: Request, names: list[str]) -> None:
    """Print what can be done next."""
    from dtbacklash.commands.console import shown_path
    from dtbacklash.prove.seal import RECORDING

    folder = shown_path(request.out)
    print(f"{len(names)} concealed recording{'s' * (len(names) > 1)} in {folder}")
    print(f"the key: {shown_path(request.key)}; keep it apart until the diagnoses are written")
    for name in names[:SHOWN]:
        print(f"dtb diagnose recording={Path(folder) / name / RECORDING} rig={request.rig}")
    if len(names) > SHOWN:
        print(f"... and {len(names) - SHOWN} more")
