"""Inspect recordings before any physics is tried: what is mended, what is left out, and what forbids a diagnosis."""

from dataclasses import dataclass, field, replace

import numpy as np

from dtbacklash.diagnose.data.compare import Block, Record, longest_step_s
from dtbacklash.diagnose.data.pull import cut
from dtbacklash.diagnose.data.tempo import tempo_rad_s
from dtbacklash.diagnose.inspect import samples
from dtbacklash.diagnose.inspect.sampling import Carried, carried
from dtbacklash.diagnose.inspect.wiring import Reversal, Rewiring, wiring
from dtbacklash.diagnose.result import Check
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.recording.channels import CLIPPED_SHARE

#: a channel clipped more often can neither be mended nor left out (share of samples)
CLIPPED_SHARE_MAX = 0.25
#: after so long a simulation has forgotten a bridge towards which it was pulled (time constants of the pull)
CLIPPED_DECAYS = 15.0
#: of the samples to fit to and to judge on, this much has to remain (share)
INSPECTED_SHARE_MIN = 0.5
#: a channel of fewer readings is left out: some stretches of twenty have to remain to choose by (readings)
HELD_READINGS_MIN = 500

TUKEY = "running median: Tukey, Exploratory Data Analysis (1977)"
EFFORT = "balance of effort, docs/diagnosis.md"
COHERENCE = "Welch's coherence; its level: Carter, Knapp and Nuttall, IEEE Trans. Audio Electroacoust. 21 (1973) 337"
LEVELS = "docs/recordings.md"
REPEATED = "equal readings in a row by chance; docs/diagnosis.md"
TURNS = "phase unwrapping: Itoh, Applied Optics 21 (1982) 2470"
SAMPLED = "Shannon, Proc. IRE 37 (1949) 10; margin for interpolation: docs/diagnosis.md"


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
    """Recordings as far as they could be mended, a row a test, what was done, and the fault if there is one."""

    records: list[Record]
    checks: list[Check] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    fault: Fault | None = None


def inspect(rig: Rig, records: list[Record]) -> Inspected:
    """Look for faults of wiring, sensors and sampling, in this order: wiring tells most.

    Returns
    -------
    The recordings with jumps of an angle undone, with spikes, clipped and repeated samples bridged and taken out of the
    masks, without dead channels.
    """
    found = Inspected(list(records))
    _dead(rig, found)
    for name in _channels(rig, found.records):
        if rig.sensors[name].quantity == "position" and rig.sensors[name].unit == "rad":
            _wrapped(name, found)
        _seldom(rig, name, found)
        if name in found.left_out:
            continue
        _spikes(name, found)
        _clipped(rig, name, found)
        _hung(rig, name, found)
    wired = [wiring(rig, r) for r in found.records]
    _wiring_rows(found, [reversals for reversals, _ in wired])
    slowest = min((carried(rig, r) for r in found.records), key=lambda c: c.per_period)
    _sampling_row(found, slowest)
    if found.fault is None:
        rewiring = next((r for _, r in wired if r is not None), None)
        found.fault = _miswired(rig, wired, rewiring) if rewiring else _too_slow(rig, found, slowest)
    return found


def _channels(rig: Rig, records: list[Record]) -> tuple[str, ...]:
    return tuple(n for n in rig.sensors if all(n in r.y for r in records))


def _dead(rig: Rig, found: Inspected) -> None:
    """Leave out channels that show nothing but noise, or say that the rest is too little."""
    shares = {}
    for name in _channels(rig, found.records):
        # a machine may rest through a stretch: a dead sensor shows nothing where it shows most, either
        record = max(found.records, key=lambda r: float(np.var(r.y[name])))
        others = {"u": record.u, **{n: v for n, v in record.y.items() if n != name}}
        shares[name] = samples.noise_alone(record.y[name], others)
        found.checks.append(_row(
            f"{name} shows more than noise", shares[name], SETTINGS.dead_noise_share,
            "share of its variance that is white noise and coherent with neither the command nor another channel, in "
            "the stretch in which it varies most; more: its sensor is dead or disconnected, or nothing moves there",
            COHERENCE,
        ))  # fmt: skip
    dead = [n for n, share in shares.items() if share >= SETTINGS.dead_noise_share]
    if not dead:
        return
    what = f"{_listed(dead)} {'shows' if len(dead) == 1 else 'show'} nothing but noise"
    fault = Fault(
        SENSOR_PREFIX + dead[0], what, "it has nothing to do with the command or another channel",
        f"Check the wiring of {_listed(dead)}, and that the machine moves, and record again.",
    )  # fmt: skip
    was = "was" if len(dead) == 1 else "were"
    _do_without(rig, dead, fault, f"{what} (dead, disconnected, or nothing moves there) and {was} left out.", found)


def _do_without(rig: Rig, names: list[str], fault: Fault, note: str, found: Inspected) -> None:
    """Leave channels out, and note that; where the rig cannot be compared without them, that is a fault."""
    try:
        _blocks(rig, tuple(n for n in _channels(rig, found.records) if n not in names), found.records)
    except UserError:
        found.fault = found.fault or fault
        return
    found.notes.append(note)
    found.left_out += names
    found.records = [replace(r, y={n: v for n, v in r.y.items() if n not in names}) for r in found.records]


def _wrapped(name: str, found: Inspected) -> None:
    """Undo the jumps of an angle that is recorded within one turn."""
    straight = [samples.unwrapped(r.y[name]) for r in found.records]
    turns = sum(turned for _, turned in straight)
    found.checks.append(_row(
        f"{name} does not begin anew at a full turn", float(turns), 1.0,
        "number of jumps by a whole turn from one sample to the next; they are undone", TURNS,
    ))  # fmt: skip
    if turns:
        found.records = [
            replace(r, y={**r.y, name: seen}) for r, (seen, _) in zip(found.records, straight, strict=True)
        ]
        found.notes.append(f"{name} begins anew at a full turn, {turns} times: the jumps are undone.")


def _seldom(rig: Rig, name: str, found: Inspected) -> None:
    """Compare a sensor that is read more seldom than recorded only where it was read."""
    masks = [samples.fresh(r.y[name]) for r in found.records]
    every = max(1.0 / float(np.mean(m)) if m is not None else 1.0 for m in masks)
    found.checks.append(_row(
        f"{name} is read at every sample", every, 1.5,
        "samples for each reading of a channel that never changes at two samples in a row; what lies between its "
        "readings is bridged, and neither fitted nor judged", SAMPLED,
    ))  # fmt: skip
    if every == 1.0:
        return
    readings = sum(len(r.u) if m is None else int(m.sum()) for r, m in zip(found.records, masks, strict=True))
    if readings < HELD_READINGS_MIN:
        what = f"{name} is read {readings} times in all"
        fault = Fault(
            SENSOR_PREFIX + name, what, "it repeats each reading for many samples",
            f"Read {name} more often, and record again.",
        )  # fmt: skip
        note = f"{what}, which is too seldom to compare it, and was left out."
        _do_without(rig, [name], fault, note, found)
        return
    bridged = [
        r if m is None else replace(r, y={**r.y, name: samples.between(r.y[name], m)})
        for r, m in zip(found.records, masks, strict=True)
    ]  # fmt: skip
    found.records = [
        r if m is None else replace(r, train=r.train & m, held=r.held & m) for r, m in zip(bridged, masks, strict=True)
    ]
    said = f"{name} repeats its readings: it is read at one of {every:.3g} samples. What lies between is bridged"
    if _enough(bridged, found.records, 1.0 / every):
        found.notes.append(f"{said}, and neither fitted nor judged.")
    else:  # another sensor that is read at other samples has left too few
        found.records = bridged
        found.notes.append(f"{said}.")


def _spikes(name: str, found: Inspected) -> None:
    masks = [samples.spikes(r.y[name], r.u) for r in found.records]
    total = sum(int(m.sum()) for m in masks)
    found.checks.append(_row(
        f"{name} is free of spikes", float(total), 1.0,
        f"number of samples further off the median of their neighbours than {SETTINGS.spike_ratio:g} times all but "
        f"{100 * (1.0 - SETTINGS.spike_usual_share):.2g} % of the others; they are bridged, and neither fitted nor "
        "judged", TUKEY,
    ))  # fmt: skip
    if total:
        _take_out(name, masks, found, 0.0)
        first = next(
            r.from_s + r.sample_time_s * int(np.flatnonzero(m)[0])
            for r, m in zip(found.records, masks, strict=True) if m.any()
        )  # fmt: skip
        found.notes.append(
            f"{name} has {total} spike{'s' * (total > 1)} (the first {first:.6g} s after the beginning): bridged, and "
            "neither fitted nor judged."
        )


def _clipped(rig: Rig, name: str, found: Inspected) -> None:
    masks = [samples.at_limits(r.y[name]) for r in found.records]
    share = _share(masks)
    found.checks.append(_row(
        f"{name} is not clipped", share, CLIPPED_SHARE,
        "share of its samples at its extreme value, reached and left at speed; they are bridged, "
        "and neither fitted nor judged",
        LEVELS,
    ))  # fmt: skip
    if share > 0.0:
        _bridge(
            rig, name, masks, found, f"{name} is clipped in {100 * share:.2g} % of its samples",
            "it runs into its extreme value at speed, stays there, and leaves it at speed",
            f"Widen the range of {name}, or move less, and record again.",
        )  # fmt: skip


def _hung(rig: Rig, name: str, found: Inspected) -> None:
    masks = [samples.hung(r.y[name]) for r in found.records]
    share = _share(masks)
    found.checks.append(_row(
        f"{name} does not hang", share, CLIPPED_SHARE,
        "share of its samples that repeat a reading for longer than chance does, before it jumps on; they are bridged, "
        "and neither fitted nor judged", REPEATED,
    ))  # fmt: skip
    if share > 0.0:
        _bridge(
            rig, name, masks, found, f"{name} hangs in {100 * share:.2g} % of its samples",
            "it repeats a reading and then jumps on", f"Check the connection of {name}, and record again.",
        )  # fmt: skip


def _bridge(
    rig: Rig, name: str, masks: list[np.ndarray], found: Inspected, said: str, known_by: str, mend: str
) -> None:
    """Bridge what a channel does not show, and what it misleads; where too little remains, that is a fault.

    said : what happens, a clause. known_by : how it is known, a clause. mend : what to do, a sentence.
    """
    before = found.records
    share = _share(masks)
    blocks = _blocks(rig, _channels(rig, before), before)
    pull = max((b.pull / b.step_s for b in blocks if b.pulled == name), default=0.0)
    _take_out(name, masks, found, CLIPPED_DECAYS / pull if pull > 0.0 else 0.0)
    # a few bridged samples drive what lies behind them nearly as it was driven
    drives = share >= CLIPPED_SHARE and any(b.imposed == name for b in blocks)
    if share <= CLIPPED_SHARE_MAX and _enough(before, found.records) and not drives:
        found.notes.append(f"{said}: bridged, and neither fitted nor judged.")
    elif found.fault is None:
        why = "and what lies behind it is driven by it in the simulation" if drives else "too often to leave that out"
        found.fault = Fault(SENSOR_PREFIX + name, said, f"{known_by}, {why}", mend)


def _share(masks: list[np.ndarray]) -> float:
    """Share of all samples."""
    return float(np.mean(np.concatenate(masks)))


def _take_out(name: str, masks: list[np.ndarray], found: Inspected, after_s: float) -> None:
    """Bridge samples of a channel, and neither fit nor judge on them and for so many seconds after."""
    records = []
    for record, mask in zip(found.records, masks, strict=True):
        taken, after = np.cumsum(mask), round(after_s / record.sample_time_s)
        near = taken > np.concatenate([np.zeros(min(2 + after, len(mask)), taken.dtype), taken[: -2 - after]])
        y = {**record.y, name: samples.bridged(record.y[name], mask)}
        records.append(replace(record, y=y, train=record.train & ~near, held=record.held & ~near))
    found.records = records


def _blocks(rig: Rig, channels: tuple[str, ...], records: list[Record]) -> list[Block]:
    return cut(rig, channels, longest_step_s(records), tempo_rad_s(rig, records))


def _enough(before: list[Record], after: list[Record], expected: float = 1.0) -> bool:
    """Whether enough is left to fit to and to judge on of the share that is ``expected`` to be."""

    def count(records: list[Record], part: str) -> int:
        return sum(int(getattr(r, part).sum()) for r in records)

    least = INSPECTED_SHARE_MIN * expected
    return all(count(after, part) >= least * count(before, part) for part in ("train", "held"))


def _wiring_rows(found: Inspected, each: list[list[Reversal]]) -> None:
    worst: dict[tuple[str, ...], Reversal] = {}
    for reversal in (r for reversals in each for r in reversals):
        worst[reversal.names] = max(reversal, worst.get(reversal.names, reversal), key=lambda r: r.value)
    for names, reversal in worst.items():
        one, most = len(names) == 1, SETTINGS.reversal_share
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
        "the sampling carries the rig's modes", statistic, ">", SETTINGS.mode_samples_min, slowest.enough,
        f"samples per period of the rig's modes ({which}); with fewer what happens between the samples is not recorded",
        SAMPLED,
    ))  # fmt: skip


def _miswired(rig: Rig, wired: list[tuple[list[Reversal], Rewiring | None]], rewiring: Rewiring) -> Fault:
    reversals = next(found for found, mending in wired if mending is rewiring)
    wrong = [r for r in reversals if r.value > SETTINGS.reversal_share]
    best = max(wrong, key=lambda r: r.turned)
    if rewiring.swapped:
        a, b = rewiring.swapped
        signs = f", and the sign of {_listed(list(rewiring.turned))} is turned round" if rewiring.turned else ""
        what, how = f"{a} and {b} have changed places{signs}", "swapped back"
        mend = f"Swap {a} and {b} in the recording (or in its mapping)"
        where = a
    else:
        names = _listed(list(rewiring.turned))
        what = f"{names} {'has its sign' if len(rewiring.turned) == 1 else 'have their signs'} turned round"
        what += f" (or {_listed(list(rewiring.instead))} instead)" if rewiring.instead else ""
        how, mend, where = "turned back", f"Turn {names} back", rewiring.turned[0]
    if rewiring.turned:
        mend += f" ({rewiring.turned[0]}: {{column: {rewiring.turned[0]}, scale: -1}} in a mapping)"
    shown = best.names[0] if len(best.names) == 1 else f"the difference of {best.names[0]} and {best.names[1]}"
    if best.unlike:
        shown = f"each of {_listed(list(best.names))}"
    why = (f"{how}, {shown} accounts for {100 * best.turned:.0f} % of what the command does to the nominal rig, as "
           f"recorded for {100 * best.straight:.0f} %")  # fmt: skip
    amplifier = rig.only("amplifier")
    place = amplifier.name if where == "u" and amplifier else SENSOR_PREFIX + where
    return Fault(place, what, why, f"{mend}, and diagnose again.")


def _too_slow(rig: Rig, found: Inspected, slowest: Carried) -> Fault | None:
    if slowest.enough or slowest.frequency_hz is None:
        return None
    step = longest_step_s(found.records)
    wanted = SETTINGS.mode_samples_min * slowest.frequency_hz
    last = _channels(rig, found.records)[-1]
    return Fault(
        SENSOR_PREFIX + last, f"The sampling ({1.0 / step:.4g} Hz) is too slow for this rig",
        f"its mode at {slowest.frequency_hz:.3g} Hz has {slowest.per_period:.2g} samples a period",
        f"Record at {wanted:.3g} Hz or faster, with the command as it was between the samples.",
    )  # fmt: skip


def _row(check: str, statistic: float, threshold: float, comment: str, source: str) -> Check:
    return Check(check, statistic, "<", threshold, statistic < threshold, comment, source)


def _listed(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
