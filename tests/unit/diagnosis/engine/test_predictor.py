"""The predictor of a linear rig against a Kalman filter in numpy; sizes of unknown forces; missing readings."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig
from scipy.linalg import expm, solve_discrete_are

from dtbacklash.diagnosis.engine.predictor import Predictor
from dtbacklash.diagnosis.engine.resampling import OPENING
from dtbacklash.diagnosis.engine.rig_simulator import linear_of
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

from .conftest import STEP_S, command, predictor_of, recorded, segments_of, with_sensors

LINEAR = ("rotary_drive", "two_mass_stage", "oscillator", "lead_screw")
each = pytest.mark.parametrize("name", LINEAR)


def predictor(name: str, seconds: float = 4.0, noise: float = 1e-3) -> tuple[Rig, np.ndarray, Predictor]:
    rig, u = nominal_rig(name), command(seconds, 1.0)
    return rig, u, predictor_of(rig, u, recorded(rig, u, noise))


def unknown(p: Predictor, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Q and R of sizes."""
    B, n = p.linear.B[1], len(p.bodies)
    return (B * (np.exp(sizes[:n]) * p.force) ** 2) @ B.T, np.diag(np.exp(2.0 * sizes[n:]))


def steady(A: np.ndarray, C: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """scipy's solution, in units in which its numbers are alike: in SI it errs in some gains by a percent."""
    noise = np.sqrt(np.diag(R))
    unit = np.sqrt(np.diag(solve_discrete_are(A.T, C.T, Q, R)))
    scaled = A / unit[:, None] * unit, C * unit / noise[:, None], Q / np.outer(unit, unit)
    return solve_discrete_are(scaled[0].T, scaled[1].T, scaled[2], np.eye(len(R))) * np.outer(unit, unit)


@each
def test_steady_gains_are_those_of_scipys_riccati_equation(name):
    rig, _, p = predictor(name)
    for shift in (0.0, -3.0):
        sizes = p.first_noise_levels() + shift
        gains, (Q, R) = p.gains(rig, sizes), unknown(p, sizes)
        C = p.linear.C[1]
        P = steady(p.linear.A[1], C, Q, R)
        S = C @ P @ C.T + R
        K = P @ C.T @ np.linalg.inv(S)
        largest = np.abs(K).max(axis=1, keepdims=True)
        assert np.all(np.abs(gains.K[1, -1] - K) < 1e-6 * largest)
        W = gains.W[1, -1]
        assert np.allclose(W @ S @ W.T, np.eye(len(S)), atol=1e-6)
        assert gains.states == p.linear.states
        assert gains.opening >= OPENING
        assert gains.K.shape == (2, gains.opening + 1, *K.shape)


def test_a_sensor_of_acceleration_takes_the_unknown_force_into_account():
    """It shows the force of the sample before at once: by Riccati's equation with noise that is correlated."""
    rig = with_sensors(nominal_rig("oscillator"), a={"of": "mass", "quantity": "acceleration"})
    u = command(4.0, 1.0)
    p = predictor_of(rig, u, recorded(rig, u))
    sizes = p.first_noise_levels()
    A, B, C, D = p.linear.A[1], p.linear.B[1], p.linear.C[1], p.linear.D
    q, R = np.diag((np.exp(sizes[:1]) * p.force) ** 2), np.diag(np.exp(2.0 * sizes[1:]))
    P = np.eye(2)
    for _ in range(20000):  # x = A z + B w is read as C x + D w
        Px, Pxy = A @ P @ A.T + B @ q @ B.T, (A @ P @ A.T + B @ q @ B.T) @ C.T + B @ q @ D.T
        S = C @ Px @ C.T + C @ B @ q @ D.T + D @ q @ B.T @ C.T + D @ q @ D.T + R
        K = Pxy @ np.linalg.inv(S)
        P = Px - K @ Pxy.T
        P = 0.5 * (P + P.T)
    gains = p.gains(rig, sizes)
    assert np.all(np.abs(gains.K[1, -1] - K) < 1e-4 * np.abs(K).max(axis=1, keepdims=True))
    W = gains.W[1, -1]
    assert np.allclose(W @ S @ W.T, np.eye(3), atol=2e-4)


def textbook(rig: Rig, u: np.ndarray, p: Predictor, sizes: np.ndarray) -> tuple[float, np.ndarray]:
    """-2 log likelihood by a Kalman filter that varies in time, and (N,) what each sample's innovations add to it."""
    (Q, R), A, C, Y = unknown(p, sizes), p.linear.A[1], p.linear.C[1], p.readings.y
    # what a held command does: from the simulation
    X = simulate(rig, u[:-1], STEP_S).states
    by = (X[1:] - X[:-1] @ A.T).T @ u[:-1] / (u[:-1] @ u[:-1])
    P = Q + np.diag([p.spread[s] ** 2 for s in p.linear.states])
    x = p.run(rig, p.gains(rig, sizes)).first
    logs, squares = 0.0, np.zeros(len(u))
    for k in range(len(u)):
        there = np.isfinite(Y[k])
        seen, noise = C[there], R[np.ix_(there, there)]
        S, e = seen @ P @ seen.T + noise, Y[k][there] - seen @ x
        logs, squares[k] = logs + np.linalg.slogdet(S)[1], e @ np.linalg.solve(S, e)
        K = np.linalg.solve(S, seen @ P).T
        x = A @ (x + K @ e) + by * u[k]
        keep = np.eye(len(A)) - K @ seen
        P = A @ (keep @ P @ keep.T + K @ noise @ K.T) @ A.T + Q
        P = 0.5 * (P + P.T)
    return logs + float(squares.sum()), squares


@each
@pytest.mark.parametrize("share", [1.0, 1e-4])
def test_the_likelihood_is_that_of_a_plain_kalman_filter(name, share):
    """At first sample by sample; then gains settle in steps, and are steady."""
    rig, u, p = predictor(name)
    sizes = p.scaled(p.first_noise_levels() + np.linspace(-1.0, 0.3, len(p.first_noise_levels())), share)
    total, squares = textbook(rig, u, p, sizes)
    gains = p.gains(rig, sizes)
    E = p.run(rig, gains).E
    assert np.allclose(np.sum(E[:OPENING] ** 2, axis=1), squares[:OPENING], rtol=1e-4, atol=1e-6)
    # a wrong first state, gain or whitening costs more
    assert abs(p.likelihood(rig, gains) - total) < 0.05 * p.count


@each
def test_what_is_frozen_is_a_full_pass_where_it_was_recorded(name):
    rig, _, p = predictor(name)
    sizes = p.first_noise_levels()
    cost = p._cost(rig, p._recorded(rig, sizes))
    full = p.likelihood(rig, p.gains(rig, sizes))
    assert cost(sizes) == pytest.approx(full, abs=1e-6)
    # a linear rig's recursion holds at all sizes
    other = sizes - 1.0
    assert cost(other) == pytest.approx(p.likelihood(rig, p.gains(rig, other)), abs=1e-5)
    assert abs(cost(other) - full) > 10.0


def test_what_is_frozen_is_a_full_pass_of_a_rig_with_laws():
    rig, u = nominal_rig("pendulum"), command(6.0, 0.4)
    true = rig.with_effect("disk", "gravity", {"torque": 0.05}).with_effect(
        "disk", "coulomb_friction", {"torque": 0.01}
    )
    y = recorded(true, u)
    y["theta"][100:200] = np.nan
    p = predictor_of(rig, u, y)
    for seen in (rig, true):
        sizes = p.first_noise_levels()
        cost = p._cost(seen, p._recorded(seen, sizes))
        assert cost(sizes) == pytest.approx(p.likelihood(seen, p.gains(seen, sizes)), abs=1e-6)
        # and near it elsewhere
        other = sizes + np.log(0.8)
        assert cost(other) == pytest.approx(p.likelihood(seen, p.gains(seen, other)), rel=2e-3)


def test_what_is_frozen_leaves_out_what_is_missing():
    rig, u = nominal_rig("two_mass_stage"), command(4.0, 1.0)
    y = recorded(rig, u)
    y["x_c"][300:900] = np.nan
    y["x_t"][::3] = np.nan
    p = predictor_of(rig, u, y)
    sizes = p.first_noise_levels()
    cost = p._cost(rig, p._recorded(rig, sizes))
    for other in (sizes, sizes - 1.0, sizes + np.array([1.0, -2.0, 0.2, -0.3])):
        assert cost(other) == pytest.approx(p.likelihood(rig, p.gains(rig, other)), abs=1e-5)


def test_missing_readings_correct_nothing():
    """Where nothing is read, the rig goes on as it would by itself."""
    rig, u = nominal_rig("oscillator"), command(4.0, 1.0)
    y = recorded(rig, u)
    for channel in y.values():
        channel[1000:1100] = np.nan
    p = predictor_of(rig, u, y)
    gains = p.gains(rig, p.first_noise_levels())
    found = p.run(rig, gains)
    assert not found.E[1000:1100].any()
    assert not found.D[1000:1100].any()
    assert np.abs(found.E[1100:]).max() < 100.0
    alone = p.simulated.onwards(rig, found.X)
    assert np.allclose(found.X[1001:1101], alone[1000:1100], rtol=1e-12, atol=1e-15)
    assert not np.allclose(found.X[901:1000], alone[900:999], rtol=1e-6, atol=1e-12)
    # one channel of two: the other still corrects
    y = recorded(rig, u)
    y["v"][500:] = np.nan
    p = predictor_of(rig, u, y)
    found = p.run(rig, p.gains(rig, p.first_noise_levels()))
    assert not found.E[500:, 1].any()
    assert found.E[500:, 0].std() > 0.1
    assert p.count == len(u) + 500


#: sensors of the lead screw that are always read, beside the carriage's that seldom is
ALWAYS = pytest.mark.parametrize("always", [("theta_m",), ("theta_m", "i_m", "q2")])


def seldom(always: tuple[str, ...]) -> tuple[Rig, np.ndarray, Predictor]:
    """A lead screw whose carriage is read at one of ten samples."""
    rig, u = nominal_rig("lead_screw"), command(6.0, 3.0)
    y = recorded(rig, u, 1e-4)
    y["q3"][np.arange(len(u)) % 10 != 0] = np.nan
    with np.errstate(all="ignore"):
        return rig, u, predictor_of(rig, u, {c: y[c] for c in ("q3", *always)})


@ALWAYS
@pytest.mark.parametrize("share", [1.0, 2e-3])
def test_a_channel_that_is_seldom_read_has_gains_that_hold(always, share):
    rig, u, p = seldom(always)
    r, m = p.readings, 1 + len(always)
    assert r.sets.tolist() == [[True] * m, [False] + [True] * len(always)]
    assert p.count == len(u) * len(always) + np.isfinite(r.y[:, 0]).sum()
    gains, A, C = p.gains(rig, p.scaled(p.first_noise_levels(), share)), p.linear.A[1], p.linear.C[1]
    which = r.which(gains.opening, r.y)
    # what is not read corrects nothing, and whitens nothing
    for k in (1001, 1005, 1009):
        assert not gains.K[1, which[k], :, 0].any()
        assert not gains.W[1, which[k], :, 0].any()
    assert gains.K[1, which[1000], :, 0].any()
    # an error fades over any ten samples
    around = np.eye(len(A))
    for k in range(1000, 1010):
        around = A @ (np.eye(len(A)) - gains.K[1, which[k]] @ C) @ around
    assert np.abs(np.linalg.eigvals(around)).max() < 1.0
    found = p.run(rig, gains)
    assert np.isfinite(found.X).all()
    assert not found.E[~r.there].any()
    assert np.abs(found.E).max() < 10.0


@ALWAYS
@pytest.mark.parametrize("share", [1.0, 2e-3])
def test_the_likelihood_of_seldom_readings_is_near_that_of_a_filter_that_varies_in_time(always, share):
    rig, u, p = seldom(always)
    sizes = p.scaled(p.first_noise_levels(), share)
    assert abs(p.likelihood(rig, p.gains(rig, sizes)) - textbook(rig, u, p, sizes)[0]) < 0.03 * len(u)


#: rig -> its matrices: forces at each body
PLANTS = {
    "oscillator": (np.array([[0.0, 1.0], [-1900.0 / 1.2, -2.0 / 1.2]]), np.array([[0.0], [1.0 / 1.2]]), 5.0),
    "two_mass_stage": (
        np.array([[0.0, 0, 1, 0], [0, 0, 0, 1], [-25e3 / 4, 25e3 / 4, -15 / 4, 15 / 4], [1e4, -1e4, 6, -6]]),
        np.array([[0, 0], [0, 0], [0.25, 0], [0, 0.4]]), 12.0,
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "forces"),
    [("oscillator", (0.5,)), ("oscillator", (0.1,)), ("two_mass_stage", (0.5, 0.5)), ("two_mass_stage", (2.0, 1.0))],
)
def test_sizes_of_unknown_forces_are_found(name, forces):
    """Random forces beside the command, integrated here by the matrix exponential; speeds are read as well."""
    A, B, gain = PLANTS[name]
    n, m = B.shape
    both = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * STEP_S)[:n]
    rng, u = np.random.default_rng(5), command(12.0, 1.0)
    effort = rng.normal(size=(len(u), m)) * forces
    effort[:, 0] += gain * u
    X = np.zeros((len(u), n))
    for k in range(len(u) - 1):
        X[k + 1] = both @ np.concatenate([X[k], effort[k]])
    rig = nominal_rig(name)
    if m > 1:
        rig = with_sensors(rig, **{f"v_{b}": {"of": b, "quantity": "velocity"} for b in ("carriage", "table")})
    shown = X + 1e-4 * X.std(axis=0) * rng.normal(size=X.shape)
    y = dict(zip(rig.sensors, shown.T, strict=True))
    p = predictor_of(rig, u, y)
    sizes, value = p.tuned(rig)
    assert value == pytest.approx(p.likelihood(rig, p.gains(rig, sizes)), abs=1e-3)
    assert np.exp(sizes[:m]) * p.force == pytest.approx(np.array(forces), rel=0.2)
    share = p.unknown(sizes)
    assert [share[b] for b in p.bodies] == pytest.approx(np.exp(sizes[:m]).tolist())
    # nothing is unknown where nothing is
    clean = predictor_of(rig, u, recorded(rig, u, 1e-4))
    assert max(clean.unknown(clean.tuned(rig)[0]).values()) < 2e-3 < min(share.values())


def test_sizes_are_scaled_and_bounded():
    rig, _, p = predictor("two_mass_stage")
    low, high = p.ends()
    sizes = p.first_noise_levels()
    assert np.all((low < sizes) & (sizes < high))
    less = p.scaled(sizes, 0.01)
    assert np.allclose(np.exp(less[:2]), 0.01 * np.exp(sizes[:2]))
    assert np.array_equal(less[2:], sizes[2:])
    assert np.allclose(p.scaled(sizes, 1e-30)[:2], low[:2])
    assert p.tuned(rig)[1] <= p.likelihood(rig, p.gains(rig, sizes))


def test_a_late_sensor_is_corrected_by_in_time():
    """What it shows is moved by whole samples; the rest stays with the simulation."""
    rig, u = nominal_rig("oscillator"), command(5.0, 1.0)
    for late in (3.0, 2.4):
        true = rig.with_effect("sensor_x", "delay", {"time": late * STEP_S})
        p = predictor_of(rig, u, recorded(true, u))
        wrong, right = (p.tuned(r)[1] for r in (rig, true))
        assert right < wrong - 1000.0
        sizes = p.tuned(true)[0]
        found = p.run(true, p.gains(true, sizes))
        assert max(p.unknown(sizes).values()) < 2e-3
        assert np.std(found.E[OPENING:-10]) == pytest.approx(1.0, abs=0.1)
        assert not found.E[-2:, 0].any()


def test_a_force_sensor_and_an_acceleration_sensor_join_in():
    sensors = {"a": {"of": "mass", "quantity": "acceleration"}, "f": {"of": "spring", "quantity": "force"}}
    rig, u = with_sensors(nominal_rig("oscillator"), **sensors), command(5.0, 1.0)
    for place, effect, values in (
        ("mass", "ground_friction", {"force": 0.5}),
        ("spring", "backlash", {"half_gap": 2e-4}),
    ):
        names = [q.name for q in rig.takes(place)[effect].parameters]
        true = rig.with_effect(place, effect, dict(zip(names, values.values(), strict=False)))
        p = predictor_of(rig, u, recorded(true, u))
        # gains are of the linear part, which the law does not change
        ours, plain = (p.gains(r, p.first_noise_levels()) for r in (true, rig))
        assert np.allclose(ours.K, plain.K)
        assert p.tuned(true)[1] < p.tuned(rig)[1] - 1000.0


def test_the_beginning_of_a_stretch_sees_what_the_whole_saw_there():
    rig, _, p = predictor("oscillator", 12.0)
    first = p.first(1.0 / 3.0)
    gains = p.gains(rig, p.first_noise_levels())
    whole, beginning = p.run(rig, gains), first.run(rig, gains)
    n = len(first.readings.u)
    assert n == 2000
    assert np.array_equal(beginning.E, whole.E[:n])
    assert first.count == 2 * n


def test_averages_of_a_linear_rig_keep_their_laws_of_the_amplifier():
    """A saturation acts before anything is averaged."""
    rig, u = nominal_rig("oscillator"), command(12.0, 1.0)
    true = rig.with_effect("amplifier", "saturation", {rig.takes("amplifier")["saturation"].size.name: 0.8})
    p = predictor_of(rig, u, recorded(true, u), 3)
    sizes = p.tuned(true)[0]
    assert p.tuned(rig)[1] > p.tuned(true)[1] + 1000.0
    assert max(p.unknown(sizes).values()) < 0.1 * max(p.unknown(p.tuned(rig)[0]).values())
    clipped = predictor_of(rig, np.clip(u, -0.8, 0.8), recorded(true, u), 3)
    there = p.simulated._driven(true)[0]
    assert np.allclose(there, clipped.readings.u)


def test_a_bench_stacks_stretches_and_sums_their_likelihoods():
    rig = nominal_rig("oscillator")
    pair = [command(s, 1.0, seed) for s, seed in ((5.0, 1), (12.0, 2))]
    parts = [segments_of(rig, u, recorded(rig, u)).predictors[0] for u in pair]
    segments = Segments(rig, tuple(parts))
    sizes, value = segments.tuned(rig)
    assert value == pytest.approx(sum(p.tuned(rig)[1] for p in parts))
    rows = segments.residuals(rig, segments.gains(rig, sizes))
    assert len(rows) == segments.count == sum(p.count for p in parts)
    assert np.array_equal(rows[: parts[0].count], parts[0].run(rig, parts[0].gains(rig, sizes[0])).E.ravel())
    # the stretch with most that is unknown stands for all in quick fits
    assert segments.most_telling(sizes) == 1
    assert segments.most_telling((parts[0].scaled(sizes[0], 1e3), sizes[1])) == 0
    segments = replace(segments, telling=1)
    quick = segments.first(1.0 / 3.0)
    assert quick.count == 2 * 2000
    assert np.array_equal(segments.of_first(sizes)[0], sizes[1])
    back = segments.back(quick.scaled(segments.of_first(sizes), 0.1), sizes)
    for before, after in zip(sizes, back, strict=True):
        assert after[0] - before[0] == pytest.approx(np.log(0.1))
        assert np.array_equal(after[1:], before[1:])


def test_a_pass_that_goes_astray_is_none():
    rig, _u, p = predictor("oscillator")
    gains = p.gains(rig, p.first_noise_levels())
    wild = replace(gains, K=gains.K * -1e3)
    segments = Segments(rig, (p,))
    with np.errstate(all="ignore"):
        assert segments.residuals(rig, [wild]) is None
        assert p.likelihood(rig, wild) >= 1e14
    assert segments.residuals(rig, [gains]) is not None


def test_a_first_state_is_where_it_was_read():
    """Of what is not read, springs are at rest."""

    def first(rig: Rig, at: dict[str, float]) -> dict[str, float]:
        u = command(4.0, 1.0)
        shown = recorded(rig, u, 0.0)
        p = predictor_of(rig, u, {c: shown[c] + y for c, y in at.items()})
        found = p.run(rig, p.gains(rig, p.first_noise_levels())).first
        return dict(zip(linear_of(rig, STEP_S, tuple(at)).states, found, strict=True))

    stage = first(nominal_rig("two_mass_stage"), {"x_t": 1e-3})
    assert stage["table q"] == stage["carriage q"] == pytest.approx(1e-3)
    assert stage["table v"] == stage["carriage v"] == 0.0
    screw = nominal_rig("lead_screw")
    lead = screw.config.parameters["p"].value
    driven = first(screw, {"theta_m": 2.0, "q3": 2.0 * lead})
    assert driven["motor_bearing q"] == pytest.approx(2.0)
    assert driven["mass_2 q"] == pytest.approx(2.0 * lead)
    drive = first(nominal_rig("rotary_drive"), {"theta_l": 0.5, "i_m": 0.2})
    assert drive["motor_rotor q"] == pytest.approx(0.5)
    assert drive["current"] == pytest.approx(0.2)
