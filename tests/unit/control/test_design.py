"""The linear design against the paper's equations and its numbers (sections 2.1 and 2.2)."""

import control
import numpy as np
import pytest
from told import refused

from dtbacklash.control import chain, design
from dtbacklash.control.chain import MotorParameters, StructureParameters

M, K, C, PITCH = 5.2, 1e4, 36.9, 1e-3 / np.pi
MOTOR = MotorParameters(J=5e-6, L=1e-3, R=12.0, k_T=0.8, k_B=0.1)
STRUCTURE = StructureParameters((M, M), (K, K), (C, C), PITCH)
K_THETA, TAU_R = 15.0, 1.0 / 6.0
POINTS = [1.0, 20j, 27j + 1, -3 + 200j, 1e3j]


def chain_of(count: int) -> StructureParameters:
    """An uneven chain, so that a mixed-up index shows."""
    i = np.arange(1.0, count + 1)
    return StructureParameters(tuple(2 + i), tuple(8e3 + 500 * i), tuple(30 + 3 * i), 4e-4)


def step(system: control.StateSpace, duration_s: float, step_s: float) -> tuple[np.ndarray, np.ndarray]:
    response = control.step_response(system, np.arange(0.0, duration_s, step_s))
    return np.array(response.time, dtype=float), np.array(np.squeeze(response.outputs), dtype=float)


@pytest.mark.parametrize("s", POINTS)
def test_motor_is_equation_6(s: complex) -> None:
    expected = 0.8 / (s * (5e-6 * 1e-3 * s**2 + 5e-6 * 12 * s + 0.1 * 0.8))
    assert chain.motor_tf(MOTOR)(s) == pytest.approx(expected, rel=1e-12)
    assert chain.motor_ss(MOTOR)(s)[1, 0] == pytest.approx(expected, rel=1e-9)
    assert chain.motor_ss(MOTOR)(s)[0, 0] == pytest.approx(expected * s, rel=1e-9)


@pytest.mark.parametrize("s", POINTS)
def test_structure_is_equation_9(s: complex) -> None:
    num = C**2 * s**2 + 2 * C * K * s + K**2
    den = M**2 * s**4 + 3 * C * M * s**3 + (C**2 + 3 * K * M) * s**2 + 2 * C * K * s + K**2
    assert chain.structure_tf(STRUCTURE)(s) == pytest.approx(PITCH * num / den, rel=1e-10)
    assert chain.structure_ss(STRUCTURE)(s) == pytest.approx(PITCH * num / den, rel=1e-8)


@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_a_chain_of_any_length_solves_its_equations_of_motion(count: int) -> None:
    structure = chain_of(count)
    mass, damping, stiffness, base_c, base_k = chain.structure_matrices(structure)
    for s in POINTS:
        dynamic = mass * s**2 + damping * s + stiffness
        expected = np.linalg.solve(dynamic, (base_c * s + base_k) * structure.pitch_m_per_rad)[-1]
        assert chain.structure_tf(structure)(s) == pytest.approx(expected, rel=1e-8)
        assert chain.structure_ss(structure)(s) == pytest.approx(expected, rel=1e-8)


def test_reduced_model_has_the_paper_readings_zeros() -> None:
    reduced = design.reduced_structure(STRUCTURE)
    assert sorted(reduced.zeros().real) == pytest.approx([-59.7, 73.8], abs=0.05)
    assert reduced.nstates == 2
    assert reduced.dcgain() == pytest.approx(1.0, abs=1e-10)
    assert abs(reduced.D[0, 0]) > 0.1  # relative degree 0, as the paper says


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_balanced_reduction_keeps_dc_and_the_error_bound(order: int) -> None:
    full = chain.structure_ss(STRUCTURE)
    reduced = design.balanced_reduction(full, order)
    assert reduced.nstates == order
    assert reduced.dcgain() == pytest.approx(full.dcgain(), rel=1e-8)
    omega = np.logspace(-1, 4, 400)
    error = np.max(np.abs(full(1j * omega) - reduced(1j * omega)))
    assert error <= 2 * np.sum(hankel_values(full)[order:]) * (1 + 1e-6) + 1e-12


def hankel_values(system: control.StateSpace) -> np.ndarray:
    from scipy.linalg import solve_continuous_lyapunov as lyapunov

    wc = lyapunov(system.A, -system.B @ system.B.T)
    wo = lyapunov(system.A.T, -system.C.T @ system.C)
    return np.sort(np.sqrt(np.abs(np.linalg.eigvals(wc @ wo))))[::-1]


def test_minimum_phase_factor_keeps_the_magnitude() -> None:
    reduced = design.reduced_structure(STRUCTURE)
    zeros, poles = design.minimum_phase(reduced)
    assert np.all(zeros.real < 0)
    omega = np.logspace(0, 3, 50)
    factor = np.array([np.prod(1 - 1j * w / zeros) / np.prod(1 - 1j * w / poles) for w in omega])
    assert np.abs(factor) == pytest.approx(np.abs(reduced(1j * omega)), rel=1e-8)


@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_prefilter_is_stable_has_dc_gain_one_over_pitch_and_inverts_a_single_mass(count: int) -> None:
    structure = chain_of(count)
    w = design.prefilter(structure, "reduced", TAU_R)
    assert np.all(w.poles().real < 0)
    assert w.dcgain() * structure.pitch_m_per_rad == pytest.approx(1.0, rel=1e-9)
    for s in POINTS if count == 1 else ():
        assert w(s) * chain.structure_tf(structure)(s) == pytest.approx(1 / (TAU_R * s + 1), rel=1e-8)


def test_dominant_frequency() -> None:
    assert chain.dominant_frequency(STRUCTURE) == pytest.approx(27.07, abs=0.005)
    undamped = StructureParameters((M, M), (K, K), (0.0, 0.0), PITCH)
    lowest = np.sqrt(K / M * (3 - np.sqrt(5)) / 2)
    assert chain.dominant_frequency(undamped) == pytest.approx(lowest, rel=1e-6)


def designed(kind: str = "reduced") -> design.ControllerDesign:
    return design.design_controller(MOTOR, STRUCTURE, K_THETA, kind, TAU_R, 1e-3)


@pytest.mark.parametrize("name", ["prefilter", "motor_position", "structure", "plant"])
def test_sampled_models_hold_at_the_samples(name: str) -> None:
    """A zero-order-hold model answers a step, which is constant between samples, exactly."""
    continuous = {
        "prefilter": design.prefilter(STRUCTURE, "reduced", TAU_R),
        "motor_position": control.ss(chain.motor_tf(MOTOR)),
        "structure": chain.structure_ss(STRUCTURE),
        "plant": control.series(control.ss(chain.motor_tf(MOTOR)), chain.structure_ss(STRUCTURE)),
    }[name]
    model = getattr(designed(), name)
    _, expected = step(continuous, 0.3, 1e-3)
    x, actual = np.zeros(model.order), []
    for _ in expected:
        actual.append((model.C @ x + model.D[:, 0])[0])
        x = model.A @ x + model.B[:, 0]
    assert np.array(actual) == pytest.approx(expected, rel=1e-6, abs=1e-9 * float(np.max(np.abs(expected))))
    assert all(m.flags.c_contiguous and m.dtype == np.float64 for m in (model.A, model.B, model.C, model.D))


def test_no_prefilter_is_a_static_gain() -> None:
    model = designed("none").prefilter
    assert (model.A.shape, model.B.shape, model.C.shape) == ((0, 0), (0, 1), (1, 0))
    assert model.D[0, 0] == pytest.approx(np.pi * 1e3)


@pytest.mark.parametrize(("call", "said"), [
    (lambda: design.prefilter(STRUCTURE, "magic", TAU_R), "prefilter=magic"),
    (lambda: design.prefilter(STRUCTURE, "reduced", 0.0), "tau_r_s=0"),
    (lambda: design.prefilter(StructureParameters((M,), (K,), (0.0,), PITCH), "reduced", TAU_R), "damping"),
    (lambda: StructureParameters((M, M), (K,), (C,), PITCH), "rig.structure"),
    (lambda: StructureParameters((M,), (-K,), (C,), PITCH), "above 0"),
])  # fmt: skip
def test_wrong_choices_are_named(call, said) -> None:
    with refused(said):
        call()
