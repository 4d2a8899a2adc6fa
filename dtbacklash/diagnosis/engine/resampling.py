"""What a predictor looks at: a recording, averaged to the rate of its motion.

White unknown forces follow whatever a sensor shows from one sample to the next. Far above the band of the motion that
is ripple, noise and counts, and the predictor then looks a few milliseconds ahead only. So readings are averaged over
blocks of samples, and the command in the same way: a moving average goes through a linear plant unchanged.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.physics.bodies import natural_frequencies_hz
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.channels import filled

#: samples for each period of the fastest motion, and of the rig's fastest mode (ratio)
MOTION_RATIO, MODE_RATIO = 12.0, 6.0
#: of a channel's power, what its band holds (share), beside so many times the noise's
BAND_SHARE, NOISE_RATIO = 0.999, 8.0
#: samples with gains of their own, while the first state becomes known
OPENING = 250
#: two integrators of the same equations differ by so much: no noise is less (share of a channel's spread)
NUMERICAL = 2e-5
#: readings that are left at least (samples)
READINGS_MIN = 2000
#: a channel of counts repeats its values: it has fewer than this share of them
COUNTED_SHARE = 0.6
#: a channel that is read at fewer of the samples is not averaged (share); sets of readings with gains of their own
OFTEN, SETS_MAX = 0.8, 16


@dataclass(frozen=True)
class Samples:
    """A stretch of a recording at the rate of a predictor.

    sample_time_s : of the predictor. every : samples of the recording that one of it stands for. u, rise : (N,)
    command, as it acts between two readings, and by how much it rises meanwhile. y : (N, m) readings, SI, NaN where
    there is none. channels : their names. noise : (m,) standard deviation that each has at least. counted : (m,)
    whether it reads in counts. recorded : (M,) the command as recorded, for laws of the amplifier, which act
    before anything is averaged. step : (N,) what a sensor of acceleration shows of the command at once, beyond that of
    the sample before; empty where nothing. recording : the number of the one that it belongs to, from 0.
    inputs : (M, commands) those of a simulator's model as recorded; None: u alone. as_stepped : whether its own steps
    made the recording, as they are.
    opened : by how much the gear's half-gap was wider than the rig's, rad.
    """

    sample_time_s: float
    every: int
    u: Floats
    rise: Floats
    y: Floats
    channels: tuple[str, ...]
    noise: Floats
    counted: np.ndarray
    recorded: Floats
    step: Floats
    recording: int = 0
    opened: float = 0.0
    inputs: Floats | None = None
    as_stepped: bool = False

    @property
    def count(self) -> int:
        """Number of readings that there are."""
        return int(self.there.sum())

    @cached_property
    def there(self) -> np.ndarray:
        """(N, m) whether each reading is."""
        return np.isfinite(self.y)

    @cached_property
    def present(self) -> Floats:
        """(m,) how often each channel is read, a share."""
        return np.asarray(np.maximum(self.there.mean(axis=0), 1e-6))

    @cached_property
    def sets(self) -> np.ndarray:
        """(s, m) sets of readings that occur together: first all of them."""
        found, counts = np.unique(self.there, axis=0, return_counts=True)
        found = found[np.argsort(-counts)][:SETS_MAX]
        return np.concatenate([np.ones((1, self.y.shape[1]), dtype=bool), found[~found.all(axis=1)]])

    @property
    def seldom(self) -> bool:
        """Whether some channel is read at few of the samples."""
        return bool((self.present < OFTEN).any())

    @property
    def opening(self) -> int:
        """Samples with gains of their own: the first ones; all, where a channel is read seldom.

        Steady gains do not follow a covariance that comes and goes, and may run away.
        """
        return len(self.u) if self.seldom else min(OPENING, len(self.u))

    def counts(self, opening: int) -> Floats:
        """(s,) samples of each set with steady gains."""
        steady = self.which(opening, self.y) - opening
        return np.bincount(steady[steady >= 0], minlength=len(self.sets)).astype(float)

    def which(self, opening: int, y: Floats) -> np.ndarray:
        """(N,) the number of the gains of each sample of readings that may have been moved in time.

        opening : samples with gains of their own.
        """
        there = self.there if y is self.y else np.isfinite(y)
        if there.all():
            found = np.full(len(y), opening)
        else:
            powers = 2 ** np.arange(y.shape[1])
            known = {int(powers @ one): k for k, one in reversed(list(enumerate(self.sets.astype(int))))}
            codes, inverse = np.unique(there @ powers, return_inverse=True)
            found = opening + np.array([known.get(int(code), 0) for code in codes])[inverse]
        first = min(opening, len(y))
        found[:first] = np.arange(first)
        return found

    def first(self, share: float) -> "Samples":
        """The beginning of the same."""
        n = min(len(self.u), max(round(share * len(self.u)), READINGS_MIN))
        recorded = self.recorded[: n * self.every + 2 * self.every]
        inputs = None if self.inputs is None else self.inputs[: len(recorded)]
        return replace(
            self, u=self.u[:n], rise=self.rise[:n], y=self.y[:n], recorded=recorded, step=self.step[:n], inputs=inputs
        )


def readings(
    u: Floats, y: dict[str, Floats], channels: tuple[str, ...], sample_time_s: float, every: int, imposed: bool,
    at_once: Floats | None = None, recording: int = 0,
) -> Samples:  # fmt: skip
    """Average a stretch of a recording over blocks of ``every`` samples, an odd number.

    u : (M,). y : channel -> (M,), NaN where a reading is missing. imposed : whether the command is a position that a
    positioner takes: it then acts at a reading and not from one to the next. at_once : (M,) the command that a sensor
    of acceleration shows, where it is not that of the sample before.
    """
    noises, counted = zip(*(noise_of(y[c]) for c in channels), strict=True)
    averaged = np.column_stack([_blocks(y[c], every) for c in channels])
    command, rise = (_blocks(u, every), np.zeros(len(u) // every)) if imposed else between(u, every)
    # what counts and what ripples does not average out as white noise does
    least = np.array(noises) / np.sqrt(every)
    step = np.zeros(0) if at_once is None or every > 1 else at_once - np.append(at_once[0], u[:-1])
    return Samples(
        sample_time_s * every, every, np.ascontiguousarray(command), rise, averaged, channels, least,
        np.array(counted), np.ascontiguousarray(u, dtype=float), step, recording,
    )  # fmt: skip


def _blocks(values: Floats, every: int) -> Floats:
    """(M // every,) means; NaN where less than half a block was read."""
    n = len(values) // every
    blocks = values[: n * every].reshape(n, every)
    there = np.isfinite(blocks)
    count = there.sum(axis=1)
    total = np.where(there, blocks, 0.0).sum(axis=1)
    return np.where(2 * count > every, total / np.maximum(count, 1), np.nan)


def between(u: Floats, every: int) -> tuple[Floats, Floats]:
    """(M // every,) the command from the middle of each block to that of the next, and by how much it rises meanwhile.

    Averaged as the readings are, it changes within a block: its mean moves a speed exactly, and a position once its
    first moment is there as well, that of a straight rise. A command that is held over each block does not rise.
    """
    n = len(u) // every
    if every == 1:
        return np.ascontiguousarray(u, dtype=float), np.zeros(len(u))
    padded = np.append(u, np.full(2 * every, u[-1]))
    box, found = np.ones(every) / every, []
    for weights in (box, 12.0 * (np.arange(every) + 0.5 - 0.5 * every) / every**2):
        values = np.convolve(padded, np.convolve(box, weights[::-1]), "valid")
        found.append(np.ascontiguousarray(values[: n * every : every]))
    return found[0], found[1]


def first_read(values: Floats) -> float:
    """What a channel reads first; 0 where it reads nothing."""
    read = values[np.isfinite(values)]
    return float(read[0]) if len(read) else 0.0


def noise_of(values: Floats) -> tuple[float, bool]:
    """A channel's noise, rms, from third differences, which a smooth motion hardly has; whether it reads in counts."""
    read = values[np.isfinite(values)]
    levels = np.unique(read)
    counted = 1 < len(levels) < COUNTED_SHARE * len(read)
    count = float(np.min(np.diff(levels))) / np.sqrt(12.0) if counted else 0.0
    white = 1.4826 * float(np.median(np.abs(np.diff(read, 3)))) / np.sqrt(20.0) if len(read) > 3 else 0.0
    return max(white, count, NUMERICAL * float(np.std(read)), 1e-300), counted


def rate_of(rig: Rig, y: dict[str, Floats], sample_time_s: float) -> int:
    """The odd number of samples that one reading may stand for."""
    if any(np.isfinite(v).mean() < OFTEN for v in y.values()):
        return 1
    if any(rig.sensors[c].quantity == "acceleration" for c in y):
        return 1  # it shows the command of the sample before at once
    modes = natural_frequencies_hz(rig)
    fastest = MODE_RATIO * float(modes.max()) if len(modes) else 0.0
    bands = [band_hz(v, sample_time_s, rig.sensors[c].quantity == "position") for c, v in y.items()]
    wanted = max(MOTION_RATIO * max(bands), fastest, 1e-12)
    samples = min(len(v) for v in y.values())
    most = min(1.0 / (sample_time_s * wanted), samples / READINGS_MIN)
    circuit = rig.only("motor_circuit")
    if circuit is not None and any(rig.sensors[c].quantity == "current" for c in y):
        # a current follows the command within a sample, whatever its mean
        most = min(most, circuit.values["inductance"] / circuit.values["resistance"] / sample_time_s)
    return max(1, (int(most) + 1) // 2 * 2 - 1)


def band_hz(values: Floats, sample_time_s: float, position: bool) -> float:
    """The frequency below which a channel has nearly all of its power, of its rate where it is a position.

    White noise is told from the upper half of the spectrum, and taken off so many times that hardly any of it is left.
    """
    v = np.diff(filled(values)) if position else filled(values)
    window = np.hanning(len(v))
    v = (v - v.mean()) * window
    power = np.abs(np.fft.rfft(v)) ** 2
    shape = 4.0 * np.sin(0.5 * np.pi * np.arange(len(power)) / len(power)) ** 2 if position else np.ones(len(power))
    upper = slice(len(power) // 2, None)
    # counts are white where the motion crosses many of them, and less so above
    level = max(float(np.median(power[upper] / shape[upper])), noise_of(values)[0] ** 2 * float(window @ window))
    noise = NOISE_RATIO * level * shape
    total = np.cumsum(np.maximum(power - noise, 0.0))
    if not total[-1] > 0.0:
        return 0.0
    return float(np.searchsorted(total, BAND_SHARE * total[-1])) / (len(v) * sample_time_s)
