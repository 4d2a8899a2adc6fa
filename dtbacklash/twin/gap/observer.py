"""The twin's mixed nonlinear-linear simulation (Figure 12): backlash, then the structure's linear observer.

An observer of G2 = num/den with the characteristic polynomial chi(s) = (s + pole)^n, driven by the simulated
theta_d and the measured q3, has the output error

    eps = q3 - q3_estimated = den(s)/chi(s) q3 - num(s)/chi(s) theta_d,

whatever its state coordinates, so no gain has to be placed. In F = pole/(s + pole) both quotients are
polynomials, realised here as a chain of n equal lags: well conditioned for any number of masses.

Sampling is by first-order hold. theta_d and q3 come from continuous motion, so straight lines between their
samples err by O(Ts^2); a zero-order hold would delay both by Ts/2, which looks like a change of the gap.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from dtbacklash.control.chain import StructureParameters, structure_polynomials
from dtbacklash.core.library import buffer, copied, lib, struct
from dtbacklash.errors import UserError

Array = NDArray[np.float64]


class Path(NamedTuple):
    """One input's way to the output error: x[k+1] = phi x[k] + b u[k], y[k] = x[k][0] + d u[k].

    phi: (n, n), upper triangular; b: (n,); start: (n,) the state at rest for a unit input.
    """

    phi: Array
    b: Array
    d: float
    start: Array


class Lags(NamedTuple):
    """The powers 1 ... n of F = pole/(s + pole) of one input: z + d u, of n equal lags in a row.

    phi: (n, n), upper triangular, z[k+1] = phi' z[k] + b u[k]. b, d, start: (n,); start: the state z at rest for a unit
    input. b_of, start_of: (n+1, n), d_of: (n+1,) what each power 0 ... n adds to a :class:`Path`.
    """

    phi: Array
    b: Array
    d: Array
    start: Array
    b_of: Array
    start_of: Array
    d_of: Array


@dataclass(frozen=True)
class TwinModel:
    """What the twin knows of the structure.

    from_q3 [m -> m] and from_theta_d [rad -> m]: the two paths to the output error. settle: first sample of a
    buffer that counts in the cost (0-based). noise_colour: power at zero frequency over mean power, >= 1, of
    the output error that white noise on q3 causes. lags: of which both paths are sums: another structure has the same
    lags and other coefficients. structure: the believed one.
    """

    from_q3: Path
    from_theta_d: Path
    settle: int
    sample_time_s: float
    pitch_m_per_rad: float
    pole_rad_s: float
    noise_colour: float
    lags: Lags
    structure: StructureParameters


def twin_model(structure: StructureParameters, pole_rad_s: float, sample_time_s: float, settle: int) -> TwinModel:
    """The observer with all n = 2N eigenvalues at -pole_rad_s [rad/s], sampled every sample_time_s [s]."""
    if not pole_rad_s > 0:
        raise UserError("twin.observer_pole_rad_s", pole_rad_s, "a number above 0")
    if len(structure.masses_kg) > lib.dtb_masses_most():
        raise UserError("rig", f"{len(structure.masses_kg)} masses", f"at most {lib.dtb_masses_most()} with a twin")
    num, den = structure_polynomials(structure)
    order = len(den) - 1
    from_q3 = sampled_path(in_lags(den, order, pole_rad_s), pole_rad_s, sample_time_s)
    return TwinModel(
        from_q3=from_q3,
        from_theta_d=sampled_path(-in_lags(num, order, pole_rad_s), pole_rad_s, sample_time_s),
        settle=int(settle),
        sample_time_s=float(sample_time_s),
        pitch_m_per_rad=structure.static_gain_m_per_rad,
        pole_rad_s=float(pole_rad_s),
        noise_colour=_noise_colour(from_q3),
        lags=_lags(order, pole_rad_s, sample_time_s),
        structure=structure,
    )


def _noise_colour(path: Path) -> float:
    """Power that a path gives to white noise at zero frequency, over that at all frequencies; at least 1."""
    covariance = scipy.linalg.solve_discrete_lyapunov(path.phi, np.outer(path.b, path.b))
    mean_power = covariance[0, 0] + path.d**2
    return max(1.0, float((path.start[0] + path.d) ** 2 / mean_power))


def in_lags(polynomial: Array, order: int, pole: float) -> Array:
    """(order+1,) coefficients c with polynomial(s)/(s + pole)^order = sum_k c[k] F^k, F = pole/(s + pole).

    With s = pole (1 - F)/F, a term p_j s^j becomes p_j pole^(j - order) (1 - F)^j F^(order - j).
    """
    coefficients = np.zeros(order + 1)
    for j, value in enumerate(np.asarray(polynomial)[::-1]):
        term = np.poly1d([-1.0, 1.0]) ** j * value * pole ** float(j - order)
        coefficients[order - j :] += np.asarray(term.coeffs)[::-1]
    return coefficients


def sampled_path(lags: Array, pole: float, sample_time_s: float) -> Path:
    """The chain of lags y = c0 u + F(c1 u + F(c2 u + ...)), sampled by first-order hold."""
    from scipy.signal import cont2discrete

    order = len(lags) - 1
    a = pole * (np.eye(order, k=1) - np.eye(order))
    system = (a, pole * lags[1:, None], np.eye(1, order), lags[:1, None])
    phi, b, _, d, _ = cont2discrete(system, sample_time_s, method="foh")
    start = np.linalg.solve(np.eye(order) - phi, b)
    columns = [np.array(column[:, 0], dtype=np.float64) for column in (b, start)]
    return Path(np.array(np.triu(phi), dtype=np.float64), columns[0], float(d[0, 0]), columns[1])


def _lags(order: int, pole: float, sample_time_s: float) -> Lags:
    """The row of lags in which each one's output is the next one's input, sampled by first-order hold."""
    from scipy.signal import cont2discrete

    each = [sampled_path(unit, pole, sample_time_s) for unit in np.eye(order + 1)]
    a, first = pole * (np.eye(order, k=-1) - np.eye(order)), pole * np.eye(order, 1)
    _, b, _, d, _ = cont2discrete((a, first, np.eye(order), np.zeros((order, 1))), sample_time_s, method="foh")
    start = np.linalg.solve(np.eye(order) - each[0].phi.T, b[:, 0])
    taken = (np.array([getattr(one, name) for one in each]) for name in ("b", "start", "d"))
    return Lags(each[0].phi, np.array(b[:, 0]), np.array(d[:, 0]), np.asarray(start, dtype=np.float64), *taken)


def play(theta_m: Array, half_gap: float, theta_d0: float, growth: float) -> Array:
    """theta_d of the backlash (16)-(17), driven by the samples theta_m; both (N,) [rad].

    theta_d stays until theta_m has crossed the gap and then follows at the distance half_gap [rad, >= 0].
    theta_d0 [rad] is where it rests before the first sample; it is pushed if the gap does not allow it.
    growth [rad/sample]: half_gap is that of the middle of the buffer, and grows by this much per sample.
    """
    theta_d = np.empty(len(theta_m))
    lib.dtb_play(len(theta_m), copied(theta_m), half_gap, theta_d0, growth, buffer(theta_d))
    return theta_d


def filtered(u: Array, path: Path) -> Array:
    """Response of a path to the samples u, (N,), from rest at u[0]."""
    out = np.array(u, dtype=np.float64, order="C")
    lib.dtb_filter(path_struct(path), len(out), buffer(out, len(out)), room(path, 1))
    return out


def cost(
    theta_m: Array, eps_q: Array, half_gap: float, theta_d0: float, growth: float, path: Path, settle: int
) -> float:
    """Mean square output error [m^2] from sample ``settle`` on, eq. (18).

    theta_m: (N,) [rad]. eps_q: (N,) [m], the measured q3 through ``from_q3``: it depends on no parameter.
    path: ``from_theta_d``. half_gap and theta_d0 [rad], growth [rad/sample] as in :func:`play`; a negative
    half_gap counts as its magnitude, which makes the cost smooth where the true gap is zero.
    """
    given = buffer_struct(theta_m, eps_q, path, settle)
    found: float = lib.dtb_cost(given, half_gap, theta_d0, growth, room(path, 1))
    return found


def sensitivities(
    theta_m: Array, eps_q: Array, half_gap: float, theta_d0: float, growth: float, path: Path, settle: int
) -> Array:
    """Output error and its derivatives by half_gap, theta_d0 and growth: rows of (4, N - settle), SI.

    Arguments as for :func:`cost`.
    """
    rows = np.empty((4, max(len(theta_m) - settle, 0)))
    given = buffer_struct(theta_m, eps_q, path, settle)
    lib.dtb_sensitivities(given, half_gap, theta_d0, growth, buffer(rows), room(path, 4))
    return rows


def cost_and_gradient(
    theta_m: Array, eps_q: Array, half_gap: float, theta_d0: float, path: Path, settle: int
) -> tuple[float, float, float]:
    """:func:`cost` [m^2] and its derivatives by half_gap and theta_d0 [m^2/rad], without growth."""
    given, out = buffer_struct(theta_m, eps_q, path, settle), np.empty(3)
    lib.dtb_cost_and_gradient(given, half_gap, theta_d0, buffer(out), room(path, 3))
    value, by_gap, by_start = out.tolist()
    return value, by_gap, by_start


def buffer_struct(theta_m: Array, eps_q: Array, path: Path, settle: int) -> Any:
    """A buffer as the core takes it; arguments as for :func:`cost`.

    Raises ValueError: it is empty, or begins to count outside of it.
    """
    N = len(theta_m)
    if N == 0 or not 0 <= settle <= N:
        raise ValueError(f"a buffer of {N} samples that count from {settle} on")
    arrays = {"theta_m": copied(theta_m, N), "eps_q": copied(eps_q, N)}
    return struct("TwinBuffer", samples=N, settle=settle, path=path_struct(path), **arrays)


def model_struct(model: TwinModel) -> Any:
    """What the twin knows of the structure, as the core takes it."""
    return struct(
        "TwinModel", from_q3=path_struct(model.from_q3), from_theta_d=path_struct(model.from_theta_d),
        settle=model.settle, sample_time=model.sample_time_s, pitch=model.pitch_m_per_rad, pole=model.pole_rad_s,
        noise_colour=model.noise_colour,
    )  # fmt: skip


def lags_struct(lags: Lags) -> Any:
    """A row of lags as the core takes it."""
    return struct("TwinLags", n=lags.b.size, **{name: copied(value) for name, value in lags._asdict().items()})


def room(path: Path, paths: int) -> Any:
    """Memory to work in with the states of so many paths."""
    return buffer(np.empty(paths * path.b.size))


def path_struct(path: Path) -> Any:
    """A path as the core takes it."""
    n = path.b.size
    arrays = {"phi": copied(path.phi, n, n), "b": copied(path.b, n), "start": copied(path.start, n)}
    return struct("TwinPath", n=n, d=path.d, **arrays)
