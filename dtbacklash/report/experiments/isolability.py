"""What a planned experiment would show: its files, its page, and what the terminal says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure as Drawn

from dtbacklash.diagnosis.experiments.isolability import ALIKE, SHOWS, Effect, Isolability
from dtbacklash.diagnosis.explain.sentences import quantity
from dtbacklash.diagnosis.labels import named_in_words
from dtbacklash.files import json_able, write_json
from dtbacklash.report.components.blocks import Block, Code, Figure, Items, Table
from dtbacklash.report.components.page import embedded, render
from dtbacklash.report.components.style import INK, MUTED, colour_bar, new_figure, save, styled

#: sentences that the terminal and the top of the page show
SENTENCES = 8
#: from what is confused to what is at right angles
SINES = LinearSegmentedColormap.from_list("sines", ["#d55e00", "#f3d3b8", "#f4f6f8"])
#: inch a row, and beside the matrix for names
SIDE, NAMES = 0.24, 4.2


def write(found: Isolability, folder: Path, command: str) -> None:
    """Write ``isolability.json``, ``effects.csv``, ``matrix.csv``, ``figures/matrix.png`` and ``report.html``."""
    document = document_of(found)
    write_json(folder / "isolability.json", document | {"command": command})
    pd.DataFrame(document["effects"]).to_csv(folder / "effects.csv", index=False)
    names = [f"{e.location}.{e.effect}" for e in found.effects]
    pd.DataFrame(found.sines, index=names, columns=names).to_csv(folder / "matrix.csv", index_label="effect")
    figures = []
    if len(found.effects) > 1:
        path = save(matrix_figure(found), folder / "figures" / "matrix.png")
        figures = [Figure(embedded(path), "Sines of the angles between what the effects do to the readings, beside the "
                          "rig's parameters within their tolerances. 1: at right angles; 0: one stands for the other.",
                          "If nothing is orange, each effect that shows can be named.")]  # fmt: skip
    parts = [
        Block("What it would confuse", [Items(sentences(found)), *figures]),
        Block("From which size on an effect shows", [effects_table(found)]),
        Block("The same for each pair", [Items([p.sentence for p in found.pairs])], folded=True),
        Block("Run it again", [Code(command)], folded=True),
    ]
    page = render("What the planned experiment would show", lead(found), parts)
    (folder / "report.html").write_text(page, encoding="utf-8")


def document_of(found: Isolability) -> dict[str, Any]:
    """``isolability.json``: effects with sizes in SI, pairs with sines, sentences."""
    return {
        "effects": [json_able(e) for e in found.effects],
        "confused": [
            {"first": ".".join(p.first), "second": ".".join(p.second), "sine": p.sine, "advice": p.advice,
             "sentence": p.sentence}
            for p in found.pairs
        ],
        "hidden": [".".join(key) for key in found.hidden],
        "one_way": list(found.one_way),
        "sentences": sentences(found),
        "settings": {"shows": SHOWS, "alike": ALIKE, "readings": found.readings, "every": found.every},
    }  # fmt: skip


def lead(found: Isolability) -> str:
    """The result in one line."""
    taken = len(found.effects) + len(found.hidden)
    return (f"{len(found.effects)} of {taken} effects show at some size; of these, {len(found.pairs)} pairs would be "
            "confused.")  # fmt: skip


def sentences(found: Isolability) -> list[str]:
    """The pairs that would be confused, those with advice first, and what never shows."""
    said = [p.sentence for p in found.pairs[:SENTENCES]]
    if len(found.pairs) > SENTENCES:
        said.append(f"{len(found.pairs) - SENTENCES} more pairs would be confused (matrix.csv, report.html).")
    if found.hidden:
        named = ", ".join(named_in_words(effect, place) for place, effect in found.hidden)
        said.append(f"No size shows here: {named}.")
    if found.one_way:
        said.append(f"Never reverses: {', '.join(found.one_way)}.")
    return said or ["Each effect that shows can be told from every other."]


def effects_table(found: Isolability) -> Table:
    """The sizes from which on effects show, and would be named."""
    rows = [
        [named_in_words(e.effect, e.location), _size(e, e.shows_from), _size(e, e.named_from),
         ", ".join(f"{n} {v:.3g}" for n, v in e.at.items())]
        for e in found.effects
    ]  # fmt: skip
    heads = "effect", "shows", "is named", "with"
    title = f"From which size on an effect shows ({SHOWS:g} standard errors), and a diagnosis would take it up"
    return Table(heads, rows, title)


def _size(effect: Effect, size: float | None) -> str:
    if size is None:
        return "at no size"
    return ("" if effect.rises else "up to ") + quantity(size, effect.unit)


@styled
def matrix_figure(found: Isolability) -> Drawn:
    """The sines between all effects that show, place by place; what would be confused is orange, with its number."""
    n = len(found.effects)
    figure = new_figure(NAMES - 0.4 + SIDE * n, width=NAMES + 1.2 + SIDE * n)
    ax = figure.subplots()
    shown = np.where(np.eye(n, dtype=bool), np.nan, found.sines)
    image = ax.imshow(shown, cmap=SINES, vmin=0.0, vmax=1.0)
    for i, j in zip(*np.nonzero((found.sines < ALIKE) & ~np.eye(n, dtype=bool)), strict=True):
        text = f"{found.sines[i, j]:.2f}".lstrip("0")
        ax.text(j, i, text, ha="center", va="center", fontsize=6.5, color="white")
    names = [named_in_words(e.effect, e.location) for e in found.effects]
    ax.set_xticks(range(n), names, rotation=90, fontsize=9)
    ax.set_yticks(range(n), names, fontsize=9)
    places = [e.location for e in found.effects]
    for k in (k for k in range(1, n) if places[k] != places[k - 1]):
        ax.axhline(k - 0.5, color=MUTED, lw=0.8)
        ax.axvline(k - 0.5, color=MUTED, lw=0.8)
    ax.grid(False)
    ax.tick_params(length=0)
    bar = colour_bar(image, ax, "sine of the angle between two effects", shrink=0.5)
    bar.ax.axhline(ALIKE, color=INK, lw=1.0)
    ax.set_title(f"What this experiment would confuse: sines below {ALIKE:g}\n"
                 f"({len(found.pairs)} pairs of {n} effects that show at {SHOWS:g} standard errors)")  # fmt: skip
    return figure
