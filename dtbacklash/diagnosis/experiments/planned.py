"""A planned experiment: its simulated readings, as a diagnosis would look at them."""

from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.diagnosis.engine.fit import FittedModel
from dtbacklash.diagnosis.engine.parameters import with_priors
from dtbacklash.diagnosis.engine.resampling import rate_of
from dtbacklash.diagnosis.engine.segments import NoiseLevels, Segments
from dtbacklash.diagnosis.engine.sensor_zeros import zeroed
from dtbacklash.diagnosis.predictions import segments_of
from dtbacklash.diagnosis.records import records_of
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.model import Recording


@dataclass(frozen=True)
class Planned:
    """The segments of a planned experiment. noise_levels : of the unknown forces, as assumed, and of the noises."""

    segments: Segments
    noise_levels: NoiseLevels
    every: int

    @property
    def model(self) -> FittedModel:
        """The rig as it is planned with, its parameters known to their tolerances."""
        return FittedModel(self.segments.nominal, (), self.noise_levels, 0.0, 0.0, 0.0, False, stiff=1.0)


def planned(rig: Rig, recording: Recording, unknown: float) -> Planned:
    """The segments of a simulated recording of a rig.

    Parameters
    ----------
    unknown : unknown force at each body, a share of the force that moves it: no model of a machine is exact.

    Raises
    ------
    UserError : nothing recorded shows some part that integrates.
    """
    nominal = with_priors(rig)
    records = records_of(recording, nominal, True, False)
    every = [rate_of(nominal, r.y, r.sample_time_s) for r in records]
    segments = segments_of(nominal, records, every)
    segments = replace(segments, nominal=zeroed(segments, nominal))
    bodies = len(segments.linear.bodies)
    noise_levels, _ = segments.tuned(segments.nominal)
    assumed = tuple(np.concatenate([np.full(bodies, np.log(unknown)), s[bodies:]]) for s in noise_levels)
    return Planned(segments, assumed, every[0])
