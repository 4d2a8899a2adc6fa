"""Start values of periodic laws: wave number and phase, by one linear regression per wave number.

A force ``A sin(n q + phase)`` along the measured motion is linear in ``A cos(phase)`` and ``A sin(phase)``, and reaches
the output through the block's linear dynamics, so that a filter replaces the simulation.
"""

import math

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.candidates import Candidate
from dtbacklash.diagnose.data.compare import Block, Record, part_of, places_of, true_angle, usual_step_s
from dtbacklash.diagnose.data.responses import Path, transfer, wave_responses
from dtbacklash.diagnose.propose.projection import Projection
from dtbacklash.diagnose.propose.wave_spectrum import Passage, likely_waves
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.assembly import compile_plant, state_names
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Bounds, Role, Values
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.plant import Plant
from dtbacklash.physics.rig import Rig

#: wave numbers are this far apart over the travel, so that none slips through (cycles)
WAVE_STEP_SHARE = 0.5
#: where the travel tells more apart, so many of the likeliest wave numbers are regressed (count)
WAVES_MAX = 150
#: every so many samples are enough to choose a wave number (samples)
WAVE_EVERY_SAMPLES = 5

#: wave numbers per batch, to limit the memory
BATCH = 25


def wave_grid(candidate: Candidate, projection: Projection) -> list[Values]:
    """The best few start values of a periodic effect; empty for another candidate."""
    wave, angle = candidate.effect.of_role(Role.WAVE), candidate.effect.of_role(Role.ANGLE)
    if angle is None or isinstance(candidate.effect.slot, slots.Reading):
        return []
    driven = isinstance(candidate.effect.slot, slots.Lead)  # by the measured angle
    blocks = [b for b in projection.evidence.blocks if (b.imposed is not None) == driven]
    block = next((b for b in blocks if candidate.place in places_of(projection.rig, b)), None)
    if block is None:
        return []
    size = candidate.effect.size
    starts = []
    for n, amplitude, phase in _scan(candidate, projection, block):
        if amplitude > 0.0:
            values = {size.name: float(np.clip(amplitude, size.low, size.high)), angle.name: float(phase)}
            starts.append(values | ({wave.name: float(n)} if wave else {}))
    return starts


def _scan(candidate: Candidate, projection: Projection, block: Block) -> list[tuple[float, float, float]]:
    """(wave number, amplitude, phase) of the best wave numbers."""
    records, part = projection.evidence.records, part_of(projection.rig, block)
    step = usual_step_s(records)  # all waves are filtered at one rate
    numbers = [k for k, r in enumerate(records) if r.sample_time_s == step]
    block = block.at(step)
    every = _every(block)
    fine = compile_plant(part, step, 1, 2, block.imposed is not None)
    coarse = compile_plant(part, every * step, 1, 2, block.imposed is not None)
    paths = [_path(candidate, projection, block, fine, number) for number in numbers]
    response = transfer(part, block, coarse, {_channel(candidate, block, part, coarse): 1.0}, every)
    start, width = _place_of_rows(projection, block)
    channels, count = len(block.channels), projection.q_rows.shape[1]
    thinned = [_thinned(records[k], every) for k in numbers]
    chosen = np.concatenate([mask for _, mask in thinned])
    ends = np.cumsum([0, *(int(r.train.sum()) for r in records)])
    at = np.concatenate([index + ends[k] for (index, _), k in zip(thinned, numbers, strict=True)])
    q = projection.q_rows[start : start + width].reshape(channels, width // channels, count)[:, at]
    e = projection.residual[start : start + width].reshape(channels, -1)[:, at]
    scale = (np.sqrt(projection.weights[block.name]) / projection.evidence.floor[block.name])[:, None, None]
    rated = []
    waves = _waves(candidate, paths, projection.evidence.bounds(candidate.key))
    if not len(waves):  # nothing moves along it
        return []
    if len(waves) > WAVES_MAX:
        rows = np.zeros((channels, len(chosen)))
        rows[:, chosen] = e
        each = np.split(rows, np.cumsum([len(mask) for _, mask in thinned])[:-1], axis=1)
        passages = [Passage(path, row) for path, row in zip(paths, each, strict=True)]
        weighted = response[0] * scale[:, :, 0], response[1]
        waves = likely_waves(waves, passages, weighted, every, WAVES_MAX)
    for some in np.array_split(waves, math.ceil(len(waves) / BATCH)):
        with np.errstate(over="ignore", invalid="ignore"):  # a simulated path may diverge
            S, C = (wave_responses(some, shape, paths, response, every)[:, :, chosen] * scale for shape in (0, 1))
            rated += [row for row in _regress(some, S, C, q, e) if np.isfinite(row).all()]
    best: list[tuple[float, float, float]] = []
    for _, n, amplitude, phase in sorted(rated, reverse=True):
        if all(abs(n - other[0]) > 0.05 * n for other in best):
            best.append((n, amplitude, phase))
    return best[: SETTINGS.scanned_starts]


def _every(block: Block) -> int:
    """Number of samples that are averaged to one; fewer where the pull would be unstable with the slower rate."""
    most = SETTINGS.pull_per_sample_max / block.pull if block.pull > 0.0 else math.inf
    return int(np.clip(most, 1, WAVE_EVERY_SAMPLES))


def _thinned(record: Record, every: int) -> tuple[np.ndarray, np.ndarray]:
    """Of the thinned samples: indices of those that train among all training samples, and the mask of those."""
    first = np.arange(0, record.samples // every * every, every)
    mask = record.train[first]
    return (np.cumsum(record.train) - 1)[first[mask]], mask


def _regress(waves: Floats, S: Floats, C: Floats, q: Floats, e: Floats) -> list[tuple[float, float, float, float]]:
    """(fall, wave number, amplitude, phase) of each wave number, by a regression on its two signatures."""
    flat = q.reshape(q.shape[0] * q.shape[1], q.shape[2])
    gram = np.linalg.inv(flat.T @ flat + 1e-12 * np.eye(flat.shape[1])) if flat.shape[1] else np.zeros((0, 0))

    def sides(X: Floats) -> tuple[Floats, Floats]:
        rows = np.swapaxes(X, 0, 1).reshape(len(waves), -1)
        return rows, rows @ flat

    (s, s_q), (c, c_q) = sides(S), sides(C)
    ss = np.einsum("ij,ij->i", s, s) - np.einsum("ij,jk,ik->i", s_q, gram, s_q)
    cc = np.einsum("ij,ij->i", c, c) - np.einsum("ij,jk,ik->i", c_q, gram, c_q)
    sc = np.einsum("ij,ij->i", s, c) - np.einsum("ij,jk,ik->i", s_q, gram, c_q)
    e_q = gram @ (flat.T @ e.ravel())
    se, ce = s @ e.ravel() - s_q @ e_q, c @ e.ravel() - c_q @ e_q
    det = np.maximum(ss * cc - sc**2, 1e-9 * ss * cc + 1e-300)
    A, B = (cc * se - sc * ce) / det, (ss * ce - sc * se) / det
    fall = A * se + B * ce
    return [
        (float(f), float(n), math.hypot(x, y), math.atan2(y, x)) for f, n, x, y in zip(fall, waves, A, B, strict=True)
    ]


def _place_of_rows(projection: Projection, block: Block) -> tuple[int, int]:
    start = 0
    for name in projection.touched:
        width = projection.evidence.rows(projection.fitted.residuals, name, "train").size
        if name == block.name:
            return start, width
        start += width
    raise KeyError(block.name)


def _path(candidate: Candidate, projection: Projection, block: Block, plant: Plant, number: int) -> Path:
    """The path of the law in recording ``number``; see :data:`Path`."""
    slot, record = candidate.effect.slot, projection.evidence.records[number]
    if isinstance(slot, slots.Lead):
        return true_angle(projection.rig, block, record), np.ones(record.samples), True
    place = projection.rig.elements[candidate.place]
    if isinstance(slot, slots.MotorTorque):
        q = projection.path(place.neighbours["drives"], number)
        circuit = plant.circuit
        rate = np.gradient(q, record.sample_time_s)
        emf = place.values["emf_constant"]
        return q, circuit[pl.C_KT] * (record.u - emf * rate) / circuit[pl.C_R], False
    return projection.path(place.name, number), np.ones(record.samples), False


def _waves(candidate: Candidate, paths: list[Path], bounds: Bounds) -> Floats:
    """(n,) wave numbers to try, spaced by what the travel can tell apart."""
    wave = candidate.effect.of_role(Role.WAVE)
    if wave is None:
        return np.ones(1)  # once a turn
    travel = max(float(np.ptp(q)) for q, _, _ in paths)
    if travel <= 0.0:
        return np.zeros(0)
    step = WAVE_STEP_SHARE * math.pi / travel
    least, fastest = bounds.get(wave.name, (wave.low, wave.high))
    most = min(wave.high, fastest, max(60.0 * wave.typical / 24.0, 6.0 * wave.typical))
    low = max(wave.low, least, 2.0 * step)
    if low >= most:
        return np.zeros(0)
    return np.linspace(low, most, int(max(2, (most - low) / step)))


def _channel(candidate: Candidate, block: Block, part: Rig, plant: Plant) -> int:
    """The plant's input channel of a periodic law: an effort on a body, or the base's position."""
    slot = candidate.effect.slot
    if isinstance(slot, slots.Lead):
        return pl.CH_D
    names = state_names(part, block.imposed is not None)
    if isinstance(slot, slots.MotorTorque):
        return pl.CH_F + plant.driven
    return pl.CH_F + (names.index(candidate.place) if candidate.place in names else 0)
