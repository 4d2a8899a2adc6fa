"""Start values near the right minimum, for a lightly damped machine whose resonances differ from its rig's.

Where a resonance is narrower than its error in frequency, rig and recording are out of phase for most of its ringing.
The sum of squares then has a local minimum for each cycle of lag, and a fit damps the mode instead of moving it. So the
first fits are to the correlation of the residual with the whitened command, over lags of a few periods, then over
longer ones; slow modes come before fast ones (multiscale inversion: C. Bunks et al., Multiscale seismic waveform
inversion, Geophysics 60 (1995) 1457).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.compare import Block, Record, part_of, poles_of, usual_step_s
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.data.tempo import is_constant
from dtbacklash.diagnose.fit.free import Free
from dtbacklash.diagnose.fit.problem import Problem, inside, limits_of
from dtbacklash.diagnose.fit.refit import solve
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.rig import Rig

#: periods of the first lags, factor to the next lags, and time constants of the decay at which they end
PERIODS, LONGER, DECAYS = 4, 4, 3.0
#: modes whose frequencies differ by this ratio have stages of their own
APART = 1.3
#: evaluations of a stage
EVALUATIONS = 5
#: samples of the recording per lag
SAMPLES_A_LAG = 50
#: order of the low-pass that removes faster modes
ORDER = 4
#: the command has no power at frequencies with less than this share of its largest density
SAYS_NOTHING = 1e-6


@dataclass(frozen=True)
class Stage:
    """Lags up to ``lags`` samples, frequencies up to ``cut``, cycles per sample (or infinity)."""

    lags: int
    cut: float


class Echo(Problem):
    """The least-squares problem of the correlation of residual and command, with weight 1 for all channels."""

    def __init__(self, evidence: Evidence, base: Rig, free: list[Free], stage: Stage) -> None:
        super().__init__(evidence, base, free)
        self.steps = "coarse"
        blocks = [b for b in evidence.blocks if b.name in self.touched]
        self.weights = {b.name: np.ones(len(b.channels)) for b in blocks}
        self._drives = {b.name: [_drive(b, record, stage) for record in evidence.records] for b in blocks}
        self._taper = 0.5 + 0.5 * np.cos(np.pi * np.arange(stage.lags) / stage.lags)

    def data(self, residuals: Residuals, name: str) -> Floats:
        """(channels, lags) correlations of one block, with a variance of at most 1 for white noise."""
        records, drives = self.evidence.records, self._drives[name]
        total = np.zeros((residuals[name][0].shape[1], len(self._taper)))
        for e, record, drive in zip(residuals[name], records, drives, strict=True):
            fitted = np.where(record.train, e.T, 0.0)
            length = 2 * (len(drive) - 1)
            total += irfft(rfft(fitted, length) * drive, length)[:, : len(self._taper)]
        tapered: Floats = total * self._taper / np.sqrt(len(records))
        return tapered

    def _mended(self, x: Floats, rows: Floats) -> None:
        """None: each step has its own differences, as it may cross into another minimum."""


def _drive(block: Block, record: Record, stage: Stage) -> Floats:
    """(frequencies,) conjugate spectrum of a block's input, whitened at the resolution of the lags, low-passed."""
    drive = _driven(block, record)
    length = next_fast_len(2 * max(len(drive), stage.lags), real=True)
    length += length % 2
    spectrum = rfft(drive - drive.mean(), length)
    lags = np.minimum(np.arange(length), length - np.arange(length))
    bartlett = np.maximum(1.0 - lags / stage.lags, 0.0)
    density = np.maximum(rfft(irfft(np.abs(spectrum) ** 2, length) * bartlett, length).real, 0.0)
    white = np.conj(spectrum) / np.sqrt(density + max(SAYS_NOTHING * float(density.max()), 1e-300))
    passed: Floats = white / np.sqrt(1.0 + (np.arange(len(white)) / (length * stage.cut)) ** (2 * ORDER))
    return passed


def _driven(block: Block, record: Record) -> Floats:
    """(N,) a block's input: the command, or the speed of the imposed angle."""
    return np.gradient(record.y[block.imposed]) if block.imposed else record.u


def approached(evidence: Evidence, base: Rig, free: list[Free], x: Floats) -> Floats:
    """(free,) start values near the right minimum, from ``x``; ``x`` itself where no mode rings for long."""
    x = inside(x, limits_of(free))
    for stage in _stages(evidence, base):
        beginning = _beginning(evidence, SAMPLES_A_LAG * stage.lags)
        if beginning.records:
            x = solve(Echo(beginning, base, free, stage), x, EVALUATIONS)
    return x


def _beginning(evidence: Evidence, samples: int) -> Evidence:
    """The first samples of each record of the usual rate that has training samples and a changing input there."""
    step = usual_step_s(evidence.records)
    records = [
        replace(r, u=r.u[:samples], y={c: seen[:samples] for c, seen in r.y.items()}, train=r.train[:samples],
                held=r.held[:samples], judge=r.judge[:samples])
        for r in evidence.records
        if r.sample_time_s == step and r.train[:samples].any()
        and not any(is_constant(_driven(b, r)[:samples]) for b in evidence.blocks)
    ]  # fmt: skip
    return replace(evidence, records=records)


def _stages(evidence: Evidence, rig: Rig) -> list[Stage]:
    step = usual_step_s(evidence.records)
    poles = np.concatenate([_ringing(rig, block, step) for block in evidence.blocks])
    poles = poles[np.argsort(poles.imag)]
    longest = max(r.samples for r in evidence.records)
    stages: list[Stage] = []
    for together in _clusters(poles):
        faster = poles[together[-1] + 1 :][:1]
        cut = float(np.sqrt(poles[together[-1]].imag * faster[0].imag)) / (2.0 * np.pi) if len(faster) else np.inf
        lags = PERIODS * 2.0 * np.pi / poles[together[0]].imag
        memory = max(DECAYS / max(-float(poles[j].real), 1e-300) for j in together)
        while True:
            stages.append(Stage(min(round(lags), longest), cut))
            if lags > min(memory, longest):
                break
            lags *= LONGER
    return stages


def _clusters(poles: Floats) -> list[list[int]]:
    """Indices of the modes, ascending, in groups that are near to each other."""
    clusters: list[list[int]] = []
    for j, pole in enumerate(poles):
        if clusters and pole.imag < APART * poles[j - 1].imag:
            clusters[-1].append(j)
        else:
            clusters.append([j])
    return clusters


def _ringing(rig: Rig, block: Block, step_s: float) -> Floats:
    """Poles of a block's modes below the Nyquist frequency that ring for longer than the first lags, per sample."""
    plant = compile_plant(part_of(rig, block), step_s, imposed=block.imposed is not None)
    poles = poles_of(plant) * step_s
    seen = poles[(poles.imag > 0.0) & (poles.imag < np.pi)]
    ringing: Floats = seen[DECAYS * seen.imag > PERIODS * 2.0 * np.pi * np.abs(seen.real)]
    return ringing
