"""The sentences of a diagnosis."""

import math
from collections.abc import Sequence

import numpy as np

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.candidates import TREMOR
from dtbacklash.diagnose.data.compare import Record
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.data.several import Several, source_of
from dtbacklash.diagnose.named import Finding, Instead, Modelled, Recalibrated, Stands
from dtbacklash.diagnose.result import CONSISTENT, PARAMETERS, UNEXPLAINED, Located, Verdict
from dtbacklash.diagnose.search.model import Model, WrongValue
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.diagnose.shown import Explained, RecordingUsed
from dtbacklash.diagnose.words import all_in_words, other_in_words, place_in_words
from dtbacklash.physics.effects.declare import name_in_words
from dtbacklash.recording.model import Recording

#: a mismatch that lies within one of these times of an event is said to lie there, s
NEAR_S = (0.05, 0.1, 0.2, 0.3)
#: a zero that is off by more than so many noise floors is said to be another one
OTHER_ZERO = 10.0
#: a second best that leaves more than this many times the error explains nothing
WORTH_SAYING = 10.0


def quantity(value: float, unit: str) -> str:
    """A number with its unit as people are shown it (lengths in millimetres), three digits."""
    shown, factor = units.shown(unit)
    return f"{factor * value:.3g}" + ("" if shown in ("", "1") else f" {shown}")


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


def open_said(grounds: Stands) -> str:
    """What of a name the recording leaves open; empty where it stands."""
    if not grounds.size.stands:
        return " The recording hardly needs it: it may not be there."
    said = []
    if not grounds.where.stands:
        said.append("where it acts")
    if not grounds.law.stands:
        said.append("which law it is")
    return f" The recording leaves open {' and '.join(said)}." if said else ""


def when(model: Model, left_out: Residuals) -> str:
    """When an effect matters: where the square of what it changes in the prediction lies, in the longest stretch.

    left_out : what remains without it.
    """
    evidence = model.evidence
    number = max(range(len(evidence.records)), key=lambda j: int(evidence.records[j].train.sum()))
    record = evidence.records[number]
    change = np.zeros(record.samples)
    for block in evidence.blocks:
        difference = left_out[block.name][number] - model.fitted.residuals[block.name][number]
        change += np.sum(difference**2, axis=1)
    if change.sum() <= 0.0:
        return "the effect does not change the prediction of this recording"
    return _when_it_moves(evidence, record, change) or _how_busy(change)


def _when_it_moves(evidence: Evidence, record: Record, change: Floats) -> str:
    """Whether a change, (N,) squares, goes with reversals or with speed; empty where neither, or no motion was seen."""
    speed = _speed(evidence, record)
    if speed is None:
        return ""
    smooth = np.convolve(speed, np.ones(11) / 11, "same")
    moving = np.flatnonzero(np.abs(smooth) > TREMOR * np.abs(smooth).max())
    turns = moving[1:][np.diff(np.sign(smooth[moving])) != 0]
    before = max(1, round(NEAR_S[0] / record.sample_time_s))
    for near_s in NEAR_S:
        near = max(1, round(near_s / record.sample_time_s))
        mask = np.zeros(record.samples, dtype=bool)
        for k in turns:
            mask[max(0, k - before) : k + near] = True
        share = float(change[mask].sum() / change.sum())
        if share > 0.5 and mask.mean() < 0.6 * share:
            near_ms = 1e3 * max(near, before) * record.sample_time_s
            return f"{100 * share:.0f} % of the mismatch lies within {near_ms:.0f} ms of a velocity reversal"
    fast = np.abs(smooth) > np.quantile(np.abs(smooth), 0.75)
    share = float(change[fast].sum() / change.sum())
    if share > 0.5:
        return f"{100 * share:.0f} % of the mismatch lies in the quarter of the time in which it moves fastest"
    return ""


def _speed(evidence: Evidence, record: Record) -> Floats | None:
    """(N,) the speed, up to its unit, of what was recorded first of the motion; None where no motion was recorded."""
    # a positioner's command is the motion itself
    if evidence.nominal.only("positioner") is not None:
        return np.gradient(record.u)
    quantities = {c: evidence.nominal.sensors[c].quantity for block in evidence.blocks for c in block.channels}
    name = next((c for c, quantity in quantities.items() if quantity in ("position", "velocity")), None)
    if name is None:
        return None
    return record.y[name] if quantities[name] == "velocity" else np.gradient(record.y[name])


def _how_busy(change: Floats) -> str:
    """In how much of the time a change, (N,) squares, happens."""
    order = np.sort(change)[::-1]
    busy = float(np.searchsorted(np.cumsum(order), 0.8 * change.sum()) / len(change))
    if busy > 0.4:
        return "the mismatch is spread over the whole recording"
    return f"80 % of the mismatch lies in {100 * busy:.0f} % of the time"


def summary(
    verdict: Verdict, findings: Sequence[Finding], recalibrated: dict[str, Recalibrated], located: Located | None,
    beyond: WrongValue | None = None,
) -> str:  # fmt: skip
    """Two or three sentences. beyond : the parameter that was let go beyond what is given, if one was."""
    if verdict == CONSISTENT:
        return "The recording agrees with the rig: what is left is the sensors' noise."
    if verdict == PARAMETERS:
        names = ", ".join(f"{n} = {quantity(p.value, p.unit)}" for n, p in recalibrated.items())
        missing = "need be" if beyond is not None and beyond.instead_of else "is"
        return f"No physics {missing} missing: recalibrated parameters explain the recording ({names})."
    parts = [f.sentence for f in findings]
    for finding in findings:
        if finding.also_fits:
            others = " or ".join(other_in_words(o) for o in finding.also_fits)
            parts.append(f"This recording cannot tell {name_in_words(finding.effect)} from {others}.")
    if verdict == UNEXPLAINED and located:
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
    """Two digits, or all before the point."""
    return f"{value:.2g}" if value < 10.0 else f"{value:.0f}"


def _percent(share: float) -> str:
    """A share in percent, with as many digits as tell it from all."""
    if share > 0.9999:
        return "over 99.99 %"
    digits = max(0, math.ceil(-math.log10(1.0 - share)) - 1)
    return f"{100 * share:.{digits}f} %"


def limits_said(effects: list[str], parameters: list[str]) -> str:
    """What to say of effects' and of the rig's parameters that stand at their limits; empty where none do."""
    said = []
    if effects:
        stand = "stands" if len(effects) == 1 else "stand"
        said.append(f"{' and '.join(effects)} {stand} at the end of the range: the data did not choose the value.")
    if parameters:
        stand, stands_in = ("stands", "it stands") if len(parameters) == 1 else ("stand", "they stand")
        said.append(f"{' and '.join(parameters)} {stand} at the limit, as far from nominal as a fit may go: there "
                    f"{stands_in} in for missing physics, or the rig's value is wrong.")  # fmt: skip
    return " ".join(said)


def beyond_said(beyond: WrongValue | None) -> str:
    """What to say of a parameter of the rig beyond its tolerance, or in the place of effects; empty where none is."""
    if beyond is None:
        return ""
    said = []
    if beyond.tolerances > SETTINGS.tolerances_max:
        said.append(f"`{beyond.name}` is {beyond.tolerances:.1f} of its tolerances from nominal: the rig's value is "
                    "wrong, or its tolerance.")  # fmt: skip
    if beyond.instead_of:
        others = all_in_words(beyond.instead_of)
        said.append(f"{others[:1].upper()}{others[1:]} would explain no less than `{beyond.name}`.")
    return " ".join(said)


def as_well_said(as_well: WrongValue) -> str:
    """The value of a parameter of the rig that would explain as much as what was found."""
    parameter = as_well.fitted.rig.config.parameters[as_well.name]
    value = quantity(parameter.value, parameter.unit)
    return f"{value} alone, {as_well.tolerances:.1f} of its tolerances from nominal"


def notes_of(recording: Recording, validation: Recording | None, share: float) -> tuple[str, ...]:
    """What the reader said, and which data are fitted to and which are held out: the last ``share``, or others."""
    judges = SETTINGS.judging_share * share
    chooses = share - judges
    if validation is None:
        return (
            *recording.notes,
            f"{_span('The recording is', recording)}: {100 * (1 - share):.0f} % of it are fitted to, "
            f"{100 * chooses:.0f} % choose the structure, by turns, and the last {100 * judges:.0f} % judge it.",
        )
    other = [f"Held-out data: {note}" for note in validation.notes if note not in recording.notes]
    return *recording.notes, *other, f"{_span('Fitted to', recording)}; {_span('chosen and judged on', validation)}."


def notes_of_several(several: Several, share: float) -> tuple[str, ...]:
    """What the reader said of each recording, which data are fitted to and held out, and what they share."""
    said = [f"{n}: {note}" for r, n in zip(several.recordings, several.names, strict=True) for note in r.notes]
    alone = [n for n, judges in zip(several.names, several.judges, strict=True) if judges]
    spans = [
        _span("Chosen and judged on" if judges else "Fitted to", r, n) + "."
        for r, n, judges in zip(several.recordings, several.names, several.judges, strict=True)
    ]
    judges = SETTINGS.judging_share * share
    parts = (
        f"{' and '.join(alone)} {'chooses' if len(alone) == 1 else 'choose'} the structure and "
        f"{'judges' if len(alone) == 1 else 'judge'} it alone."
        if alone else
        f"Of each recording {100 * (1 - share):.0f} % are fitted to, {100 * (share - judges):.0f} % choose the "
        f"structure, by turns, and the last {100 * judges:.0f} % judge it."
    )  # fmt: skip
    steps = {r.sample_time_s for r in several.recordings}
    rates = () if len(steps) == 1 else (
        "The recordings have several sample times: each is simulated at its own. Scans for start values take those "
        "with the sample time at which most is fitted.",
    )  # fmt: skip
    shared = ("The recordings share the rig's physics and parameters; first states, and the zeros of positions after "
              "the first recording, are free.")  # fmt: skip
    return *said, *several.notes, *spans, parts, shared, *rates


def zeros_said(recordings: Sequence[RecordingUsed], floor: dict[str, float]) -> tuple[str, ...]:
    """Which zeros of further recordings lie elsewhere than those of the first, by more than ``OTHER_ZERO`` floors."""
    return tuple(
        f"{one.name} counts {channel} from another zero than {recordings[0].name}: "
        f"{quantity(float(zero['value']), str(zero['unit']))} off, which is taken off."
        for one in recordings for channel, zero in one.zeros.items()
        if abs(float(zero["value"])) > OTHER_ZERO * floor.get(channel, 0.0)
    )  # fmt: skip


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
