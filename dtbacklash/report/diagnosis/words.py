"""A diagnosis in words: its verdict in one line, places and effects as a person would write them."""

from __future__ import annotations

import shlex
from collections.abc import Collection

from dtbacklash.diagnose.named import Finding, Modelled
from dtbacklash.diagnose.result import CONSISTENT, MISSING, PARAMETERS, UNEXPLAINED, Diagnosis
from dtbacklash.diagnose.words import named_in_words, other_in_words, place_in_words
from dtbacklash.physics.effects.declare import name_in_words
from dtbacklash.physics.rig import SENSOR_PREFIX
from dtbacklash.report.kit.intervals import interval
from dtbacklash.report.kit.numbers import number


def next_command(diagnosis: Diagnosis, file: str) -> str:
    """The command that runs the rig that was found, complete: without a gear no controller but the open loop fits."""
    closed = diagnosis.rig.only("gear") is not None
    return shlex.join(["dtb", "run", f"rig={file}", *([] if closed else ["controller=open_loop"])])


def heading(diagnosis: Diagnosis) -> str:
    """The verdict in one line."""
    named = _by_place(diagnosis.findings)
    if diagnosis.verdict == CONSISTENT:
        return "The model explains this recording"
    if diagnosis.verdict == PARAMETERS:
        verb = "need be" if any(row.also_fits for row in diagnosis.recalibrated.values()) else "is"
        return f"No physics {verb} missing; recalibrate {listed(list(diagnosis.recalibrated))}"
    if diagnosis.verdict == MISSING:
        return f"Missing: {listed(named)}"
    if diagnosis.fault:
        return f"No physics was looked for: {diagnosis.fault}"
    there = diagnosis.located
    where = f" at the {place_in_words(there.location)}" if there and there.shown else ""
    rest = f"beside {listed(named)}, " if named else ""
    if (found := diagnosis.modelled) is not None:
        over = f"the {found.state} of {place_in_words(found.location)}"
        return f"Unexplained, but modelled: {rest}an effort over {over}"
    return f"Unexplained: {rest}more than noise is left{where}"


def partial(finding: Finding) -> str:
    """What is put behind the name of a finding of which something is open."""
    return " (partial)" if finding.confidence == "partial" else ""


def listed(names: list[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


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
    return f"{number(100 * value)} %" if metric == "nrmse" else number(value)


def labels(findings: tuple[Finding, ...]) -> list[tuple[str, str]]:
    """What stands below an element of the drawing: its place, and effect and the size that it has."""
    told = []
    for finding in findings:
        effect = name_in_words(finding.effect)
        sensor = finding.location.startswith(SENSOR_PREFIX)  # its label stands below what it watches
        lines = [f"{place_in_words(finding.location)}: {effect}" if sensor else effect]
        told.append((finding.location, "\n".join(lines + [text for _, text in _values(finding)[:1]])))
    return told


def _values(finding: Finding) -> list[tuple[str, str]]:
    """Parameters of a finding with their intervals."""
    return [(name_in_words(n), interval(p.value, p.ci95, p.unit)) for n, p in finding.parameters.items()]


def percents(shares: dict[str, float]) -> dict[str, str]:
    """Shares as whole percents that add up as the shares do: the largest remainders are rounded up."""
    exact = {name: 100.0 * share for name, share in shares.items()}
    whole = {name: int(value) for name, value in exact.items()}
    for name in sorted(exact, key=lambda n: whole[n] - exact[n])[: round(sum(exact.values())) - sum(whole.values())]:
        whole[name] += 1
    return {name: f"{value} %" if value else "< 1 %" for name, value in whole.items()}


def answers(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """The first screen of a page: (question, answer), without the questions that the verdict does not raise."""
    told = [
        ("What?", diagnosis.summary),
        ("Where?", _where(diagnosis)),
        ("How much?", _how_much(diagnosis)),
        ("How sure?", _how_sure(diagnosis)),
        ("Does it fit?", _does_it_fit(diagnosis)),
        ("What next?", diagnosis.next_experiment),
    ]
    return [(question, answer) for question, answer in told if answer]


def _where(diagnosis: Diagnosis) -> str:
    evidence = sorted(diagnosis.shown.evidence.items(), key=lambda one: -one[1])
    if evidence:
        told = percents(dict(evidence))
        shares = [f"{place_in_words(place)} ({told[place]} of the evidence)" for place, _ in evidence]
        return capital(listed(shares), diagnosis.nominal.elements) + "."
    if diagnosis.located and diagnosis.located.shown:
        return f"At or near the {place_in_words(diagnosis.located.location)}."
    return "" if diagnosis.verdict in (CONSISTENT, PARAMETERS) or diagnosis.fault else "Nothing shows where."


def _how_much(diagnosis: Diagnosis) -> str:
    parts = [
        f"{capital(named_in_words(f.effect, f.location))}: {', '.join(' '.join(pair) for pair in _values(f))}."
        for f in diagnosis.findings
        if f.parameters
    ]
    parts += [
        f"{name} is {interval(r.value, r.ci95, r.unit, size=r.nominal)} instead of "
        f"{interval(r.nominal, None, r.unit, size=r.nominal)}."
        for name, r in diagnosis.recalibrated.items()
    ]
    return " ".join(parts)


def _how_sure(diagnosis: Diagnosis) -> str:
    parts = [_grounds(f) for f in diagnosis.findings]
    if diagnosis.findings or diagnosis.recalibrated:
        parts.append("The intervals are 95 % confidence intervals.")
    failed = [c.check for c in diagnosis.checks if not c.passed]
    if diagnosis.checks:
        parts.append(checks_said(len(diagnosis.checks), failed))
    return " ".join(parts)


def _grounds(finding: Finding) -> str:
    """What a name rests on, in figures."""
    said = f"{capital(named_in_words(finding.effect, finding.location))} is {finding.confidence}"
    grounds = finding.stands
    if grounds is None or grounds.size.ratio is None:
        return f"{said}."
    rivals = [g for g in (grounds.where, grounds.law) if g.against is not None and g.ratio is not None]
    close = min(rivals, key=lambda g: g.ratio or 0.0, default=None)
    said += f": without it {number(grounds.size.ratio)} times as much (rms) is left"
    if close is None or close.against is None or close.ratio is None:
        return f"{said}."
    return f"{said}, with {other_in_words(close.against)} in its place {number(close.ratio)} times."


def checks_said(count: int, failed: list[str]) -> str:
    """How many checks pass, and which fail."""
    if not failed:
        return f"All {count} checks pass." if count > 1 else "The check passes."
    fails = "This check fails" if len(failed) == 1 else "These checks fail"
    return f"{count - len(failed)} of {count} checks pass. {fails}: {'; '.join(failed)}."


def _does_it_fit(diagnosis: Diagnosis) -> str:
    """The errors on held-out data, and those of the worst channel where more than noise is left."""
    fit, best = diagnosis.fit, better_model(diagnosis)
    nominal, better, floor = (
        error_text(value, fit.metric) for value in (fit.held_out.nominal, getattr(fit.held_out, best), fit.noise_floor)
    )
    if diagnosis.verdict == CONSISTENT or better == "-":
        said = f"On data that it was not fitted to, the nominal model errs by {nominal}"
    else:
        said = f"On data that neither was fitted to, the nominal model errs by {nominal}, the {best} one by {better}"
    if diagnosis.modelled:
        modelled = error_text(fit.held_out.modelled, fit.metric)
        return f"By no name. {said}, and with what is modelled by {modelled}; noise alone gives {floor}."
    said += f"; noise alone gives {floor}."
    if diagnosis.verdict == UNEXPLAINED and diagnosis.shown.floors:  # a noisy channel may hide the one that matters
        left = {c: errors.extended or 0.0 for c, errors in diagnosis.shown.floors.items()}
        worst = max(left, key=lambda c: left[c])
        return f"No. {said} The worst channel is {worst}, where the error is {number(left[worst], 2)} times the noise."
    return said if diagnosis.verdict == UNEXPLAINED else f"Yes. {said}"


def formula_rows(modelled: Modelled, plain: bool = False) -> list[list[str]]:
    """Of each formula: family, law, parameters with intervals, what it leaves beside the table, what is said of it."""
    rows = []
    for one in modelled.formulas:
        values = [
            f"{name} = {interval(value, (low, high), one.units.get(name, ''), plain=plain)}"
            for name, (value, low, high) in one.parameters.items()
        ]
        said = "chosen" if one.chosen else "cannot be told from the best" if one.tied else "leaves more"
        rows.append([one.family, one.law, ", ".join(values), number(one.left), said])
    return rows


def _by_place(findings: tuple[Finding, ...]) -> list[str]:
    """``Coulomb friction and constant force at the carriage``, ...: a text a place."""
    places = list(dict.fromkeys(f.location for f in findings))
    return [
        f"{listed([name_in_words(f.effect) for f in findings if f.location == place])} at the {place_in_words(place)}"
        for place in places
    ]
