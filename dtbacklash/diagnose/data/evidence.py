"""The evidence of a diagnosis: recordings, blocks and noise floor, and the residuals of a rig on them."""

from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.candidates import PlacesInMotion
from dtbacklash.diagnose.data.compare import Block, Record, Steps, longest_step_s, places_of, residual
from dtbacklash.diagnose.data.floor import Noise, channel_noise, noise_floor
from dtbacklash.diagnose.data.in_motion import with_start
from dtbacklash.diagnose.data.pull import cut, guided, zero_channels
from dtbacklash.diagnose.data.tempo import tempo_rad_s
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.declare import Bounds
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.channels import runs

#: what linear motion between samples leaves where a sensor is exact (share of the signal)
METHOD_ERROR_SHARE = 2e-4
#: a channel's noise is corrected where a residual shows less than this of it: its estimate scatters (ratio)
QUIETER_RATIO = 0.8
#: a residual far above the floor is correlated so long: it counts once, or it would overrule every prior (1/tempo)
CORRELATED_RATIO = 0.5

#: largest residual, in floors: the simulation diverged
RUNAWAY = 1e9

Residuals = dict[str, list[Floats]]


def by_recording(records: list[Record]) -> list[list[Record]]:
    """The records of each recording together, in their order."""
    found: dict[int, list[Record]] = {}
    for record in records:
        found.setdefault(record.recording, []).append(record)
    return list(found.values())


def stretch_of(records: list[Record]) -> int:
    """Number of samples of a stretch, over which losses are compared; of the longest sample time among the records."""
    longest = longest_step_s(records)
    held = sum(int(r.held.sum()) * (r.sample_time_s / longest) for r in records)
    return max(20, int(held) // SETTINGS.paired_stretches)


def _finite(residuals: Floats) -> Floats:
    return np.clip(np.nan_to_num(residuals, nan=RUNAWAY, posinf=RUNAWAY, neginf=-RUNAWAY), -RUNAWAY, RUNAWAY)


def _cut(rig: Rig, pulled: Rig, channels: tuple[str, ...], records: list[Record], tempo_rad_s: float) -> list[Block]:
    """The blocks of a rig, with the pull that the rig ``pulled`` needs."""
    step = longest_step_s(records)
    blocks = [guided(pulled, b, records) for b in cut(rig, channels, step, tempo_rad_s)]
    if any(r.own_zero for r in records):
        blocks = [replace(b, zeros=zero_channels(rig, b, step)) for b in blocks]
    return blocks


@dataclass
class Evidence:
    """Recordings, the blocks into which the rig is cut, and the noise floor of every channel."""

    nominal: Rig
    records: list[Record]
    blocks: list[Block]
    noise: Noise
    floor: dict[str, Floats]
    stretch: int
    moving: PlacesInMotion

    @classmethod
    def gather(
        cls, rig: Rig, records: list[Record], tempo: float | None = None, noise: Noise | None = None
    ) -> "Evidence":
        """Cut the rig and measure the floor; tempo (rad/s) and noise are estimated from the records if not given."""
        channels = tuple(n for n in rig.sensors if all(n in r.y for r in records))
        tempo = tempo_rad_s(rig, records) if tempo is None else tempo
        blocks = _cut(rig, rig, channels, records, tempo)
        records = [with_start(rig, blocks, r) for r in records]
        stretch = stretch_of(records)
        noise = channel_noise(records) if noise is None else noise
        moving = PlacesInMotion(rig, blocks, records)
        return cls(rig, records, blocks, noise, noise_floor(rig, blocks, records, noise), stretch, moving)

    def pulled_for(self, rig: Rig) -> "Evidence":
        """The same with the pull that a rig needs to follow these records, or that the nominal rig needs, if weaker.

        Under the pull that the nominal rig needs, a channel is followed whatever the model does.
        """
        channels = tuple(c for c in self.nominal.sensors if any(c in b.channels for b in self.blocks))
        tempo = self.blocks[0].tempo / longest_step_s(self.records)
        usual, needed = (_cut(self.nominal, pulled, channels, self.records, tempo) for pulled in (self.nominal, rig))
        blocks = [new if new.pull < old.pull else old for new, old in zip(needed, usual, strict=True)]
        if blocks == self.blocks:
            return self
        return replace(self, blocks=blocks, floor=noise_floor(self.nominal, blocks, self.records, self.noise))

    @property
    def correlated(self) -> float:
        """Number of consecutive samples that count as one, of a residual far above the floor.

        Of recordings of several sample times, their mean: all samples together count as often as each for itself.
        """
        samples: dict[float, int] = {}
        for r in self.records:
            samples[r.sample_time_s] = samples.get(r.sample_time_s, 0) + r.samples
        each = {s: max(1.0, CORRELATED_RATIO / self.blocks[0].at(s).tempo) for s in samples}
        if len(each) == 1:
            return next(iter(each.values()))
        return sum(samples.values()) / sum(n / each[s] for s, n in samples.items())

    def bounds(self, key: tuple[str, str]) -> Bounds:
        """Parameter -> (low, high) within which these recordings can show an effect (place, name)."""
        return find(self.nominal.kind_at(key[0]), key[1], key[0]).bounds_at(self.moving(key[0]))

    def quieter(self, residuals: Residuals) -> "Evidence":
        """The same with a lower floor, where these residuals show that a channel has less noise."""
        left = {c: [e[:, j] * self.floor[b.name][j] for e in residuals[b.name]]
                for b in self.blocks for j, c in enumerate(b.channels)}  # fmt: skip
        noise = channel_noise(self.records, left)
        ratio = QUIETER_RATIO
        noise = {c: noise[c] if noise[c][0] < ratio * old[0] else old for c, old in self.noise.items()}
        if noise == self.noise:
            return self
        return replace(self, noise=noise, floor=noise_floor(self.nominal, self.blocks, self.records, noise))

    def least(self) -> dict[str, Floats]:
        """Per block, (channels,) the smallest mean square that means anything, in units of the floor's.

        More than 1 for a sensor without noise in a block that a measured angle drives: the angle is known at the
        samples only, and its course between them leaves a small share of the signal.
        """
        least = {}
        for block in self.blocks:
            sizes = np.array([np.mean([np.std(r.y[c]) for r in self.records]) for c in block.channels])
            noise = np.array([self.noise[c][0] for c in block.channels])
            exact = noise <= 1.05 * SETTINGS.numerical_error_share * sizes
            method = (METHOD_ERROR_SHARE * sizes / self.floor[block.name]) ** 2
            counts = exact & (block.imposed is not None)
            least[block.name] = np.where(counts, np.maximum(method, 1.0), 1.0)
        return least

    def passed(self) -> dict[str, Floats]:
        """Per block, (channels,) the share of the floor's mean square that is not the sensor's noise.

        Mostly from an encoder's counts that drive the structure. It is measured on a simulated recording, in which the
        motor stops between other counts: so it is known to a factor only, and an effect can fit it.
        """
        sensors = {b.name: np.array([self.noise[c][0] for c in b.channels]) for b in self.blocks}
        return {name: np.clip(1.0 - (s / self.floor[name]) ** 2, 0.0, 1.0) for name, s in sensors.items()}

    def rescaled(self, residuals: Residuals, before: "Evidence") -> Residuals:
        """Residuals in units of this floor, from those in units of the floor of ``before``."""
        return {
            b.name: [e * (before.floor[b.name] / self.floor[b.name]) for e in residuals[b.name]] for b in self.blocks
        }

    def residuals(
        self, rig: Rig, known: Residuals | None = None, places: set[str] | None = None, steps: Steps = "fine"
    ) -> Residuals:
        """Per block and record, (N, channels) residuals in units of the floor.

        known : residuals of a rig that differs at ``places`` only: blocks without these places are copied.
        """
        found: Residuals = {}
        for block in self.blocks:
            if known is not None and block.name in known and not (places or set()) & places_of(rig, block):
                found[block.name] = known[block.name]
            else:
                scale = self.floor[block.name]
                with np.errstate(over="ignore", invalid="ignore"):  # the simulation may diverge
                    left = [_finite(residual(rig, block, r, steps) / scale) for r in self.records]
                found[block.name] = self.without_zeros(block, left)
        return found

    def without_zeros(self, block: Block, each: list[Floats]) -> list[Floats]:
        """Per record, (N, channels, ...) residuals or responses of a block without what a free zero explains.

        The zero is linear and has no prior, so that the fit to all that is used of its recording is their mean
        (variable projection: Golub & Pereyra, SIAM J. Numer. Anal. 10 (1973) 413).
        """
        columns = [block.channels.index(c) for c in block.zeros]
        if not columns or not any(r.own_zero for r in self.records):
            return each
        found = list(each)
        for number in {r.recording for r in self.records if r.own_zero}:
            own = [k for k, r in enumerate(self.records) if r.recording == number]
            used = [self.records[k].used for k in own]
            if any(u.any() for u in used):
                mean = np.concatenate([each[k][u][:, columns] for k, u in zip(own, used, strict=True)]).mean(axis=0)
                for k in own:
                    found[k] = each[k].copy()
                    found[k][:, columns] -= mean
        return found

    def rows(self, residuals: Residuals, name: str, part: str) -> Floats:
        """(channels, samples) of one block's residuals in a part: ``train`` or ``held``."""
        # slices copy faster than a mask
        chosen = [
            e[a:b]
            for e, r in zip(residuals[name], self.records, strict=True) for a, b in runs(getattr(r, part))
        ]  # fmt: skip
        if not chosen:
            return np.zeros((residuals[name][0].shape[1], 0))
        return (chosen[0] if len(chosen) == 1 else np.concatenate(chosen)).T

    def mean_square(self, residuals: Residuals, part: str) -> dict[str, Floats]:
        """Per block, (channels,) mean square in units of the floor's."""
        return {b.name: np.mean(self.rows(residuals, b.name, part) ** 2, axis=1) for b in self.blocks}

    def rms(self, residuals: Residuals, part: str = "held") -> float:
        """Root mean square over all channels, in units of the floor."""
        return float(np.sqrt(np.mean(np.concatenate(list(self.mean_square(residuals, part).values())))))

    def stretches(self, residuals: Residuals, name: str, part: str = "held") -> Floats:
        """(channels, stretches) mean squares over stretches of a part, in units of the floor's.

        A stretch lies within one recording and is as long in each, in seconds; a recording of less than one is one.
        """
        return self.means(self.rows(residuals, name, part) ** 2, part)

    def means(self, rows: Floats, part: str) -> Floats:
        """(channels, stretches) means of (channels, samples) of a part over its stretches."""
        means, first = [], 0
        for _, samples, stretch in self._stretches_of(part):
            whole = rows[:, first : first + samples // stretch * stretch]
            means.append(whole.reshape(len(rows), -1, stretch).mean(axis=2))
            first += samples
        return means[0] if len(means) == 1 else np.concatenate([np.zeros((len(rows), 0)), *means], axis=1)

    def recordings_of_stretches(self, part: str = "held") -> np.ndarray:
        """(stretches,) for each stretch of :meth:`stretches` the number of its recording."""
        each = [np.full(samples // stretch, number) for number, samples, stretch in self._stretches_of(part)]
        return np.concatenate([np.zeros(0, dtype=int), *each])

    def _stretches_of(self, part: str) -> list[tuple[int, int, int]]:
        """Of each recording that has any of a part: number, samples of the part, and samples of a stretch."""
        found, longest, recordings = [], longest_step_s(self.records), by_recording(self.records)
        of_held = self.stretch if part != "used" else stretch_of([replace(r, held=r.used) for r in self.records])
        for records in recordings:
            samples = sum(int(getattr(r, part).sum()) for r in records)
            stretch = round(of_held * (longest / records[0].sample_time_s))
            if samples:
                found.append((records[0].recording, samples, min(stretch, samples) if len(recordings) > 1 else stretch))
        return found
