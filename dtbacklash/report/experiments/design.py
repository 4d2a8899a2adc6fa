"""The experiment that tells rivals apart: its command, how sure its answer would be, and its page."""

from __future__ import annotations

import math
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Drawn

from dtbacklash.diagnosis.engine.selection import LEAST
from dtbacklash.diagnosis.experiments.design import Design, Tried
from dtbacklash.diagnosis.experiments.rivalry import Rivalry
from dtbacklash.diagnosis.explain.sentences import quantity
from dtbacklash.files import write_json
from dtbacklash.physics.element_kinds import KINDS
from dtbacklash.physics.simulate import simulate_roughly
from dtbacklash.report.components.blocks import Block, Code, Figure, Items, Table
from dtbacklash.report.components.page import embedded, render
from dtbacklash.report.components.style import COLOUR, SERIES, envelope, new_figure, save, styled

#: rivals that the figure shows
DRAWN = 3
TOLD = "told apart"
NOT_TOLD = "stays open"


def errors_of(tried: Tried) -> list[float]:
    """Standard errors by which each rival would be apart, the least first."""
    return sorted(math.sqrt(max(value, 0.0)) for value in tried.apart)


def write(found: Design, rivalry: Rivalry, folder: Path, command: str) -> None:
    """Write ``command.csv``, ``design.json``, ``figures/command.png`` and ``report.html``."""
    step, best = rivalry.seen.sample_time_s, found.best
    held = np.append(best.u, best.u[-1])
    pd.DataFrame({"t": np.round(step * np.arange(len(held)), 9), "u": held}).to_csv(folder / "command.csv", index=False)
    write_json(folder / "design.json", {
        "command": "command.csv", "kind": best.kind, "sample_time_s": step, "duration_s": step * len(best.u),
        "largest_command": float(np.abs(best.u).max()), "travel": best.travel, "speed": best.speed,
        "rivals": [
            {"model": rival.name, "standard_errors": math.sqrt(value), "evidence": value, "told_apart": value > LEAST}
            for rival, value in zip(rivalry.rivals, best.apart, strict=True)
        ],
        "drawn_multisine": None if found.beside is None else [math.sqrt(v) for v in found.beside.apart],
        "commands": {t.kind: [math.sqrt(v) for v in t.apart] for t in found.commands},
        "tries": found.tries, "sentences": sentences(found, rivalry), "repeat": command,
    })  # fmt: skip
    path = save(command_figure(found, rivalry), folder / "figures" / "command.png")
    told = "The command, and how each model differs from the found one in the sensor that tells most, in its noise."
    figure = Figure(embedded(path), told, "If a line leaves the band, that model would be seen to be wrong.")
    parts = [
        Block("How sure the answer would be", [rivals_table(found, rivalry), Items(sentences(found, rivalry))]),
        Block("The command", [figure, Code(run_command(found, rivalry, "found/rig.yaml", "command.csv"))]),
        Block("Run it again", [Code(command)], folded=True),
    ]
    page = render("The experiment that tells apart what is open", sentences(found, rivalry)[0], parts)
    (folder / "report.html").write_text(page, encoding="utf-8")


def rivals_table(found: Design, rivalry: Rivalry) -> Table:
    """Each model that is open, and how far it would be from the found one."""
    beside = found.beside.apart if found.beside else (math.nan,) * len(rivalry.rivals)
    rows = [
        [rival.name, f"{math.sqrt(value):.3g}", "-" if math.isnan(other) else f"{math.sqrt(other):.3g}",
         TOLD if value > LEAST else NOT_TOLD]
        for rival, value, other in zip(rivalry.rivals, found.best.apart, beside, strict=True)
    ]  # fmt: skip
    heads = "model that is open", "apart [standard errors]#", "by a multisine as drawn#", "the answer"
    return Table(heads, rows, "How far from what was found")


def sentences(found: Design, rivalry: Rivalry) -> list[str]:
    """How sure the answer would be, and what the machine would do."""
    best, told = found.best, sum(value > LEAST for value in found.best.apart)
    many = len(best.apart)
    all_ = "The model that is open" if many == 1 else f"All {many} models that are open" if told == many else (
        f"{told} of {many} models that are open")  # fmt: skip
    first = f"{all_} would be told from what was found, by {errors_of(best)[0]:.3g} standard errors at least." if (
        told == many) else f"{told} of {many} models that are open would be told from what was found."  # fmt: skip
    body = max(best.travel, key=lambda b: best.travel[b])
    largest = f"{np.abs(best.u).max():.3g} {rivalry.found.command_unit}"
    units = KINDS[rivalry.found.kind_at(body)].quantities
    goes, fast = quantity(best.travel[body], units["position"]), quantity(best.speed[body], units["velocity"])
    way = f"{body} goes {goes} from where it begins, at {fast} at most"
    moves = f"{best.kind} of {len(best.u) * rivalry.seen.sample_time_s:.3g} s, at most {largest}; {way}."
    said = [first, moves[:1].upper() + moves[1:]]
    if found.drifts:
        said.append(f"It is no longer, since {found.drifts} moves without a command.")
    if told < many:
        said.append("What stays open needs larger limits, more time, or another sensor.")
    return said


def run_command(found: Design, rivalry: Rivalry, rig: str, command: str) -> str:
    """The command line that simulates the experiment on the found rig."""
    step = rivalry.seen.sample_time_s
    words = [f"rig={rig}", "controller=open_loop", "reference=csv", f"reference.path={command}",
             f"duration_s={step * len(found.best.u):.9g}", f"sample_time_s={step:.9g}"]  # fmt: skip
    return shlex.join(["dtb", "run", *words])


@styled
def command_figure(found: Design, rivalry: Rivalry) -> Drawn:
    """The command above, and below it how the open models differ from the found one."""
    u, step, noise = found.best.u, rivalry.seen.sample_time_s, rivalry.seen.noise
    figure = new_figure(5.2)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.0, 1.3))
    t = step * np.arange(len(u))
    above.plot(*envelope(t, u), color=COLOUR["voltage"], lw=1.4)
    above.set_ylabel(f"u [{rivalry.found.command_unit}]")
    above.set_title("The command")
    own = simulate_roughly(rivalry.found, u, step).sensors
    for k, rival in enumerate(rivalry.rivals[:DRAWN]):
        other = simulate_roughly(rival.rig, u, step).sensors
        differs = {c: (other[c] - own[c])[:-1] / noise[c] for c in noise}
        most = max(differs, key=lambda c: float(np.std(differs[c])))
        below.plot(*envelope(t, differs[most]), color=SERIES[k], lw=1.4, label=f"{rival.name} ({most})")
    below.axhspan(-1.0, 1.0, color="#7b8794", alpha=0.25, lw=0)
    below.set_yscale("symlog", linthresh=1.0)
    below.set_ylabel("other than found\n[noise of the sensor]")
    below.set_xlabel("time [s]")
    below.set_title("What the models that are open would show before they are fitted anew")
    below.legend(loc="best", fontsize=9)
    return figure
