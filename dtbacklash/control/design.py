"""Design of the controllers from the linear models of motor and structure (paper, sections 2.1 and 2.2).

Everything here is SI: metres, radians, volts, seconds. Transfer functions are those of python-control, which
is imported inside the functions because its import alone takes a second. The compiled loop gets plain arrays
(:class:`SampledModel`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from dtbacklash.control.chain import (
    Array,
    MotorParameters,
    StructureParameters,
    dominant_frequency,
    motor_ss,
    motor_tf,
    structure_ss,
)
from dtbacklash.control.linear_law import LinearLaw
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    import control

PREFILTERS = ("reduced", "none")
#: Order that is kept of the structure's balanced realisation: one dominant mode (section 2.2.1).
REDUCED_ORDER = 2
#: Hankel singular values below this share of the largest are rounding, not dynamics.
HANKEL_FLOOR = 1e-12


@dataclass(frozen=True)
class SampledModel:
    """x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k].

    Contiguous float64 arrays of shapes (n, n), (n, m), (p, n), (p, m); a static gain has n = 0.
    """

    A: Array
    B: Array
    C: Array
    D: Array

    @property
    def order(self) -> int:
        """Number of states."""
        return int(self.A.shape[0])


@dataclass(frozen=True)
class ControllerDesign:
    """All sampled-data models that the controllers need (zero-order hold at ``sample_time_s``).

    prefilter: W, reference minus prediction error [m] -> theta_ref [rad], eq. (14).
    motor_position: G1, u [V] -> theta_m [rad]; states current, speed, angle.
    structure: G2, theta_d [rad] -> position of the last mass [m].
    plant: G1 G2 sampled as one, u [V] -> position of the last mass [m].
    dominant_frequency_rad_s: damped frequency omega_d of the structure's dominant mode.
    delays_s: those that are known: of the command, of the measured angle, of the measured output, s.
    law: the whole controller, where it is none of the paper's (:mod:`.rivals`).
    """

    prefilter: SampledModel
    motor_position: SampledModel
    structure: SampledModel
    plant: SampledModel
    k_theta_v_per_rad: float
    sample_time_s: float
    dominant_frequency_rad_s: float
    delays_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    law: LinearLaw | None = None


def inner_loop(motor: MotorParameters, k_theta: float) -> control.TransferFunction:
    """G_theta(s) = K G1 / (1 + K G1), theta_ref -> theta_m, eq. (12)."""
    import control

    return control.feedback(k_theta * motor_tf(motor), 1)


def balanced_reduction(system: control.StateSpace, order: int) -> control.StateSpace:
    """Balanced realisation of a stable system, residualised to ``order`` states: the dc gain stays.

    python-control's own balanced reduction needs the Fortran library slycot; the balancing here is the
    square-root algorithm on SciPy's Lyapunov solver, the residualisation is python-control's ``matchdc``.
    """
    import control

    a, b, c = system.A, system.B, system.C
    roots = [_psd_root(scipy.linalg.solve_continuous_lyapunov(x, -y @ y.T)) for x, y in ((a, b), (a.T, c.T))]
    u, hankel, vt = scipy.linalg.svd(roots[1].T @ roots[0])
    rank = int(np.sum(hankel > HANKEL_FLOOR * hankel[0]))
    scale = 1.0 / np.sqrt(hankel[:rank])
    right = roots[0] @ vt[:rank].T * scale
    left = (roots[1] @ u[:, :rank] * scale).T
    balanced = control.ss(left @ a @ right, left @ b, c @ right, system.D)
    if rank <= order:
        return balanced
    return control.model_reduction(balanced, list(range(order, rank)), method="matchdc")


def _psd_root(gramian: Array) -> Array:
    """A square root X with X X^T = gramian, also where rounding made the Gramian slightly indefinite."""
    values, vectors = scipy.linalg.eigh(0.5 * (gramian + gramian.T))
    return np.asarray(vectors * np.sqrt(np.clip(values, 0.0, None)))


def reduced_structure(structure: StructureParameters) -> control.StateSpace:
    """The dominant mode of G2 / G2(0): balanced, reduced to second order, dc gain 1 (section 2.2.1)."""
    import control

    full = structure_ss(structure)
    if np.max(full.poles().real) >= -1e-9 * np.max(np.abs(full.poles())):
        raise UserError("controller.prefilter", "reduced", "needs damping in the structure; without it choose none")
    normalised = control.ss(full.A, full.B / structure.static_gain_m_per_rad, full.C, full.D)
    return balanced_reduction(normalised, min(REDUCED_ORDER, full.nstates))


def minimum_phase(system: control.StateSpace) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Zeros and poles of the minimum-phase spectral factor: right-half-plane zeros mirrored to the left.

    |G(j w)| stays as it is, and the inverse becomes stable. A zero on the axis cannot be inverted: UserError.
    """
    zeros, poles = system.zeros(), system.poles()
    # the zeros of a strictly proper model come out of the pencil as huge numbers or infinity
    zeros = zeros[np.abs(zeros) < 1e9 * np.max(np.abs(poles))]
    if np.any(np.abs(zeros.real) <= 1e-9 * np.abs(zeros)):
        raise UserError("controller.prefilter", "reduced", "cannot invert this structure; choose none")
    return -np.abs(zeros.real) + 1j * zeros.imag, poles


def prefilter(structure: StructureParameters, kind: str, tau_r_s: float) -> control.StateSpace:
    """W(s) = W~(s)/G2(0), position [m] -> theta_ref [rad], eqs (14) and (15); the paper's G2(0) is the pitch p.

    kind 'reduced': W~ = G_d^-1 / (tau_r s + 1), G_d the minimum-phase factor of :func:`reduced_structure`;
    kind 'none': W~ = 1. Raises UserError for another kind or where G_d cannot be inverted.
    """
    import control

    gain = 1.0 / structure.static_gain_m_per_rad
    if kind == "none":
        return control.ss([], [], [], [[gain]])
    if kind != "reduced":
        raise UserError("controller.prefilter", kind, "one of " + ", ".join(PREFILTERS))
    if not tau_r_s > 0:
        raise UserError("controller.tau_r_s", tau_r_s, "a number above 0")
    zeros, poles = minimum_phase(reduced_structure(structure))
    if poles.size > zeros.size + 1:
        raise UserError("controller.prefilter", kind, "the inverse is improper here; choose none")
    num, den = np.poly(poles).real, np.polymul(np.poly(zeros).real, [tau_r_s, 1.0])
    return _tf_to_ss(num * (gain * den[-1] / num[-1]), den)


def _tf_to_ss(num: Array, den: Array) -> control.StateSpace:
    """Controllable canonical form, its time scaled by the poles' geometric mean: entries near 1."""
    import control

    order = len(den) - 1
    rate = abs(den[-1] / den[0]) ** (1.0 / order)
    powers = rate ** np.arange(order, -1, -1.0) / (den[0] * rate**order)
    num_scaled = np.concatenate([np.zeros(order + 1 - len(num)), num]) * powers
    den_scaled = den * powers
    companion = np.eye(order, k=-1)
    companion[0] = -den_scaled[1:]
    c = (num_scaled[1:] - num_scaled[0] * den_scaled[1:])[None, :]
    return control.ss(companion * rate, np.eye(order, 1) * rate, c, [[num_scaled[0]]])


def sampled(system: control.StateSpace, sample_time_s: float) -> SampledModel:
    """Zero-order-hold equivalent of a continuous model."""
    import control

    if system.nstates == 0:
        rows, columns = system.noutputs, system.ninputs
        return _model(np.zeros((0, 0)), np.zeros((0, columns)), np.zeros((rows, 0)), np.atleast_2d(system.D))
    discrete = control.c2d(system, sample_time_s, method="zoh")
    return _model(discrete.A, discrete.B, discrete.C, discrete.D)


def _model(*matrices: Any) -> SampledModel:
    return SampledModel(*(np.ascontiguousarray(matrix, dtype=np.float64) for matrix in matrices))


def design_controller(
    motor: MotorParameters,
    structure: StructureParameters,
    k_theta: float,
    prefilter_kind: str,
    tau_r_s: float,
    sample_time_s: float,
) -> ControllerDesign:
    """All sampled models of the controllers.

    k_theta in V/rad; prefilter_kind and tau_r_s as in :func:`prefilter`, whose UserErrors it raises.
    """
    import control

    full = motor_ss(motor)
    angle = control.ss(full.A, full.B, full.C[1:], [[0.0]])
    chain = structure_ss(structure)
    return ControllerDesign(
        prefilter=sampled(prefilter(structure, prefilter_kind, tau_r_s), sample_time_s),
        motor_position=sampled(angle, sample_time_s),
        structure=sampled(chain, sample_time_s),
        plant=sampled(control.series(angle, chain), sample_time_s),
        k_theta_v_per_rad=float(k_theta),
        sample_time_s=float(sample_time_s),
        dominant_frequency_rad_s=dominant_frequency(structure),
    )


def largest_gain(motor: SampledModel, delay: int = 0) -> float:
    """The gain of the inner loop, V/rad, from which it is unstable, its voltage ``delay`` samples late.

    The loop u[k + delay] = K (theta_ref[k] - theta_m[k]) around the sampled G1, by bisection of the spectral radius;
    inf where no gain up to 1e9 V/rad is too large.
    """

    def stable(gain: float) -> bool:
        # states: those of the motor, then the voltages that are on their way, the next one first
        n = motor.order
        a = np.zeros((n + delay, n + delay))
        a[:n, :n] = motor.A
        feedback = -gain * motor.C[0]
        if delay:
            a[:n, n] = motor.B[:, 0]
            a[n:-1, n + 1 :] = np.eye(delay - 1)
            a[-1, :n] = feedback
        else:
            a += np.outer(motor.B[:, 0], feedback)
        return bool(np.abs(np.linalg.eigvals(a)).max() < 1.0)

    low, high = 0.0, 1.0
    while stable(high):
        low, high = high, 2.0 * high
        if high > 1e9:
            return float("inf")
    while high - low > 1e-4 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
