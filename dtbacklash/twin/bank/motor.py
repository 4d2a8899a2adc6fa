"""The motor's half of the bank: which law of the motor has changed, from the voltage and the measured angle alone.

The structure does not push back on the motor, so that its equation (:mod:`.motor`) holds whatever happens behind the
gear. Each hypothesis is a rig, whose equation leaves a torque over; it is compared by means over blocks, whose
covariance the angle's noise and counts give through the equation. Dry friction at rest takes whatever it has to, up to
its level: where the motor does not clearly move, blocks only tell whether the level is exceeded.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import linalg

from dtbacklash.arrays import Floats
from dtbacklash.control.belief import Belief, on_the_motor
from dtbacklash.control.chain import motor_parameters
from dtbacklash.physics.rig import Rig
from dtbacklash.twin.bank.equation import difference_equation, voltage_in_part
from dtbacklash.twin.bank.hypotheses import Hypothesis, cogging
from dtbacklash.twin.bank.whitened import BLOCK, Fit, blocks, count_of, fitted, without_counts

#: effects between voltage and angle that the equation has
LAWS = ("coulomb_friction", "viscous_friction", "constant_load", "cogging", "gain_error")  # and a delay
#: faster than this throughout a block and its neighbours, rad/s, the motor moves: noise does not turn it round
MOVING_RAD_S = 1.0
#: torque by which the equation itself errs, N m: laws are taken at the samples
MODEL_N_M = 2e-6
#: what any model errs by, of the torque at rest that the largest voltage gives, for STAYS_S at a time
MODEL_SHARE = 1e-5
#: periods a radian of cogging that are looked for
PERIODS = range(1, 49)
#: waves that the motor has to pass: less of one looks like anything slow
WAVES = 2.0
#: standard deviations of a block by which a torque at rest may seem to exceed dry friction's level
BEYOND = 2.0
#: for how long an angle's error by counts stays, s; and how a wave errs that a sample passes whole, of its size
STAYS_S, PASSED = 0.05, 0.02
#: variance that takes a block out of the comparison, (N m)^2
NOTHING_KNOWN = 1e2


class MotorBuffer:
    """One buffer of voltage and angle, and how it is explained; arguments as of :class:`.bank.Buffer`."""

    def __init__(self, u: Floats, theta_m: Floats, belief: Belief, sample_time_s: float) -> None:
        count = theta_m.size // BLOCK * BLOCK
        self.u, self.theta = u[:count], theta_m[:count]
        self.angle = without_counts(self.theta)
        self.belief, self.sample_time_s = belief, sample_time_s
        rotor = belief.rig.motor_rotor()
        assert rotor is not None
        self.rotor = rotor.name
        self.missing = [name for name, _ in on_the_motor(belief.rig) if name not in LAWS]
        a, _, by_torque = difference_equation(motor_parameters(belief.rig), sample_time_s)
        self.sign = self._signs()
        covariance = self._covariance(a, float(by_torque.sum()))
        self.free = np.sqrt(np.diag(covariance))
        self.alternating = np.where(np.arange(self.sign.size) % 2 == 0, 1.0, -1.0)
        self.covariance = covariance
        believed = belief.rig.effect(self.rotor, "cogging") or {}
        self.factors = self._factors(believed.get("torque", 0.0), believed.get("periods", 0.0))

    def _factors(self, torque: float, periods: float) -> tuple[Floats, Floats]:
        """Cholesky factors of the blocks' covariance, without and with dry friction, for cogging of this size.

        A wave of the angle is known no better than the angle, within its counts, and errs where a sample passes much
        of it.
        """
        rate = np.abs(np.diff(self.angle, append=self.angle[-1]))
        passed = blocks(np.minimum(periods * rate, 1.0) ** 2)[1:]
        count = torque * periods * count_of(self.theta) / np.sqrt(12.0)
        apart_s = _apart_s(passed.size, self.sample_time_s)
        covariance = self.covariance + count**2 * np.exp(-apart_s / STAYS_S) + np.diag((PASSED * torque * passed) ** 2)
        unknown = np.diag(np.where(self.sign != 0.0, 0.0, NOTHING_KNOWN))
        return (np.asarray(linalg.cholesky(covariance, lower=True)),
                np.asarray(linalg.cholesky(covariance + unknown, lower=True)))  # fmt: skip

    def _signs(self) -> Floats:
        """(blocks - 1,) direction in which the motor moves in a block and its neighbours; 0 where it may not."""
        edges = np.append(self.theta[::BLOCK], self.theta[-1])
        speed = np.diff(edges) / (BLOCK * self.sample_time_s)
        direction = np.where(np.abs(speed) > MOVING_RAD_S, np.sign(speed), 0.0)
        padded = np.concatenate([[direction[0]], direction, [direction[-1]]])
        same = (padded[:-2] == direction) & (padded[2:] == direction)
        return np.where(same, direction, 0.0)[1:]

    def _covariance(self, a: Floats, scale: float) -> Floats:
        """(blocks - 1,) squared: of the blocks' means of the torque that is left over, by the angle's noise alone."""
        n = self.theta.size
        rows = np.zeros((n // BLOCK, n))
        for k in range(n):
            for i in range(min(4, k + 1)):
                rows[k // BLOCK, k - i] += a[i] / (scale * BLOCK)
        rows = rows[1:]
        # the angle is no smooth record: its noise is what the equation leaves over at the highest frequencies
        left = np.diff(np.convolve(self.theta, a, "valid") - self._driven(self.belief.rig), 2)
        gain = float(np.sum(np.convolve(a, [1.0, -2.0, 1.0]) ** 2))
        quiet = np.abs(left) <= np.quantile(np.abs(left), 0.9)
        noise = float(np.sqrt(np.mean(left[quiet] ** 2)) / 0.7886 / np.sqrt(gain))
        noise = max(noise, count_of(self.theta) / np.sqrt(12.0))
        motor = motor_parameters(self.belief.rig)
        errs = MODEL_SHARE * motor.gain * motor.k_T / motor.R * float(np.max(np.abs(self.u)))
        stays = errs**2 * np.exp(-_apart_s(len(rows), self.sample_time_s) / STAYS_S)
        return noise**2 * rows @ rows.T + MODEL_N_M**2 * np.eye(len(rows)) + stays

    def _driven(self, rig: Rig) -> Floats:
        """(N - 3,) what the voltage gives in the equation of a rig's motor, late by the delay of its amplifier."""
        amplifier = rig.only("amplifier")
        there = rig.effects.get(amplifier.name, {}) if amplifier else {}
        samples = there.get("delay", {}).get("time", 0.0) / self.sample_time_s
        whole = min(int(samples), self.u.size)
        # before the buffer the machine is at rest
        u = np.concatenate([np.full(whole + 1, self.u[0]), self.u[: self.u.size - whole]])
        after, until = voltage_in_part(motor_parameters(rig), self.sample_time_s, samples - int(samples))
        return np.convolve(u[1:], after, "valid") + np.convolve(u[:-1], until, "valid")

    def torque(self, rig: Rig) -> Floats:
        """(blocks - 1,) torque that is left over beside all but a rig's dry friction, N m."""
        a, _, by_torque = difference_equation(motor_parameters(rig), self.sample_time_s)
        there = rig.effects.get(self.rotor, {})
        wave = there.get("cogging", {"torque": 0.0, "periods": 0.0, "phase": 0.0})
        known = there.get("constant_load", {}).get("torque", 0.0) + wave["torque"] * self._wave(
            wave["periods"], wave["phase"]
        )
        left = np.convolve(self.theta, a, "valid") - self._driven(rig)
        left -= np.convolve(known, by_torque, "valid")
        return self._blocks(left / by_torque.sum())

    def _wave(self, periods: float, phase: float) -> Floats:
        """(N,) mean of ``sin(periods theta + phase)`` from each sample to the next; between, the angle is straight.

        Across the gap the motor may pass more than a radian of a wave in one sample.
        """
        half = 0.5 * periods * np.diff(self.angle, append=self.angle[-1])
        return np.asarray(np.sin(periods * self.angle + half + phase) * np.sinc(half / np.pi))

    def _blocks(self, left: Floats) -> Floats:
        return blocks(np.concatenate([np.zeros(self.theta.size - left.size), left]))[1:]

    def whitened(self, rig: Rig, factors: tuple[Floats, Floats] | None = None) -> Floats:
        """(blocks - 1,) residual of a rig's motor, whitened; at rest by what dry friction's level is exceeded."""
        level = rig.effects.get(self.rotor, {}).get("coulomb_friction", {}).get("torque", 0.0)
        left = self.torque(rig)
        if level <= 0.0:
            return self._solve(left, False, factors)
        rest = self.sign == 0.0
        # friction of no size explains nothing: the band about its level goes with it
        band = BEYOND * level / (level + self.free)
        beyond = np.maximum((np.abs(left) - level) / self.free - band, 0.0)
        # a block that dry friction explains whatever it shows counts as one that is explained to the noise
        unseen = np.where(rest, np.sqrt(1.0 + beyond**2) * self.alternating, 0.0)
        moving = np.where(rest, 0.0, left + level * self.sign)
        return self._solve(moving, True, factors) + unseen

    def _solve(self, left: Floats, dry: bool, factors: tuple[Floats, Floats] | None = None) -> Floats:
        return np.asarray(linalg.solve_triangular((factors or self.factors)[dry], left, lower=True, check_finite=False))

    def fit(self, hypothesis: Hypothesis | None) -> Fit:
        """The best fit of a hypothesis (None: what is believed)."""
        if hypothesis is None:
            left = self.whitened(self.belief.rig)
            return Fit(np.zeros(0), np.zeros((0, 0)), left, np.zeros((left.size, 0)))

        factors = self.factors

        def residual(x: Floats) -> Floats:
            return self.whitened(hypothesis.changed(self.belief.rig, tuple(x)), factors)

        starts = [np.array(hypothesis.to_fit(start)) for start in hypothesis.starts]
        longest = np.array(hypothesis.longest())
        fit = min((fitted(residual, x, longest=longest) for x in starts), key=lambda fit: fit.chi2)
        if hypothesis.periods:
            factors = self._factors(math.hypot(*hypothesis.from_fit(tuple(fit.x))), hypothesis.periods)
            fit = fitted(residual, fit.x, longest=longest)
        return fit

    def coggings(self, most: int = 3) -> list[Hypothesis]:
        """Cogging with the periods that explain most, the best first."""
        left = self.whitened(self.belief.rig)
        dry = "coulomb_friction" in self.belief.rig.effects.get(self.rotor, {})
        _, _, by_torque = difference_equation(motor_parameters(self.belief.rig), self.sample_time_s)
        shape = by_torque / by_torque.sum()
        explained = []
        for periods in PERIODS:
            if periods * float(np.ptp(self.angle)) < 2.0 * np.pi * WAVES:
                continue
            waves = np.array([
                self._solve(self._blocks(np.convolve(self._wave(periods, phase), shape, "valid")), dry)
                for phase in (0.0, 0.5 * np.pi)
            ]).T  # fmt: skip
            best = np.linalg.lstsq(waves, left, rcond=None)[0]
            explained.append((float(np.sum((waves @ best) ** 2)), periods))
        return [cogging(self.belief, float(periods)) for _, periods in sorted(explained, reverse=True)[:most]]


def _apart_s(count: int, sample_time_s: float) -> Floats:
    """(count, count) times between blocks, s."""
    return np.asarray(np.abs(np.subtract.outer(np.arange(count), np.arange(count))) * BLOCK * sample_time_s)
