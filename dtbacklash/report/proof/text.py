"""The score as text: the rows of its tables, all of it as Markdown, and for the terminal."""

from __future__ import annotations

import math

from dtbacklash.prove.run import SCORING_FROM
from dtbacklash.prove.score import Quantity, Score, Share
from dtbacklash.report.components.blocks import Table
from dtbacklash.report.components.markdown import table
from dtbacklash.report.components.numbers import number

#: fewer recordings meet every bar by chance, or miss it
ENOUGH = 20
HEADS = ("figure", "share#", "count#", "95 % interval#", "bar#", "met", "over all sizes#")


def bar_text(bar: tuple[float, float] | None) -> str:
    """A bar in words."""
    if bar is None:
        return ""
    low, high = bar
    return f"at least {100 * low:.0f} %" if high >= 1.0 else f"{100 * low:.0f} to {100 * high:.0f} %"


def met_text(met: bool | None, bar: object) -> str:
    """Pass or miss; a dash where there was nothing to judge, nothing where there is no bar."""
    if bar is None:
        return ""
    return "-" if met is None else "pass" if met else "**miss**"


def plain(row: list[str]) -> list[str]:
    """A row without Markdown's stars."""
    return [cell.replace("*", "") for cell in row]


def few(score: Score) -> str:
    """What is said in the place of bars where there are too few recordings to judge them; empty elsewhere."""
    return f"{score.cases} recordings are too few to judge a bar" if score.cases < ENOUGH else ""


def percent(share: float) -> str:
    """A share in percent."""
    return "-" if math.isnan(share) else f"{100 * share:.1f} %"


def figure_row(figure: Share) -> list[str]:
    """A share's row: what, value, count, interval, bar, verdict, and the same over all cases."""
    low, high = figure.interval
    every = "" if figure.every_of is None else f"{figure.every_right}/{figure.every_of}"
    interval = f"{100 * low:.1f} to {100 * high:.1f} %" if figure.of else "-"
    return [figure.what, percent(figure.share), f"{figure.right}/{figure.of}", interval, bar_text(figure.bar),
            met_text(figure.met, figure.bar), every]  # fmt: skip


def rig_rows(score: Score) -> list[list[str]]:
    """The shares of each rig, a group of rows a rig, of what was counted there; its name stands in the first."""
    found = []
    for rig, figures in score.rigs.items():
        counted = [figure_row(f) for f in figures if f.of or f.every_of]
        found += [[rig if j == 0 else "", *row] for j, row in enumerate(counted)]
    return found


def rig_counts(score: Score) -> list[list[str]]:
    """The counts of each rig: a row a figure, a column a rig, empty where nothing was counted."""
    counts: dict[str, dict[str, str]] = {}
    for rig, figures in score.rigs.items():
        for f in figures:
            if f.of:
                stars = "**" if f.bar is not None and f.met is False else ""
                counts.setdefault(f.what, {})[rig] = f"{stars}{f.right}/{f.of}{stars}"
    return [[what, *(of.get(rig, "") for rig in score.rigs)] for what, of in counts.items()]


def quantity_row(q: Quantity) -> list[str]:
    """A distribution's row: what, median, 90 % quantile, unit, cases, bar, verdicts of both."""
    bar = "" if q.at_most is None else f"at most {number(q.at_most)}"
    met = " / ".join(met_text(q.met(v), q.at_most) for v in (q.median, q.ninety)) if q.at_most is not None else ""
    return [q.what, number(q.median), number(q.ninety), "" if q.unit == "1" else q.unit, str(q.of), bar, met]


def reliability_rows(score: Score) -> list[list[str]]:
    """How many of the names of a confidence are right, in all and by part of the rig."""
    rows = []
    for r in score.reliability:
        low, high = r.interval
        share, interval = percent(r.right / r.of), f"{100 * low:.1f} to {100 * high:.1f} %"
        rows.append([r.confidence, r.family, share, f"{r.right}/{r.of}", interval])
    return rows


def which_seeds(score: Score) -> str:
    """One sentence: which seeds were scored, and whether the tool may have been tuned on them."""
    if score.seeds is None:
        return "No recording."
    low, high = score.seeds
    if low >= SCORING_FROM:
        development = f"development seeds, on which the tool is tuned, are those below {SCORING_FROM}"
        return f"Scoring seeds {low} to {high}; {development}."
    there = "development seeds" if high < SCORING_FROM else f"development seeds below {SCORING_FROM}"
    return f"Seeds {low} to {high}, with {there}: the tool may have been tuned on them."


def markdown(score: Score) -> str:
    """The score as Markdown: what was counted, the shares with their bars, the errors and times."""
    kinds = ", ".join(
        f"{score.kinds[k]} {words}" + (f" ({score.clear[k]} clear)" if k in ("single", "several", "unknown") else "")
        for k, words in KIND_WORDS.items()
    )
    failed = f" Diagnoses that failed, and count as wrong: {score.failed or 'none'}."
    if score.oracle_failed:
        failed += f" Cases that are not clear because the oracle itself failed: {score.oracle_failed}."
    small = f" ({score.lifelike} lifelike, with small things beside what is hidden)" if score.lifelike else ""
    command = score.notes.get("command")
    return "\n".join([
        *([f"```sh\n{command}\n```\n"] if command else []),
        f"{score.cases} recordings{small}: {kinds}. {which_seeds(score)}{failed}\n",
        table(("figure", "share", "count", "95 % interval", "bar", "", "over all sizes"),
              map(figure_row, score.figures)),
        *([table(("count of each rig, **bold** below its bar", *score.rigs), rig_counts(score))] if score.rigs else []),
        table(("figure", "median", "90 % quantile", "unit", "cases", "bar", ""), map(quantity_row, score.quantities)),
        *([table(("confidence", "part of the rig", "names that are right", "count", "95 % interval"),
                 reliability_rows(score))] if score.reliability else []),
    ])  # fmt: skip


KIND_WORDS = {
    "nothing": "hide nothing", "parameters": "only wrong parameters", "single": "one effect",
    "several": "two or three effects", "unknown": "physics that the catalogue lacks",
}  # fmt: skip


def shares_table(score: Score) -> Table:
    """The shares with their bars."""
    return Table(HEADS, [plain(figure_row(f)) for f in score.figures], "Blind proof")


def terminal(score: Score) -> list[str]:
    """Errors and times, a line each."""
    lines = [f"{few(score)}: pass and miss say little."] if few(score) else []
    for q in score.quantities:
        what, median, ninety, unit, of, bar, met = plain(quantity_row(q))
        judged = f"; {bar}: {met}" if bar else ""
        lines.append(" ".join(f"{what}: median {median}, 90 % {ninety} {unit}".split()) + f" ({of} cases{judged})")
    return lines
