"""How far a design is from instability: margins, sensitivity, robustness, and cycles in a play.

The loop is cut at the voltage, with the motor in contact. A controller answers the measured angle and output by
``u = H_theta theta_m + H_q q3``, so that L = -(H_theta G1 + H_q G1 S). With W the prefilter, S the structure, G1 the
motor, K the gain of the inner loop, F = W S and G = K G1 / (1 + K G1), all sampled (theory.md, "Margins"):

- ``measured``: H_theta = -K (1 - F), H_q = -K W: the model moves as the plant does, and L = K G1;
- ``bare``, ``exact``: H_theta = -K / (1 - K F G1), H_q = -K W / (1 - K F G1);
- ``inner_loop``, ``inverse``: H_theta = -K, H_q = -K W / (1 - F G).

Delays that the design knows are in the models as in the plant: G1 is with those of the command and of the measured
angle, S with that of the measured output less that of the angle. Only ``measured`` has none in its F. What is left is
the margin for a delay that is not known.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dtbacklash.config.run import RunConfig
from dtbacklash.control.chain import motor_ss, structure_ss
from dtbacklash.control.design import ControllerDesign, SampledModel, sampled
from dtbacklash.result_cache import kept

if TYPE_CHECKING:
    from dtbacklash.control.belief import Belief, Linear

Reals = NDArray[np.float64]
Response = NDArray[np.complex128]

#: points of the grid of frequencies, from LOWEST_RAD_S to the Nyquist frequency
POINTS, LOWEST_RAD_S = 6000, 1e-2
#: a balance of the describing function closer to 0 than this is a cycle
BALANCED = 0.02


@dataclass(frozen=True)
class Margins:
    """Margins of a design; None where there is none, as the loop never crosses.

    gain : factor on the loop's gain, above 1, that makes it unstable. phase_deg, delay_s : phase and delay that do.
    ms : largest sensitivity, the inverse of the distance of the Nyquist curve from -1. crossover_rad_s : where the
    smallest delay margin lies. small_gain : largest share of the distance from -1 by which the parameters' tolerances
    move the Nyquist curve: below 1, the small-gain theorem says that it stays stable. cycle_share, cycle_rad_s :
    amplitude of the motor over the half-gap and frequency of the cycle that the describing function of the play
    predicts.
    """

    gain: float | None
    phase_deg: float | None
    delay_s: float | None
    ms: float
    crossover_rad_s: float | None
    small_gain: float
    cycle_share: float | None
    cycle_rad_s: float | None

    def as_dict(self) -> dict[str, float | None]:
        """For ``summary.json``."""
        return asdict(self)


def frequencies(sample_time_s: float) -> Reals:
    """(POINTS,) rad/s."""
    return np.geomspace(LOWEST_RAD_S, 0.999 * math.pi / sample_time_s, POINTS)


def response(model: SampledModel, omega: Reals, sample_time_s: float) -> Response:
    """Frequency response (n,) of a sampled model of one input and one output."""
    found = np.full(omega.size, complex(model.D[0, 0]))
    if model.order:
        z = np.exp(1j * omega * sample_time_s)[:, None, None]
        found += np.linalg.solve(z * np.eye(model.order) - model.A, model.B[:, :1])[:, :, 0] @ model.C[0]
    return found


def play_gain(share: Reals) -> Response:
    """Describing function of the play, its output over a sine; share : half-gap over amplitude, 0 to 1."""
    x = 1.0 - 2.0 * share
    real = 0.5 + (np.arcsin(x) + x * np.sqrt(1.0 - x**2)) / np.pi
    return np.asarray(real - 4j * share * (1.0 - share) / np.pi)


@dataclass(frozen=True)
class DesignedLoop:
    """A designed controller with what it controls; ``result.design`` of a run.

    form : the internal model. tau_r_s : time constant of the prefilter. models_gap : whether its model has the play;
    else the machine has it. variations : see :meth:`.belief.Belief.varied`.
    """

    design: ControllerDesign
    form: str
    tau_r_s: float
    models_gap: bool
    variations: tuple[tuple[Linear, Linear], ...]

    @classmethod
    def of(cls, config: RunConfig, design: ControllerDesign, belief: Belief) -> DesignedLoop:
        """That of a run whose ``auto`` is settled."""
        c = config.controller
        return cls(design, c.internal_model, c.tau_r_s, c.structure == "nimc", belief.varied(tuple(c.compensate)))

    def margins(self) -> Margins:
        """Gain, phase and delay margin, sensitivity, the small-gain bound under the tolerances, and the cycle."""
        return kept(margins, self)

    def curves(self) -> Curves:
        """The same as frequency responses."""
        return Curves(self, frequencies(self.design.sample_time_s))


@dataclass(frozen=True)
class Curves:
    """Frequency responses of a loop at ``omega`` (n,) rad/s; each (n,)."""

    of: DesignedLoop
    omega: Reals

    @cached_property
    def plant(self) -> tuple[Response, Response]:
        """G1 and S with their delays: voltage -> measured angle of the motor, and on to the measured output."""
        d, (motor, structure) = self.of.design, self.late
        return (
            response(d.motor_position, self.omega, d.sample_time_s) * motor,
            response(d.structure, self.omega, d.sample_time_s) * structure,
        )

    @cached_property
    def late(self) -> tuple[Response, Response]:
        """The known delays in G1 and in S."""
        command, angle, output = self.of.design.delays_s
        return np.exp(-1j * self.omega * (command + angle)), np.exp(-1j * self.omega * (output - angle))

    @cached_property
    def filtered(self) -> tuple[Response, Response]:
        """W, and F = W S."""
        w = response(self.of.design.prefilter, self.omega, self.of.design.sample_time_s)
        return w, w * self.plant[1]

    @cached_property
    def controller(self) -> tuple[Response, Response]:
        """H_theta and H_q: measured angle and output -> voltage."""
        if (law := self.of.design.law) is not None:
            a, b = law.A + np.outer(law.E, law.C), law.B + np.outer(law.E, law.D)  # within the limit of the voltage
            angle, output = (SampledModel(a, b[:, j : j + 1], law.C[None, :], law.D[None, j : j + 1]) for j in (1, 2))
            step = self.of.design.sample_time_s
            return response(angle, self.omega, step), response(output, self.omega, step)
        g1, k, (w, f) = self.plant[0], self.of.design.k_theta_v_per_rad, self.filtered
        if self.of.form == "measured":
            return -k * (1.0 - f / self.late[1]), -k * w
        if self.of.form in ("bare", "exact"):
            own = 1.0 / (1.0 - k * f * g1)
            return -k * own, -k * w * own
        return np.full_like(w, -k), -k * w / (1.0 - f * k * g1 / (1.0 + k * g1))

    @cached_property
    def loop(self) -> Response:
        """L, cut at the voltage."""
        return self._around(*self.plant)

    @cached_property
    def sensitivity(self) -> Reals:
        """|1 / (1 + L)|."""
        return np.asarray(1.0 / np.abs(1.0 + self.loop))

    @cached_property
    def moved(self) -> Reals:
        """How far the tolerances move L at most, over its distance from -1: the sum over the parameters, each alone."""
        step = self.of.design.sample_time_s
        total = np.zeros(self.omega.size)
        for both in self.of.variations:
            g1_s = [
                (self.late[0] * response(sampled(motor_ss(one.motor)[1, 0], step), self.omega, step),
                 self.late[1] * response(sampled(structure_ss(one.structure), step), self.omega, step)) for one in both
            ]  # fmt: skip
            total += np.max([np.abs(self._around(*pair) - self.loop) for pair in g1_s], axis=0)
        return total * self.sensitivity

    @cached_property
    def around_the_play(self) -> Response:
        """What closes the loop over the play, X: a cycle is where X = -1/(1 - N), or -1/N if the play is the machine's.

        Of a believed play that is not there, the output follows the motor by all that it leaves: 1 + K G1 (N +
        F (1 - N)) = 0; with ``inverse`` the loop on the angle stays closed in it:
        1 + (1 - N) G F (1 + 1/(tau_r s)) = 0.
        """
        g1, s = self.plant
        if not self.of.models_gap:
            to_angle, to_output = self.controller
            return -to_output * g1 * s / (1.0 - to_angle * g1)
        servo, f = self.of.design.k_theta_v_per_rad * g1, self.filtered[1]
        if self.of.form == "inverse":
            return servo / (1.0 + servo) * f * (1.0 + 1.0 / (self.of.tau_r_s * 1j * self.omega))
        return servo / (1.0 + servo) * (f - 1.0)

    def play(self, share: Reals) -> Response:
        """1 - N, or N, at each half-gap over amplitude."""
        return 1.0 - play_gain(share) if self.of.models_gap else play_gain(share)

    def _around(self, g1: Response, s: Response) -> Response:
        to_angle, to_output = self.controller
        return -(to_angle + to_output * s) * g1


def cycle(of: DesignedLoop) -> tuple[float, float] | None:
    """Amplitude over the half-gap, and rad/s, of the cycle that the play's describing function predicts, or None."""
    at = Curves(of, np.geomspace(2.0, 300.0, 800))
    share = np.linspace(0.02, 0.995, 400)
    balance = 1.0 + at.play(share)[:, None] * at.around_the_play
    i, j = np.unravel_index(np.abs(balance).argmin(), balance.shape)
    if abs(balance[i, j]) > BALANCED:
        return None
    return float(1.0 / share[i]), float(at.omega[j])


def crossings(values: Reals) -> tuple[NDArray[np.intp], Reals]:
    """Where values (n,) on the grid pass 0: the point before, and the share of the way to the next, linearly."""
    at = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)
    return at, values[at] / (values[at] - values[at + 1])


def margins(of: DesignedLoop) -> Margins:
    """Margins of a design. Of all crossings of the loop's frequency response the nearest counts."""
    curves = of.curves()
    omega, loop = curves.omega, curves.loop
    at, share = crossings(loop.imag)
    real = loop.real[at] * (1.0 - share) + loop.real[at + 1] * share
    gains = -1.0 / real[(real < 0.0) & (real > -1.0)]
    at, share = crossings(np.log(np.abs(loop)))
    where = omega[at] * (omega[at + 1] / omega[at]) ** share
    angle = np.unwrap(np.angle(loop))
    phases = angle[at] * (1.0 - share) + angle[at + 1] * share + np.pi
    delays = np.mod(phases, 2.0 * np.pi) / where
    swings = cycle(of)
    return Margins(
        gain=float(gains.min()) if gains.size else None,
        phase_deg=float(np.degrees(np.abs(np.angle(np.exp(1j * phases)))).min()) if phases.size else None,
        delay_s=float(delays.min()) if delays.size else None,
        ms=float(np.max(curves.sensitivity)),
        crossover_rad_s=float(where[delays.argmin()]) if delays.size else None,
        small_gain=float(np.max(curves.moved)),
        cycle_share=None if swings is None else swings[0],
        cycle_rad_s=None if swings is None else swings[1],
    )
