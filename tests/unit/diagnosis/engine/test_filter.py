"""The compiled loops and the linear model, against scipy, python-control and recursions written out in numpy."""

import control
import numpy as np
import pytest
from nominal import nominal_rig
from scipy.linalg import expm, solve_discrete_are

from dtbacklash.diagnosis.engine.filter import answers, frozen, opening, riccati
from dtbacklash.diagnosis.engine.rig_simulator import linear_of
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.kernel.simulation import amplify
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

from .conftest import STEP_S, with_sensors

#: rig -> sensors beside its own
MORE = {
    "rotary_drive": {
        "a": {"of": "load", "quantity": "acceleration"}, "w": {"of": "load", "quantity": "velocity"},
        "effort": {"of": "shaft", "quantity": "torque"},
    },
    "two_mass_stage": {
        "a": {"of": "carriage", "quantity": "acceleration"}, "effort": {"of": "support", "quantity": "force"},
    },
    "oscillator": {"a": {"of": "mass", "quantity": "acceleration"}, "effort": {"of": "spring", "quantity": "force"}},
    "lead_screw": {
        "a": {"of": "mass_3", "quantity": "acceleration"}, "q1": {"of": "mass_1", "quantity": "position"},
        "v2": {"of": "mass_2", "quantity": "velocity"},
    },
}  # fmt: skip
each = pytest.mark.parametrize("name", list(MORE))
#: body that the drive moves, and its effort per volt held over a sample, where that is a constant
DRIVEN = {"two_mass_stage": ("carriage", 12.0), "oscillator": ("mass", 5.0)}


def seeing_more(name: str) -> Rig:
    return with_sensors(nominal_rig(name), **MORE[name])


@each
def test_the_linear_model_is_what_one_sample_of_the_simulation_does(name):
    rig = seeing_more(name)
    linear = linear_of(rig, STEP_S, tuple(rig.sensors))
    u = np.random.default_rng(0).normal(size=60)
    response = simulate(rig, u, STEP_S, substeps=1)
    A, X, Y = linear.A[1], response.states, np.column_stack([response.sensors[c] for c in rig.sensors])
    # all that is left is the command, which acts in the same way in each sample
    left = X[1:] - X[:-1] @ A.T
    by = left.T @ u / (u @ u)
    assert np.abs(left - np.outer(u, by)).max() < 1e-10 * np.abs(left).max()
    shown = Y[1:] - X[1:] @ linear.C[1].T
    at_once = shown.T @ u / (u @ u)
    assert np.all(np.abs(shown - np.outer(u, at_once)).max(axis=0) < 1e-10 * np.abs(Y).max(axis=0))
    if name in DRIVEN:
        body, gain = DRIVEN[name]
        forced = linear.force(linear.bodies.index(body))
        assert np.allclose(by, gain * forced[0], rtol=1e-9, atol=1e-9 * np.abs(by).max())
        assert np.allclose(at_once, gain * forced[1], rtol=1e-9, atol=1e-12)


@each
def test_forces_move_and_show_as_a_constant_force_does(name):
    """A constant effort at each body, by an effect of the catalogue, against B and D."""
    rig = seeing_more(name)
    linear = linear_of(rig, STEP_S, tuple(rig.sensors))
    for j, body in enumerate(linear.bodies):
        values, size = rig.elements[body].values, 1e-4
        turns = rig.elements[body].kind == "rotor"
        effect = ("gravity", {"torque": size, "phase": 0.5 * np.pi}) if turns else ("constant_force", {"force": size})
        response = simulate(rig.with_effect(body, *effect), np.zeros(1), STEP_S, substeps=1)
        B, sign = size * linear.B[1][:, j], np.sign(response.states[1, linear.index(body)])
        assert np.allclose(sign * response.states[1], B, rtol=1e-6, atol=1e-6 * np.abs(B).max())
        seen = sign * np.array([response.sensors[c][1] for c in rig.sensors])
        assert np.allclose(seen, linear.C[1] @ B + size * linear.D[:, j], rtol=1e-5, atol=1e-12)
        assert linear.inertia[j] == pytest.approx(values["inertia" if turns else "mass"])
        assert linear.states[linear.index(body)] == f"{body} v"


def test_a_linear_model_is_that_of_the_matrix_exponential():
    """The two masses of the stage, from their equations of motion."""
    m1, m2, k, c = 4.0, 2.5, 2.5e4, 15.0
    K, C = np.array([[-k / m1, k / m1], [k / m2, -k / m2]]), np.array([[-c / m1, c / m1], [c / m2, -c / m2]])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [K, C]])
    B = np.vstack([np.zeros((2, 2)), np.diag([1 / m1, 1 / m2])])
    both = expm(np.block([[A, B], [np.zeros((2, 6))]]) * STEP_S)
    linear = linear_of(nominal_rig("two_mass_stage"), STEP_S, ("x_t", "x_c"))
    assert np.allclose(linear.A[1], both[:4, :4], rtol=1e-10, atol=1e-12)
    assert np.allclose(linear.B[1], both[:4, 4:], rtol=1e-10, atol=1e-15)
    assert np.allclose(linear.C[1], [[0, 1, 0, 0], [1, 0, 0, 0]], atol=1e-12)


@pytest.mark.parametrize(
    ("place", "effect", "values"),
    [("mass", "ground_friction", {"force": 1.0}), ("sensor_x", "delay", {"time": 3.0 * STEP_S}),
     ("spring", "backlash", {"half_gap": 1e-4}),
     ("spring", "cubic_stiffness", {"k3": 1e9}), ("sensor_x", "offset", {"offset": 0.1})],
)  # fmt: skip
def test_the_linear_model_is_as_if_laws_did_nothing(place, effect, values):
    """Once a body at rest held by friction had no acceleration, and a late sensor showed nothing."""
    rig = seeing_more("oscillator")
    names = [p.name for p in rig.takes(place)[effect].parameters]
    other = rig.with_effect(place, effect, dict(zip(names, values.values(), strict=False)))
    plain, there = (linear_of(r, STEP_S, tuple(rig.sensors)) for r in (rig, other))
    for one in ("A", "B", "C", "D"):
        assert np.allclose(getattr(there, one), getattr(plain, one), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("whole", "rest"), [(0.0, 0.4), (3.0, 0.4), (2.0, 0.0)])
def test_a_late_sensor_shows_what_was_a_part_of_a_sample_ago(whole, rest):
    """Whole samples are taken off its readings; of the rest, by the matrix exponential of the oscillator."""
    rig, channels = seeing_more("oscillator"), ("x", "v", "a")
    plain = linear_of(rig, STEP_S, channels)
    back = expm(-rest * STEP_S * np.array([[0.0, 1.0], [-1900.0 / 1.2, -2.0 / 1.2]]))
    for j, c in enumerate(channels):
        late = linear_of(rig.with_effect(f"sensor_{c}", "delay", {"time": (whole + rest) * STEP_S}), STEP_S, channels)
        expected = plain.C[1].copy()
        expected[j] = expected[j] @ back
        assert np.allclose(late.C[1], expected, rtol=1e-6, atol=1e-6)
        assert np.allclose(late.A, plain.A, rtol=1e-12, atol=0.0)


def test_a_linear_model_has_what_is_linear():
    rig = seeing_more("oscillator")
    damped = rig.with_effect("mass", "viscous_friction", {"coefficient": 3.0})
    scaled = rig.with_effect("sensor_x", "gain_error", {"relative": 0.1})
    channels = tuple(rig.sensors)
    a, d, s = (linear_of(r, STEP_S, channels) for r in (rig, damped, scaled))
    assert d.A[1][1, 1] - a.A[1][1, 1] == pytest.approx(-3.0 / 1.2 * STEP_S, rel=0.1)
    assert s.C[1][0, 0] == pytest.approx(1.1)
    assert d.C[1][channels.index("a"), 1] == pytest.approx(-(2.0 + 3.0) / 1.2)


def plants(name: str) -> tuple:
    """A rig's linear part with unknown forces and noises of a plain size."""
    rig = nominal_rig(name)
    linear = linear_of(rig, STEP_S, tuple(rig.sensors))
    B = linear.B[1]
    size = 1.0 / np.abs(B).max(axis=0)
    q = (1e-2 * size * np.arange(1, len(linear.bodies) + 1)) ** 2
    R = np.diag(1e-3 * np.arange(1, len(rig.sensors) + 1)) ** 2
    return linear.A[1], linear.C[1], (B * q) @ B.T, R, B, np.diag(q)


@each
def test_doubling_finds_what_scipy_and_control_find(name):
    A, C, Q, R, B, q = plants(name)
    P = riccati(A, C, Q, R)
    expected = solve_discrete_are(A.T, C.T, Q, R)
    assert np.abs(P - expected).max() < 1e-6 * np.abs(expected).max()
    gain = np.linalg.solve(C @ P @ C.T + R, C @ P).T
    # control's gain leads to the next sample
    to_next = control.dlqe(A, B, C, q, R)[0]
    assert np.allclose(A @ gain, to_next, rtol=1e-5, atol=1e-5 * np.abs(to_next).max())
    again = A @ (P - gain @ C @ P) @ A.T + Q
    assert np.abs(again - P).max() < 1e-8 * np.abs(P).max()
    start = 1e-2 * np.eye(len(A))
    opened, _, _ = opening(*map(np.ascontiguousarray, (A, C, Q, R, start)), np.ones((3000, len(C)), dtype=bool))
    if name == "oscillator":  # which forgets where it began within that time
        assert np.allclose(opened[2999], gain, rtol=1e-6)


@each
@pytest.mark.parametrize("settles", [False, True])
def test_opening_gains_are_those_of_the_plain_recursion(name, settles):
    """Readings that are missing at random, or a channel that begins after the gains of the others have settled."""
    A, C, Q, R, _, _ = plants(name)
    n0, P = 3000 if settles else 40, np.eye(len(A)) * 1e-2
    there = np.random.default_rng(2).uniform(size=(n0, len(C))) < 0.8
    there[0] = True
    if settles:
        there[:], there[: n0 // 2, -1] = True, False
    K, W, logs = opening(*map(np.ascontiguousarray, (A, C, Q, R, P)), there)
    total = 0.0
    for k in range(n0):
        seen = C[there[k]]
        S = seen @ P @ seen.T + R[np.ix_(there[k], there[k])]
        gain, inverse = np.zeros(C.T.shape), np.zeros(R.shape)
        gain[:, there[k]] = P @ seen.T @ np.linalg.inv(S)
        inverse[np.ix_(there[k], there[k])] = np.linalg.inv(S)
        assert np.allclose(K[k], gain, rtol=1e-5, atol=1e-7 * np.abs(gain).max())
        assert np.allclose(W[k].T @ W[k], inverse, rtol=1e-6, atol=1e-6 * np.abs(inverse).max())
        total += np.linalg.slogdet(S)[1]
        P = A @ (np.eye(len(A)) - gain @ C) @ P @ A.T + Q
    assert logs == pytest.approx(total, rel=1e-9)
    assert np.triu(W[0], 1).max() == 0.0


def recursion(missing: np.ndarray) -> tuple:
    """A small plant under random drives, with some readings missing; its innovations in plain numpy.

    One of six gains each sample: the opening ones in turn, then any of them.
    """
    rng = np.random.default_rng(4)
    A, C = np.array([[0.9, 0.2], [-0.1, 0.8]]), np.array([[1.0, 0.0], [0.3, 1.0]])
    K, W = rng.normal(size=(6, 2, 2)) * 0.3, np.tril(rng.normal(size=(6, 2, 2)))
    N = len(missing)
    which = np.concatenate([np.arange(6), rng.integers(0, 6, N - 6)])
    drive, Y, x0 = rng.normal(size=(N, 2)), rng.normal(size=(N, 2)), np.array([0.3, -0.2])
    Y[missing] = np.nan
    x, rows = x0, np.zeros((N, 2))
    for k in range(N):
        d = np.where(missing[k], 0.0, Y[k] - C @ x)
        rows[k] = np.where(missing[k], 0.0, W[which[k]] @ d)
        x = A @ (x + K[which[k]] @ d) + drive[k]
    return A, C, K, W, which, drive, Y, x0, rows


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_a_frozen_recursion_is_the_plain_one(share):
    missing = np.random.default_rng(1).uniform(size=(80, 2)) < share
    A, C, K, W, which, drive, Y, x0, rows = recursion(missing)
    assert frozen(A, C, K, W, which, drive, Y, x0) == pytest.approx(np.sum(rows**2), rel=1e-12)


@pytest.mark.parametrize("at_once", [False, True])
def test_answers_are_how_innovations_change_with_an_effort(at_once):
    """By the difference of two recursions; the effort acts on the state, and in what is read, then or later."""
    rng = np.random.default_rng(5)
    missing = rng.uniform(size=(80, 2)) < 0.2
    A, C, K, W, which, *_ = recursion(missing)
    b, c, F = np.array([0.4, -0.3]), np.array([0.0, 0.7]), rng.normal(size=(3, 80))
    E = answers(A, C, K, W, which, F, b, c, missing, at_once)
    for j in range(3):
        x, before = np.zeros(2), 0.0
        for k in range(80):
            d = np.where(missing[k], 0.0, -(C @ x + c * (F[j, k] if at_once else before)))
            assert np.allclose(E[j, 2 * k : 2 * k + 2], np.where(missing[k], 0.0, W[which[k]] @ d), atol=1e-12)
            x, before = A @ (x + K[which[k]] @ d) + b * F[j, k], F[j, k]


def test_an_amplifier_gives_what_its_laws_make_of_each_command():
    rig = nominal_rig("oscillator")
    rig = rig.with_effect("amplifier", "saturation", {rig.takes("amplifier")["saturation"].size.name: 1.5})
    u, out = np.linspace(-3.0, 3.0, 13), np.zeros(13)
    amplify(compile_plant(rig, STEP_S, 1, 1), u, out)
    assert np.allclose(out, np.clip(u, -1.5, 1.5))
