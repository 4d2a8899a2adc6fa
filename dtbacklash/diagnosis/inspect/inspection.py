"""Inspect recordings before any physics is tried: what is left out of them, and what forbids a diagnosis."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.inspect import samples
from dtbacklash.diagnosis.inspect.clock import GAIN, clocks, set_right
from dtbacklash.diagnosis.inspect.command import bridged, outliers
from dtbacklash.diagnosis.inspect.sampling import MODE_SAMPLES_MIN, Carried, carried
from dtbacklash.diagnosis.inspect.wiring import Rewiring, wiring
from dtbacklash.diagnosis.labels import listed
from dtbacklash.diagnosis.records import Mask, Record
from dtbacklash.diagnosis.result import Check
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.recording.channels import CLIPPED_SHARE, filled
from dtbacklash.recording.mapping import Channel
from dtbacklash.recording.plausible import REVERSAL_SHARE, Reversal
from dtbacklash.recording.refusal import SAMPLES_MIN

#: a channel of which more is missing is a fault (share of its samples)
MISSING_SHARE_MAX = 0.25
#: of its readings to fit to and to judge on, this much has to remain (share)
LEFT_SHARE_MIN = 0.5
#: so many outliers of a recording's command are said one by one
OUTLIERS_SAID = 3
#: of fewer readings in a stretch nothing is told (readings)
STRETCH_READINGS_MIN = 20

TUKEY = "running median: Tukey, Exploratory Data Analysis (1977)"
EFFORT = "balance of effort, docs/method.md"
COHERENCE = "Welch's coherence; its level: Carter, Knapp and Nuttall, IEEE Trans. Audio Electroacoust. 21 (1973) 337"
LEVELS = "docs/recordings.md"
REPEATED = "equal readings in a row by chance; docs/method.md"
TURNS = "phase unwrapping: Itoh, Applied Optics 21 (1982) 2470"
SAMPLED = "Shannon, Proc. IRE 37 (1949) 10; margin for interpolation: docs/method.md"
#: a note on a clock begins so
CLOCK = "The clock of "


@dataclass(frozen=True)
class Fault:
    """What forbids to name any physics.

    where : an element or ``sensor_<name>``. what : the fault, as a sentence without its full stop.
    why : how it is known, a clause. mend : what to do before diagnosing again, a sentence.
    """

    where: str
    what: str
    why: str
    mend: str


@dataclass
class Inspected:
    """Recordings without what is wrong in them, a row a test, what was done, and the fault if there is one."""

    records: list[Record]
    checks: list[Check] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    fault: Fault | None = None


def inspect(rig: Rig, records: list[Record]) -> Inspected:
    """Look for faults of wiring, sensors and sampling, in this order: wiring tells most.

    Returns
    -------
    The recordings with jumps of an angle undone, without dead channels. Spikes, clipped and repeated samples are NaN.
    """
    found = Inspected(list(records))
    _command(rig, found)
    _dead(rig, found)
    for name in _channels(rig, found.records):
        if rig.sensors[name].quantity == "position" and rig.sensors[name].unit == "rad":
            _wrapped(name, found)
        _seldom(name, found)
        if name not in found.left_out:
            for wrong in WRONG:
                _without(wrong, name, found)
    _clocks(rig, found)
    wired = [wiring(rig, r) for r in found.records]
    _wiring_rows(found, [reversals for reversals, _ in wired])
    slowest = min((carried(rig, r) for r in found.records), key=lambda c: c.per_period)
    _sampling_row(found, slowest)
    if found.fault is None:
        rewiring = next((r for _, r in wired if r is not None), None)
        found.fault = _miswired(rig, found.records[0], wired, rewiring) if rewiring else _too_slow(rig, found, slowest)
    return found


def _command(rig: Rig, found: Inspected) -> None:
    """Bridge outliers of the command, and say where they were."""
    masks = [outliers(rig, r) for r in found.records]
    count = sum(int(m.sum()) for m in masks)
    found.checks.append(_row(
        "u is free of outliers", float(count), 1.0,
        "number of samples that stand alone and that no sensor answers as the rig would; what lies between their "
        "neighbours is put in their place", TUKEY,
    ))  # fmt: skip
    for record, mask in zip(found.records, masks, strict=True):
        for k in np.flatnonzero(mask).tolist()[:OUTLIERS_SAID]:
            at_s = record.from_s + k * record.sample_time_s
            where = (
                f"u is {record.u[k]:.6g} at {at_s:.6g} s (row {round(at_s / record.sample_time_s) + 1} of the values)"
            )
            found.notes.append(f"{where}, and no sensor answers that: bridged.")
    more = count - sum(min(int(m.sum()), OUTLIERS_SAID) for m in masks)
    if more:
        found.notes.append(f"u has {more} more outliers: bridged.")
    found.records = [bridged(r, mask) if mask.any() else r for r, mask in zip(found.records, masks, strict=True)]


def _channels(rig: Rig, records: list[Record]) -> tuple[str, ...]:
    """The channels that some recording has."""
    return tuple(n for n in rig.sensors if any(n in r.y for r in records))


def _dead(rig: Rig, found: Inspected) -> None:
    """Leave out channels that show nothing but noise, or say that the rest is too little."""
    shares = {}
    for name in _channels(rig, found.records):
        # a machine may rest through a stretch: a dead sensor shows nothing where it shows most, either
        record = max((r for r in found.records if name in r.y), key=lambda r: float(np.var(filled(r.y[name]))))
        read = np.isfinite(record.y[name])
        others = {"u": record.u[read], **{n: filled(v)[read] for n, v in record.y.items() if n != name}}
        shares[name] = samples.noise_alone(record.y[name][read], others)
        found.checks.append(_row(
            f"{name} shows more than noise", shares[name], samples.DEAD_NOISE_SHARE,
            "share of its variance that is white noise and coherent with neither the command nor another channel, in "
            "the stretch in which it varies most; more: its sensor is dead or disconnected, or nothing moves there",
            COHERENCE,
        ))  # fmt: skip
    dead = [n for n, share in shares.items() if share >= samples.DEAD_NOISE_SHARE]
    if not dead:
        return
    what = f"{listed(dead)} {'shows' if len(dead) == 1 else 'show'} nothing but noise"
    fault = Fault(
        SENSOR_PREFIX + dead[0], what, "it has nothing to do with the command or another channel",
        f"Check the wiring of {listed(dead)}, and that the machine moves, and record again.",
    )  # fmt: skip
    was = "was" if len(dead) == 1 else "were"
    _do_without(dead, fault, f"{what} (dead, disconnected, or nothing moves there) and {was} left out.", found)


def _do_without(names: list[str], fault: Fault, note: str, found: Inspected) -> None:
    """Leave channels out, and note that; where a recording has no other, that is a fault.

    Any other channel will do: what it does not show, the predictor holds to be unknown.
    """
    rest = [replace(r, y={n: v for n, v in r.y.items() if n not in names}) for r in found.records]
    if not all(r.y for r in rest):
        found.fault = found.fault or fault
        return
    found.notes.append(note)
    found.left_out += names
    found.records = rest


def _wrapped(name: str, found: Inspected) -> None:
    """Undo the jumps of an angle that is recorded within one turn."""
    turns, records = 0, []
    for record in found.records:
        values = record.y.get(name, np.zeros(0))
        read = np.isfinite(values)
        straight, turned = samples.unwrapped(values[read])
        turns += turned
        if turned:
            values = np.full(record.samples, np.nan)
            values[read] = straight
        records.append(replace(record, y={**record.y, name: values}) if turned else record)
    found.records = records
    found.checks.append(_row(
        f"{name} does not begin anew at a full turn", float(turns), 1.0,
        "number of jumps by a whole turn from one sample to the next; they are undone", TURNS,
    ))  # fmt: skip
    if turns:
        found.notes.append(f"{name} begins anew at a full turn, {turns} times: the jumps are undone.")


def _marked(name: str, found: Inspected, test: Callable[[Floats, Floats], Mask]) -> list[Mask]:
    """Which samples of a channel a test marks, a mask a record.

    test : of the readings that there are, and of the command at these.
    """
    masks = []
    for record in found.records:
        mask = np.isfinite(record.y.get(name, np.full(record.samples, np.nan)))
        mask[mask] = test(record.y[name][mask], record.u[mask]) if mask.sum() >= STRETCH_READINGS_MIN else False
        masks.append(mask)
    return masks


def _leave_out(name: str, masks: list[Mask], found: Inspected) -> None:
    """Make samples of a channel missing."""
    found.records = [
        replace(r, y={**r.y, name: np.where(mask, np.nan, r.y[name])}) if mask.any() else r
        for r, mask in zip(found.records, masks, strict=True)
    ]


def _readings(name: str, records: list[Record]) -> Floats:
    """How many readings of a channel are fitted to, and how many are held out."""
    read = [(r, np.isfinite(r.y[name])) for r in records if name in r.y]
    return np.array([sum(int((m & getattr(r, part)).sum()) for r, m in read) for part in ("train", "held")])


def _seldom(name: str, found: Inspected) -> None:
    """Of a sensor that is read more seldom than it is recorded, keep its readings."""
    before, masks = found.records, _marked(name, found, lambda values, _: samples.stale(values))
    every = max(1.0 / (1.0 - float(m.mean())) for m in masks)
    found.checks.append(_row(
        f"{name} is read at every sample", every, 1.5,
        "samples for each reading of a channel that never changes at two samples in a row; what lies between its "
        "readings is left out", SAMPLED,
    ))  # fmt: skip
    if every == 1.0:
        return
    _leave_out(name, masks, found)
    said, readings = f"{name} repeats its readings", int(_readings(name, found.records).sum())
    if readings >= SAMPLES_MIN:
        found.notes.append(f"{said}: it is read at one of {every:.3g} samples. What lies between is left out.")
        return
    what, found.records = f"{name} is read {readings} times in all", before
    fault = Fault(
        SENSOR_PREFIX + name, what, "it repeats each reading for many samples",
        f"Read {name} more often, and record again.",
    )  # fmt: skip
    _do_without([name], fault, f"{what}, which is too seldom to compare it, and was left out.", found)


@dataclass(frozen=True)
class Wrong:
    """What may be wrong with single samples of a channel, which are left out.

    marks : of readings and the command, which are wrong. passes : what is true of a channel without. most : so many
    pass, a share of its samples; a number where it is 1. comment, source : of its row. said : what is wrong, with
    {count}, {s} and {percent}. known_by : how that is known. mend : what to do, with the channel's {name}.
    """

    marks: Callable[[Floats, Floats], Mask]
    passes: str
    most: float
    comment: str
    source: str
    said: str
    known_by: str
    mend: str


WRONG = (
    Wrong(
        samples.spikes, "is free of spikes", 1.0,
        f"number of samples further off the median of their neighbours than {samples.SPIKE_RATIO:g} times all but "
        f"{100 * (1.0 - samples.SPIKE_USUAL_SHARE):.2g} % of the others; they are left out", TUKEY,
        "has {count} spike{s}", "they stand alone", "Check the connection of {name}, and record again.",
    ),
    Wrong(
        lambda values, _: samples.at_limits(values), "is not clipped", CLIPPED_SHARE,
        "share of its samples at its extreme value, reached and left at speed; they are left out", LEVELS,
        "is clipped in {percent} % of its samples",
        "it runs into its extreme value at speed, stays there, and leaves it at speed",
        "Widen the range of {name}, or move less, and record again.",
    ),
    Wrong(
        lambda values, _: samples.hung(values), "does not hang", CLIPPED_SHARE,
        "share of its samples that repeat a reading for longer than chance does, before it jumps on; they are left out",
        REPEATED,
        "hangs in {percent} % of its samples", "it repeats a reading and then jumps on",
        "Check the connection of {name}, and record again.",
    ),
)  # fmt: skip


def _without(wrong: Wrong, name: str, found: Inspected) -> None:
    """Leave out the samples of a channel that are wrong; where too little remains of it, that is a fault."""
    masks, before = _marked(name, found, wrong.marks), found.records
    count = sum(int(m.sum()) for m in masks)
    share = count / sum(r.samples for r in before if name in r.y)
    statistic = float(count) if wrong.most == 1.0 else share
    found.checks.append(_row(f"{name} {wrong.passes}", statistic, wrong.most, wrong.comment, wrong.source))
    if not count:
        return
    _leave_out(name, masks, found)
    said = f"{name} " + wrong.said.format(count=count, s="s" * (count > 1), percent=f"{100 * share:.2g}")
    if share <= MISSING_SHARE_MAX and all(_readings(name, found.records) >= LEFT_SHARE_MIN * _readings(name, before)):
        first = min(r.from_s + r.sample_time_s * int(m.argmax()) for r, m in zip(before, masks, strict=True) if m.any())
        found.notes.append(f"{said} (the first {first:.6g} s after the beginning): left out.")
    elif found.fault is None:
        why = f"{wrong.known_by}, too often to leave that out"
        found.fault = Fault(SENSOR_PREFIX + name, said, why, wrong.mend.format(name=name))


def _clocks(rig: Rig, found: Inspected) -> None:
    """Take the readings of sensors whose log has a clock of its own at the times of the command."""
    known = clocks(rig, found.records)
    found.checks.append(_row(
        "the sensors and u have one clock", max((c.gain for c, _ in known.values()), default=1.0), GAIN,
        "how many times as coherent with the command what the drive moves is at another clock, the same one at low and "
        "at high frequencies; readings are then taken at the times of the command's", COHERENCE,
    ))  # fmt: skip
    for number, (clock, names) in known.items():
        if clock.gain > GAIN:
            found.records = [set_right(r, names, clock.fast) if r.recording == number else r for r in found.records]
            where = f" of recording {number + 1}" if len(known) > 1 else ""
            found.notes.append(
                f"{CLOCK}{listed(list(names))}{where} is {100 * abs(clock.fast):.3g} % "
                f"{'fast' if clock.fast > 0.0 else 'slow'} against that of u: set right. What is left of that acts as "
                "friction and delays do: no name is sure, and intervals are too narrow. Record both with one clock."
            )


def _wiring_rows(found: Inspected, each: list[list[Reversal]]) -> None:
    worst: dict[tuple[str, ...], Reversal] = {}
    for reversal in (r for reversals in each for r in reversals):
        worst[reversal.names] = max(reversal, worst.get(reversal.names, reversal), key=lambda r: r.value)
    for names, reversal in worst.items():
        one, most = len(names) == 1, REVERSAL_SHARE
        which = "two channels account for, exchanged," if reversal.unlike else (
            f"{'a channel' if one else 'the difference of two'} accounts for with its sign turned round,"
        )  # fmt: skip
        found.checks.append(_row(
            f"polarity of {names[0]}" if one else f"{names[0]} and {names[1]} are in their places", reversal.value,
            most, f"share of the effort that {which} less that as recorded; missing physics takes effort away but "
            "turns no sign", EFFORT,
        ))  # fmt: skip


def _sampling_row(found: Inspected, slowest: Carried) -> None:
    which = (
        "no mode matters"
        if slowest.frequency_hz is None
        else f"the fastest that matters: {slowest.frequency_hz:.3g} Hz"
    )
    statistic = slowest.per_period
    found.checks.append(Check(
        "the sampling carries the rig's modes", statistic, ">", MODE_SAMPLES_MIN, slowest.enough,
        f"samples per period of the rig's modes ({which}); with fewer what happens between the samples is not recorded",
        SAMPLED,
    ))  # fmt: skip


def _miswired(
    rig: Rig, record: Record, wired: list[tuple[list[Reversal], Rewiring | None]], rewiring: Rewiring
) -> Fault:
    reversals = next(found for found, mending in wired if mending is rewiring)
    best = max((r for r in reversals if r.wrong), key=lambda r: r.turned)
    if rewiring.swapped:
        a, b = rewiring.swapped
        signs = f", and the sign of {listed(list(rewiring.turned))} is turned round" if rewiring.turned else ""
        what, how = f"{a} and {b} have changed places{signs}", "swapped back"
        mend = f"Swap {a} and {b} in the recording (or in its mapping)"
        where = a
    else:
        names = listed(list(rewiring.turned))
        what = f"{names} {'has its sign' if len(rewiring.turned) == 1 else 'have their signs'} turned round"
        what += f" (or {listed(list(rewiring.instead))} instead)" if rewiring.instead else ""
        how, mend, where = "turned back", f"Turn {names} back", rewiring.turned[0]
    if rewiring.turned:
        mend += f" ({_turned_back(rewiring.turned[0], record)} in a mapping)"
    shown = best.names[0] if len(best.names) == 1 else f"the difference of {best.names[0]} and {best.names[1]}"
    if best.unlike:
        shown = f"each of {listed(list(best.names))}"
    why = (f"{how}, {shown} accounts for {100 * best.turned:.0f} % of what the command does to the nominal rig, as "
           f"recorded for {100 * best.straight:.0f} %")  # fmt: skip
    amplifier = rig.only("amplifier")
    place = amplifier.name if where == "u" and amplifier else SENSOR_PREFIX + where
    return Fault(place, what, why, f"{mend}, and diagnose again.")


def _turned_back(name: str, record: Record) -> str:
    """The line of a mapping that turns a channel round, with all else as it was read."""
    read = record.columns.get(name, Channel(name))
    said = {"column": read.column, "scale": -read.scale, "offset": -read.offset, "unit": read.unit, "si_unit": read.si}
    kept = {key: f"{value:.15g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
            for key, value in said.items() if value or key == "scale"}  # fmt: skip
    return f"{name}: {{{', '.join(f'{key}: {value}' for key, value in kept.items())}}}"


def _too_slow(rig: Rig, found: Inspected, slowest: Carried) -> Fault | None:
    if slowest.enough or slowest.frequency_hz is None:
        return None
    step = max(r.sample_time_s for r in found.records)
    wanted = MODE_SAMPLES_MIN * slowest.frequency_hz
    last = _channels(rig, found.records)[-1]
    return Fault(
        SENSOR_PREFIX + last, f"The sampling ({1.0 / step:.4g} Hz) is too slow for this rig",
        f"its mode at {slowest.frequency_hz:.3g} Hz has {slowest.per_period:.2g} samples a period",
        f"Record at {wanted:.3g} Hz or faster, with the command as it was between the samples.",
    )  # fmt: skip


def _row(check: str, statistic: float, threshold: float, comment: str, source: str) -> Check:
    return Check(check, statistic, "<", threshold, statistic < threshold, comment, source)
