"""How the recording saw the machine, and the models that it leaves open: what the next experiment is designed from."""

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.conclusion import Conclusion
from dtbacklash.diagnosis.engine.horizons import STRETCHES
from dtbacklash.diagnosis.engine.motion import motion_of
from dtbacklash.diagnosis.explain.differences import changed
from dtbacklash.diagnosis.planning import Observed, OpenModel
from dtbacklash.physics.rig_file import rig_content


def observed(c: Conclusion) -> Observed:
    """Of the recordings together: their largest motion, the noise and the unknown force of the found model."""
    segments, motion = c.search.segments, c.search.motion
    last = max(segments.predictors, key=lambda p: p.count).readings
    ends = np.cumsum([len(p.readings.u) for p in segments.predictors])[:-1]

    def most(values: Floats, from_the_first: bool) -> float:
        parts = np.split(values, ends)
        return max(float(np.abs(v - v[0] * from_the_first).max()) for v in parts)

    unknown, n = c.unknown(c.last), len(segments.linear.bodies)
    force = dict(zip(segments.linear.bodies, segments.predictors[0].force.tolist(), strict=True))
    noise: dict[str, float] = {}
    for p, noise_levels in zip(segments.predictors, c.last.noise_levels, strict=True):
        # of means: what a reading of the recording itself has more
        of_one = np.exp(noise_levels[n:]) * np.sqrt(p.readings.every)
        noise |= dict(zip(p.readings.channels, of_one.tolist(), strict=True))
    return Observed(
        last.sample_time_s / last.every, float(len(last.u) * last.sample_time_s),
        max(float(np.abs(p.readings.recorded).max()) for p in segments.predictors),
        {b: most(motion.position[b], True) for b in motion.position},
        {b: most(motion.speed[b], False) for b in motion.speed},
        noise, {b: share * force[b] for b, share in unknown.items()}, tuple(_open(c)), *_slow(c),
    )  # fmt: skip


def _slow(c: Conclusion) -> tuple[dict[str, float], float]:
    """Body -> rms over stretches of the mean force that the found rig lacks there; how long a stretch is, s.

    Over a stretch the corrections of a speed add up to the impulse of what is unknown.
    """
    segments, rig = c.search.segments, c.model.rig
    means = motion_of(segments, rig, segments.gains(rig, c.model.noise_levels)).unknown_means(STRETCHES)
    inertia = dict(zip(segments.linear.bodies, segments.linear.inertia.tolist(), strict=True))
    length = sum(len(p.readings.u) * p.readings.sample_time_s for p in segments.predictors) / STRETCHES
    return {b: inertia[b] * float(np.sqrt(np.mean(a**2))) for b, a in means.items()}, length


def _open(c: Conclusion) -> list[OpenModel]:
    """The rivals of every name that are not beaten, the closest first; each model once. What else may have changed."""
    rivals = [(key, r) for key in c.model.keys for r in c.judged.rivals.get(key, ()) if not r.beaten]
    found: dict[tuple[tuple[str, str], ...], OpenModel] = {}
    last = c.search.segments.recordings[-1]
    for key, rival in sorted(rivals, key=lambda one: one[1].lead):
        others = tuple(sorted(rival.model.keys))
        if others != tuple(sorted(c.model.keys)):
            found.setdefault(others, OpenModel(key, rival.keys, rig_content(rival.model.rig.of(last)), rival.lead))
    for change, *_ in changed(c):
        for title, (t, model) in change.rivals.items():
            if not t > c.search.rules.min_t:
                is_, lead = ("", title), model.score - c.model.score
                found[(("", change.title), is_)] = OpenModel(
                    ("", change.title), (is_,), rig_content(model.rig.of(last)), lead
                )
    return list(found.values())
