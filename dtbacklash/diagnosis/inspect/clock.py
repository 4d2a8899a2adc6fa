"""A sensor's clock against that of the command: whether one log runs faster than the other.

What a machine shows of its command is late by as much at its end as at its beginning. Where a sensor's log runs fast,
its lag changes evenly with time, at all frequencies alike: then the cross-spectra of stretches of the recording, turned
back by that, agree. ``S_w(f)`` is that of the command and the sensor in a stretch about the time ``t_w``; the clock is
the ``eps`` at which ``sum_f |sum_w S_w(f) exp(2 pi i f eps t_w)|^2``, each frequency in proportion to its powers, is
largest: a sum of coherences (Carter, Proc. IEEE 75 (1987) 236). What changes as a machine drifts delays not all
frequencies alike. A play that grows does, of a square wave: what lies behind it is later and later. So the body that
the drive moves has to show the clock first.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.records import Record
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.channels import filled

#: clocks are looked for up to this (share); stretches that overlap by half, of so many samples at least
FASTEST, STRETCHES, SAMPLES_MIN = 0.02, 32, 64
#: of the turn of the fastest frequency, from one clock to the next that is tried
STEP = 0.1
#: to so many stretches they are padded, so that what lies between two turns of a phase is known
PADDED = 16 * STRETCHES
#: so often a clock is looked for anew in what was set right: a stretch is coherent with one that it has moved out of
ROUNDS = 3
#: frequencies at which the command has less are not looked at (share of its largest power)
DRIVEN = 1e-4
#: so many of them at most are looked at, the best driven ones
FREQUENCIES = 200
#: a clock that is wrong makes a recording so many times as coherent
GAIN = 1.3
#: stretches that have nothing in common are coherent by one part in their number: so many times that is more
BY_CHANCE = 4.0
#: the clocks that the lower and the higher half of the frequencies show differ by less (share)
APART = 0.3


@dataclass(frozen=True)
class Clock:
    """What is known of a sensor's clock.

    fast : by how much its log is faster than the command's, a share. coherence, before : the mean coherence at that,
    and as it was recorded. apart : by how much the clocks that the lower and the higher half of the frequencies show
    differ, a share of it.
    """

    fast: float
    coherence: float
    before: float
    apart: float

    @property
    def shown(self) -> bool:
        """Whether the sensor shows enough of the command to tell."""
        return self.coherence * STRETCHES > BY_CHANCE

    @property
    def gain(self) -> float:
        """How many times as coherent the recording is at that clock; 1 where its frequencies do not agree on one."""
        return self.coherence / max(self.before, 1e-300) if self.shown and self.apart < APART else 1.0


def clock_of(u: Floats, y: Floats, step_s: float) -> Clock | None:
    """The clock of a sensor's log. u, y : (N,) command and readings, without gaps; None where nothing is told."""
    length = 2 * (len(u) // (STRETCHES + 1))
    if length < SAMPLES_MIN or not (np.ptp(u) > 0.0 and np.ptp(y) > 0.0):
        return None
    first = np.arange(0, len(u) - length, length // 2)
    U, Y = (_spectra(values, first, length) for values in (u, np.diff(y, prepend=y[0])))
    t, f = (first - first.mean()) * step_s, np.fft.rfftfreq(length, step_s)[2:-1]
    driven = (np.abs(U) ** 2).sum(axis=0)
    powers = np.sqrt(driven * (np.abs(Y) ** 2).sum(axis=0))
    kept = np.flatnonzero((driven > DRIVEN * driven.max()) & (powers > 0.0))
    kept = np.sort(kept[np.argsort(-driven[kept], kind="stable")[:FREQUENCIES]])
    if len(kept) < 2:
        return None
    S, f = (np.conj(U) * Y)[:, kept] / powers[kept], f[kept]
    steps = np.arange(0.0, FASTEST, STEP / (f.max() * np.ptp(t)))
    tried = np.append(-steps[:0:-1], steps)
    power = np.abs(np.fft.fft(S, PADDED, axis=0)) ** 2  # over how fast the phase of a frequency turns
    turns = -f * (t[1] - t[0]) * PADDED

    def at(clock: float) -> Floats:
        """(frequencies,) what each has at a clock."""
        found: Floats = power[np.rint(clock * turns).astype(int) % PADDED, np.arange(len(f))]
        return found

    total = np.array([at(clock).sum() for clock in tried])
    best, still = int(total.argmax()), at(0.0)
    if not 0 < best < len(tried) - 1:
        return None
    each = at(tried[best])
    half = int(np.searchsorted(np.cumsum(each), 0.5 * each.sum()))
    halves = np.array([(found[:half].sum(), found[half:].sum()) for found in map(at, tried)])
    low, high = tried[halves.argmax(axis=0)]
    before, most, after = total[best - 1 : best + 2]
    between = 0.5 * (before - after) / min(before - 2.0 * most + after, -1e-300)
    fast = float(tried[best] + between * (tried[1] - tried[0]))
    apart = float(abs(high - low)) / max(abs(fast), 1e-300)
    return Clock(fast / (1.0 - fast), float(each.mean()), float(still.mean()), apart)


def _spectra(values: Floats, first: np.ndarray, length: int) -> np.ndarray:
    """(stretches, frequencies) of stretches that begin at ``first``, without the slowest two and the last one."""
    parts = np.lib.stride_tricks.sliding_window_view(values, length)[first]
    return np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * np.hanning(length), axis=1)[:, 2:-1]


def clocks(rig: Rig, records: list[Record]) -> dict[int, tuple[Clock, tuple[str, ...]]]:
    """Number of a recording -> its sensors' clock, and those that have it; of its longest stretch.

    It is what the body that the drive moves shows most of, and of all sensors that do not show that they have none.
    """
    longest: dict[int, Record] = {}
    for r in records:
        if r.samples > getattr(longest.get(r.recording), "samples", 0):
            longest[r.recording] = r
    found = {}
    moved = {rig.drive.name, rig.drive.neighbours["drives"]} if rig.drive else set()
    for number, r in longest.items():
        each = {n: c for n in r.y if (c := clock_of(r.u, filled(r.y[n]), r.sample_time_s)) is not None}
        first = max((n for n in each if rig.sensors[n].of in moved), key=lambda n: each[n].gain, default=None)
        if first is not None:
            right = [n for n, c in each.items() if c.shown and not c.gain > GAIN]
            found[number] = _refined(r, first, each[first]), tuple(n for n in r.y if n not in right)
    return found


def _refined(record: Record, name: str, clock: Clock) -> Clock:
    """A clock that is wrong, by what is left once it is set right."""
    for _ in range(ROUNDS if clock.gain > GAIN else 0):
        y = filled(set_right(record, (name,), clock.fast).y[name])
        left = clock_of(record.u, y, record.sample_time_s)
        clock = clock if left is None else replace(clock, fast=(1.0 + clock.fast) * (1.0 + left.fast) - 1.0)
    return clock


def set_right(record: Record, names: Collection[str], fast: float) -> Record:
    """The record with these sensors' readings at the times of the command's clock; both began together."""
    from scipy.interpolate import CubicSpline

    at = np.arange(record.samples, dtype=float)
    begun = record.from_s / record.sample_time_s
    logged = (begun + at) * (1.0 + fast) - begun
    near = np.clip(np.rint(logged), 0, len(at) - 1).astype(int)
    y = dict(record.y)
    for name in set(names) & set(y):
        lost = ~np.isfinite(y[name][near]) | (logged < 0.0) | (logged > at[-1])
        y[name] = np.where(lost, np.nan, CubicSpline(at, filled(y[name]))(logged))
    return replace(record, y=y, retimed=True)
