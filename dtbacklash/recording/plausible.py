"""Balance of effort: what the command makes a channel do in the rig, against what the channel shows.

Physics that the rig lacks changes what it does by a factor 50 easily: friction lets it creep where the nominal model
runs away. So sizes are not compared. What is compared is the effort that the recorded motion takes with the effort
that the command makes, both brought to the recorded quantity through the nominal linear rig::

    D G u  =  s D y  +  sum_j b_j D G n_j

G is the nominal rig without its effects, D takes means over short blocks and differences them as often as G
integrates (so that nothing piles up), y is the channel as recorded. The n_j are what the command may be used up by,
however large, up to the command itself: friction that holds (the command while nothing moves), Coulomb friction (the
sign of the speed), viscous friction, a constant load, a spring; for a rig that comes to rest by itself, its free
decay as well. All of them have the scale of the command, whatever the unit of y. What remains is the rig's own
inertia, back-emf or stiffness, and the factor s on it is 1 in right units and 1/1000 for millimetres read as metres:
no physics that is missing moves it by a factor 20. On the recordings of the tests that differ most from their rigs
(friction near stalling, loads as large as the drive, play, PID loops) it lies between 0.3 and 3.

Two channels of unlike quantities that have changed places are found the same way: each is held against the command
alone, with its own column and with the other's. The share that a motion accounts for knows no scale, so it
does not matter in which unit a column in the wrong place was read. On 19 pairs of the tests' recordings the mean of the
two shares is larger by 0.58 to 1 with the columns in their places.

Two relations need no mechanics. A current: u = R i + L i' + k_B omega. A position behind a screw whose motor's angle
is recorded: the angle drives the structure in place of the command, and a play of any width may lie between.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from collections.abc import Mapping as Dict
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from itertools import combinations

import numpy as np
from scipy.optimize import lsq_linear

from dtbacklash.arrays import Floats
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.simulate import simulate
from dtbacklash.recording.command import stepped

SAMPLES_MAX = 60_000  # of the part that is looked at: where the command moves most
SAMPLES_WIRING = 20_000  # of that which is looked at for signs and places
#: a sign or a place is wrong above it; of 431 channels that were wired right the largest had 0.34 (share of effort)
REVERSAL_SHARE = 0.5
PACES = (0.5, 0.7, 1.4, 2.0)  # factors on the speed of the rig's modes
BLOCKS = (200, 600, 2000)  # means over so many parts of the recording
NOTHING = 1e-6  # of the effort: what remains of it without the motion says nothing below this
REST = 0.03  # of the rms speed, below which a body rests

Channels = Dict[str, Floats]
Names = tuple[str, ...]


@dataclass(frozen=True)
class Scale:
    """What a channel's unit looks like.

    factor : by which the recorded values are too large (1/s; 0: unknown).
    share : of the effort that nothing else accounts for, that the motion accounts for.
    sustained : size of the motion over what the command can make, in the later part; 0 where the rig integrates.
    """

    factor: float
    share: float
    sustained: float


@dataclass(frozen=True)
class Reversal:
    """Shares of the effort that a channel, or two, account for as recorded, and turned round or exchanged.

    unlike : two channels of which no difference can be taken; the mean of their shares.
    """

    names: Names
    straight: float
    turned: float
    unlike: bool = False

    @property
    def value(self) -> float:
        """The second share less the first."""
        return self.turned - self.straight

    @property
    def wrong(self) -> bool:
        """Whether a sign is turned round, or two channels have changed places."""
        return self.value > REVERSAL_SHARE


@dataclass(frozen=True)
class Question:
    """``target = s y + sum_j b_j other_j``, with ``low_j <= b_j <= high_j``, after differencing ``order`` times."""

    target: Floats
    y: Floats
    others: tuple[tuple[Floats, float, float], ...]
    order: int


def scales(rig: Rig, channels: Channels, sample_time_s: float, command: str) -> dict[str, Scale]:
    """What the units of the rig's channels look like; channels that say nothing are left out."""
    u = channels.get("u")
    if u is None or len(u) < 2 or not np.any(u):
        return {}
    bench = Bench.of(rig, channels, sample_time_s, command)
    return {name: scale for name in rig.sensors if (scale := bench.scale((name,))) is not None}


def plain_rig(rig: Rig) -> Rig:
    """The rig without its effects: linear, but for what its elements are."""
    return build_rig(replace(rig.config, effects={}))


def _busiest(u: Floats, samples: int) -> slice:
    """The stretch of at most ``samples`` in which the command varies most."""
    starts = range(0, max(len(u) // samples, 1) * samples, samples)
    first = max(starts, key=lambda k: float(np.std(u[k : k + samples])))
    return slice(first, first + samples)


@dataclass(frozen=True)
class Bench:
    """A rig without its effects, and what it showed.

    channels : (N,) values in SI, the command ``u`` among them. command : see :mod:`.command`.
    simulated : what the rig was simulated with -> what its sensors show, shared by the variants of a bench.
    """

    rig: Rig
    channels: Channels
    step_s: float
    command: str
    simulated: dict[tuple[object, ...], Channels] = field(default_factory=dict, compare=False, repr=False)

    @classmethod
    def of(cls, rig: Rig, channels: Channels, step_s: float, command: str, samples: int = SAMPLES_MAX) -> Bench:
        """With the part of a recording in which the command varies most."""
        part = _busiest(channels["u"], samples)
        return cls(plain_rig(rig), {name: values[part] for name, values in channels.items()}, step_s, command)

    def pairs(self, alike: bool) -> Iterator[tuple[str, str]]:
        """Recorded channels of one quantity and unit that one signal drives; or of two, but for currents."""
        recorded = [s for s in self.rig.sensors.values() if s.name in self.channels]
        for a, b in combinations(recorded, 2):
            if (a.quantity, a.unit) == (b.quantity, b.unit):
                fits = alike and self.driver(a.name) == self.driver(b.name)
            else:
                fits = not alike and "current" not in (a.quantity, b.quantity)
            if fits:
                yield a.name, b.name

    def changed(self, turned: Names = (), swapped: Names = ()) -> Bench:
        """The same with two channels that have changed places, then with some signs turned round."""
        channels = {**self.channels, **{a: self.channels[b] for a, b in zip(swapped, reversed(swapped), strict=True)}}
        return replace(self, channels={**channels, **{name: -channels[name] for name in turned}})

    def reversal(self, names: Names, unlike: bool = False) -> Reversal | None:
        """The reversal of a channel or of a pair; None where nothing can be compared."""
        other = self.changed(turned=names) if len(names) == 1 else self.changed(swapped=names)
        first, second = self._share(names, unlike), other._share(names, unlike)
        if first is None or second is None:
            return None
        if second - first > REVERSAL_SHARE:
            paces = (replace(self, step_s=pace * self.step_s)._share(names, unlike) or 0.0 for pace in PACES)
            first = max(first, *paces)
        return Reversal(names, first, second, unlike)

    def exchange(self, name: str) -> Reversal | None:
        """The reversal of the command and a position or a speed, which have changed places; None: nothing is said."""
        if self.rig.sensors[name].quantity not in ("position", "velocity") or self.rig.only("positioner") is not None:
            return None
        alone = replace(self, channels={one: self.channels[one] for one in ("u", name)})
        paces = (replace(alone, step_s=pace * self.step_s).scale((name,)) for pace in (1.0, *PACES))
        straight, turned = [one for one in paces if one], alone.changed(swapped=("u", name)).scale((name,))
        if not straight or turned is None:
            return None
        return Reversal(("u", name), max(one.share for one in straight), turned.share, True)

    def _share(self, names: Names, unlike: bool) -> float | None:
        if not unlike:
            found = self.scale(names)
            return None if found is None else found.share
        alone = (replace(self, channels={name: self.channels[name] for name in ("u", one)}) for one in names)
        each = [bench.scale((one,)) for bench, one in zip(alone, names, strict=True)]
        return sum(found.share for found in each if found is not None) / len(names)

    def scale(self, names: Names) -> Scale | None:
        """What a channel's unit looks like, or that of a difference; None where nothing is said."""
        try:
            question = self._question(names)
        except UserError:  # a rig that cannot be simulated says nothing
            return None
        return None if question is None else scale_of(question)

    def driver(self, name: str) -> str:
        """The signal that makes a channel: the command, or behind a screw the recorded motor's angle."""
        angle = self._angle()
        behind = angle in self.channels and self.rig.only("screw") is not None
        return angle if behind and self.rig.sensors[name].quantity != "current" and self._kind(name) != "rotor" else "u"

    def _question(self, names: Names) -> Question | None:
        """What drives a channel, or the difference of two that one signal drives, against what it shows.

        None where nothing was recorded, nothing moves, or the rig has no drive (raises UserError: it cannot be
        simulated).
        """
        if any(name not in self.channels for name in names):
            return None
        y = _shown(self.channels, names)
        if not np.any(y != y[0]):
            return None
        theta = self.channels.get(self._angle())
        circuit = self.rig.only("motor_circuit")
        if self.rig.sensors[names[0]].quantity == "current" and circuit is not None:
            return self._current(circuit.values, y, theta)
        if theta is not None and self.driver(names[0]) != "u":
            return self._behind_screw(names, y, theta)
        return self._effort(names, y)

    def _angle(self) -> str:
        """The sensor of the rotor's angle, or empty."""
        angles = (s.name for s in self.rig.sensors.values() if s.quantity == "position")
        return next((name for name in angles if self._kind(name) == "rotor"), "")

    def _kind(self, name: str) -> str:
        return self.rig.elements[self.rig.sensors[name].of].kind

    def _answer(
        self, u: Floats, names: Names, step_s: float, half_gap_rad: float = 0.0, theta_rad: Floats | None = None
    ) -> Floats:
        """What the rig shows, with play in its gear, if any; the same is not simulated again for another channel."""
        key = (_digest(u), step_s, half_gap_rad, b"" if theta_rad is None else _digest(theta_rad))
        if key not in self.simulated:
            gear = self.rig.only("gear") if half_gap_rad else None
            rig = self.rig.with_effect(gear.name, "backlash", {"half_gap": half_gap_rad}) if gear else self.rig
            self.simulated[key] = simulate(rig, u, step_s, theta_m_rad=theta_rad).sensors
        return _shown(self.simulated[key], names)

    def _current(self, circuit: Dict[str, float], i: Floats, theta: Floats | None) -> Question:
        """The balance of the circuit; where no angle is recorded the back-emf is unknown."""
        voltage = circuit["resistance"] * i + circuit["inductance"] * np.gradient(i, self.step_s)
        emf = None if theta is None else circuit["emf_constant"] * np.gradient(theta, self.step_s)
        return Question(self.channels["u"], voltage, () if emf is None else ((emf, -np.inf, np.inf),), 0)

    def _behind_screw(self, names: Names, y: Floats, theta: Floats) -> Question:
        """The structure driven by the recorded angle, without play or with the play that fits best."""
        angle, u = theta - theta[0], np.zeros(len(theta) - 1)
        width = float(np.ptp(angle)) / 2
        best, likeness = np.zeros(len(y)), -1.0
        for share in (0.0, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9) if self.rig.only("gear") and width > 0.0 else (0.0,):
            driven = self._answer(u, names, self.step_s, min(share * width, 6.0), angle)
            size = float(np.std(driven))
            like = float(np.mean((driven - driven.mean()) * (y - y.mean()))) / size if size > 0.0 else -1.0
            if like > likeness:
                best, likeness = driven, like
        return Question(best, y, (), 0)

    def _effort(self, names: Names, y: Floats) -> Question | None:
        """The effort of the command against that of the recorded motion, with all that may use it up."""
        if self.rig.only("positioner") is None and self.rig.only("amplifier") is None:
            return None
        sensor, u = self.rig.sensors[names[0]], self.channels["u"]
        fine, parts = stepped(u, self.command)

        def answer(held: Floats) -> Floats:
            return self._answer(np.repeat(held[:-1], parts), names, self.step_s / parts)[::parts]

        target = self._answer(fine, names, self.step_s / parts)[::parts]
        if self.rig.only("positioner") is not None:
            return Question(target, y, (), 0)
        top, order = float(np.abs(u).max()), self._integrators(names)
        motion = _smooth(self.channels[names[0]])
        speed = motion if sensor.quantity == "velocity" else np.gradient(motion)
        speed = _smooth(speed)
        moving = np.abs(speed) > REST * float(np.sqrt(np.mean(speed**2)))
        used: list[tuple[Floats, float, float]] = [
            (np.where(moving, 0.0, u), 0.0, 1.0),  # friction that holds
            (np.where(moving, top * np.sign(speed), 0.0), 0.0, 1.5),
            (top * speed / max(float(np.abs(speed).max()), 1e-300), 0.0, 2.0),
            (np.full(len(u), top), -2.0, 2.0),  # a load
        ]
        if order and sensor.quantity == "position":
            off = y - y.mean()
            used.append((top * off / float(np.abs(off).max()), 0.0, 2.0))  # a spring
        others = [(answer(effort), low, high) for effort, low, high in used]
        if not order:
            decay = answer(np.where(np.arange(len(u)) == 0, top, 0.0))
            others += [(decay, -np.inf, np.inf), (np.gradient(decay), -np.inf, np.inf)]
        return Question(target, y, tuple(others), order)

    def _integrators(self, names: Names) -> int:
        """How often the rig integrates on the way to a sensor: how its answer to a step grows."""
        n = 4000
        y = np.abs(self._answer(np.ones(n), names, 5 * self.step_s))
        return min(2, max(0, round(math.log2(max(y[n], 1e-300) / max(y[n // 2], 1e-300)))))


def _shown(channels: Channels, names: Names) -> Floats:
    """One channel, or the difference of two."""
    return channels[names[0]] if len(names) == 1 else channels[names[0]] - channels[names[1]]


def _digest(values: Floats) -> bytes:
    return blake2b(values.tobytes(), digest_size=16).digest()


def _smooth(values: Floats) -> Floats:
    width = max(1, len(values) // 1000)
    return np.convolve(np.pad(values, width, mode="edge"), np.ones(width) / width, "same")[width : len(values) + width]


def scale_of(question: Question) -> Scale:
    """Solve for s with blocks of several lengths; the most telling counts."""
    best = Scale(0.0, 0.0, _sustained(question))
    for count in BLOCKS:
        length = max(1, len(question.y) // count)

        def form(values: Floats, length: int = length) -> Floats:
            means = values[: len(values) // length * length].reshape(-1, length).mean(axis=1)
            return means - means.mean() if question.order == 0 else np.diff(means, question.order)

        target, y = form(question.target), form(question.y)
        sizes = float(np.linalg.norm(target)), float(np.linalg.norm(y))
        if not all(0.0 < size < math.inf for size in sizes):
            continue
        others = [(form(values), low, high) for values, low, high in question.others]
        s, rest = _fit(target, y, others)
        _, without = _fit(target, None, others)
        share = 1.0 - rest / without if without > NOTHING else 0.0
        if share > best.share:
            best = replace(best, factor=1.0 / s if s > 0.0 else 0.0, share=share)
    return best


def _sustained(question: Question) -> float:
    """The size of the motion over that of the linear answer, without the beginning, where something may decay."""
    later = slice(len(question.y) // 3, None)
    size = float(np.std(question.target[later]))
    return float(np.std(question.y[later])) / size if question.order == 0 and 0.0 < size < math.inf else 0.0


def _fit(target: Floats, y: Floats | None, others: list[tuple[Floats, float, float]]) -> tuple[float, float]:
    """The factor s on y (0 without), and the mean square that remains."""
    columns = [(values, low, high) for values, low, high in others if np.isfinite(values).all() and np.any(values)]
    if y is not None:
        columns = [(y, 0.0, np.inf), *columns]
    scale = float(np.linalg.norm(target))
    if not columns:
        return 0.0, 1.0
    matrix = np.column_stack([values for values, _, _ in columns])
    norms = np.linalg.norm(matrix, axis=0)
    low = np.array([low for _, low, _ in columns]) * norms / scale
    high = np.array([high for _, _, high in columns]) * norms / scale
    # the same problem in as many rows as columns
    small: Floats = np.linalg.qr(np.column_stack([matrix / norms, target / scale]), mode="reduced")[1]
    found = lsq_linear(small[:, :-1], small[:, -1], (low, high), method="bvls")
    s = float(found.x[0]) * scale / norms[0] if y is not None else 0.0
    return s, 2.0 * float(found.cost)
