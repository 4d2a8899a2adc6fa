"""A diagnosis in words: its verdict in a line, each cause in a row, what is left, the command that uses the result."""

from __future__ import annotations

import math
import shlex
from collections.abc import Collection
from pathlib import Path

import numpy as np

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.explain.next_experiment import DESIGN
from dtbacklash.diagnosis.findings import Finding, Recalibrated
from dtbacklash.diagnosis.labels import listed, named_in_words, one_of_in_words, other_in_words, place_in_words
from dtbacklash.diagnosis.plot_data import Curve
from dtbacklash.diagnosis.result import CONSISTENT, MISSING, PARAMETERS, UNEXPLAINED, Diagnosis
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.declare import name_in_words
from dtbacklash.physics.rig import SENSOR_PREFIX
from dtbacklash.report.components.blocks import Table
from dtbacklash.report.components.intervals import degrees, interval
from dtbacklash.report.components.numbers import number, percent

#: heads of the table of causes
CAUSES = ("place", "law", "size, 95 % interval", "sure?", "explains#")


def design_command(diagnosis: Diagnosis, folder: str) -> str:
    """The command that designs the experiment for what is open, with the folder of the diagnosis; else empty."""
    return shlex.join(["dtb", "design", folder]) if diagnosis.next_experiment.endswith(DESIGN) else ""


def next_command(diagnosis: Diagnosis, file: str) -> str:
    """The command that runs the rig that was found, complete: without a gear no controller but the open loop fits.

    A simulator's model that was found is shown by its simulator.
    """
    config = diagnosis.rig.config
    if config.simulator == "fmu":
        start = [word for name, p in config.parameters.items() for word in (name, f"{p.value:.9g}")]
        return shlex.join(["fmpy", "simulate", config.model, *(["--start-values", *start] if start else [])])
    if config.simulator == "mujoco":
        found = Path(file).parent / "found" / Path(config.model).name
        return shlex.join(["python", "-m", "mujoco.viewer", f"--mjcf={found}"])
    closed = diagnosis.rig.only("gear") is not None
    return shlex.join(["dtb", "run", f"rig={file}", *([] if closed else ["controller=open_loop"])])


def heading(diagnosis: Diagnosis) -> str:
    """The verdict in one line."""
    named = _by_place(diagnosis.findings)
    if diagnosis.work and diagnosis.work.depth == "none":
        return f"No physics was looked for; {_calibrated(diagnosis)}"
    if diagnosis.verdict == CONSISTENT:
        return "The model explains this recording"
    if diagnosis.verdict == PARAMETERS:
        verb = "need be" if any(row.also_fits for row in diagnosis.recalibrated.values()) else "is"
        return f"No physics {verb} missing; recalibrate {listed(list(moved(diagnosis)))}"
    if diagnosis.verdict == MISSING:
        return f"Missing: {listed(named)}"
    if diagnosis.fault:
        return f"No physics was looked for: {diagnosis.fault}"
    if diagnosis.suspected:
        return "Unexplained: " + diagnosis.suspected.replace("`", "").rstrip(".")
    there = diagnosis.located
    where = f" at the {place_in_words(there.location)}" if there and there.shown else ""
    rest = f"beside {listed(named)}, " if named else ""
    if (found := diagnosis.modelled) is not None:
        over = f"the {found.state} of {place_in_words(found.location)}"
        return f"Unexplained, but modelled: {rest}an effort over {over}"
    return f"Unexplained: {rest}more than noise is left{where}"


def _calibrated(diagnosis: Diagnosis) -> str:
    """What a calibration alone comes to."""
    if diagnosis.verdict == UNEXPLAINED:
        return "the calibrated rig leaves more than noise"
    enough = diagnosis.explained.enough if diagnosis.explained else None
    left = "leaves what was called enough" if enough else "leaves noise"
    others = f", with other {listed(list(moved(diagnosis)))}," if diagnosis.recalibrated else ""
    return f"the calibrated rig{others} {left}"


def moved(diagnosis: Diagnosis) -> dict[str, Recalibrated]:
    """The parameters that had to move: those whose given value their intervals exclude; all, where none does."""
    away = {name: row for name, row in diagnosis.recalibrated.items() if not row.ci95[0] <= row.nominal <= row.ci95[1]}
    return away or dict(diagnosis.recalibrated)


def causes(diagnosis: Diagnosis, plain: bool = False) -> Table:
    """A row a cause: place, law, size, sure or open against what, share of the mismatch that it explains.

    plain : in letters that every terminal has.
    """
    much = diagnosis.explained
    shares = much.causes if much else {}
    rows = []
    for f in diagnosis.findings:
        values = [
            f"{name_in_words(n)} {interval(p.value, p.ci95, p.unit, plain)}{'' if plain else degrees(p.unit, p.value)}"
            for n, p in f.parameters.items()
        ]
        share = shares.get(f"{f.location}.{f.effect}")
        rows.append([place_in_words(f.location), name_in_words(f.effect), "\n".join(values), _sure(f), _percent(share)])
    if (m := diagnosis.modelled) is not None:
        chosen = next((one for one in m.formulas if one.chosen), None)
        law = f"{m.effect}: {chosen.law}" if chosen else f"{m.effect}: a table over the {m.state}"
        size = formula_values(chosen.parameters, chosen.units, plain, "\n") if chosen else ""
        rows.append(
            [place_in_words(m.location), law, size, "no name", _percent(shares.get(f"{m.location}.{m.effect}"))]
        )
    listed_already = {f"{f.location}.{f.effect}" for f in diagnosis.findings}
    listed_already |= {f"{m.location}.{m.effect}"} if m else set()
    for name in (n for n in shares if n not in listed_already and n not in diagnosis.recalibrated):
        rows.append(_beside(diagnosis, name, _percent(shares[name]), plain))
    for name, row in moved(diagnosis).items():
        rows.append(_parameter(diagnosis, name, row, _percent(shares.get(name)), plain))
    if diagnosis.verdict == UNEXPLAINED and not diagnosis.fault and much is not None and m is None:
        rows.append(_unknown(diagnosis))
    return Table(CAUSES, rows, "Causes", look="causes")


def _sure(finding: Finding) -> str:
    """How sure a name is, and what is open of it."""
    if finding.confidence == "sure":
        return "sure"
    if finding.confidence == "one_of":
        return f"sure as one of: {one_of_in_words((finding.location, finding.effect), finding.also_fits)}"
    others = "; ".join(other_in_words(a) for a in finding.also_fits)
    if others:
        return f"open against {others}"
    grounds = finding.evidence
    if grounds is None:
        return "open"
    if not grounds.size.stands:
        return "open: it may not be there"
    said = [text for text, one in (("where", grounds.where), ("which law", grounds.law)) if not one.stands]
    return f"open: {' and '.join(said)}" if said else "open: much is left"


def _beside(diagnosis: Diagnosis, name: str, share: str, plain: bool) -> list[str]:
    """The row of what the modelled rig has beside its table or formula, and no name stands for."""
    place, _, effect = name.rpartition(".")
    values = diagnosis.rig.effect(place, effect) or {}
    kind = find(diagnosis.rig.kind_at(place), effect, place)
    sizes = [f"{name_in_words(p.name)} {interval(values[p.name], None, p.unit, plain)}" for p in kind.parameters[:2]]
    return [place_in_words(place), name_in_words(effect), "\n".join(sizes), "no name", share]


def _parameter(diagnosis: Diagnosis, name: str, row: Recalibrated, share: str, plain: bool) -> list[str]:
    """The row of a parameter that had to move."""
    config = diagnosis.nominal.config
    users = [place for place, spec in config.elements.items() if name in spec.values()]
    known = config.parameters.get(name)
    said = known.description if known and known.description else "parameter"
    value = interval(row.value, row.ci95, row.unit, plain, size=row.nominal)
    given = interval(row.nominal, None, row.unit, plain, size=row.nominal)
    others = "; ".join(other_in_words(a) for a in row.also_fits)
    sure = f"open against {others}" if others else _away(known.tolerance if known else 0.0, row)
    owner, _, short = name.rpartition(".")
    where = ", ".join(map(place_in_words, users)) or owner.rpartition(".")[2].replace("_", " ")
    what = said if said.startswith(f"{short} of ") else f"{short}, {said}"
    return [where, what, f"{value}\ninstead of {given}", sure, share]


def _away(tolerance: float, row: Recalibrated) -> str:
    """How far a value is from nominal, in its tolerances."""
    width = abs(row.nominal) * tolerance
    return f"{number(abs(row.value - row.nominal) / width, 2)} tolerances away" if width > 0.0 else "-"


def _unknown(diagnosis: Diagnosis) -> list[str]:
    """The row of what nothing explains: where it lies and how large the force is that the recording still needs."""
    much, there = diagnosis.explained, diagnosis.located
    assert much is not None
    where = place_in_words(there.location) if there and there.shown else "unknown"
    size = ""
    if much.unknown:
        body = max(much.unknown, key=lambda b: float(much.unknown[b]["after"]))
        one = much.unknown[body]
        share, force = float(one["after"]), float(one["after"]) * float(one["force"])
        size = f"{interval(force, None, str(one['unit']), True)} rms\n{percent(share, 2)} of what acts on it"
    done = sum(much.causes.values())
    return [where, "unexplained", size, "open", _percent(1.0 - done)]


def _percent(share: float | None) -> str:
    """A share in percent; next to nothing and next to all are said to be that."""
    if share is None:
        return "-"
    return "< 0.1 %" if share < 1e-3 else "> 99.9 %" if 0.999 < share < 1.0 else percent(share)


def judged(diagnosis: Diagnosis) -> tuple[Curve, ...]:
    """The channels as they judge: simulated by the commands alone, unless a constant would do as well there."""
    free = diagnosis.free_running
    last = "modelled" if diagnosis.modelled else "extended"
    error = getattr(free.held_out, last) if free else None
    alone = error is not None and error < 1.0
    return (diagnosis.shown.alone if alone else ()) or diagnosis.shown.curves


def mean_square(values: Floats) -> float:
    """The mean square of what is finite of (N,) values; nan where nothing is."""
    known = values[np.isfinite(values)]
    return float(np.mean(known**2)) if len(known) else math.nan


def left(diagnosis: Diagnosis, plain: bool = False) -> Table:
    """What is left of each channel where it was not fitted, in the sensor's unit: rms before and after, noise."""
    rows = []
    for curve in judged(diagnosis) if not diagnosis.fault else ():
        factor, unit = sensor_unit(diagnosis, curve.name)
        part = curve.t_s >= (curve.t_s[0] if curve.held_out_from_s is None else curve.held_out_from_s)
        motion = float(np.nanstd(curve.measured))
        ends = [math.sqrt(mean_square((curve.measured - v)[part])) for v in (curve.nominal, curve.extended)]
        sizes = [number(v / factor, plain=plain) for v in (*ends, curve.noise_floor or math.nan)]
        share = percent(ends[1] / motion, 2, plain) if motion else "-"
        rows.append([f"{curve.name} [{unit if plain else units.in_signs(unit)}]", *sizes[:2], share, sizes[2]])
    return Table(
        ("sensor", "before, rms#", "left, rms#", "of its motion#", "noise, rms#"),
        rows,
        f"What is left where nothing was fitted, {judged_how(diagnosis)}",
    )


def sensor_unit(diagnosis: Diagnosis, channel: str) -> tuple[float, str]:
    """The unit in which a channel was recorded, and its size in SI; where nobody said, the usual one."""
    name = channel.partition(" (")[0]
    sensor, read = diagnosis.nominal.sensors[name], diagnosis.units.get(name, "")
    for said in (read if read in units.UNITS else "", sensor.recorded_in, units.shown(sensor.unit)[0]):
        known = units.find(said) if said else None
        if known is not None and known.si == sensor.unit:
            return known.factor, said
    return 1.0, sensor.unit


def judged_how(diagnosis: Diagnosis) -> str:
    """How the rigs say what they say where they judge."""
    alone = judged(diagnosis) is diagnosis.shown.alone
    if not alone:
        return "predicted from one reading to the next"
    window = diagnosis.free_running.window_s if diagnosis.free_running else None
    return "simulated by the commands alone" + (f" for {number(window)} s at a time" if window else "")


def lead(diagnosis: Diagnosis) -> str:
    """What was compared with what, and how much is explained."""
    rig = diagnosis.nominal.config
    of = f"Recording{'s' if diagnosis.recordings else ''} {diagnosis.source}, compared with the rig {rig.name}"
    of += f" ({rig.description})" if rig.description else ""
    return " ".join(filter(None, [diagnosis.first, f"{of}.", together(diagnosis)]))


def failing(diagnosis: Diagnosis) -> str:
    """Which checks fail; empty where none does."""
    failed = [c.check for c in diagnosis.checks if not c.passed]
    return checks_said(len(diagnosis.checks), failed) if failed else ""


def together(diagnosis: Diagnosis) -> str:
    """How much all causes explain, and whether what is left is what the user called enough."""
    much = diagnosis.explained
    total = sum(much.causes.values()) if much else 0.0
    # of predictions that an unknown force brings back to the readings much is explained, and much of what acts is not
    how = f", {judged_how(diagnosis)}" if diagnosis.verdict == "unexplained" else ""
    said = [f"Together this explains {_percent(total)} of the mismatch{how}."] if total > 0.0 else []
    if much is not None and much.enough is not None:
        said.append(
            "What is left is " + ("what was called enough." if much.enough else "more than what was called enough.")
        )
    return " ".join(said)


def better_model(diagnosis: Diagnosis) -> str:
    """What to call the model that is set against the nominal one: without a named effect it is recalibrated only."""
    return "extended" if diagnosis.findings else "recalibrated"


def capital(text: str, names: Collection[str] = ()) -> str:
    """A text that begins a sentence; one that begins with the name of a channel stays as it is."""
    return text if text.split(" ", maxsplit=1)[0] in names else text[:1].upper() + text[1:]


def error_text(value: float | None, metric: str) -> str:
    """An error of fit; a normalised one in percent."""
    if value is None:
        return "-"
    return percent(value) if metric == "nrmse" else number(value)


def labels(findings: tuple[Finding, ...]) -> list[tuple[str, str]]:
    """What stands below an element of the drawing: its place, and effect and the size that it has."""
    told = []
    for finding in findings:
        effect = name_in_words(finding.effect)
        sensor = finding.location.startswith(SENSOR_PREFIX)  # its label stands below what it watches
        lines = [f"{place_in_words(finding.location)}: {effect}" if sensor else effect]
        lines += [interval(p.value, p.ci95, p.unit) for p in list(finding.parameters.values())[:1]]
        told.append((finding.location, "\n".join(lines)))
    return told


def percents(shares: dict[str, float]) -> dict[str, str]:
    """Shares as whole percents that add up as the shares do: the largest remainders are rounded up."""
    exact = {name: 100.0 * share for name, share in shares.items()}
    whole = {name: int(value) for name, value in exact.items()}
    for name in sorted(exact, key=lambda n: whole[n] - exact[n])[: round(sum(exact.values())) - sum(whole.values())]:
        whole[name] += 1
    return {name: f"{value} %" if value else "< 1 %" for name, value in whole.items()}


def grounds(finding: Finding) -> str:
    """What a name rests on, in figures."""
    said = f"{capital(named_in_words(finding.effect, finding.location))} is {finding.confidence}"
    stands = finding.evidence
    if stands is None or stands.size.ratio is None:
        return f"{said}."
    rivals = [g for g in (stands.where, stands.law) if g.against is not None and g.ratio is not None]
    close = min(rivals, key=lambda g: g.ratio or 0.0, default=None)
    said += f": without it {number(stands.size.ratio)} times as much (rms) is left"
    if close is None or close.against is None or close.ratio is None:
        return f"{said}."
    return f"{said}, with {other_in_words(close.against)} in its place {number(close.ratio)} times."


def checks_said(count: int, failed: list[str]) -> str:
    """How many checks pass, and which fail."""
    if not failed:
        return f"All {count} checks pass." if count > 1 else "The check passes."
    fails = "This check fails" if len(failed) == 1 else "These checks fail"
    return f"{count - len(failed)} of {count} checks pass. {fails}: {'; '.join(failed)}."


def formula_values(
    parameters: dict[str, tuple[float, float, float]], of: dict[str, str], plain: bool = False, between: str = ", "
) -> str:
    """The parameters of a formula with their intervals. of : name -> unit."""
    return between.join(
        f"{name} = {interval(value, (low, high), of.get(name, ''), plain)}"
        for name, (value, low, high) in parameters.items()
    )


def _by_place(findings: tuple[Finding, ...]) -> list[str]:
    """``Coulomb friction and constant force at the carriage``, ...: a text a place."""
    places = list(dict.fromkeys(f.location for f in findings))
    return [
        f"{listed([name_in_words(f.effect) for f in findings if f.location == place])} at the {place_in_words(place)}"
        for place in places
    ]
