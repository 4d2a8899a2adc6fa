"""What is said before all else: a command that does nothing, a unit that may be wrong, and in the end what it was."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.scale_errors import GAIN
from dtbacklash.diagnosis.labels import all_in_words
from dtbacklash.diagnosis.result import UNEXPLAINED, Diagnosis
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.recording.channels import idle_command
from dtbacklash.recording.command import NONE
from dtbacklash.recording.model import Recording
from dtbacklash.recording.wrong_units import Doubt, doubts_of

#: a recording in which nothing turns round so often is short, or one that does not at all and is no longer than that
TURNS_MIN, SHORT_S = 8, 10.0
#: means over so many parts of a recording are looked at
BLOCKS = 2000


def doubted(rig: Rig, recordings: Sequence[Recording]) -> list[Doubt]:
    """The units that may be wrong, each channel once.

    Raises
    ------
    UserError : a channel is off by the factor of a wrong unit, which no physics does.
    """
    return list({doubt.channel: doubt for one in recordings for doubt in doubts_of(rig, one)}.values())


def said_first(found: Diagnosis, recordings: Sequence[Recording], doubts: Sequence[Doubt]) -> Diagnosis:
    """The diagnosis with what its user has to know before he believes it."""
    alone = not found.nominal.config.commands  # of several commands one may well be idle
    driven = [r for r in recordings if alone and r.command != NONE]
    idle = [text for r in driven for text in idle_command(r.channels, r.units.get("u", "V"))]
    open_ = () if found.suspected else doubts  # a wrong number of the rig is what looks like a wrong unit
    said = " ".join([*dict.fromkeys(idle), *_short(recordings), *(_what_it_was(found, doubt) for doubt in open_)])
    return replace(found, first=said, summary=f"{said} {found.summary}") if said else found


def _short(recordings: Sequence[Recording]) -> list[str]:
    """A sentence where hardly anything happens in what is commanded in all recordings together; else none."""
    names = {c for r in recordings for c in r.channels if c != "r"}
    turns = max(sum(_turns(r.channels[c]) for r in recordings if c in r.channels) for c in names)
    lasts = sum(r.duration_s for r in recordings)
    if turns >= TURNS_MIN or (not turns and lasts > SHORT_S) or not any(np.any(r.channels["u"]) for r in recordings):
        return []
    often = f"turns round more than {turns} times" if turns else "turns round"
    return [f"{lasts:.3g} s are short: nothing {often}. What acts seldom, or at another speed, may not show in it; "
            "record half a minute with many reversals."]  # fmt: skip


def _turns(values: Floats) -> int:
    """How often a channel turns round, by a fifth of its range at least."""
    read = values[np.isfinite(values)]
    length = max(1, len(read) // BLOCKS)
    means = read[: len(read) // length * length].reshape(-1, length).mean(axis=1)
    least, turns, way = 0.2 * float(np.ptp(means)), 0, 0.0
    low = high = float(means[0])
    for mean in means.tolist():
        low, high = min(low, mean), max(high, mean)
        fell, rose = high - mean >= least > 0.0 and way >= 0.0, mean - low >= least > 0.0 and way <= 0.0
        if fell or rose:
            turns += way != 0.0
            way, low, high = (-1.0 if fell else 1.0), mean, mean
    return turns


def _what_it_was(found: Diagnosis, doubt: Doubt) -> str:
    """Whether physics explains what looked like a wrong unit."""
    looked = f"{doubt.channel} looked to be in a wrong unit: {doubt.looks}."
    if any(f.location == SENSOR_PREFIX + doubt.channel and f.effect == GAIN for f in found.findings):
        return f"{looked} Nothing else explains it: the unit is wrong, or the sensor's gain."
    if found.verdict == UNEXPLAINED:
        return f"{looked} No physics was found that explains it: check the unit first."
    named = all_in_words((f.location, f.effect) for f in found.findings) or " and ".join(found.recalibrated)
    return f"{looked} It is not: {named or 'the rig as it is'} explains it."
