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

Two channels of unlike quantities that have changed places are found the same way (:func:`places`): each is held against
the command alone, with its own column and with the other's. The share that a motion accounts for knows no scale, so it
does not matter in which unit a column in the wrong place was read. On 19 pairs of the tests' recordings the mean of the
two shares is larger by 0.58 to 1 with the columns in their places.

Two relations need no mechanics. A current: u = R i + L i' + k_B omega. A position behind a screw whose motor's angle
is recorded: the angle drives the structure in place of the command, and a play of any width may lie between.
"""

from __future__ import annotations

import math
from collections.abc import Mapping as Dict
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import lsq_linear

from dtbacklash.arrays import Floats
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Element, Rig, Sensor, build_rig
from dtbacklash.physics.simulate import simulate
from dtbacklash.recording.command import stepped

EXCHANGED = 0.5  # share of effort by which two columns have to agree better with the command the other way round
SAMPLES_PLACES = 20_000  # of the part that is looked at for that
SAMPLES_MAX = 60_000  # of the part that is looked at: where the command moves most
BLOCKS = (200, 600, 2000)  # means over so many parts of the recording
NOTHING = 1e-6  # of the effort: what remains of it without the motion says nothing below this
REST = 0.03  # of the rms speed, below which a body rests


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
class Question:
    """``target = s y + sum_j b_j other_j``, with ``low_j <= b_j <= high_j``, after differencing ``order`` times."""

    target: Floats
    y: Floats
    others: tuple[tuple[Floats, float, float], ...]
    order: int


@dataclass(frozen=True)
class Places:
    """Mean share of the command's effort that two channels account for: as recorded, with their columns exchanged."""

    straight: float
    turned: float

    @property
    def exchanged(self) -> bool:
        """Whether only the exchanged columns are what the command does to the rig."""
        return self.turned - self.straight > EXCHANGED


def unlike(rig: Rig, channels: Dict[str, Floats]) -> list[tuple[str, str]]:
    """Recorded pairs of motions of two quantities or units."""
    moving = [s for s in rig.sensors.values() if s.name in channels and s.quantity != "current"]
    return [(a.name, b.name) for a, b in combinations(moving, 2) if (a.quantity, a.unit) != (b.quantity, b.unit)]


def places(
    rig: Rig, pair: tuple[str, str], channels: Dict[str, Floats], sample_time_s: float, command: str, pace: float = 1.0
) -> Places:
    """How well two channels and their exchange agree with the command; 0 and 0 where nothing can be compared.

    pace : factor on the speed of the rig's modes.
    """
    part = busiest(channels["u"], SAMPLES_PLACES)
    u, (a, b) = channels["u"][part], (channels[name][part] for name in pair)

    def share(columns: tuple[Floats, Floats]) -> float:
        each = (
            balance(plain_rig(rig), (name,), {"u": u, name: values}, pace * sample_time_s, command)
            for name, values in zip(pair, columns, strict=True)
        )
        return sum(scale_of(question).share for question in each if question is not None) / 2

    try:
        return Places(share((a, b)), share((b, a)))
    except UserError:  # a rig that cannot be simulated says nothing
        return Places(0.0, 0.0)


def scales(rig: Rig, channels: dict[str, Floats], sample_time_s: float, command: str) -> dict[str, Scale]:
    """What the units of the rig's channels look like; channels that say nothing are left out."""
    u = channels.get("u")
    if u is None or len(u) < 2 or not np.any(u):
        return {}
    part = busiest(u)
    cut = {name: values[part] for name, values in channels.items()}
    bare = plain_rig(rig)
    try:
        questions = {name: balance(bare, (name,), cut, sample_time_s, command) for name in rig.sensors}
    except UserError:  # a rig that cannot be simulated says nothing about units
        return {}
    return {name: scale_of(question) for name, question in questions.items() if question is not None}


def busiest(u: Floats, samples: int = SAMPLES_MAX) -> slice:
    """The stretch of at most ``samples`` in which the command varies most."""
    count = len(u) // samples
    if count < 1:
        return slice(0, len(u))
    sizes = [float(np.std(u[k * samples : (k + 1) * samples])) for k in range(count)]
    k = int(np.argmax(sizes))
    return slice(k * samples, (k + 1) * samples)


def plain_rig(rig: Rig) -> Rig:
    """The rig without its effects: linear, but for what its elements are."""
    return build_rig(replace(rig.config, effects={}))


def driver(rig: Rig, name: str, channels: Dict[str, Floats]) -> str:
    """The signal that makes a channel in the nominal rig: the command, or behind a screw the recorded motor's angle."""
    angle = _angle(rig)
    behind = angle in channels and rig.only("screw") is not None
    sensor = rig.sensors[name]
    return angle if behind and sensor.quantity != "current" and _kind(rig, sensor) != "rotor" else "u"


def balance(
    rig: Rig, names: tuple[str, ...], channels: Dict[str, Floats], sample_time_s: float, command: str
) -> Question | None:
    """What drives a channel, or the difference of two, against what it shows.

    Parameters
    ----------
    rig : without effects (:func:`plain_rig`). names : of one channel, or of two whose difference is asked for (both
        driven by the same signal). channels : (N,) values in SI. command : see :mod:`.command`.

    Returns
    -------
    None where nothing was recorded, nothing moves, or the rig has no drive.

    Raises
    ------
    UserError : the rig cannot be simulated.
    """
    if any(name not in channels for name in names):
        return None
    y = _shown(channels, names)
    if not np.any(y != y[0]):
        return None
    theta = channels.get(_angle(rig))
    circuit = rig.only("motor_circuit")
    if rig.sensors[names[0]].quantity == "current" and circuit is not None:
        return _current(circuit, channels["u"], y, theta, sample_time_s)
    if theta is not None and driver(rig, names[0], channels) != "u":
        return _behind_screw(rig, names, y, theta, sample_time_s)
    return _effort(rig, names, channels, sample_time_s, command)


def _angle(rig: Rig) -> str:
    """The sensor of the rotor's angle, or empty."""
    found = (s.name for s in rig.sensors.values() if s.quantity == "position" and _kind(rig, s) == "rotor")
    return next(found, "")


def _shown(channels: Dict[str, Floats], names: tuple[str, ...]) -> Floats:
    """One channel, or the difference of two."""
    return channels[names[0]] if len(names) == 1 else channels[names[0]] - channels[names[1]]


def _kind(rig: Rig, sensor: Sensor) -> str:
    return rig.elements[sensor.of].kind


def _current(circuit: Element, u: Floats, i: Floats, theta: Floats | None, step: float) -> Question:
    """The balance of the circuit; where no angle is recorded the back-emf is unknown."""
    voltage = circuit.values["resistance"] * i + circuit.values["inductance"] * np.gradient(i, step)
    others: tuple[tuple[Floats, float, float], ...] = ()
    if theta is not None:
        others = ((circuit.values["emf_constant"] * np.gradient(theta, step), -np.inf, np.inf),)
    return Question(u, voltage, others, 0)


def _behind_screw(rig: Rig, names: tuple[str, ...], y: Floats, theta: Floats, step: float) -> Question:
    """The structure driven by the recorded angle, without play or with the play that fits best."""
    angle, u = theta - theta[0], np.zeros(len(theta) - 1)
    width = float(np.ptp(angle)) / 2
    gear = rig.only("gear")
    best, likeness = np.zeros(len(y)), -1.0
    for share in (0.0, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9) if gear and width > 0.0 else (0.0,):
        worn = rig.with_effect(gear.name, "backlash", {"half_gap": min(share * width, 6.0)}) if gear and share else rig
        driven = _shown(simulate(worn, u, step, theta_m_rad=angle).sensors, names)
        size = float(np.std(driven))
        like = float(np.mean((driven - driven.mean()) * (y - y.mean()))) / size if size > 0.0 else -1.0
        if like > likeness:
            best, likeness = driven, like
    return Question(best, y, (), 0)


def _effort(
    rig: Rig, names: tuple[str, ...], channels: Dict[str, Floats], step: float, command: str
) -> Question | None:
    """The effort of the command against that of the recorded motion, with all that may use it up."""
    if rig.only("positioner") is None and rig.only("amplifier") is None:
        return None
    sensor, u, y = rig.sensors[names[0]], channels["u"], _shown(channels, names)
    fine, parts = stepped(u, command)

    def answer(held: Floats) -> Floats:
        return _shown(simulate(rig, np.repeat(held[:-1], parts), step / parts).sensors, names)[::parts]

    target = _shown(simulate(rig, fine, step / parts).sensors, names)[::parts]
    if rig.only("positioner") is not None:
        return Question(target, y, (), 0)
    top, order = float(np.abs(u).max()), _integrators(rig, names, step)
    motion = _smooth(channels[names[0]])
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


def _smooth(values: Floats) -> Floats:
    width = max(1, len(values) // 1000)
    return np.convolve(np.pad(values, width, mode="edge"), np.ones(width) / width, "same")[width : len(values) + width]


def _integrators(rig: Rig, names: tuple[str, ...], step: float) -> int:
    """How often the rig integrates on the way to a sensor: how its answer to a step grows."""
    n = 4000
    y = np.abs(_shown(simulate(rig, np.ones(n), 5 * step).sensors, names))
    return min(2, max(0, round(math.log2(max(y[n], 1e-300) / max(y[n // 2], 1e-300)))))


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
