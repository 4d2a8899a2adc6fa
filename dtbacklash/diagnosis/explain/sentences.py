"""The sentences of a diagnosis."""

import math
from collections.abc import Sequence

import numpy as np

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.conclusion import Conclusion
from dtbacklash.diagnosis.engine.parameters import Key, taken_out, unit_of
from dtbacklash.diagnosis.findings import Alternative, Confidence, Evidence, Finding, Instead, Modelled, Recalibrated
from dtbacklash.diagnosis.labels import all_in_words, one_of_in_words, other_in_words, place_in_words
from dtbacklash.diagnosis.plot_data import Explained
from dtbacklash.diagnosis.records import UNLOGGED
from dtbacklash.diagnosis.result import CONSISTENT, PARAMETERS, UNEXPLAINED, Located, Verdict
from dtbacklash.diagnosis.several import Several, source_of
from dtbacklash.physics.effects.declare import name_in_words
from dtbacklash.physics.rig import SENSOR_PREFIX
from dtbacklash.recording.model import Recording

#: a mismatch that lies within one of these times of an event is said to lie there, s
NEAR_S = (0.05, 0.1, 0.2, 0.3)
#: speeds below this share of the fastest count as rest
MOVES = 0.02
#: a second best that leaves more than this many times the error explains nothing
WORTH_SAYING = 10.0


def quantity(value: float, unit: str) -> str:
    """A number with its unit as people are shown it (lengths in millimetres), three digits."""
    shown, factor = units.shown(unit)
    return f"{factor * value:.3g}" + ("" if shown in ("", "1") else f" {shown}")


def zeros_said(c: Conclusion) -> str:
    """The zeros of sensors that begin anywhere, of one recording; of several they stand in their table."""
    found, unseen = [], 0
    for f, x in zip(c.values.free, c.values.x, strict=True):
        if f.is_zero:
            found.append(f"{f.place.removeprefix(SENSOR_PREFIX)} {quantity(f.value(x), unit_of(c.model.rig, f))}")
            error = c.values.errors.get((f.place, f.effect, f.label), math.inf)
            assert f.recording is not None
            unseen += error > c.search.segments.spreads[f.place.removeprefix(SENSOR_PREFIX), f.recording]
    if not found or len({p.readings.recording for p in c.search.segments.predictors}) > 1:
        return ""
    rest = " Nothing in the rig holds a position: that is what each read first." if unseen == len(found) else ""
    return f"Zero of {', '.join(found)}.{rest}"


def less(instead: Instead | None) -> str:
    """What the second best would be, where there is one that explains a part."""
    if instead is None or not 1.0 <= instead.times_the_error <= WORTH_SAYING:
        return ""
    what = f"{name_in_words(instead.effect)} ({quantity(instead.value, instead.unit)})"
    worse = instead.times_the_error
    times = _two(worse)
    place = place_in_words(instead.location)
    return (f" Without that effect in the catalogue, {what} at the {place} would be named, "
            f"with {times} times the error; it is not needed in addition.")  # fmt: skip


def certainty_said(mark: Confidence, grounds: Evidence, key: Key, others: Sequence[Alternative], explains: bool) -> str:
    """What of a name the recording leaves open, by the rivals that it does not lead; empty where it is sure.

    key : of the name. others : laws that also fit. explains : whether most of what was unknown is explained.
    """
    if mark == "sure":
        return ""
    if mark == "one_of":
        return f" ({one_of_in_words(key, others)}: this recording cannot tell which)"
    if not grounds.size.stands:
        return ". It may not be there: the rig without it predicts the recording as well"
    said = []
    if not grounds.where.stands:
        said.append("where it acts")
    if not grounds.law.stands:
        said.append("which law it is")
    if said:
        return f". The recording leaves open {' and '.join(said)}"
    return "" if explains else ". It leads all that was tried in its place, but most of what was unknown is left"


def when(c: Conclusion, key: Key) -> str:
    """When an effect matters: where the square of what it changes in the prediction lies, in the longest stretch."""
    number = max(range(len(c.search.segments.predictors)), key=lambda k: c.search.segments.predictors[k].count)
    p = c.search.segments.predictors[number]
    gains = p.gains(c.model.rig, c.model.noise_levels[number])
    with_it = p.run(c.model.rig, gains)
    with np.errstate(over="ignore"):
        change = np.sum((with_it.E - p.run(taken_out(c.model.rig, key), gains).E) ** 2, axis=1)
    if not change.sum() > 0.0 or not np.isfinite(change).all():
        return "the effect does not change the prediction of this recording"
    v = p.linear.speed
    speeds = with_it.X[:, v : v + len(p.linear.bodies)]
    place = key[0] if key[0] in p.linear.bodies else p.linear.bodies[0]
    speed = speeds[:, p.linear.bodies.index(place)]
    return _when_it_moves(p.readings.sample_time_s, speed, change) or _how_busy(change)


def _when_it_moves(sample_time_s: float, speed: Floats, change: Floats) -> str:
    """Whether a change, (N,) squares, goes with reversals or with speed; empty where neither."""
    moving = np.flatnonzero(np.abs(speed) > MOVES * np.abs(speed).max())
    turns = moving[1:][np.diff(np.sign(speed[moving])) != 0]
    before = max(1, round(NEAR_S[0] / sample_time_s))
    for near_s in NEAR_S:
        near = max(1, round(near_s / sample_time_s))
        mask = np.zeros(len(change), dtype=bool)
        for k in turns:
            mask[max(0, k - before) : k + near] = True
        share = float(change[mask].sum() / change.sum())
        if share > 0.5 and mask.mean() < 0.6 * share:
            near_ms = 1e3 * max(near, before) * sample_time_s
            return f"{100 * share:.0f} % of the mismatch lies within {near_ms:.0f} ms of a velocity reversal"
    fast = np.abs(speed) > np.quantile(np.abs(speed), 0.75)
    share = float(change[fast].sum() / change.sum())
    if share > 0.5:
        return f"{100 * share:.0f} % of the mismatch lies in the quarter of the time in which it moves fastest"
    return ""


def _how_busy(change: Floats) -> str:
    """In how much of the time a change, (N,) squares, happens."""
    order = np.sort(change)[::-1]
    busy = float(np.searchsorted(np.cumsum(order), 0.8 * change.sum()) / len(change))
    if busy > 0.4:
        return "the mismatch is spread over the whole recording"
    return f"80 % of the mismatch lies in {100 * busy:.0f} % of the time"


def summary(
    verdict: Verdict, findings: Sequence[Finding], recalibrated: dict[str, Recalibrated], located: Located | None,
    looked: bool = True, enough: bool | None = None, unlogged: bool = False, explains: bool = False,
) -> str:  # fmt: skip
    """Two or three sentences.

    looked : whether physics was looked for. enough : whether what is left was called so. unlogged : whether it may be
    what a command did between its logged values. explains : whether little is left.
    """
    left = "what was called enough" if enough else UNLOGGED if unlogged else "the sensors' noise"
    if verdict == CONSISTENT:
        return f"The recording agrees with the rig: what is left is {left}."
    names = ", ".join(f"{n} = {quantity(p.value, p.unit)}" for n, p in recalibrated.items())
    if verdict == PARAMETERS:
        if not looked or enough:
            return f"With recalibrated parameters ({names}) what is left is {left}."
        return f"No physics is missing: recalibrated parameters explain the recording ({names})."
    parts = [f.sentence for f in findings]
    for finding in findings:
        if finding.also_fits and finding.confidence == "partial":
            others = " or ".join(other_in_words(o) for o in finding.also_fits)
            parts.append(f"This recording cannot tell {name_in_words(finding.effect)} from {others}.")
    if findings and names:
        parts.append(f"Recalibrated beside that: {names}.")
    if verdict == UNEXPLAINED and findings and explains:
        parts.append("Little is left beside that, but none of it is sure.")
    elif verdict == UNEXPLAINED and located and looked:
        said = "What remains" if findings else "The mismatch"
        where = f" and lies at or near {place_in_words(located.location)}" if located.shown else ""
        parts.append(f"{said} is real{where}, but nothing in the catalogue was found that explains it"
                     f"{'' if located.shown else ', and nothing shows where it lies'}.")  # fmt: skip
    return " ".join(parts)


def explained_said(much: Explained, findings: bool) -> str:
    """How much of the mismatch is explained, and what is left.

    findings : whether physics was found; else what is explained is explained by recalibration.
    """
    shares = [
        f"{_percent(share)} of the mismatch {how}"
        for share, how in ((much.compared, "as compared"), (much.free_running, "simulated freely"))
        if share is not None and share > 0.0
    ]
    left = [
        f"{c} {quantity(row.rms, row.unit)} ({_two(100 * row.of_motion)} % of its motion, {_two(row.floors)} floors)"
        for c, row in much.left.items()
    ]
    by = "The extended rig" if findings else "The recalibrated rig"
    said = f"{by} explains {' and '.join(shares)}. " if shares else ""
    if not left:
        return f"{by} does not follow the recording: its simulation does not stay finite."
    if much.enough is not None:
        left.append("which is what was called enough" if much.enough else "more than what was called enough")
    return f"{said}Left: {', '.join(left)}."


def modelled_said(modelled: Modelled, much: Explained) -> str:
    """What no name explains, as the rig has it now: over which state, like which formula, and what that explains."""
    place, times = place_in_words(modelled.location), f", times the {modelled.times}" if modelled.times else ""
    gone = f" instead of {all_in_words(modelled.instead_of)}" if modelled.instead_of else ""
    said = f"Modelled{gone}: an effort at the {place} over the {modelled.state}{times}, "
    chosen = next((f for f in modelled.formulas if f.chosen), None)
    others = [f.family for f in modelled.formulas if f.tied and not f.chosen]
    if chosen is None:
        said += "as a table; none of the formulas that were tried does as well"
    else:
        said += f"like {chosen.family}, {chosen.law}"
        said += f" (the recording cannot tell it from {' or '.join(others)})" if others else ""
    if much.modelled and much.modelled[1] is not None and much.modelled[1] > 0.0:
        said += f". With it the rig explains {_percent(much.modelled[1])} of the mismatch as compared"
    return said + "."


def _two(value: float) -> str:
    """Two digits, or all before the point; of next to nothing only that."""
    if 0.0 < value < 1e-3:
        return "less than 0.001"
    return f"{value:.2g}" if value < 10.0 else f"{value:.0f}"


def _percent(share: float) -> str:
    """A share in percent, with as many digits as tell it from all."""
    if share > 0.9999:
        return "over 99.99 %"
    digits = max(0, math.ceil(-math.log10(1.0 - share)) - 1)
    return f"{100 * share:.{digits}f} %"


def unknown_said(much: Explained) -> str:
    """The unknown force that the recording still needs, where it needs most, in its unit and beside what acts there."""
    if not much.unknown:
        return ""
    body = max(much.unknown, key=lambda b: float(much.unknown[b]["after"]))
    row = much.unknown[body]
    before, after, force = (float(row[n]) for n in ("before", "after", "force"))
    share = f"{_two(100 * after)} % of what acts on it"
    said = f"{quantity(after * force, str(row['unit']))} at the {place_in_words(body)}, {share}"
    was = f" ({_two(100 * before)} % before)" if before > 1.5 * after else ""
    return f"Unknown force left: {said}{was}."


def tolerances_said(away: dict[str, float], usual: float) -> str:
    """What to say of parameters of the rig that are further from nominal than their tolerances allow."""
    said = [f"`{name}` is {far:.1f} of its tolerances from nominal" for name, far in away.items() if far > usual]
    return f"{' and '.join(said)}: the rig's value is wrong, or its tolerance." if said else ""


def notes_of(recording: Recording, validation: Recording | None, share: float) -> tuple[str, ...]:
    """What the reader said, and which data are fitted to and which judge: the last ``share``, or others."""
    if validation is None:
        return (
            *recording.notes,
            f"{_span('The recording is', recording)}: {100 * (1 - share):.0f} % of it are fitted to, and the last "
            f"{100 * share:.0f} % judge.",
        )
    other = [f"Held-out data: {note}" for note in validation.notes if note not in recording.notes]
    return *recording.notes, *other, f"{_span('Fitted to', recording)}; {_span('judged on', validation)}."


def notes_of_several(several: Several, share: float) -> tuple[str, ...]:
    """What the reader said of each recording, which data are fitted to and which judge, and what they share."""
    said = [f"{n}: {note}" for r, n in zip(several.recordings, several.names, strict=True) for note in r.notes]
    alone = [n for n, judges in zip(several.names, several.judges, strict=True) if judges]
    spans = [
        _span("Judged on" if judges else "Fitted to", r, n) + "."
        for r, n, judges in zip(several.recordings, several.names, several.judges, strict=True)
    ]
    parts = (
        f"{' and '.join(alone)} {'judges' if len(alone) == 1 else 'judge'} alone."
        if alone else
        "Each recording is left out in turn: it judges the rig that the others alone ask for, by one step of the fit."
        if several.turns else
        f"Of each recording {100 * (1 - share):.0f} % are fitted to, and the last {100 * share:.0f} % judge."
    )  # fmt: skip
    shared = ("The recordings share the rig's physics and parameters; first states and the sizes of what is unknown "
              "are each recording's own.")  # fmt: skip
    return *said, *several.notes, *spans, parts, shared


def units_of(several: Several) -> dict[str, str]:
    """Channel -> the unit that was read, of each recording where they differ."""
    found = {}
    for channel in dict.fromkeys(c for r in several.recordings for c in r.assumed_units):
        said = {n: r.assumed_units.get(channel, "") for r, n in zip(several.recordings, several.names, strict=True)}
        alike = len(set(said.values())) == 1
        found[channel] = next(iter(said.values())) if alike else "; ".join(f"{n}: {u}" for n, u in said.items() if u)
    return found


def _span(what: str, r: Recording, name: str = "") -> str:
    stretches = f" in {len(r.stretches)} stretches" if len(r.stretches) > 1 else ""
    return f"{what} {name or source_of(r)}, {r.t_s[0]:.6g} to {r.t_s[-1]:.6g} s ({r.samples} samples{stretches})"
