"""The pages of ``docs/`` that are made from the code, so that they cannot disagree with it.

``python -m dtbacklash.docs [FOLDER]`` writes ``effects.md`` and ``configuration.md`` (default folder: ``docs``).
A test compares the committed pages with what these functions return.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash.commands.run_help import GROUPS
from dtbacklash.config import run
from dtbacklash.config.load import settings
from dtbacklash.docs_settings import MEANINGS
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import CATALOGUE, Effect, Parameter, effects_of
from dtbacklash.physics.elements import GROUND, KINDS, QUANTITIES

if TYPE_CHECKING:
    import pandas as pd

MADE = "<!-- Made by `python -m dtbacklash.docs`. Change the code, not this page. -->\n"
#: suffix of a setting's name -> its unit
SUFFIXES = {
    "_v_per_rad": "V/rad", "_rad_s": "rad/s", "_mm": "mm", "_deg": "deg", "_s": "s", "_hz": "Hz",
}  # fmt: skip
UNITS = {"twin.buffer": "samples", "twin.settle": "samples", "rig.parameters": "SI", "rig.effects": "SI"}
SECTIONS: dict[str, Any] = {
    field.name: field.default_factory
    for field in dataclasses.fields(run.RunConfig)
    if dataclasses.is_dataclass(field.default_factory)
}


def table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a Markdown table; a bar inside a cell is escaped."""
    lines = [list(heads)]
    lines.append(["---"] * len(lines[0]))
    lines += [[cell.replace("|", "\\|").replace("\n", " ") for cell in row] for row in rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines) + "\n"


def number(value: float) -> str:
    """Return a bound as text: 1e-06 as 1e-06, infinity as a word."""
    return "unlimited" if value == float("inf") else f"{value:g}"


def effects_page() -> str:
    """Return the text of ``docs/effects.md``: every effect with its law, parameters, units, bounds, source."""
    parts = [MADE, "# Effects\n", EFFECTS_INTRO]
    for kind in dict.fromkeys(kind for kind, _ in CATALOGUE):
        parts += [f"## {kind}\n", f"{_of_kind(kind)}\n"]
        rows: list[list[str]] = []
        for effect in effects_of(kind).values():
            for parameter in effect.parameters:
                rows.append(_parameter_row(effect, parameter))
        parts.append(table(("effect", "law", "parameter", "unit", "lowest", "highest", "default", "neutral", "source"),
                           rows))  # fmt: skip
    return "\n".join(parts)


def _of_kind(kind: str) -> str:
    if kind == "sensor":
        return "At `sensor_<name>`, for every sensor of the rig."
    places = lead_screw_elements(kind)
    where = "On the rig `lead_screw`: " + ", ".join(f"`{p}`" for p in places) if places else "Not on `lead_screw`"
    return f"{KINDS[kind].description}. {where}."


def lead_screw_elements(kind: str) -> list[str]:
    """Return the names of the elements of a kind on the paper's rig."""
    from omegaconf import OmegaConf

    text = (resources.files("dtbacklash.conf") / "rig" / "lead_screw.yaml").read_text(encoding="utf-8")
    elements = OmegaConf.to_container(OmegaConf.create(text).elements)
    assert isinstance(elements, dict)
    return [str(name) for name, element in elements.items() if element["kind"] == kind]


def _parameter_row(effect: Effect, parameter: Parameter) -> list[str]:
    first = parameter is effect.size
    default = "must be given" if first else number(parameter.typical)
    neutral = number(parameter.neutral) if parameter.neutral is not None else ""
    head = [f"`{effect.name}`", f"`{effect.law}`"] if first else ["", ""]
    return [*head, f"`{parameter.name}`", parameter.unit, number(parameter.low), number(parameter.high), default,
            neutral, effect.source if first else ""]  # fmt: skip


def configuration_page() -> str:
    """Return the text of ``docs/configuration.md``: the groups and their options, every setting, the rig's file."""
    parts = [MADE, "# Configuration\n", CONFIGURATION_INTRO, "## Groups\n"]
    parts.append(table(("group", "option", "what it is"), _option_rows()))
    parts += ["## Settings\n", SETTINGS_INTRO]
    for section in ["", *SECTIONS]:
        rows = [row for key, row in _setting_rows() if (key.split(".")[0] if "." in key else "") == section]
        parts += [f"### {section or 'the run'}\n", table(("setting", "unit", "default", "allowed", "meaning"), rows)]
    parts += [
        "## A rig of your own\n",
        RIG_INTRO,
        table(("kind", "fields", "neighbours", "what it is"), _kind_rows()),
    ]
    parts += ["Sensors:\n", table(("`of` an element of kind", "`quantity` and its unit in the simulation"), [
        (f"`{kind}`", ", ".join(f"`{q}` [{u}]" for q, u in there.items())) for kind, there in QUANTITIES.items()
    ])]  # fmt: skip
    return "\n".join(parts)


def _option_rows() -> list[list[str]]:
    rows = []
    for group in GROUPS:
        if "/" in group:
            continue
        for option in packaged_options(group):
            text = (resources.files("dtbacklash.conf") / group / f"{option}.yaml").read_text(encoding="utf-8")
            rows.append([f"`{group}`", f"`{option}`", first_sentence(text)])
    return rows


def first_sentence(yaml: str) -> str:
    """Return the first sentence of the comment that a file of ``conf`` begins with."""
    comment: list[str] = []
    for line in yaml.splitlines():
        if not line.startswith("#"):
            break
        if "@package" not in line:
            comment.append(line[1:].strip())
    return " ".join(comment).split(". ")[0].removesuffix(".") + "."


def packaged_options(group: str) -> list[str]:
    """Return the options of a group that come with the package, sorted."""
    files = (resources.files("dtbacklash.conf") / group).iterdir()
    return sorted(file.name.removesuffix(".yaml") for file in files if file.name.endswith(".yaml"))


def _setting_rows() -> list[tuple[str, list[str]]]:
    defaults = dataclasses.asdict(run.RunConfig())
    rows = []
    for key in settings():
        value: Any = defaults
        for part in key.split("."):
            value = value[part]
        rows.append((key, [f"`{key}`", unit_of(key), shown(value), allowed(key), MEANINGS[key]]))
    return rows


def unit_of(key: str) -> str:
    """Return the unit of a setting: by its suffix, or listed."""
    return UNITS.get(key) or next((unit for suffix, unit in SUFFIXES.items() if key.endswith(suffix)), "")


def shown(value: Any) -> str:
    """Return a default as one writes it on the command line."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    return str(value) if not isinstance(value, dict) else ""


def allowed(key: str) -> str:
    """Return what a setting accepts, in the words with which it refuses something else."""
    *sections, name = key.split(".")
    schema: Any = SECTIONS[sections[0]] if sections else run.RunConfig
    kind = settings()[key]
    if kind is bool:
        return "true, false"
    if kind in (int, float):
        wrong: Any = float("nan")
    elif kind in (str, str | None) and key not in ("controller.name", "rig.name", "rig.description"):
        wrong = "?"
    else:
        return ""
    try:
        schema(**{name: wrong})
    except UserError as error:
        text = error.allowed.removeprefix("must be ").removeprefix("choose one of ").removeprefix("finite and ")
        return text.removesuffix(f" {unit_of(key)}") if unit_of(key) else text
    return ""


def _kind_rows() -> list[list[str]]:
    rows = []
    for kind in KINDS.values():
        fields = [f"`{name}` [{unit}]" for name, unit in kind.required.items()]
        fields += [f"`{name}` [{unit}] (optional)" for name, unit in kind.optional.items()]
        rows.append(
            [f"`{kind.name}`", ", ".join(fields), ", ".join(f"`{n}`" for n in kind.neighbours), kind.description]
        )
    return rows


def claims_table(claims: pd.DataFrame) -> str:
    """Return the table of ``docs/paper.md`` from the rows of ``claims.csv``."""
    rows = [
        (str(c["claim"]), str(c["section"]), str(c["paper"]), str(c["ours"]), str(c["tolerance"]),
         "yes" if c["pass"] else "**no**")
        for c in claims.to_dict("records")
    ]  # fmt: skip
    return table(("claim", "section", "the paper", "ours", "tolerance", "holds"), rows)


EFFECTS_INTRO = """\
What a rig may do beside its linear model. An effect is switched on by its size (the first parameter), on the command
line or in the rig's YAML:

```sh
dtb run rig.effects.motor_bearing.coulomb_friction.torque=0.02 controller.internal_model=measured
```

`rig.effects.ELEMENT.EFFECT.PARAMETER=VALUE`, in SI. Parameters that are not given take the default. At the neutral
value the effect does nothing, to the last bit: it is left out of the compiled arrays. `v`, `q`, `s` are a body's speed
and position and a link's stretch; a bound is inclusive. What each effect assumes: [simulation.md](simulation.md).
"""

CONFIGURATION_INTRO = """\
Everything that `dtb run` can be told. A group is chosen by `group=option`, a setting by `key=value`;
`dtb run --cfg job` prints the result and runs nothing:

```sh
dtb run --cfg job controller=imc profile=ramp
```

A folder `conf` in the current directory extends the groups: `conf/rig/mine.yaml` is `rig=mine`, and an option of ours
of the same name is replaced. `rig=` also takes the path of a YAML file.
"""

SETTINGS_INTRO = """\
The defaults here are the schema's; an option of a group may set others. A value outside what is allowed ends in one
line and exit code 2.
"""

RIG_INTRO = f"""\
A rig is one YAML file with `parameters`, `elements`, `effects` and `sensors`; `dtbacklash/conf/rig/lead_screw.yaml` is
an example to copy. Elements name parameters, so that two links may share one stiffness. `tolerance` is relative, one
standard deviation. `between` joins two masses or carriages, or one of them and `{GROUND}`. At most one amplifier,
motor_circuit, actuator, rotor, gear and screw. The controllers `imc` and `nimc` need a motor, a screw that carries a
mass, and a chain of links from there; other rigs run with `controller=open_loop`.
"""


def write(folder: Path) -> list[Path]:
    """Write the pages into ``folder``; returns the files."""
    pages = {"effects.md": effects_page(), "configuration.md": configuration_page()}
    for name, text in pages.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in pages]


if __name__ == "__main__":
    for written in write(Path(sys.argv[1] if len(sys.argv) > 1 else "docs")):
        print(written)
