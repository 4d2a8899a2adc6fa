"""The page ``configuration.md``: groups, settings of every command, the file of a rig; all from the code."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import groupby

from dtbacklash.config.grammar import COMMON, FILES, GRAMMARS, RUN, Grammar
from dtbacklash.config.groups import FOLDERS, GROUPS, PACKAGED, packaged_options
from dtbacklash.config.setting import Declared, declared
from dtbacklash.config.twin import PARTS
from dtbacklash.physics.kinds import GROUND, KINDS
from dtbacklash.report.kit.markdown import table

HEADS = ("setting", "unit", "default", "allowed", "meaning")
#: a full stop that ends a sentence, and none of an abbreviation
_SENTENCE_END = re.compile(r"(?<!\bFig)(?<!\be\.g)(?<!\bi\.e)\.\s")


def page() -> str:
    """The text of the page, without its first line."""
    parts = ["# Configuration\n", INTRO, "## Groups\n"]
    parts.append(table(("group", "option", "what it is"), _option_rows()))
    parts += ["## What every command takes\n", EVERY_INTRO, table(("word", "meaning"), _common_rows())]
    parts += ["## dtb run\n", SETTINGS_INTRO, *_sections(RUN)]
    for grammar in (GRAMMARS | FILES).values():
        if grammar is not RUN:
            parts += [f"## dtb {grammar.name}\n", *_of_command(grammar)]
    parts += ["## dtb twin\n", TWIN_INTRO, *_of_the_twin()]
    parts += ["## A rig of your own\n", RIG_INTRO]
    parts.append(table(("kind", "fields", "neighbours", "what it is"), _kind_rows()))
    parts += ["Sensors:\n", table(("`of` an element of kind", "`quantity` and its unit in the simulation"), [
        (f"`{k.name}`", ", ".join(f"`{q}` [{u}]" for q, u in k.quantities.items()))
        for k in KINDS.values() if k.quantities
    ])]  # fmt: skip
    return "\n".join(parts)


def _option_rows() -> list[list[str]]:
    rows = []
    for group in RUN.groups:
        if group in FOLDERS:
            rows.append([f"`{group}`", f"those of `{FOLDERS[group]}`", f"{GROUPS[group]}."])
        for option in packaged_options(group):
            text = (PACKAGED / group / f"{option}.yaml").read_text(encoding="utf-8")
            rows.append([f"`{group}`", f"`{option}`", first_sentence(text)])
    return rows


def first_sentence(yaml: str) -> str:
    """The first sentence of the comment that a file of ``conf`` begins with."""
    comment: list[str] = []
    for line in yaml.splitlines():
        if not line.startswith("#"):
            break
        if "@package" not in line:
            comment.append(line[1:].strip())
    return _SENTENCE_END.split(" ".join(comment), maxsplit=1)[0].removesuffix(".") + "."


def _common_rows() -> list[list[str]]:
    rows = [[f"`{word}`", about.meaning] for word, about in COMMON.items()]
    rows += [["`hydra/launcher=NAME`", GROUPS["hydra/launcher"] + ": joblib, basic, submitit_local, submitit_slurm"]]
    return [*rows, ["`-m`", "a sweep: every combination of the comma-separated choices; see below"]]


def _sections(grammar: Grammar) -> Iterator[str]:
    """A table a section of the schema; the command's own settings first."""
    listed = sorted(grammar.settings.values(), key=lambda one: "." in one.key)  # stable
    for section, settings in groupby(listed, key=lambda one: one.key.rpartition(".")[0].partition(".")[0]):
        yield f"### {section or 'the run'}\n"
        yield table(HEADS, map(_row, settings))


def _of_command(grammar: Grammar) -> Iterator[str]:
    """One table; the settings of the rig are those of ``dtb run``."""
    yield f"{grammar.about}\n\n```sh\n" + "\n".join(grammar.examples) + "\n```\n"
    rows = [_row(one) for one in grammar.settings.values() if not one.key.startswith("rig.")]
    if rows:
        yield table(HEADS, rows)
    if "rig" in grammar.groups:
        yield "And the group `rig`, with `rig.parameters...` and `rig.effects...`, as in `dtb run`.\n"
    if not grammar.one_file:
        yield f"Results go to `out=FOLDER`, by default `{grammar.folder}`.\n"


def _of_the_twin() -> Iterator[str]:
    """A table a part; what is written to be read first is its first line."""
    for name, part in PARTS.items():
        first, _, rest = part.about.partition("\n")
        yield f"### dtb twin {name}\n\n{first[0].upper()}{first[1:]}. {rest}".rstrip() + "\n"
        if part.schema is not None:
            yield table(HEADS, map(_row, declared(part.schema)))


def _row(one: Declared) -> list[str]:
    about = one.about
    name = f"`{one.word}`" + (f" (`{one.key}`)" if about.word and about.word != one.key else "")
    name += f" (`{about.flag}`)" if about.flag else ""
    return [name, about.unit, "" if one.is_mapping else one.shown(), one.allowed(), about.meaning]


def _kind_rows() -> list[list[str]]:
    rows = []
    for kind in KINDS.values():
        fields = [
            f"`{name}` [{unit if isinstance(unit, str) else ' or '.join(unit)}]" for name, unit in kind.required.items()
        ]
        fields += [f"`{name}` [{unit}] (optional)" for name, unit in kind.optional.items()]
        rows.append(
            [f"`{kind.name}`", ", ".join(fields), ", ".join(f"`{n}`" for n in kind.neighbours), kind.description]
        )
    return rows


INTRO = """\
Everything that a command can be told. All but `dtb recordings`, `dtb export` and `dtb twin` have one grammar, that of
[Hydra](https://hydra.cc): a group is chosen by `group=option`, a setting by `key=value`; `--cfg job` prints the result
and runs nothing:

```sh
dtb run --cfg job controller=imc profile=ramp
dtb diagnose --cfg job recording=emps
```

A folder `conf` in the current directory extends the groups: `conf/rig/mine.yaml` is `rig=mine`, and an option of ours
of the same name is replaced. `rig=` also takes the path of a YAML file. A path may hold blanks, umlauts and whatever a
shell lets through; a comma separates the choices of a sweep, unless quotes stand around the path:
`recording="'a,b.csv'"`. `dtb --install-completion` lets bash and zsh complete all of it.
"""

EVERY_INTRO = """\
A sweep runs every combination, two or more at a time, and ends with one table (`sweep.csv`) and one page. Finished jobs
are kept when one fails or you press Ctrl-C; the same command again does only what is missing:

```sh
dtb run -m controller=imc,nimc_fixed profile=s_curve,step
dtb diagnose -m recording=a.csv,b.csv
```
"""

TWIN_INTRO = """\
The twin as a process of its own; [remote.md](remote.md) says how. Its parts take `key=value`, no groups and no sweeps.
"""

SETTINGS_INTRO = """\
The defaults here are the schema's; an option of a group may set others. A value outside what is allowed ends in one
line and exit code 2.
"""

RIG_INTRO = f"""\
A rig is one YAML file with `parameters`, `elements`, `effects` and `sensors`; `dtbacklash/conf/rig/lead_screw.yaml` is
an example to copy. Elements name parameters, so that two links may share one stiffness. `tolerance` is relative, one
standard deviation. A parameter of an effect is a number, or `{{value: 0.02, tolerance: 0.1}}`; a diagnosis takes 0.3
(of an angle 0.3 rad) where there is none. `between` joins two masses or carriages, or one of them and `{GROUND}`. At
most one amplifier, motor_circuit, actuator, rotor, gear and screw. The controllers `imc` and `nimc` need a motor, a
screw that carries a mass, and a chain of links from there; other rigs run with `controller=open_loop`. `recorded_in`
of a sensor is the unit of its column in recordings that say nothing of units (default: SI);
[recordings.md](recordings.md#units) lists them.
"""
