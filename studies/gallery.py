"""The gallery of diagnoses: recordings with something hidden in them, and what `dtb diagnose` says of each.

``python -m studies gallery [FOLDER [NAME ...]]`` conceals and diagnoses a recording for each exhibit, which
takes minutes, and writes ``gallery.md``, ``images/gallery_<name>.png`` and ``gallery/<name>.json`` into a folder
(default: ``docs``); with names only these exhibits are made anew. Everything comes from seeds: the same code gives the
same gallery.
"""

from __future__ import annotations

import re
import shlex
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image

from dtbacklash.files import read_json, write_json, write_text
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig
from dtbacklash.prove.rules import SENSOR
from dtbacklash.prove.secret import Secret
from dtbacklash.report.components.intervals import interval
from dtbacklash.report.components.markdown import table

MADE = "<!-- Made by `python -m studies gallery docs`. Change the code, not this page. -->\n"
PAGE, DATA, IMAGES = "gallery.md", "gallery", "images"
RIG, FOUND = "lead_screw", "found"
#: width of an image [pixels], its colours, and its size at most [bytes]
WIDTH, COLOURS, BYTES_MAX = 860, 48, 60_000
VERDICTS = {
    "consistent": "consistent", "parameters": "parameters are off", "missing_physics": "missing physics",
    "unexplained": "unexplained",
}  # fmt: skip
#: errors of sensors and unknown forces, which the report of a diagnosis has as tables
LEFT = re.compile(r" (?:Left|Unknown force left): .*?(?:\)|acts on it)\.(?= |$)")
INTRO = """\
After this page you can recognise the results of `dtb diagnose` by their drawings. Each section conceals a recording.
This command diagnoses it without the answer:

```sh
dtb diagnose recording=hidden/*/recording.csv.gz rig=lead_screw out=found
```

In a drawing the rig runs from the command to the last mass. The darker an element, the more of the evidence is there.
The plot below it shows the force that the motion needs and the model lacks, with the law that was fitted to it. A good
result is dark in one place, and its law runs through the points. No exhibit is chosen by its result: misses are shown.
"""


@dataclass(frozen=True)
class Exhibit:
    """One recording: what is hidden in it, by the choices of ``dtb conceal``, and what there is to see."""

    name: str
    title: str
    see: str
    choices: tuple[str, ...]
    seed: int = 7

    @property
    def chosen(self) -> dict[str, str]:
        """The choices as keywords."""
        return dict(word.split("=", 1) for word in self.choices)

    @property
    def command(self) -> str:
        """What conceals the recording on the command line."""
        return shlex.join(["dtb", "conceal", "out=hidden", f"seed={self.seed}", *self.choices])


EXHIBITS = (
    Exhibit("backlash", "A worn gear", "The screw rests while the motor crosses the gap: lost motion at each reversal.",
            ("effect=gear.backlash",)),
    Exhibit("friction", "Friction in the motor's bearing",
            "A torque against the motion that does not depend on the speed: two levels, and a jump at standstill.",
            ("effect=motor_bearing.coulomb_friction", "instruments=rich")),
    Exhibit("cubic", "A spring that is not linear", "A force that grows with the third power of the stretch.",
            ("effect=link_1.cubic_stiffness",)),
    Exhibit("cogging", "Cogging", "A torque that repeats with the motor's angle.", ("effect=motor_bearing.cogging",)),
    Exhibit("absorber", "A hidden mass", "Something hangs on the last mass and swings at a frequency of its own.",
            ("effect=mass_3.absorber",)),
    Exhibit("delay", "A late sensor", "The signal is right, but late: the error grows with the speed.",
            ("effect=sensor_q3.delay",)),
    Exhibit("nothing", "Nothing", "The machine is the nominal rig; only the noise of the sensors remains.",
            ("kind=nothing",)),
    Exhibit("parameters", "A wrong parameter", "No physics is missing; a value of the rig's file is off.",
            ("kind=parameters",)),
    Exhibit("unknown", "Physics that the catalogue lacks",
            "The mismatch is real, and no effect of the catalogue explains it.",
            ("kind=unknown",)),
    Exhibit("formula", "A law that the catalogue lacks",
            "No name, but a table of the missing force over a state, and a formula that fits as well.",
            ("kind=unknown", "instruments=rich"), seed=1101),
)  # fmt: skip

#: (exhibit, empty folder) -> what was hidden; leaves the files of a diagnosis in the folder ``FOUND`` in it
Make = Callable[[Exhibit, Path], Secret]


def conceal_and_diagnose(exhibit: Exhibit, folder: Path) -> Secret:
    """Make one recording, diagnose it within ``folder``, and only then open its seal."""
    from dtbacklash import diagnose
    from dtbacklash.prove.conceal import conceal
    from dtbacklash.prove.seal import RECORDING, open_seal

    key = folder / "key"
    case = conceal(exhibit.seed, RIG, folder / "hidden", key_file=key, **exhibit.chosen)  # type: ignore[arg-type]
    diagnose(case / RECORDING, RIG).save(folder / FOUND)
    return open_seal(case, key)


def make(exhibits: Sequence[Exhibit], docs: Path, by: Make = conceal_and_diagnose) -> None:
    """Make the data and the images of some exhibits, and then the page of all that there are."""
    from dtbacklash import load_rig

    rig = load_rig(RIG)
    for number, exhibit in enumerate(exhibits, 1):
        print(f"{number} of {len(exhibits)}: {exhibit.title}", file=sys.stderr, flush=True)
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            secret = by(exhibit, folder)
            figures = folder / FOUND / "figures"
            diagnosis = read_json(folder / FOUND / "diagnosis.json")
            pictures = [figures / "rig.png", *sorted(figures.glob("law_*.png"))[:1]]
            picture(pictures, docs / IMAGES / f"gallery_{exhibit.name}.png")
        write_json(docs / DATA / f"{exhibit.name}.json", summary(secret, diagnosis, rig))
    write_text(docs / PAGE, page_text(docs))


def summary(secret: Secret, diagnosis: dict[str, Any], rig: Rig) -> dict[str, Any]:
    """What the page says of an exhibit: what was hidden and what was found, in words and values."""
    kept = ("location", "effect", "parameters", "also_fits", "sentence")
    return {
        "hidden": hidden_sentences(secret, rig),
        "truth": {".".join((e["location"], e["effect"])): e["parameters"] for e in secret.effects}
        | {"": dict(secret.parameters)},
        "verdict": diagnosis["verdict"],
        "summary": diagnosis["summary"],
        "findings": [{name: f.get(name) for name in kept} for f in diagnosis["findings"]],
        "recalibrated": diagnosis["recalibrated"],
        "next_experiment": diagnosis.get("next_experiment") or "",
    }


def hidden_sentences(secret: Secret, rig: Rig) -> list[str]:
    """What was hidden, a sentence each, values to three digits."""
    said = []
    for e in secret.effects:
        place = e["location"]
        kind = SENSOR if place.startswith(f"{SENSOR}_") else rig.elements[place].kind
        effect = find(kind, e["effect"], place)
        units = {p.name: p.unit for p in effect.parameters}
        values = {name: interval(float(f"{v:.3g}"), None, units[name]) for name, v in e["parameters"].items()}
        said.append(effect.said(effect.idle(e["parameters"])).format(location=place, **values))
    for name, value in secret.parameters.items():
        there = rig.config.parameters[name]
        change = 100.0 * (value / there.value - 1.0)
        said.append(f"{name} ({there.description}) is off by {change:+.1f} %.")
    if secret.unknown:
        said.append(f"At {secret.unknown['location']}: {secret.unknown['description']}.")
    return said or ["Nothing."]


def page_text(docs: Path) -> str:
    """The text of ``gallery.md``, from the data of the exhibits."""
    parts = [MADE, "# Gallery of diagnoses\n", INTRO]
    for exhibit in EXHIBITS:
        found = read_json(docs / DATA / f"{exhibit.name}.json")
        if found:
            parts += _section(exhibit, found)
    return "\n".join(parts)


def _section(exhibit: Exhibit, found: dict[str, Any]) -> list[str]:
    parts = [f"## {exhibit.title}\n", f"{exhibit.see}\n", f"```sh\n{exhibit.command}\n```\n"]
    parts.append(f"- Hidden: {' '.join(found['hidden'])}")
    parts.append(f"- Diagnosed: **{VERDICTS[found['verdict']]}**. {LEFT.sub('', found['summary'])}\n")
    rows = list(_rows(found))
    if rows:
        parts.append(table(("parameter", "hidden", "found, 95 % interval"), rows))
    also = [f"{a['effect']} at {a['location']}" for f in found["findings"] for a in f["also_fits"] or []]
    if also:
        parts.append(f"This recording cannot tell it from: {', '.join(also)}.\n")
    if found["next_experiment"]:
        parts.append(f"To record next: {found['next_experiment']}\n")
    parts.append(f"![{exhibit.title}: the rig with the evidence]({IMAGES}/gallery_{exhibit.name}.png)\n")
    return parts


def _rows(found: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Parameter, true value, found value with its interval: of each finding, and of what was recalibrated."""
    rows = []
    for f in found["findings"]:
        truth = found["truth"].get(f"{f['location']}.{f['effect']}", {})
        for name, p in (f["parameters"] or {}).items():
            rows.append(_row(f"`{f['location']}` {name}", truth.get(name), p, p["unit"]))
    for name, p in found["recalibrated"].items():
        rows.append(_row(f"`{name}`", found["truth"][""].get(name, p["nominal"]), p, p["unit"]))
    return rows


def _row(name: str, truth: float | None, p: dict[str, Any], unit: str) -> tuple[str, str, str]:
    shown = "" if truth is None else interval(truth, None, unit, size=p["value"])
    return name, shown, interval(p["value"], p["ci95"], unit)


def picture(files: Sequence[Path], target: Path) -> None:
    """Pictures below each other as one small PNG of few colours."""
    images = [_of_width(file, WIDTH) for file in files]
    canvas = Image.new("RGB", (WIDTH, sum(image.height for image in images)), "white")
    top = 0
    for image in images:
        canvas.paste(image, (0, top))
        top += image.height
    target.parent.mkdir(parents=True, exist_ok=True)
    for share in (1.0, 0.9, 0.8, 0.7, 0.6):
        size = (int(share * canvas.width), int(share * canvas.height))
        small = canvas.resize(size, Image.Resampling.LANCZOS) if share < 1.0 else canvas
        small.quantize(COLOURS, dither=Image.Dither.NONE).save(target, optimize=True)
        if target.stat().st_size <= BYTES_MAX:
            return


def _of_width(file: Path, width: int) -> Image.Image:
    with Image.open(file) as image:
        height = round(image.height * width / image.width)
        return image.convert("RGB").resize((width, height), Image.Resampling.LANCZOS)


def main(words: Sequence[str]) -> None:
    """Make the gallery in the folder ``words[0]``; of the exhibits named after it, or all."""
    docs, names = Path(words[0] if words else "docs"), words[1:]
    unknown = set(names) - {e.name for e in EXHIBITS}
    if unknown:
        raise SystemExit(f"no exhibit {min(unknown)!r}; choose of {', '.join(e.name for e in EXHIBITS)}")
    make([e for e in EXHIBITS if not names or e.name in names], docs)
    print(docs / PAGE)
