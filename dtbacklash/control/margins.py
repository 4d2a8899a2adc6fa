"""How far a design is from instability: margins, sensitivity, robustness, and cycles in a gap that is not there.

The loop is cut at the voltage, with the motor in contact, so that the loop transfer function is that of everything from
a voltage to the voltage that it brings about. With W the prefilter, S the structure, G1 the motor, K the gain of the
inner loop and G = K G1 / (1 + K G1) the loop closed over the angle, all sampled (theory.md, "Margins"):

- ``measured``: the model is driven by what the plant is driven by, and cancels it: L = K G1;
- ``bare``, ``exact``: L = K (1 + W S) G1 / (1 - K W S G1);
- ``inner_loop``, ``inverse``: L = K G1 (1 + W S / (1 - W S G)).
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from dtbacklash.control.design import ControllerDesign, SampledModel

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
    smallest delay margin lies. cycle_share, cycle_rad_s : amplitude of the motor over the believed half-gap and
    frequency of the cycle that the describing function of the play predicts where there is no gap.
    """

    gain: float | None
    phase_deg: float | None
    delay_s: float | None
    ms: float
    crossover_rad_s: float | None
    cycle_share: float | None
    cycle_rad_s: float | None

    def as_dict(self) -> dict[str, float | None]:
        """For ``summary.json``."""
        return asdict(self)


def frequencies(sample_time_s: float) -> NDArray[np.float64]:
    """(POINTS,) rad/s."""
    return np.geomspace(LOWEST_RAD_S, 0.999 * math.pi / sample_time_s, POINTS)


def response(model: SampledModel, omega: NDArray[np.float64], sample_time_s: float) -> Response:
    """Frequency response (n,) of a sampled model of one input and one output."""
    found = np.full(omega.size, complex(model.D[0, 0]))
    if model.order:
        z = np.exp(1j * omega * sample_time_s)[:, None, None]
        found += np.linalg.solve(z * np.eye(model.order) - model.A, model.B[:, :1])[:, :, 0] @ model.C[0]
    return found


def loop_transfer(design: ControllerDesign, form: str, omega: NDArray[np.float64]) -> Response:
    """L(exp(i omega T)), (n,), cut at the voltage; form : the internal model."""
    w, s, g1 = (response(m, omega, design.sample_time_s) for m in (design.prefilter, design.structure,
                                                                   design.motor_position))  # fmt: skip
    k = design.k_theta_v_per_rad
    f = w * s
    if form == "measured":
        return k * g1
    if form in ("bare", "exact"):
        return k * (1.0 + f) * g1 / (1.0 - k * f * g1)
    closed = k * g1 / (1.0 + k * g1)
    return k * g1 * (1.0 + f / (1.0 - f * closed))


def play_gain(share: NDArray[np.float64]) -> Response:
    """Describing function of the play, its output over a sine; share : half-gap over amplitude, 0 to 1."""
    x = 1.0 - 2.0 * share
    real = 0.5 + (np.arcsin(x) + x * np.sqrt(1.0 - x**2)) / np.pi
    return np.asarray(real - 4j * share * (1.0 - share) / np.pi)


def cycle(design: ControllerDesign, form: str, tau_r_s: float) -> tuple[float, float] | None:
    """Amplitude over the believed half-gap, and rad/s, of the cycle where there is no gap; None: none is predicted.

    The output follows the motor by all that the believed play N leaves: 1 + K G1 (N + F (1 - N)) = 0, F = W S. With
    ``inverse`` the loop on the angle stays closed in the gap, and 1 + (1 - N) G F (1 + 1/(tau_r s)) = 0.
    """
    omega = np.geomspace(2.0, 300.0, 800)
    at: Response = 1j * omega.astype(np.complex128)
    share = np.linspace(0.02, 0.995, 400)
    n = play_gain(share)[:, None]
    w, s, g1 = (response(m, omega, design.sample_time_s) for m in (design.prefilter, design.structure,
                                                                   design.motor_position))  # fmt: skip
    servo = design.k_theta_v_per_rad * g1
    balance: Response
    if form == "inverse":
        balance = 1.0 + (1.0 - n) * servo / (1.0 + servo) * w * s * (1.0 + 1.0 / (tau_r_s * at))
    else:
        balance = 1.0 + servo * (n + w * s * (1.0 - n))
    i, j = np.unravel_index(np.abs(balance).argmin(), balance.shape)
    if abs(balance[i, j]) > BALANCED:
        return None
    return float(1.0 / share[i]), float(omega[j])


def crossings(values: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Where values (n,) on the grid pass 0: the point before, and the share of the way to the next, linearly."""
    at = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)
    return at, values[at] / (values[at] - values[at + 1])


def margins(design: ControllerDesign, form: str, tau_r_s: float, gap: bool = True) -> Margins:
    """Margins of a design with an internal model of this form; gap : whether its model has one.

    Of all crossings of the loop's frequency response the nearest counts.
    """
    omega = frequencies(design.sample_time_s)
    loop = loop_transfer(design, form, omega)
    at, share = crossings(loop.imag)
    real = loop.real[at] * (1.0 - share) + loop.real[at + 1] * share
    gains = -1.0 / real[(real < 0.0) & (real > -1.0)]
    at, share = crossings(np.log(np.abs(loop)))
    where = omega[at] * (omega[at + 1] / omega[at]) ** share
    angle = np.unwrap(np.angle(loop))
    phases = angle[at] * (1.0 - share) + angle[at + 1] * share + np.pi
    delays = np.mod(phases, 2.0 * np.pi) / where
    swings = cycle(design, form, tau_r_s) if gap else None
    return Margins(
        gain=float(gains.min()) if gains.size else None,
        phase_deg=float(np.degrees(np.abs(np.angle(np.exp(1j * phases)))).min()) if phases.size else None,
        delay_s=float(delays.min()) if delays.size else None,
        ms=float(np.max(1.0 / np.abs(1.0 + loop))),
        crossover_rad_s=float(where[delays.argmin()]) if delays.size else None,
        cycle_share=None if swings is None else swings[0],
        cycle_rad_s=None if swings is None else swings[1],
    )
