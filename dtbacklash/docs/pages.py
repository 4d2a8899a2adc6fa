"""The pages of ``docs/`` that are made from the code, so that they cannot disagree with it.

``python -m dtbacklash.docs [FOLDER]`` writes ``effects.md``, ``configuration.md`` and ``settings.md`` (default folder:
``docs``). Their prose stands in the templates beside this module; here is what fills their tables. A test compares the
committed pages with what these functions return.
"""

from __future__ import annotations

import re
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from dtbacklash import yaml_files
from dtbacklash.config.grammar import COMMON, FILES, GRAMMARS, RUN
from dtbacklash.config.groups import FOLDERS, GROUPS, PACKAGED, packaged_options
from dtbacklash.config.setting import Declared, declared
from dtbacklash.config.twin import PARTS
from dtbacklash.diagnosis.settings import DiagnoseSettings
from dtbacklash.physics.catalogue import CATALOGUE, effects_of
from dtbacklash.physics.effects.declare import Effect, Parameter
from dtbacklash.physics.effects.table import KNOTS
from dtbacklash.physics.element_kinds import GROUND, KINDS, Kind
from dtbacklash.report.components.markdown import table

if TYPE_CHECKING:
    import pandas as pd

#: a full stop that ends a sentence, and not an abbreviation
_SENTENCE_END = re.compile(r"(?<!\bFig)(?<!\be\.g)(?<!\bi\.e)\.\s")


def write(folder: Path) -> list[Path]:
    """Write the pages into ``folder``; returns the files."""
    pages = {"effects.md": effects_page(), "configuration.md": configuration_page(), "settings.md": settings_page()}
    for name, text in pages.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in pages]


def effects_page() -> str:
    """Return the text of ``docs/effects.md``: every effect with its law, parameters, units, bounds, source."""
    heads = ("effect", "law", "parameter", "unit", "lowest", "highest", "default", "neutral", "source")
    kinds = [
        (kind, _where(kind), [_parameter_row(e, p) for e in effects_of(kind).values() for p in e.listed])
        for kind in dict.fromkeys(kind for kind, _ in CATALOGUE)
    ]
    return _filled("effects", heads=heads, kinds=kinds)


def settings_page() -> str:
    """Return the text of ``docs/settings.md``: every setting of the diagnosis with its value, unit and reason."""
    settings = DiagnoseSettings().to_json()
    rows = [(f"`{name}`", f"{one['value']:g}", one["unit"], one["reason"]) for name, one in settings.items()]
    return _filled("settings", rows=rows)


def configuration_page() -> str:
    """Return the text of ``docs/configuration.md``: groups, the settings of every command, the rig's file."""
    own_first = sorted(RUN.settings.values(), key=lambda one: "." in one.key)  # stable: a table a section
    sections = groupby(own_first, key=lambda one: one.key.rpartition(".")[0].partition(".")[0])
    common = [(f"`{word}`", about.meaning) for word, about in COMMON.items()]
    common.append(
        ("`hydra/launcher=NAME`", GROUPS["hydra/launcher"] + ": joblib, basic, submitit_local, submitit_slurm")
    )
    common.append(("`-m`", "a sweep: every combination of the comma-separated choices"))
    return _filled(
        "configuration",
        heads=("setting", "unit", "default", "allowed", "meaning"),
        options=_option_rows(),
        common=common,
        run_sections=[(section or "the run", [_setting_row(one) for one in rows]) for section, rows in sections],
        commands=[
            (command, [_setting_row(one) for key, one in command.settings.items() if not key.startswith("rig.")])
            for command in (GRAMMARS | FILES).values()
            if command is not RUN
        ],
        parts=[
            (name, _about(part.about), [_setting_row(one) for one in declared(part.schema)] if part.schema else [])
            for name, part in PARTS.items()
        ],
        ground=GROUND,
        kinds=[_kind_row(kind) for kind in KINDS.values()],
        quantities=[
            (f"`{kind.name}`", ", ".join(f"`{name}` [{unit}]" for name, unit in kind.quantities.items()))
            for kind in KINDS.values()
            if kind.quantities
        ],
    )


def claims_table(claims: pd.DataFrame) -> str:
    """Return the table of ``docs/paper.md`` from the rows of ``claims.csv``."""
    rows = [
        [*(str(claim[name]) for name in ("claim", "section", "paper", "ours", "tolerance")),
         "yes" if claim["pass"] else "**no**"]
        for claim in claims.to_dict("records")
    ]  # fmt: skip
    return table(("claim", "section", "the paper", "ours", "tolerance", "holds"), rows)


def number(value: float) -> str:
    """Return a bound as text: 1e-06 as 1e-06, infinity as a word."""
    return "unlimited" if value == float("inf") else f"{value:g}"


def first_sentence(yaml: str) -> str:
    """The first sentence of the comment that a file of ``conf`` begins with."""
    comment = re.match(r"(#.*\n)*", yaml)
    assert comment is not None
    lines = [line[1:].strip() for line in comment.group().splitlines() if "@package" not in line]
    return _SENTENCE_END.split(" ".join(lines), maxsplit=1)[0].removesuffix(".") + "."


def lead_screw_elements(kind: str) -> list[str]:
    """Return the names of the elements of a kind on the paper's rig."""
    elements = yaml_files.read((PACKAGED / "rig" / "lead_screw.yaml").read_bytes())["elements"]
    return [str(name) for name, element in elements.items() if element["kind"] == kind]


def _filled(name: str, **values: Any) -> str:
    """The page of a template; its tables come without the line break at their end."""
    loader = PackageLoader("dtbacklash", "docs")
    pages = Environment(loader=loader, undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True)
    return pages.get_template(f"{name}.md.j2").render(table=lambda *given: table(*given).rstrip("\n"), **values)


def _where(kind: str) -> str:
    if kind == "sensor":
        return "At `sensor_<name>`, for every sensor of the rig."
    places = ", ".join(f"`{place}`" for place in lead_screw_elements(kind))
    return f"{KINDS[kind].description}. " + (
        f"On the rig `lead_screw`: {places}." if places else "Not on `lead_screw`."
    )


def _parameter_row(effect: Effect, parameter: Parameter) -> list[str]:
    """A row of an effect's table; its name, its law and its source stand in the row of its size alone."""
    first = parameter is effect.size
    neutral = "" if parameter.neutral is None else number(parameter.neutral)
    if parameter.neutral is None:
        default = number(parameter.typical)
    else:
        default = "must be given" if len(effect.amplitudes) == 1 else f"{neutral}; one must be given"
    name = f"`{parameter.name}`" + (
        f" to `{parameter.name[0]}{KNOTS}`" if effect.is_table and parameter.name[1:] == "1" else ""
    )
    return [
        f"`{effect.name}`" if first else "", f"`{effect.law}`" if first else "", name, parameter.unit,
        number(parameter.low), number(parameter.high), default, neutral, effect.source if first else "",
    ]  # fmt: skip


def _option_rows() -> list[tuple[str, str, str]]:
    rows = []
    for group in RUN.groups:
        if group in FOLDERS:
            rows.append((f"`{group}`", f"those of `{FOLDERS[group]}`", f"{GROUPS[group]}."))
        for option in packaged_options(group):
            text = (PACKAGED / group / f"{option}.yaml").read_text(encoding="utf-8")
            rows.append((f"`{group}`", f"`{option}`", first_sentence(text)))
    return rows


def _setting_row(one: Declared) -> list[str]:
    about = one.about
    name = f"`{one.word}`" + (f" (`{one.key}`)" if one.word != one.key else "")
    name += f" (`{about.flag}`)" if about.flag else ""
    return [name, one.unit, "" if one.is_mapping else one.shown(), one.allowed(), about.meaning]


def _about(text: str) -> str:
    """What a part of ``dtb twin`` is, as sentences: its first line is a phrase of a list."""
    first, _, rest = text.partition("\n")
    return f"{first[0].upper()}{first[1:]}. {rest}".rstrip()


def _kind_row(kind: Kind) -> list[str]:
    fields = [
        f"`{name}` [{unit if isinstance(unit, str) else ' or '.join(unit)}]" for name, unit in kind.required.items()
    ]
    fields += [f"`{name}` [{unit}] (optional)" for name, unit in kind.optional.items()]
    return [f"`{kind.name}`", ", ".join(fields), ", ".join(f"`{n}`" for n in kind.neighbours), kind.description]
