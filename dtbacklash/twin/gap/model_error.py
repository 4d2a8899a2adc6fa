"""What a wrong model does to an estimate: the gap, fitted again with what may be wrong, and its standard error.

Method. The output error is linear in the coefficients of the structure's polynomials: with F = pole/(s + pole) it is
``e = v(psi)' R``, where R are the powers of F applied to q3, to theta_d, to the direction of q3's motion (for dry
friction at a mass), and a constant. psi says what may be wrong: stiffness and damping (their logarithms), the
pitch, compliance of the screw, an offset between the two sensors (or the screw's local pitch error), dry friction at
each mass. Each has a prior N(0, sigma_i^2) from :class:`Tolerances`. Gap, start, growth and psi are fitted together
by Gauss-Newton, ``min |e|^2 / s^2 + sum psi_i^2 / sigma_i^2``; the gap's standard error is the root of its element
of the inverse of ``J J'/s^2 + diag(1/sigma_i^2)``. The noise s^2 is the power of what is left at low frequency
(:meth:`.Problem.noise_m2`). So a wrong stiffness, which the residual shows, costs the gap nothing, and friction,
which looks like a gap, as much as the residual leaves open. Where the plain fit leaves less than rounding
(``FLOOR_DEG``), nothing can hide in it, and the estimate and its error stay those of the plain fit.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtbacklash.control.chain import StructureParameters
from dtbacklash.core.library import struct
from dtbacklash.twin.gap.observer import TwinModel, in_lags, lags_struct

Array = NDArray[np.float64]
#: (power of the stiffness, of the damping, of s) -> coefficient
Polynomial = dict[tuple[int, int, int], float]

#: what the output error is a sum of: lags of q3, of theta_d and of friction's direction, and a constant
OF_Q3, OF_THETA_D, OF_FRICTION, OF_CONSTANT = range(4)
#: entries of psi behind those of stiffness, damping and pitch; the first of friction's
COMPLIANCE, OFFSET, FRICTION = 3, 4, 5


@dataclass(frozen=True)
class Tolerances:
    """How wrong a model may be, one standard deviation each.

    stiffness, damping: relative; that of their ratios to the masses, in which alone they show (twice the rig's own
    tolerances: what is concealed from a twin is not drawn from its data sheet). pitch: relative, locally (0.015: a
    pitch error of 5 um once a turn). compliance: of the screw, relative to that of the first link (0.05: 5e-6 m/N).
    offset_m: between the zeros of both sensors, or the screw's local pitch error (5 um: a rolled screw).
    friction_m: dry friction at a mass, by what it moves the last mass at rest (20 um: 0.1 N behind two springs of
    1e4 N/m, a well lubricated slide). growth_deg_s: of the gap.
    presliding_m: motion that turns friction round, above a position sensor's noise.
    """

    stiffness: float = 0.2
    damping: float = 0.3
    pitch: float = 0.015
    compliance: float = 0.05
    offset_m: float = 5e-6
    friction_m: float = 20e-6
    growth_deg_s: float = 2.0
    presliding_m: float = 4e-6

    def deviations(self, masses: int) -> Array:
        """(5 + masses,) standard deviations of psi."""
        first = [self.stiffness, self.damping, self.pitch, self.compliance, self.offset_m]
        return np.array([*first, *[self.friction_m] * masses])


def model_error(model: TwinModel, tolerances: Tolerances) -> Any:
    """What may be wrong in a model, as the core takes it."""
    terms = model_terms(model)
    deviations = [np.inf, np.inf, np.radians(tolerances.growth_deg_s)]
    masses = len(model.structure.masses_kg)
    return struct(
        "ModelError", lags=lags_struct(model.lags), masses=masses, terms=len(terms),
        powers=np.array(list(terms), dtype=np.int64), term=np.array(list(terms.values())),
        deviations=np.append(deviations, tolerances.deviations(masses)), presliding=tolerances.presliding_m,
    )  # fmt: skip


def model_terms(model: TwinModel) -> dict[tuple[int, int, int, int, int], Array]:
    """The coefficients of the output error: what each term adds to those of the powers of the lag.

    Each is a product of powers of the stiffness' and the damping's factor (entries 1 and 2 of a key), of the pitch's
    (entry 3) and of an entry of psi (entry 4, or -1), for one of the four that the error is a sum of (entry 0).
    """
    structure, order, pole = model.structure, model.lags.b.size, model.pole_rad_s
    powers = [in_lags(unit, order, pole) for unit in np.eye(order + 1)[::-1]]  # of s^0, s^1, ...
    found: dict[tuple[int, int, int, int, int], Array] = defaultdict(lambda: np.zeros(order + 1))

    def add(of: int, polynomial: Polynomial, factor: int = -1, size: float = 1.0, pitch: int = 0) -> None:
        for (soft, damped, s), value in polynomial.items():
            if s <= order:  # behind a single mass the base's inertia would differentiate: it is left out there
                found[of, soft, damped, pitch, factor] += size * value * powers[s]

    num, den = numerator(structure), denominator(structure)
    add(OF_Q3, den)
    add(OF_THETA_D, num, size=-1.0, pitch=1)
    yielding_q3, yielding_theta_d = yielding(structure)
    add(OF_Q3, yielding_q3, COMPLIANCE)
    add(OF_THETA_D, yielding_theta_d, COMPLIANCE, pitch=1)
    for j in range(len(structure.masses_kg)):
        through = force(structure, j)
        add(OF_FRICTION, product({(1, 0, 0): 1.0}, through), FRICTION + j, at_rest(den) / at_rest(through))
    for (soft, damped, s), value in den.items():
        if s == 0:
            found[OF_CONSTANT, soft, damped, 0, OFFSET][0] += value / pole**order
    return found


def product(*factors: Polynomial) -> Polynomial:
    """The product of polynomials."""
    found: Polynomial = {(0, 0, 0): 1.0}
    for factor in factors:
        terms: Polynomial = defaultdict(float)
        for (a, b, c), one in found.items():
            for (d, e, f), other in factor.items():
                terms[a + d, b + e, c + f] += one * other
        found = terms
    return found


def at_rest(polynomial: Polynomial) -> float:
    """Its value at s = 0, for the believed stiffness and damping."""
    return sum(value for (_, _, s), value in polynomial.items() if s == 0)


def link(structure: StructureParameters, i: int) -> Polynomial:
    """The impedance c s + k of the link before mass i, or of none behind the last."""
    if i >= len(structure.stiffnesses_n_per_m):
        return {}
    return {(0, 1, 1): structure.dampings_n_s_per_m[i], (1, 0, 0): structure.stiffnesses_n_per_m[i]}


def determinant(structure: StructureParameters, first: int, stop: int) -> Polynomial:
    """det(M s^2 + C s + K) of the masses first <= i < stop, by the masses' product; by the three-term recurrence."""
    before: Polynomial = {}
    now: Polynomial = {(0, 0, 0): 1.0}
    for i in range(first, stop):
        diagonal: Polynomial = defaultdict(float, {(0, 0, 2): structure.masses_kg[i]})
        grounds = structure.ground_dampings_n_s_per_m, structure.ground_stiffnesses_n_per_m
        ground = {(0, 0, power): each[i] for power, each in zip((1, 0), grounds, strict=True) if each}
        for part in (link(structure, i), link(structure, i + 1), ground):
            for key, value in part.items():
                diagonal[key] += value
        following = product(diagonal, now)
        for key, value in product(link(structure, i), link(structure, i), before).items():
            following[key] -= value
        before, now = now, following
    return {key: value / math.prod(structure.masses_kg[first:stop]) for key, value in now.items()}


def numerator(structure: StructureParameters) -> Polynomial:
    """That of :func:`.chain.structure_polynomials`."""
    size = structure.pitch_m_per_rad / math.prod(structure.masses_kg)
    return product({(0, 0, 0): size}, *(link(structure, i) for i in range(len(structure.masses_kg))))


def denominator(structure: StructureParameters) -> Polynomial:
    """That of :func:`.chain.structure_polynomials`."""
    return determinant(structure, 0, len(structure.masses_kg))


def force(structure: StructureParameters, j: int) -> Polynomial:
    """From a force on mass j [N] to den(s) q3."""
    size = 1.0 / math.prod(structure.masses_kg[j:])
    behind = (link(structure, i) for i in range(j + 1, len(structure.masses_kg)))
    return product({(0, 0, 0): size}, determinant(structure, 0, j), *behind)


def yielding(structure: StructureParameters) -> tuple[Polynomial, Polynomial]:
    """What compliance of the screw, relative to the first link's, adds to den (of q3) and to -num (of theta_d).

    The base is then at p theta_d less the compliance times the force through the screw. The structure does not say what
    else the base carries: a mass and a link to the ground like the first ones, as in the paper.
    """
    m, c, k = structure.masses_kg[0], structure.dampings_n_s_per_m[0], structure.stiffnesses_n_per_m[0]
    soft, first = {(-1, 0, 0): 1.0 / k}, link(structure, 0)
    others = determinant(structure, 1, len(structure.masses_kg))
    q3 = product({(0, 0, 0): -1.0 / m}, soft, first, first, others)
    base = {(0, 0, 2): m, (0, 1, 1): 2.0 * c, (1, 0, 0): 2.0 * k}
    return q3, product(soft, numerator(structure), base)
