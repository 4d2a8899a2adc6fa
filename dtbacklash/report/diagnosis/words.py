"""A diagnosis in words: its verdict in one line, places and effects as a person would write them."""

from __future__ import annotations

from dtbacklash.diagnose.result import CONSISTENT, MISSING, PARAMETERS, Diagnosis, Finding
from dtbacklash.diagnose.words import place_in_words
from dtbacklash.physics.effects.declare import name_in_words


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
    return f"Unexplained: {rest}more than noise is left{where}"


def partial(finding: Finding) -> str:
    """What is put behind the name of a finding that is a part of the truth at best."""
    return " (partial)" if finding.confidence == "partial" else ""


def listed(names: list[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def better_model(diagnosis: Diagnosis) -> str:
    """What to call the model that is set against the nominal one: without a named effect it is recalibrated only."""
    return "extended" if diagnosis.findings else "recalibrated"


def capital(text: str) -> str:
    """A text that begins a sentence."""
    return text[:1].upper() + text[1:]


def _by_place(findings: tuple[Finding, ...]) -> list[str]:
    """``Coulomb friction and constant force at the carriage``, ...: a text a place."""
    places = list(dict.fromkeys(f.location for f in findings))
    return [
        f"{listed([name_in_words(f.effect) for f in findings if f.location == place])} at the {place_in_words(place)}"
        for place in places
    ]
