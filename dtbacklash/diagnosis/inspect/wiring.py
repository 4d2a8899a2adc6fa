"""Wiring: channels whose sign is turned round, and pairs that have changed places, the command among them.

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
(:class:`dtbacklash.recording.plausible.Reversal`). The command and a position or a speed that have changed places are
found as such a pair: what moves takes no effort that a position would make.

Of 431 reversals on drawn machines that are wired right (friction near stalling, loads as large as the drive, play as
wide as the motion, masses off by half, PID loops) two exceed 0.05, and the largest is 0.34 (a single tone between two
modes). Of 129 recordings with one sign turned or two channels swapped, 119 are named and none wrongly; the others say
nothing.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from dtbacklash.diagnosis.records import Record
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.channels import filled
from dtbacklash.recording.command import HELD
from dtbacklash.recording.plausible import SAMPLES_WIRING, Bench, Reversal

#: two rewirings mend alike where their sums of reversals differ by less (share of effort)
REWIRING_SHARE = 0.1


@dataclass(frozen=True)
class Rewiring:
    """What mends a recording: signals to turn (``u`` among them), a pair to swap first; what would do as well."""

    turned: tuple[str, ...] = ()
    swapped: tuple[str, ...] | None = None
    instead: tuple[str, ...] = ()


def wiring(rig: Rig, record: Record) -> tuple[list[Reversal], Rewiring | None]:
    """The reversal of every channel and of every pair, and what would mend those found.

    Returns
    -------
    A reversal each that could be computed, and the fewest changes after which none is left; None if there are none.
    """
    if rig.config.model:
        return [], None
    channels = {"u": record.u, **{n: filled(v) for n, v in record.y.items() if n in rig.sensors}}
    bench = Bench.of(rig, channels, record.sample_time_s, HELD, SAMPLES_WIRING)
    exchanges = [r for name in rig.sensors if name in channels and (r := bench.exchange(name)) is not None]
    exchanges += [r for pair in bench.pairs(alike=False) if (r := bench.reversal(pair, unlike=True)) is not None]
    found = [*exchanges, *_reversals(bench)]
    most = max(exchanges, key=lambda r: r.value, default=None)
    if most is not None and most.wrong:
        return found, Rewiring(swapped=most.names)
    return found, _mended(bench, found) if any(r.wrong for r in found) else None


def _reversals(bench: Bench) -> list[Reversal]:
    """Of every channel, then of every pair, that say anything."""
    single = [(name,) for name in bench.rig.sensors if name in bench.channels]
    every = (bench.reversal(names) for names in (*single, *bench.pairs(alike=True)))
    return [r for r in every if r is not None]


def _mended(bench: Bench, found: Sequence[Reversal]) -> Rewiring:
    """The fewest changes after which no reversal is left: one sign, one swap, one swap and a sign, two signs."""
    wrong = sorted((r.names for r in found if r.wrong), key=lambda names: (len(names), names))
    if len(wrong[0]) == 2:
        return Rewiring(swapped=wrong[0])
    signals = [n for n in ("u", *bench.rig.sensors) if n in bench.channels]
    left = {s: _left(bench.changed(turned=(s,))) for s in signals}
    least = min(left.values())
    if least < math.inf:  # one sensor alone: rather it than the command
        first, *alike = sorted((s for s in signals if left[s] < least + REWIRING_SHARE), key=lambda s: s == "u")
        return Rewiring((first,), None, tuple(alike))
    for pair in bench.pairs(alike=True):
        for turned in ((), *((name,) for name in pair)):
            if _left(bench.changed(turned, pair)) < math.inf:
                return Rewiring(turned, pair)
    return Rewiring(tuple(names[0] for names in wrong if len(names) == 1))


def _left(bench: Bench) -> float:
    """The sum of the reversals of the channels, which is low where all are right; infinite if one is wrong."""
    found = _reversals(bench)
    return math.inf if any(r.wrong for r in found) else sum(r.value for r in found)
