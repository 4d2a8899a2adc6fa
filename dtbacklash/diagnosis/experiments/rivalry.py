"""How far rivals would be apart in an experiment that nobody has made yet.

The found rig is simulated on a command, and a rival predicts its readings, at gains with the unknown forces and the
noise that the diagnosis found. By how much the whitened innovations differ, once the laws of the rival are fitted anew
and the rig's parameters within what they are known to, is the expected fall of -2 log likelihood; its square root
counts standard errors (Hunter and Reiner, Technometrics 7 (1965) 307, whitened by what both are uncertain by).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.fit import FitProblem
from dtbacklash.diagnosis.engine.motion import motion_of
from dtbacklash.diagnosis.engine.parameters import Key, effects_of_rig, is_known
from dtbacklash.diagnosis.engine.predictor import ASTRAY, Gains
from dtbacklash.diagnosis.engine.resampling import rate_of
from dtbacklash.diagnosis.engine.segments import NoiseLevels, Segments
from dtbacklash.diagnosis.parallel import spread
from dtbacklash.diagnosis.planning import Observed
from dtbacklash.diagnosis.predictions import segments_of
from dtbacklash.diagnosis.records import Record
from dtbacklash.diagnosis.settings import SETTINGS
from dtbacklash.errors import UserError
from dtbacklash.physics.assembly import compile_plant, state_names
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate_roughly

#: seed of the noise that a simulated recording has: the same for all commands, so that they are compared alike
SEED = 0
#: steps by which a rival is fitted to what the found rig would show, where it is asked for exactly
STEPS = 6


@dataclass(frozen=True)
class Rival:
    """Another model: its rig, and what it has that the nominal rig has not."""

    name: str
    rig: Rig
    keys: tuple[Key, ...]


@dataclass(frozen=True)
class Answer:
    """How the found rig moves on a command: largest travel and speed of each body, SI; its readings."""

    record: Record
    travel: dict[str, float]
    speed: dict[str, float]


class Rivalry:
    """The found rig, and the rivals that its recording has left open."""

    def __init__(self, found: Rig, rivals: Sequence[Rival], seen: Observed) -> None:
        self.found, self.rivals, self.seen = found, tuple(rivals), seen
        # what the rivals have in common with the found rig is what the next recording is believed to begin with
        self.nominal = found
        for key in effects_of_rig(found):
            if is_known(found, key):
                self.nominal = self.nominal.with_effect(*key, None)

    def answer(self, rig: Rig, u: Floats) -> Answer | None:
        """The answer of a rig to a command; None where it does not stay finite."""
        step = self.seen.sample_time_s
        plant = compile_plant(rig, step, 1, 1)
        names, first, n = state_names(rig, plant.imposed), plant.position, plant.n_bodies
        with np.errstate(over="ignore", invalid="ignore"):
            shown = simulate_roughly(rig, u, step)
        if not all(np.isfinite(v).all() for v in shown.sensors.values()):
            return None
        rng = np.random.default_rng(SEED)
        y = {c: shown.sensors[c][: len(u)] + size * rng.standard_normal(len(u)) for c, size in self.seen.noise.items()}
        whole = np.ones(len(u), dtype=bool)
        X = shown.states
        q, v = X[:, first : first + n], X[:, first + n : first + 2 * n]
        return Answer(
            Record(step, u, y, whole, ~whole),
            dict(zip(names, np.abs(q - q[0]).max(axis=0).tolist(), strict=True)),
            dict(zip(names, np.abs(v).max(axis=0).tolist(), strict=True)),
        )  # fmt: skip

    def segments(self, record: Record) -> tuple[Segments, NoiseLevels]:
        """Predictors of a simulated recording, and the noise levels that the diagnosis found."""
        every = rate_of(self.nominal, record.y, record.sample_time_s)
        segments = segments_of(self.nominal, [record], [every])
        (p,) = segments.predictors
        low, high = p.ends()
        # on another motion no model is as exact as on the one that it was fitted to
        shares = [
            max(self.seen.unknown.get(b, 0.0) / f, SETTINGS.unexplained_attention)
            for b, f in zip(p.bodies, p.force, strict=True)
        ]
        forces = np.log(shares)
        return segments, (np.clip(np.concatenate([forces, p.nominal_noise]), low, high),)

    def apart(self, record: Record, exactly: bool = False) -> list[float]:
        """The expected fall of -2 log likelihood against each rival; of one that runs away it is large.

        exactly : whether rivals are fitted to the recording as well, and the smaller of both counts.
        """
        segments, noise_levels = self.segments(record)
        gains = segments.gains(self.found, noise_levels)
        own = segments.residuals(self.found, gains)
        if own is None:
            return [0.0] * len(self.rivals)
        return spread(lambda rival: self._apart(segments, noise_levels, gains, own, rival, exactly), self.rivals)

    def _apart(
        self,
        segments: Segments,
        noise_levels: NoiseLevels,
        gains: list[Gains],
        own: Floats,
        rival: Rival,
        exactly: bool,
    ) -> float:
        rig = rival.rig
        try:
            problem = FitProblem(segments, rig, rival.keys, motion_of(segments, rig, gains), 1.0)
            x = problem.start()
            rows = problem.residuals(x, gains)
        except (UserError, np.linalg.LinAlgError):
            return 0.0
        if rows is None:
            return ASTRAY
        moved = rows.copy()
        moved[: len(own)] -= own
        J = problem.jacobian(x, gains, rows)
        Q, _ = np.linalg.qr(J / np.maximum(np.linalg.norm(J, axis=0), 1e-300))
        left = moved - Q @ (Q.T @ moved)
        found = float(left @ left)
        if exactly:  # a fit that stops beside its optimum would promise too much
            found = min(found, max(float(problem.gauss_newton(noise_levels, x, STEPS)[1] - own @ own), 0.0))
        return found
