"""The predictors of all stretches and recordings together: what is fitted to, stacked."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.predictor import ASTRAY, LOST, Gains, Predictor
from dtbacklash.diagnosis.engine.simulator import Linear
from dtbacklash.diagnosis.parallel import spread
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig

#: share of the unknown forces at which it is asked whether steps are fine enough
STRICT = 0.1

#: noise levels of unknown forces and noises of each stretch
NoiseLevels = tuple[Floats, ...]


@dataclass(frozen=True)
class Segments:
    """Predictors of one rig, a stretch each; their rows are stacked, their noise levels are their own.

    telling : the stretch on whose beginning quick fits are made.
    """

    nominal: Rig
    predictors: tuple[Predictor, ...]
    telling: int = 0

    @property
    def count(self) -> int:
        """Readings in all."""
        return sum(p.count for p in self.predictors)

    @property
    def innovations(self) -> int:
        """Rows that are innovations, missing readings with them."""
        return sum(p.readings.y.size for p in self.predictors)

    @property
    def sensors(self) -> set[str]:
        """Places of the sensors that were recorded."""
        return {SENSOR_PREFIX + c for p in self.predictors for c in p.readings.channels}

    @cached_property
    def recordings(self) -> tuple[int, ...]:
        """Numbers of the recordings, in order."""
        return tuple(sorted({p.readings.recording for p in self.predictors}))

    @cached_property
    def anywhere(self) -> tuple[int, ...]:
        """The recordings, where there are several and no position that is read in them has a known zero."""
        read = {c: self.nominal.sensors[c] for p in self.predictors for c in p.readings.channels}
        known = any(s.quantity == "position" and not s.relative for s in read.values())
        return () if known or len(self.recordings) < 2 else self.recordings

    @cached_property
    def spreads(self) -> dict[tuple[str, int], float]:
        """(channel, recording) -> how much its readings vary, rms, SI."""
        found: dict[tuple[str, int], float] = {}
        for p in self.predictors:
            for channel, y in zip(p.readings.channels, p.readings.y.T, strict=True):
                key = channel, p.readings.recording
                found[key] = max(found.get(key, 1e-300), float(np.nanstd(y)))
        return found

    @property
    def linear(self) -> Linear:
        """Of the nominal rig, on the first stretch."""
        return self.predictors[0].linear

    def most_telling(self, noise_levels: NoiseLevels) -> int:
        """The stretch that says most of what is missing: by its unknown force, times its readings."""
        each = [max(p.unknown(s).values()) * p.count for p, s in zip(self.predictors, noise_levels, strict=True)]
        return each.index(max(each))

    def first(self, share: float) -> "Segments":
        """The beginning of the telling stretch, for quick fits."""
        return Segments(self.nominal, (self.predictors[self.telling].first(share),))

    def of_first(self, noise_levels: NoiseLevels) -> NoiseLevels:
        """The noise levels that belong to :meth:`first`."""
        return (noise_levels[self.telling],)

    def back(self, noise_levels: NoiseLevels, before: NoiseLevels) -> NoiseLevels:
        """Sizes for all from those of :meth:`first`: unknown forces changed alike."""
        n = len(self.linear.bodies)
        by = noise_levels[0][:n] - before[self.telling][:n]
        return tuple(np.concatenate([s[:n] + by, s[n:]]) for s in before)

    @property
    def floor(self) -> float:
        """-2 log likelihood of a model that leaves each sensor's noise and nothing else."""
        each = (p.readings.there.sum(axis=0) @ (2.0 * p.nominal_noise + 1.0) for p in self.predictors)
        return float(sum(each))

    def gains(self, rig: Rig, noise_levels: NoiseLevels) -> list[Gains]:
        """Of each stretch."""
        return [p.gains(rig, s) for p, s in zip(self.predictors, noise_levels, strict=True)]

    def scaled(self, noise_levels: NoiseLevels, factor: float) -> NoiseLevels:
        """Sizes with other unknown forces."""
        return tuple(p.scaled(s, factor) for p, s in zip(self.predictors, noise_levels, strict=True))

    def residuals(
        self, rig: Rig, gains: Sequence[Gains], recording: int | None = None, others: Floats | None = None
    ) -> Floats | None:
        """(readings,) whitened innovations, sample after sample; None where a pass does not stay finite.

        recording, others : only this one is run; those of the others are taken from there.
        """
        ends = np.cumsum([0, *(p.readings.y.size for p in self.predictors)])

        def of(k: int) -> Floats:
            if others is not None and recording not in (None, self.predictors[k].readings.recording):
                return others[ends[k] : ends[k + 1]]
            return self.predictors[k].run(rig, gains[k]).E.ravel()

        found = spread(of, range(len(self.predictors)))
        rows = found[0] if len(found) == 1 else np.concatenate(found)
        return rows if np.isfinite(rows).all() and np.abs(rows).max() < ASTRAY else None

    def leads(
        self, rig: Rig, moved: dict[str, tuple[Rig, float]], gains: Sequence[Gains], kept: bool = True
    ) -> dict[str, Floats]:
        """See :meth:`.Predictor.leads`."""
        each = [p.leads(rig, moved, g, kept) for p, g in zip(self.predictors, gains, strict=True)]
        return {title: np.concatenate([one[title] for one in each]) for title in moved}

    @cached_property
    def fine(self) -> "Segments":
        """The same, simulated in fine steps."""
        return replace(self, predictors=tuple(p.stepping(finely=True) for p in self.predictors))

    @property
    def coarse(self) -> "Segments":
        """The same, not simulated in fine steps; itself where it is not."""
        if not any(p.simulated.finely for p in self.predictors):
            return self
        return replace(self, predictors=tuple(p.stepping(finely=False) for p in self.predictors))

    def refine(self, rig: Rig, noise_levels: NoiseLevels, worth: float) -> bool:
        """Simulate in finer steps from now on, if that changes innovations by so much; whether it does.

        worth : sum of squares.
        """
        coarse = [p.simulated for p in self.predictors if not p.simulated.finely]
        if not coarse:
            return False
        gains = self.gains(rig, self.scaled(noise_levels, STRICT))  # what is rough makes forces seem unknown
        rough = self.residuals(rig, gains)
        for simulated in coarse:
            simulated.finely = True
        fine = self.residuals(rig, gains)
        if rough is None or fine is None or np.sum((fine - rough) ** 2) > worth:
            return True
        for simulated in coarse:
            simulated.finely = False
        return False

    def tuned(self, rig: Rig, noise_levels: NoiseLevels | None = None, **how: object) -> tuple[NoiseLevels, float]:
        """Sizes that make a rig likeliest, and -2 log likelihood."""
        each = spread(
            lambda k: self.predictors[k].tuned(rig, None if noise_levels is None else noise_levels[k], **how),  # type: ignore[arg-type]
            range(len(self.predictors)),
        )
        return tuple(s for s, _ in each), min(sum(v for _, v in each), LOST)

    def unknown(self, noise_levels: NoiseLevels) -> dict[str, float]:
        """Body -> its unknown force, a share of what acts there, rms over the stretches."""
        weights = np.array([p.count for p in self.predictors], dtype=float)
        squares = np.array([np.exp(2.0 * s[: len(self.linear.bodies)]) for s in noise_levels])
        mean = np.sqrt(weights @ squares / weights.sum())
        return dict(zip(self.linear.bodies, mean.tolist(), strict=True))

    def most_unknown(self, noise_levels: NoiseLevels) -> float:
        """The largest of these."""
        return max(self.unknown(noise_levels).values())
