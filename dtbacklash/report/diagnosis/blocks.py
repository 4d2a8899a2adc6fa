"""A diagnosis as blocks below its first screen: how sure, every signal and law, parameters, checks, how it was done."""

from __future__ import annotations

from math import isfinite

from dtbacklash import units
from dtbacklash.diagnosis.findings import Finding, Recalibrated
from dtbacklash.diagnosis.labels import listed, named_in_words, other_in_words, place_in_words
from dtbacklash.diagnosis.result import UNEXPLAINED, Diagnosis
from dtbacklash.diagnosis.settings import SETTINGS
from dtbacklash.files import json_text
from dtbacklash.physics.effects.declare import name_in_words
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.rig_file import rig_yaml
from dtbacklash.report.components.blocks import Block, Code, Figure, Items, Table
from dtbacklash.report.components.intervals import interval
from dtbacklash.report.components.numbers import change, number
from dtbacklash.report.diagnosis.methods import methods
from dtbacklash.report.diagnosis.words import better_model, capital, checks_said, error_text, formula_values, grounds

MODELS = ("nominal", "recalibrated", "extended", "modelled")
#: from this many times the signal on, an error is only said to be over it
BEYOND = 10.0
#: candidates that are shown at once, and correlations worth a row
SHOWN_CANDIDATES, CORRELATED = 10, 0.5
#: what a rig's errors on its own are
FREELY = "simulated from the first sample by the commands alone."
IN_WINDOWS = (
    "simulated by the commands alone for {length} s at a time, each time from a state that the readings before make "
    "known; a machine that nothing pulls back drifts away over the whole recording although its physics is right."
)
SETTING = ("setting", "value#", "unit", "what it is")
PARAMETER = ("parameter", "what it is", "nominal#", "value, 95 % interval#", "change#", "tolerance#")


def folded(diagnosis: Diagnosis, rig: Figure, curves: list[Figure], laws: list[Figure]) -> list[Block]:
    """The sections below the first screen. rig, curves, laws : the figures."""
    text, works = methods(diagnosis)
    settings = [[f"`{n}`", str(s["value"]), s["unit"], s["reason"]] for n, s in SETTINGS.to_json().items()]
    passed = sum(c.passed for c in diagnosis.checks)
    sections = [
        Block("How sure is it, and where?", [*_sure(diagnosis), rig], folded=True, id="sure"),
        Block("Every signal, and the errors", [*errors(diagnosis), *curves], folded=True, id="fit"),
        Block("The laws, and what the recording shows of them", [*_modelled(diagnosis), *laws], folded=True, id="laws"),
        Block("Parameters", _calibration(diagnosis), "and what the recording does not tell", True, "parameters"),
        Block("Checks", [_checks(diagnosis)], f"{passed} of {len(diagnosis.checks)} pass", True, "checks"),
        Block("What was considered", _considered(diagnosis), f"{len(diagnosis.candidates)} effects", True, "tried"),
        Block("The recording", [Items(diagnosis.notes), _units(diagnosis)], folded=True, id="recording"),
        Block("Methods", [text, Items(works, numbered=True)], folded=True, id="methods"),
        Block("Files and settings", [
            Block("rig.yaml", [Code(rig_yaml(diagnosis.rig))], folded=True),
            Block("The settings of this diagnosis", [Table(SETTING, settings)], folded=True),
            Block("diagnosis.json", [Code(json_text(diagnosis.to_json()))], folded=True),
        ], folded=True, id="files"),
    ]  # fmt: skip
    return [section for section in sections if not section.empty]


def _sure(diagnosis: Diagnosis) -> list[str]:
    """What each cause rests on, and what was said of the whole."""
    told = [diagnosis.summary]
    for f in diagnosis.findings:
        told.append(
            " ".join(filter(None, (grounds(f), f"{f.when[:1].upper()}{f.when[1:]}." if f.when else "", _alike(f))))
        )
    told += [f"{name}: {_alike(row)}" for name, row in diagnosis.recalibrated.items() if row.also_fits]
    failed = [c.check for c in diagnosis.checks if not c.passed]
    if diagnosis.checks:
        told.append(checks_said(len(diagnosis.checks), failed))
    return told


def _alike(row: Finding | Recalibrated) -> str:
    """What a finding or a parameter cannot be told from, if there is anything."""
    others = "; ".join(other_in_words(a) for a in row.also_fits)
    return f"This recording cannot tell it from {others}." if others else ""


def errors(diagnosis: Diagnosis) -> list[str | Table]:
    """The errors of all models, compared and on their own; of each of several recordings; held out, in noise floors."""
    fit, free, best = diagnosis.fit, diagnosis.free_running, better_model(diagnosis)
    there = {"extended": best == "extended", "modelled": diagnosis.modelled is not None}
    models = [model for model in MODELS if there.get(model, True)]
    rows = [
        [words, *(error_text(getattr(one, m), fit.metric) for m in models), error_text(fit.noise_floor, fit.metric)]
        for words, one in (("fitted to", fit.train), ("held out", fit.held_out))
    ]
    own = "on its own" if not free or free.window_s is None else f"on its own for {number(free.window_s)} s"
    alone = ((f"fitted to, {own}", free.train), (f"held out, {own}", free.held_out)) if free else ()
    rows += [[words, *(_alone(getattr(one, m)) for m in models), ""] for words, one in alone]
    what = "normalised rms error" if fit.metric == "nrmse" else fit.metric
    heads = [f"{m}#" for m in models]
    in_floors = [m for m in models if m != "modelled"]
    floors = [[c, *(number(getattr(one, m)) for m in in_floors)] for c, one in diagnosis.shown.floors.items()]
    return [
        Table((what, *heads, "noise floor#"), rows),
        f"The errors are those of {listed(list(fit.channels))}, relative to their standard deviations. On its own: "
        + (FREELY if not free or free.window_s is None else IN_WINDOWS.format(length=number(free.window_s))),
        Table(("held-out rms error, noise floors", *(f"{m}#" for m in in_floors)), floors),
        _recordings(diagnosis),
        in_each(diagnosis),
    ]


def _alone(value: float | None) -> str:
    """The error of a model that runs freely, which may be anything."""
    if value is None:
        return "runs away"
    return error_text(value, "nrmse") if value < BEYOND else f"over {100 * BEYOND:.0f} %"


def _recordings(diagnosis: Diagnosis) -> Table:
    """A row of each of several recordings: samples, sample time, held-out errors of the models, zeros."""
    columns = MODELS[:3] if diagnosis.findings else MODELS[:2]
    rows = []
    for k, one in enumerate(diagnosis.recordings, 1):
        said = [error_text(getattr(one.held_out, c), diagnosis.fit.metric) if one.held_out else "-" for c in columns]
        zeros = [f"{c} {interval(float(z['value']), None, str(z['unit']))}" for c, z in one.zeros.items()]
        rows.append(
            [str(k), one.name, str(one.samples), interval(one.sample_time_s, None, "s"), *said, ", ".join(zeros) or "-"]
        )
    return Table(("no.", "recording", "samples#", "sample time#", *(f"{c}#" for c in columns), "zeros"), rows)


def in_each(diagnosis: Diagnosis, plain: bool = False) -> Table:
    """What each of several recordings says of each cause: a row a recording, a column a cause."""
    titles = list(dict.fromkeys(title for one in diagnosis.recordings for title in one.causes))
    rows = []
    for one in diagnosis.recordings if titles else ():
        cells = []
        for title in titles:
            cause = one.causes.get(title)
            known = cause is not None and isfinite(cause.value)
            size = interval(cause.value, cause.ci95, cause.unit, plain) if cause is not None and known else ""
            cells.append("not fitted to" if cause is None else ", ".join(filter(None, (cause.said, size))))
        rows.append([one.name, *cells])
    return Table(("recording", *titles), rows, "What each recording says of each cause")


def _modelled(diagnosis: Diagnosis) -> list[str | Table]:
    """What no name explains, as the rig has it: the formulas that were tried, and the table's values."""
    m = diagnosis.modelled
    if m is None:
        return []
    formulas = [
        [f.family, f.law, formula_values(f.parameters, f.units), number(f.left),
         "chosen" if f.chosen else "cannot be told from the best" if f.tied else "leaves more"]
        for f in m.formulas
    ]  # fmt: skip
    x_unit, y_unit = (units.in_signs(unit) for unit in (m.state_unit, m.unit))
    return [
        m.sentence,
        Table(("family", "law", "parameters, 95 % intervals", "left, beside the table#", "said"), formulas),
        Table((f"{m.state} [{x_unit}]#", f"value [{y_unit}]#", "standard error#"),
              [[f"{v:.4g}" for v in p] for p in m.points]),
        f"The rig's file has it as the effect `{m.effect}`. Beyond the states that the recording covers a table is "
        "constant, and a formula is a guess.",
    ]  # fmt: skip


def parameter_row(name: str, row: Recalibrated, rig: Rig) -> list[str]:
    """A parameter as it was fitted."""
    known = rig.config.parameters.get(name)
    return [
        name, known.description if known else "", interval(row.nominal, None, row.unit, size=row.nominal),
        interval(row.value, row.ci95, row.unit, size=row.nominal),
        change(row.value, row.nominal), f"± {number(100 * known.tolerance)} %" if known else "-",
    ]  # fmt: skip


def _calibration(diagnosis: Diagnosis) -> list[str | Table | Items]:
    """All parameters, which of them go together, and what the recording does not tell."""
    found, rig = diagnosis.calibration, diagnosis.nominal
    rows = found.parameters if found else diagnosis.recalibrated
    if not rows:
        return []
    parts: list[str | Table | Items] = [Table(PARAMETER, [parameter_row(n, row, rig) for n, row in rows.items()])]
    if found and found.blind:
        parts += ["Beyond the tolerances the recording does not tell:", Items([one.sentence for one in found.blind])]
    names = list(found.correlation) if found else []
    pairs = [(a, b, found.correlation[a][b]) for i, a in enumerate(names) for b in names[i + 1 :]] if found else []
    far = sorted((p for p in pairs if abs(p[2]) >= CORRELATED), key=lambda p: -abs(p[2]))
    if pairs:
        parts.append(f"Correlations of their errors of {CORRELATED} and more; at 1 or -1 only a combination is known. "
                     "All of them: `calibration.correlation` in diagnosis.json." if far else
                     f"No two errors are correlated by {CORRELATED} or more.")  # fmt: skip
    parts.append(Table(("parameter", "with", "correlation#"), [[a, b, f"{c:.2f}"] for a, b, c in far]))
    return parts


def _checks(diagnosis: Diagnosis) -> Table:
    """The rows, those that fail first."""
    names = {*diagnosis.nominal.sensors, "u"}
    rows = [
        [capital(c.check, names), number(c.statistic), f"{c.operator} {number(c.threshold)}",
         "pass" if c.passed else "fail", f"{capital(c.comment, names)}. ({c.source})"]
        for c in sorted(diagnosis.checks, key=lambda c: c.passed)
    ]  # fmt: skip
    return Table(("check", "statistic#", "threshold#", "result", "what it is"), rows)


def _considered(diagnosis: Diagnosis) -> list[str | Table | Block]:
    """The candidates, what was chosen first; what was not found, and how large it could still be."""
    chosen = {(f.location, f.effect) for f in diagnosis.findings}
    alike = {(a.location, a.effect) for f in diagnosis.findings for a in f.also_fits}
    rank = {
        c: (0 if c in chosen else 1 if c in alike else 2)
        for c in ((x.location, x.effect) for x in diagnosis.candidates)
    }
    ordered = sorted(diagnosis.candidates, key=lambda c: rank[c.location, c.effect])
    rows = [
        [name_in_words(c.effect), place_in_words(c.location), number(c.score), number(c.held_out), c.verdict]
        for c in ordered
    ]
    marks = {k: "chosen" for k, c in enumerate(ordered) if (c.location, c.effect) in chosen}
    heads = ("effect", "at", "score#", "held-out error, noise floors#", "verdict")
    unseen = "; ".join(named_in_words(x.effect, x.location) for x in diagnosis.limits if not x.visible)
    if not rows and not diagnosis.limits:
        return []
    return [
        "The score is how far minus twice the log-likelihood falls, to first order, with that effect alone. All "
        "compete for the same mismatch.",
        Table(heads, rows[:SHOWN_CANDIDATES], marks=marks),
        Block(f"{len(rows) - SHOWN_CANDIDATES} more", [Table(heads, rows[SHOWN_CANDIDATES:])], folded=True),
        "These effects were not found. The bound says how large each could still be (95 %, one at a time, to first "
        "order)."
        if diagnosis.limits else "",
        Table(("effect", "at", "bound"), _limits(diagnosis)),
        f"This recording cannot show: {unseen}." if unseen else "",
    ]  # fmt: skip


def _limits(diagnosis: Diagnosis) -> list[list[str]]:
    """Effect, place, and the bound on the size of each effect that is not there."""
    rows = []
    for limit in (x for x in diagnosis.limits if x.visible):
        value, sign = (limit.upper95, "<") if limit.upper95 is not None else (limit.lower95, ">")
        shown, factor = units.shown(limit.unit)
        text = f"{limit.parameter.replace('_', ' ')} {sign} {number(factor * (value or 0.0))} {units.in_signs(shown)}"
        rows.append([name_in_words(limit.effect), place_in_words(limit.location), text.strip()])
    return rows


def _units(diagnosis: Diagnosis) -> str:
    """The units that were read, and who said so."""
    read = ", ".join(f"{channel} in {unit}" for channel, unit in diagnosis.units.items())
    return f"Units: {read}." if read else ""


def law_caption(diagnosis: Diagnosis, effect: str, against: str) -> tuple[str, str]:
    """What the figure of a law shows, and what to see in it."""
    if effect:
        return (
            f"the fitted law against {against}, and what the recording shows of it point by point.",
            "If the law is right, the points follow it within their bars from end to end. Points that leave it "
            "together speak for another law.",
        )
    rest = diagnosis.located.rest if diagnosis.located and diagnosis.verdict == UNEXPLAINED else None
    share = f"{100 * max(rest.explained, 0.0):.0f} %" if rest else ""
    most = f", and no function of that state alone explains more than {share} of the held-out mismatch"
    return (
        f"recovered from the recording against {against}, the state that it depends on most. No law of the catalogue "
        f"fits it{most if rest else ''}.",
        "Where the bars are short against the shape, the shape is the law to look for.",
    )
