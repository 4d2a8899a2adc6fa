"""Wiring: channels whose sign is turned round, and pairs that have changed places.

One statistic decides, the *balance of effort* of :mod:`dtbacklash.recording.plausible`: what the command makes a
channel do in the nominal rig is compared with what the channel shows, beside all that may use the command up
(friction, loads, a spring, a decay, play), each as large as the command. ``share`` is the part of what those leave of
the command's effort that the motion accounts for, with a factor above 0. Missing physics takes effort away: the share
falls towards 0. It does not make the machine go the other way: the share of the *turned* channel stays at 0. So

    reversal = share(turned) - share(as recorded)

is near -1 on a clean recording, near 0 where friction leaves nothing of the rig's own, and near 1 where the sign is
wrong. A swap of two channels turns the sign of their difference, so it has the same statistic. Near a resonance a
wrong mass turns the phase: the largest share as recorded over rigs whose modes are up to twice as fast or half as
fast counts. Two channels of unlike quantities have no difference: there the mean of the two shares is compared
(``places`` of :mod:`dtbacklash.recording.plausible`).

Of 431 reversals on drawn machines that are wired right (friction near stalling, loads as large as the drive, play as
wide as the motion, masses off by half, PID loops) two exceed 0.05, and the largest is 0.34 (a single tone between two
modes). Of 129 recordings with one sign turned or two channels swapped, 119 are named and none wrongly; the others say
nothing.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.records import Record, filled
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.command import HELD
from dtbacklash.recording.plausible import balance, busiest, driver, places, plain_rig, scale_of, unlike

#: a sign is wrong above it; of 431 channels that were wired right the largest had 0.34 (share of effort)
REVERSAL_SHARE = 0.5
#: two rewirings mend alike where their sums of reversals differ by less (share of effort)
REWIRING_SHARE = 0.1

#: factors on the speed of the rig's modes
PACES = (0.5, 0.7, 1.4, 2.0)
#: of the part of a recording that is looked at, where the command moves most
SAMPLES_MAX = 20_000

Channels = dict[str, Floats]
Pair = tuple[str, str]


@dataclass(frozen=True)
class Reversal:
    """Shares of the effort that a channel, or the difference of two, accounts for as recorded and turned round.

    unlike : two channels of which no difference can be taken; the mean of their shares.
    """

    names: tuple[str, ...]
    straight: float
    turned: float
    unlike: bool = False

    @property
    def value(self) -> float:
        """Above ``REVERSAL_SHARE`` the sign is wrong."""
        return self.turned - self.straight


@dataclass(frozen=True)
class Rewiring:
    """What mends a recording: signals to turn (``u`` among them), a pair to swap first; what would do as well."""

    turned: tuple[str, ...]
    swapped: Pair | None = None
    instead: tuple[str, ...] = ()


def wiring(rig: Rig, record: Record) -> tuple[list[Reversal], Rewiring | None]:
    """The reversal of every channel and of every pair, and what would mend those found.

    Returns
    -------
    A reversal each that could be computed, and the fewest changes after which none is left; None if there are none.
    """
    if rig.config.model:
        return [], None
    part = busiest(record.u, SAMPLES_MAX)
    channels = {"u": record.u[part], **{n: filled(v)[part] for n, v in record.y.items() if n in rig.sensors}}
    bench = Bench(plain_rig(rig), record.sample_time_s)
    exchanges = [_exchange(rig, pair, channels, record.sample_time_s) for pair in unlike(rig, channels)]
    found = [*exchanges, *bench.reversals(channels)]
    most = max(exchanges, key=lambda r: r.value, default=None)
    if most is not None and most.value > REVERSAL_SHARE:
        a, b = most.names
        return found, Rewiring((), (a, b))
    if not any(r.value > REVERSAL_SHARE for r in found):
        return found, None
    return found, bench.mended(channels, found)


def _exchange(rig: Rig, pair: Pair, channels: Channels, step_s: float) -> Reversal:
    """The reversal of two channels of unlike quantities."""
    found = places(rig, pair, channels, step_s, HELD)
    straight = found.straight
    if found.exchanged:
        straight = max(straight, *(places(rig, pair, channels, step_s, HELD, pace).straight for pace in PACES))
    return Reversal(pair, straight, found.turned, unlike=True)


@dataclass(frozen=True)
class Bench:
    """A rig without effects on which recordings are tried."""

    rig: Rig
    step_s: float

    def reversals(self, channels: Channels) -> list[Reversal]:
        """Of every channel, then of every pair, that say anything."""
        single = [(name,) for name in self.rig.sensors if name in channels]
        every = (self.reversal(names, channels) for names in (*single, *self.pairs(channels)))
        return [r for r in every if r is not None]

    def pairs(self, channels: Channels) -> Iterator[Pair]:
        """Channels of the same quantity and unit that the same signal drives."""
        for a, b in combinations([n for n in self.rig.sensors if n in channels], 2):
            one, other = self.rig.sensors[a], self.rig.sensors[b]
            alike = (one.quantity, one.unit) == (other.quantity, other.unit)
            if alike and driver(self.rig, a, channels) == driver(self.rig, b, channels):
                yield a, b

    def reversal(self, names: tuple[str, ...], channels: Channels) -> Reversal | None:
        """The reversal of a channel or of a pair; None where nothing can be compared."""
        other = turned(channels, names) if len(names) == 1 else swapped(channels, names)
        first, second = self._share(names, channels), self._share(names, other)
        if first is None or second is None:
            return None
        if second - first > REVERSAL_SHARE:
            first = max(first, *(self._share(names, channels, pace) or 0.0 for pace in PACES))
        return Reversal(names, first, second)

    def _share(self, names: tuple[str, ...], channels: Channels, pace: float = 1.0) -> float | None:
        try:
            question = balance(self.rig, names, channels, pace * self.step_s, HELD)
        except UserError:  # a rig that cannot be simulated says nothing
            return None
        return None if question is None else scale_of(question).share

    def mended(self, channels: Channels, found: list[Reversal]) -> Rewiring:
        """The fewest changes after which no reversal is left: one sign, one swap, one swap and a sign, two signs."""
        reversed_ = {r.names for r in found if r.value > REVERSAL_SHARE}
        wrong = {names[0] for names in reversed_ if len(names) == 1}
        if not wrong:
            (a, b) = next(iter(reversed_))
            return Rewiring((), (a, b))
        signals = [n for n in ("u", *self.rig.sensors) if n in channels]
        left = {s: self._left(turned(channels, (s,))) for s in signals}
        best = min(left, key=lambda s: (left[s], s == "u"))
        if left[best] < math.inf:
            alike = sorted((s for s in signals if left[s] < left[best] + REWIRING_SHARE), key=lambda s: s == "u")
            return Rewiring((alike[0],), None, tuple(alike[1:]))  # one sensor alone: rather it than the command
        for pair in self.pairs(channels):
            back = swapped(channels, pair)
            if self._left(back) < math.inf:
                return Rewiring((), pair)
            for name in pair:
                if self._left(turned(back, (name,))) < math.inf:
                    return Rewiring((name,), pair)
        return Rewiring(tuple(sorted(wrong)))

    def _left(self, channels: Channels) -> float:
        """The sum of the reversals of the channels, which is low where all are right; infinite if one is wrong."""
        found = [r.value for r in self.reversals(channels)]
        return math.inf if any(value > REVERSAL_SHARE for value in found) else sum(found)


def turned(channels: Channels, names: tuple[str, ...]) -> Channels:
    """The channels with some signs turned round."""
    return {**channels, **{name: -channels[name] for name in names}}


def swapped(channels: Channels, names: tuple[str, ...]) -> Channels:
    """The channels with two that have changed places."""
    a, b = names
    return {**channels, a: channels[b], b: channels[a]}
