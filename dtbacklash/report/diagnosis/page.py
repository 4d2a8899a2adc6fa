"""The page of a diagnosis, its figures, and beside them the files that the diagnosis itself is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Drawn

from dtbacklash.diagnosis.explain.save import save
from dtbacklash.diagnosis.labels import named_in_words
from dtbacklash.diagnosis.plot_data import Curve
from dtbacklash.diagnosis.result import CONSISTENT, MISSING, PARAMETERS, UNEXPLAINED, Diagnosis
from dtbacklash.report.components.blocks import Block, Code, Figure, Part, Side
from dtbacklash.report.components.page import embedded, fragment, render
from dtbacklash.report.components.style import png
from dtbacklash.report.components.style import save as save_figure
from dtbacklash.report.diagnosis import words
from dtbacklash.report.diagnosis.blocks import folded, law_caption
from dtbacklash.report.diagnosis.figures import NARROW, curve_figure, judged_figure, law_figure
from dtbacklash.report.diagnosis.rig_drawing import draw_rig

BADGES = {
    CONSISTENT: ("consistent", "good"),
    PARAMETERS: ("recalibrated", "fair"),
    MISSING: ("missing physics", "warm"),
    UNEXPLAINED: ("unexplained", "bad"),
}


def write(diagnosis: Diagnosis, folder: Path) -> None:
    """Write ``diagnosis.json``, ``rig.yaml``, ``figures/*.png`` and ``report.html`` into an existing folder."""
    save(diagnosis, folder)
    stopped = [("stopped early", "bad")] if diagnosis.stopped else []
    parts = first_screen(diagnosis, folder) + folded(diagnosis, *_figures(diagnosis, folder / "figures"))
    page = render(words.heading(diagnosis), words.lead(diagnosis), parts, [*stopped, BADGES[diagnosis.verdict]])
    (folder / "report.html").write_text(page, encoding="utf-8")


def first_look(diagnosis: Diagnosis) -> str:
    """The verdict, a row a cause and the figure of what was not fitted, as HTML for a notebook."""
    curve = judged_curve(diagnosis)
    drawn = png(judged_figure(curve, words.sensor_unit(diagnosis, curve.name))) if curve else png(rig_figure(diagnosis))
    return fragment(
        words.heading(diagnosis) + ".", words.causes(diagnosis), Figure(embedded(drawn), words.lead(diagnosis))
    )


def first_screen(diagnosis: Diagnosis, folder: Path) -> list[Part]:
    """Causes; one figure beside what is left, what to record next, and the command that uses the result."""
    table, rest, curve = words.causes(diagnosis), words.left(diagnosis), judged_curve(diagnosis)
    right: list[Part] = [
        Block("What is left", [rest]),
        Block("What next", [diagnosis.next_experiment, Code(words.design_command(diagnosis, "."))]),
        Block(
            "Use it",
            [Code("" if diagnosis.fault else words.next_command(diagnosis, "rig.yaml"))],
            "in this page's folder",
        ),
    ]
    if not table.rows and not rest.rows:
        right.insert(0, diagnosis.summary)
    checked = words.failing(diagnosis)
    if curve is None:
        return [table, *right, checked]
    unit = words.sensor_unit(diagnosis, curve.name)
    path = save_figure(judged_figure(curve, unit), folder / "figures" / "judged.png")
    held = "The part that was not fitted" if curve.held_out_from_s is not None else "A part of the recording"
    figure = Figure(
        embedded(path), f"{held}, {words.judged_how(diagnosis)}; below it what the model leaves.",
        narrow=embedded(png(judged_figure(curve, unit, NARROW))),
    )  # fmt: skip
    return [table, Side([figure], right), checked]


def judged_curve(diagnosis: Diagnosis) -> Curve | None:
    """The channel that is shown first: the one that the nominal model misses most beside its motion."""
    curves = words.judged(diagnosis)
    missed = {c.name: words.mean_square(c.measured - c.nominal) / (float(np.nanvar(c.measured)) or 1.0) for c in curves}
    return max(curves, key=lambda c: missed[c.name], default=None)


def _figures(diagnosis: Diagnosis, folder: Path) -> tuple[Figure, list[Figure], list[Figure]]:
    """Draw and save the rig, every channel, every law."""
    shown, model = diagnosis.shown, words.better_model(diagnosis)
    told = "The percentages divide what is explained among the elements." if shown.evidence else (
        "Nothing is coloured, because what is left is noise.")  # fmt: skip
    rig = Figure(
        embedded(save_figure(rig_figure(diagnosis), folder / "rig.png")),
        f"The rig from the command to the last mass, with its sensors above and what was found below. {told}",
    )
    curves = [
        Figure(
            embedded(save_figure(curve_figure(c, model), folder / f"curve_{c.name}.png")),
            "measured and modelled above, and below what each model leaves unexplained, on scales of their own. The "
            "right-hand side enlarges the dotted window.",
            "If the model is right, what it leaves fills the green band evenly and looks the same in grey (held out) "
            "as before.", f"{c.name}:",
        )
        for c in shown.curves
    ]  # fmt: skip
    laws = []
    for index, law in enumerate(shown.laws):
        path = save_figure(law_figure(law), folder / f"law_{index + 1}_{law.location}.png")
        caption = law_caption(diagnosis, law.effect, law.state_label)
        laws.append(Figure(embedded(path), *caption, words.capital(named_in_words(law.effect, law.location)) + ":"))
    return rig, curves, laws


def rig_figure(diagnosis: Diagnosis) -> Drawn:
    """The rig, with the evidence at each element and what was found there."""
    return draw_rig(diagnosis.nominal, diagnosis.shown.evidence, words.labels(diagnosis.findings))
