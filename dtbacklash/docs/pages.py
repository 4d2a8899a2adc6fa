"""The pages of ``docs/`` that are made from the code, so that they cannot disagree with it.

``python -m dtbacklash.docs [FOLDER]`` writes ``effects.md``, ``configuration.md`` and ``settings.md`` (default folder:
``docs``).
A test compares the committed pages with what these functions return.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from dtbacklash.diagnose.settings import DiagnoseSettings
from dtbacklash.docs import configuration
from dtbacklash.physics.catalogue import CATALOGUE, effects_of
from dtbacklash.physics.effects.declare import Effect, Parameter
from dtbacklash.physics.kinds import KINDS
from dtbacklash.report.kit.markdown import table

if TYPE_CHECKING:
    import pandas as pd

MADE = "<!-- Made by `python -m dtbacklash.docs`. Change the code, not this page. -->\n"


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
    default = _default(effect, parameter)
    neutral = number(parameter.neutral) if parameter.neutral is not None else ""
    head = [f"`{effect.name}`", f"`{effect.law}`"] if first else ["", ""]
    return [*head, f"`{parameter.name}`", parameter.unit, number(parameter.low), number(parameter.high), default,
            neutral, effect.source if first else ""]  # fmt: skip


def _default(effect: Effect, parameter: Parameter) -> str:
    if parameter.neutral is None:
        return number(parameter.typical)
    return "must be given" if len(effect.amplitudes) == 1 else f"{number(parameter.neutral)}; one must be given"


def configuration_page() -> str:
    """Return the text of ``docs/configuration.md``: groups, the settings of every command, the rig's file."""
    return f"{MADE}\n{configuration.page()}"


def settings_page() -> str:
    """Return the text of ``docs/settings.md``: every setting of the diagnosis with its value, unit and reason."""
    rows = (
        (f"`{name}`", f"{said['value']:g}", said["unit"], said["reason"])
        for name, said in DiagnoseSettings().to_json().items()
    )
    return "\n".join([MADE, "# Settings of the diagnosis\n", SETTINGS_INTRO,
                      table(("setting", "value", "unit", "what it is, and why"), rows)])  # fmt: skip


def claims_table(claims: pd.DataFrame) -> str:
    """Return the table of ``docs/paper.md`` from the rows of ``claims.csv``."""
    rows = [
        (str(c["claim"]), str(c["section"]), str(c["paper"]), str(c["ours"]), str(c["tolerance"]),
         "yes" if c["pass"] else "**no**")
        for c in claims.to_dict("records")
    ]  # fmt: skip
    return table(("claim", "section", "the paper", "ours", "tolerance", "holds"), rows)


EFFECTS_INTRO = """\
What a rig may do beside its linear model. An effect is switched on by its size (the first parameter, or another one
that has a neutral value), on the command line or in the rig's YAML:

```sh
dtb run rig.effects.motor_bearing.coulomb_friction.torque=0.02 controller.internal_model=inner_loop
```

`rig.effects.ELEMENT.EFFECT.PARAMETER=VALUE`, in SI. Parameters that are not given take the default. At the neutral
value (at both, where there are two) the effect does nothing, to the last bit: it is left out of the compiled arrays.
`v`, `q`, `s` are a body's speed and position and a link's stretch; a bound is inclusive. What each effect assumes:
[simulation.md](simulation.md).
"""


SETTINGS_INTRO = """\
The numbers that decide a verdict, a name, an estimate or an interval, in the order in which [a diagnosis](diagnosis.md)
uses them; floors are the noise floor's. They stand in every `diagnosis.json` (`settings`). Scales of
time are ratios to the recording's own tempo, rad/s. What halving and doubling them does: [ablation.md](ablation.md).

```python
from dataclasses import replace
from dtbacklash.diagnose.settings import DiagnoseSettings, using

with using(replace(DiagnoseSettings(), earn_errors=3.0)):
    found = dtb.diagnose(recording, rig)
```
"""


def write(folder: Path) -> list[Path]:
    """Write the pages into ``folder``; returns the files."""
    pages = {"effects.md": effects_page(), "configuration.md": configuration_page(), "settings.md": settings_page()}
    for name, text in pages.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in pages]
