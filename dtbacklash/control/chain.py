"""Motor and structure of a rig: their parameters, and their linear models (paper, section 2.1).

Everything is SI: metres, radians, volts, seconds. Transfer functions are those of python-control, which is imported
inside the functions because its import alone takes a second.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dtbacklash.errors import UserError
from dtbacklash.physics.bodies import screw_spring
from dtbacklash.physics.effects import slots
from dtbacklash.physics.rig import Element, Rig

if TYPE_CHECKING:
    import control

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MotorParameters:
    """A dc motor, eqs (1)-(4), by the paper's symbols, and what the paper's has not.

    J: rotor inertia [kg m^2]; L: inductance [H]; R: resistance [ohm]; k_T: torque constant [N m/A];
    k_B: back-emf constant [V s/rad]. viscous_n_m_s: viscous friction [N m s/rad]; gain: volts at the winding per volt
    of command.
    """

    J: float
    L: float
    R: float
    k_T: float
    k_B: float
    viscous_n_m_s: float = 0.0
    gain: float = 1.0


@dataclass(frozen=True)
class StructureParameters:
    """A chain of N >= 1 masses on a base that the lead screw moves to ``pitch_m_per_rad * theta_d``.

    Link i (stiffness [N/m], damping [N s/m]) joins mass i [kg] to mass i-1, link 1 joins mass 1 to the base.
    All three tuples have length N. The paper's structure is N = 2: its q_2 and q_3. ``ground_stiffnesses_n_per_m`` and
    ``ground_dampings_n_s_per_m`` : between each mass and the ground; empty where there are none.
    """

    masses_kg: tuple[float, ...]
    stiffnesses_n_per_m: tuple[float, ...]
    dampings_n_s_per_m: tuple[float, ...]
    pitch_m_per_rad: float
    ground_stiffnesses_n_per_m: tuple[float, ...] = ()
    ground_dampings_n_s_per_m: tuple[float, ...] = ()

    @property
    def static_gain_m_per_rad(self) -> float:
        """G2(0): the pitch, or less where springs to the ground hold the masses back."""
        if not any(self.ground_stiffnesses_n_per_m):
            return self.pitch_m_per_rad
        num, den = structure_polynomials(self)
        return float(num[-1] / den[-1])

    def __post_init__(self) -> None:
        sizes = (len(self.masses_kg), len(self.stiffnesses_n_per_m), len(self.dampings_n_s_per_m))
        if sizes[0] < 1 or len(set(sizes)) != 1:
            raise UserError("rig.structure", sizes, "as many springs and dampers as masses, at least one")
        for ground in (self.ground_stiffnesses_n_per_m, self.ground_dampings_n_s_per_m):
            if len(ground) not in (0, sizes[0]) or min(ground, default=0.0) < 0:
                raise UserError("rig.structure", ground, "none, or one of at least 0 for each mass")
        if min(self.masses_kg) <= 0 or min(self.stiffnesses_n_per_m) <= 0 or min(self.dampings_n_s_per_m) < 0:
            raise UserError("rig.structure", self, "masses and stiffnesses above 0, dampings at least 0")
        if self.pitch_m_per_rad <= 0:
            raise UserError("rig.structure.pitch_m_per_rad", self.pitch_m_per_rad, "a number above 0")


def driven_chain(rig: Rig) -> tuple[list[Element], list[Element]]:
    """Masses and links behind the mass that the screw carries, in order.

    Raises
    ------
    UserError : the rig is not a screw-driven chain of masses, for which the paper's controllers are made.
    """
    screw = rig.only("screw")
    base = screw.neighbours.get("carries") if screw else None
    allowed = (
        "a rig with a motor, a screw that carries a mass, and a chain of links from there, or controller=open_loop"
    )
    if base is None or rig.only("motor_circuit") is None or len(rig.of_kind("rotor")) != 1:
        raise UserError("rig", rig.config.name, f"this controller needs {allowed}")
    links, masses, here = [], [], base
    remaining = {e.name: e for e in rig.of_kind("link")}
    while step := [e for e in remaining.values() if here in e.neighbours["between"]]:
        link = step[0]
        here = next(end for end in link.neighbours["between"] if end != here)
        if len(step) > 1 or here not in rig.elements:
            break
        del remaining[link.name]
        if link.values["stiffness"] == 0.0:
            name = rig.config.elements[link.name]["stiffness"]
            raise UserError(f"rig.parameters.{name}.value", 0.0, f"above 0 N/m: {link.name} drives {here}")
        links.append(link)
        masses.append(rig.elements[here])
    if remaining or not links:
        raise UserError("rig", rig.config.name, f"this controller needs {allowed}")
    return masses, links


def structure_parameters(rig: Rig) -> StructureParameters:
    """The chain that the screw drives, as the design wants it; raises as :func:`driven_chain`."""
    masses, links = driven_chain(rig)
    screw = rig.only("screw")
    assert screw is not None
    springs = [(e.values["stiffness"], e.values.get("damping", 0.0)) for e in links]
    yielding = screw_spring(rig)
    if yielding is not None:  # then the mass on the screw has a motion of its own
        masses, springs = [rig.elements[screw.neighbours["carries"]], *masses], [yielding, *springs]
    ground = [
        (
            e.values.get("ground_stiffness", 0.0),
            e.values.get("ground_damping", 0.0) + rig.amount(e.name, slots.BodyDamping, "coefficient"),
        )
        for e in masses
    ]
    return StructureParameters(
        tuple(e.values["mass"] for e in masses),
        tuple(k for k, _ in springs),
        tuple(c for _, c in springs),
        screw.values["lead"],
        tuple(k for k, _ in ground) if any(k for k, _ in ground) else (),
        tuple(c for _, c in ground) if any(c for _, c in ground) else (),
    )


def motor_parameters(rig: Rig) -> MotorParameters:
    """The motor of a rig as the design wants it; the rig has one (:func:`driven_chain` checks it)."""
    circuit, rotor = rig.only("motor_circuit"), rig.motor_rotor()
    assert circuit is not None
    assert rotor is not None
    v, amplifier = circuit.values, rig.only("amplifier")
    gain = rig.effects.get(amplifier.name, {}).get("gain_error", {}).get("relative", 0.0) if amplifier else 0.0
    return MotorParameters(
        rotor.values["inertia"], v["inductance"], v["resistance"], v["torque_constant"], v["emf_constant"],
        rig.amount(rotor.name, slots.BodyDamping, "coefficient"), 1.0 + gain,
    )  # fmt: skip


def motor_tf(motor: MotorParameters) -> control.TransferFunction:
    """G1(s), u [V] -> theta_m [rad], eq. (6)."""
    import control

    b = motor.viscous_n_m_s
    slow, fast = motor.J * motor.R + b * motor.L, motor.J * motor.L
    return control.tf([motor.gain * motor.k_T], [fast, slow, motor.k_B * motor.k_T + b * motor.R, 0.0])


def motor_ss(motor: MotorParameters) -> control.StateSpace:
    """u [V] -> (omega_m [rad/s], theta_m [rad]), eqs (1)-(4); states current, speed, angle."""
    import control

    slowing = -motor.viscous_n_m_s / motor.J if motor.viscous_n_m_s else 0.0
    a = [[-motor.R / motor.L, -motor.k_B / motor.L, 0.0], [motor.k_T / motor.J, slowing, 0.0], [0.0, 1.0, 0.0]]
    b, c = [[motor.gain / motor.L], [0.0], [0.0]], [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    return control.ss(a, b, c, np.zeros((2, 1)))


def structure_matrices(structure: StructureParameters) -> tuple[Array, Array, Array, Array, Array]:
    """M, C, K of eq. (8), shape (N, N), and the base's columns of C and of K, shape (N,)."""
    n = len(structure.masses_kg)
    mass = np.diag(np.asarray(structure.masses_kg, dtype=float))
    matrices = []
    grounds = (structure.ground_dampings_n_s_per_m, structure.ground_stiffnesses_n_per_m)
    for links, ground in zip((structure.dampings_n_s_per_m, structure.stiffnesses_n_per_m), grounds, strict=True):
        matrix = np.diag(ground) if ground else np.zeros((n, n))
        for i, value in enumerate(links):
            matrix[i, i] += value
            if i > 0:
                matrix[i - 1, i - 1] += value
                matrix[i - 1, i] = matrix[i, i - 1] = -value
        matrices.append(matrix)
    base = np.zeros((2, n))
    base[:, 0] = structure.dampings_n_s_per_m[0], structure.stiffnesses_n_per_m[0]
    return mass, matrices[0], matrices[1], base[0], base[1]


def structure_ss(structure: StructureParameters) -> control.StateSpace:
    """G2 in state space, theta_d [rad] -> position of the last mass [m], from M, C and K of eq. (8).

    States: the N positions, and the N velocities less M^-1 c p theta_d. The latter takes the derivative of
    the input out of eq. (8), so that a step of theta_d needs no impulse.
    """
    import control

    mass, damping, stiffness, base_c, base_k = structure_matrices(structure)
    n, p = mass.shape[0], structure.pitch_m_per_rad
    c_in = np.linalg.solve(mass, base_c) * p
    k_in = np.linalg.solve(mass, base_k * p - damping @ c_in)
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]])
    c_out = np.zeros((1, 2 * n))
    c_out[0, n - 1] = 1.0
    return control.ss(a, np.concatenate([c_in, k_in])[:, None], c_out, [[0.0]])


def structure_polynomials(structure: StructureParameters) -> tuple[Array, Array]:
    """G2(s): numerator with the pitch, monic denominator, highest power first; eq. (9) for two equal masses.

    The numerator is the product of the links' impedances, the denominator det(M s^2 + C s + K): exact
    coefficients, without the cancellations of a general state-space conversion.
    """
    mass, damping, stiffness, _, _ = structure_matrices(structure)
    links = zip(structure.dampings_n_s_per_m, structure.stiffnesses_n_per_m, strict=True)
    num = np.array([structure.pitch_m_per_rad])
    for c, k in links:
        num = np.polymul(num, [c, k])
    den = tridiagonal_determinant(mass, damping, stiffness)
    return num / den[0], den / den[0]


def structure_tf(structure: StructureParameters) -> control.TransferFunction:
    """G2(s), theta_d [rad] -> position of the last mass [m], from :func:`structure_polynomials`."""
    import control

    return control.tf(*structure_polynomials(structure))


def tridiagonal_determinant(mass: Array, damping: Array, stiffness: Array) -> Array:
    """Coefficients of det(M s^2 + C s + K) of a chain, highest power first, by the three-term recurrence."""
    before, now = np.zeros(1), np.ones(1)
    for i in range(mass.shape[0]):
        diagonal = np.array([mass[i, i], damping[i, i], stiffness[i, i]])
        following = np.polymul(diagonal, now)
        if i > 0:
            link = np.array([damping[i, i - 1], stiffness[i, i - 1]])
            following = np.polysub(following, np.polymul(np.polymul(link, link), before))
        before, now = now, following
    return now


def dominant_frequency(structure: StructureParameters) -> float:
    """Damped frequency omega_d [rad/s] of the oscillating mode that decays most slowly (27.07 in the paper).

    An overdamped structure has none: then the magnitude of its slowest pole.
    """
    poles = structure_ss(structure).poles()
    oscillating = poles[np.abs(poles.imag) > 1e-6 * np.abs(poles)]
    if oscillating.size == 0:
        return float(np.min(np.abs(poles)))
    # an undamped chain has all its poles on the axis: there the lowest frequency decides
    slowest = oscillating[np.lexsort((np.abs(oscillating), np.round(-oscillating.real, 9)))][0]
    return float(abs(slowest.imag))
