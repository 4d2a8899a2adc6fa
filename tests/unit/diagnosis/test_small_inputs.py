"""Small recordings of known origin, made in closed form, that tell little or were read in another way."""

from pathlib import Path
from textwrap import dedent

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

import dtbacklash as dtb
from dtbacklash.diagnosis import diagnose
from dtbacklash.diagnosis.records import AFTER, SMOOTH
from dtbacklash.diagnosis.result import Diagnosis
from dtbacklash.physics.rig_file import rig_yaml
from dtbacklash.recording import read_recording

pytestmark = pytest.mark.check

STEP_S = 1e-3
ACCELEROMETER = """
    name: shaken
    parameters: {k_f: {value: 2 N/V, tolerance: 0.02}}
    elements:
      amplifier: {kind: amplifier, drives: shaker}
      shaker: {kind: actuator, gain: k_f, drives: body}
      body: {kind: mass, mass: 0.8 kg}
      spring: {kind: link, between: [ground, body], stiffness: 45.6 N/mm, damping: 19.1 N s/m}
    effects: {}
    sensors: {a: {of: body, quantity: acceleration}}
    """
SHAFT = """
    name: shaft
    parameters:
      gain: {value: 1.0, unit: N m/V, tolerance: 0.0}
      J: {value: 1.2e-4, unit: kg m^2, tolerance: 0.3}
    elements:
      amplifier: {kind: amplifier, drives: drive}
      drive: {kind: actuator, gain: gain, drives: shaft}
      shaft: {kind: rotor, inertia: J}
    effects: {}
    sensors: {v: {of: shaft, quantity: velocity}}
    """
WHEEL = """
    name: wheel
    parameters:
      k: {value: 80 N m/V, tolerance: 0.2}
      J: {value: 1 kg m^2, tolerance: 0}
    elements:
      amplifier: {kind: amplifier, drives: motor}
      motor: {kind: actuator, gain: k, drives: wheel}
      wheel: {kind: rotor, inertia: J}
    effects: {wheel: {viscous_friction: {coefficient: {value: 80, tolerance: 0.2}}}}
    sensors: {omega: {of: wheel, quantity: velocity}}
    """


def diagnosed(folder: Path, rig: str, command: str | None = None, **columns: np.ndarray) -> Diagnosis:
    (folder / "rig.yaml").write_text(dedent(rig))
    pd.DataFrame(columns).to_csv(folder / "log.csv", index=False)
    nominal = dtb.load_rig(str(folder / "rig.yaml"))
    return diagnose(read_recording(str(folder / "log.csv"), rig=nominal, command=command), nominal)


PENDULUM = """
    name: let_go
    parameters: {J: {value: 0.01 kg m^2, tolerance: 0.05}}
    elements: {arm: {kind: rotor, inertia: J}}
    effects:
      arm:
        gravity: {torque: {value: 0.6, tolerance: 0.02}, phase: {value: 3.14159, tolerance: 0.02}}
        viscous_friction: {coefficient: {value: 0.0025, tolerance: 0.3}}
    sensors: {theta: {of: arm, quantity: position, absolute: true}}
    """


def sines(t: np.ndarray, seed: int = 1) -> np.ndarray:
    """A smooth signal up to 60 Hz."""
    rng = np.random.default_rng(seed)
    f = rng.uniform(2.0, 60.0, 30)
    return 0.3 * np.sin(2.0 * np.pi * f[:, None] * t + rng.uniform(0.0, 6.0, (30, 1))).sum(axis=0)


@pytest.mark.parametrize(("course", "fine"), [(AFTER, 1), (SMOOTH, 50), ("", 1)], ids=["after", "smooth", "before"])
def test_the_data_tell_which_command_an_accelerometer_shows(tmp_path, course, fine):
    """Read after the command has stepped, or a smooth command; the usual reading, before it steps, needs no word."""
    h = STEP_S / fine
    t = h * np.arange(6000 * fine)
    u, held = sines(t), sines(t + 0.5 * h if fine > 1 else t)
    A, b = np.array([[0.0, 1.0], [-57000.0, -23.875]]), np.array([0.0, 2.5])
    E = expm(h * A)
    gain = np.linalg.solve(A, (E - np.eye(2)) @ b)
    x, a = np.zeros(2), np.zeros(len(t))
    for k in range(len(t)):
        a[k] = A[1] @ x + 2.5 * (u[k - 1] if course == "" and k else u[k])
        x = E @ x + gain * held[k]
    noise = 0.02 * np.random.default_rng(2).standard_normal(6000)
    found = diagnosed(tmp_path, ACCELEROMETER, t=t[::fine], u=u[::fine], a=a[::fine] + noise)
    assert found.verdict == "consistent"
    assert [note for note in found.notes if note in (AFTER, SMOOTH)] == ([course] if course else [])


def test_one_way_tells_no_friction_from_a_load(tmp_path):
    """J 1.4e-4, viscous 1.35e-4, Coulomb 0.0312: the torque is 0.04 or 0.06, and the shaft turns one way only."""
    t = STEP_S * np.arange(20_000)
    u, v = np.where(t % 4.0 < 2.0, 0.06, 0.04), np.zeros(len(t))
    v[0] = 65.0
    decay = np.exp(-1.35 / 1.4 * STEP_S)
    for k in range(len(t) - 1):
        ends = (u[k] - 0.0312) / 1.35e-4
        v[k + 1] = ends + (v[k] - ends) * decay
    found = diagnosed(tmp_path, SHAFT, t=t, u=u, v=v + 0.3 * np.random.default_rng(1).standard_normal(len(t)))
    named = {f.effect: f for f in found.findings}
    assert named.pop("viscous_friction").confidence == "sure"
    (other,) = named.values()
    assert other.confidence == "one_of"
    assert {"coulomb_friction", "constant_load"} <= {other.effect, *(a.effect for a in other.also_fits)}
    assert abs(next(iter(other.parameters.values())).value) == pytest.approx(0.0312, rel=0.01)


def test_what_a_sensor_cannot_resolve_is_not_missing_and_rest_is_left_out(tmp_path):
    """A wheel that is told a speed, read in counts of 0.05 rad/s; its last third rests and reads 0."""
    step_s = 5e-3
    t = step_s * np.arange(3000)
    u = np.where(t < 10.0, np.random.default_rng(4).uniform(-5.0, 5.0, 51)[np.minimum((t / 0.2).astype(int), 50)], 0.0)
    omega = np.zeros(len(t))
    for k in range(len(t) - 1):
        omega[k + 1] = u[k] + (omega[k] - u[k]) * np.exp(-80.0 * step_s)
    found = diagnosed(tmp_path, WHEEL, t=t, u=u, omega=0.05 * np.round(omega / 0.05))
    assert found.verdict == "consistent"
    assert found.work is not None
    assert found.work.judged > 0
    assert all(channel.of_motion > 1e-6 for channel in found.explained.left.values())


SPRUNG = """
    name: sprung
    parameters: {k_f: {value: 1 N/V, tolerance: 0.05}}
    elements:
      amplifier: {kind: amplifier, drives: coil}
      coil: {kind: actuator, gain: k_f, drives: body}
      body: {kind: mass, mass: 0.5 kg}
      spring: {kind: link, between: [ground, body], stiffness: 200 N/m, damping: 1 N s/m}
    effects: {}
    sensors: {x: {of: body, quantity: position}}
    """
SERVO = """
    name: arm
    parameters: {}
    elements:
      servo: {kind: servo, position_gain: 8 N m/rad, speed_gain: 0.4 N m s/rad, drives: arm}
      arm: {kind: rotor, inertia: 0.01 kg m^2}
    effects: {}
    sensors: {phi: {of: arm, quantity: position, recorded_in: rad}}
    """


def driven(u: np.ndarray, A: np.ndarray, b: np.ndarray, step_s: float = STEP_S) -> np.ndarray:
    """(N, n) states of a linear plant from rest, its command held."""
    n = len(A)
    whole = expm(step_s * np.block([[A, b[:, None]], [np.zeros((1, n + 1))]]))
    x = np.zeros((len(u), n))
    for k in range(len(u) - 1):
        x[k + 1] = whole[:n, :n] @ x[k] + whole[:n, n] * u[k]
    return x


def steps(n: int, hold: int, seed: int) -> np.ndarray:
    return np.repeat(np.random.default_rng(seed).uniform(-2.0, 2.0, n // hold + 1), hold)[:n]


def test_each_recording_has_its_zeros_and_they_are_said(tmp_path):
    """A spring holds the body at 0; the sensor reads 138 mm there, and in another recording -20 mm."""
    (tmp_path / "rig.yaml").write_text(dedent(SPRUNG))
    rig, recordings = dtb.load_rig(str(tmp_path / "rig.yaml")), []
    for k, zero in enumerate((0.138, -0.02)):
        u = steps(8000, 100, k)
        x = driven(u, np.array([[0.0, 1.0], [-400.0, -2.0]]), np.array([0.0, 2.0]))[:, 0]
        noise = 2e-6 * np.random.default_rng(9 + k).standard_normal(len(u))
        pd.DataFrame({"t": STEP_S * np.arange(len(u)), "u": u, "x": x + zero + noise}).to_csv(tmp_path / f"{k}.csv")
        recordings.append(read_recording(str(tmp_path / f"{k}.csv"), rig=rig))
    alone = diagnose(recordings[0], rig)
    assert (alone.verdict, alone.findings) == ("consistent", ())
    assert any(note.startswith("Zero of x 138 mm.") for note in alone.notes)
    assert "zeros" not in rig_yaml(alone.rig)  # they are the recording's
    both = dtb.diagnose(recordings, rig)
    assert (both.verdict, len(both.findings)) == ("consistent", 0)
    assert [r.zeros["x"]["value"] for r in both.diagnosis.recordings] == pytest.approx([0.138, -0.02], abs=2e-6)


def test_an_absolute_sensor_that_is_off_is_a_finding(tmp_path):
    u = steps(8000, 100, 3)
    x = driven(u, np.array([[0.0, 1.0], [-400.0, -2.0]]), np.array([0.0, 2.0]))[:, 0]
    noise = 2e-6 * np.random.default_rng(4).standard_normal(len(u))
    absolute = SPRUNG.replace("quantity: position", "quantity: position, absolute: true")
    found = diagnosed(tmp_path, absolute, t=STEP_S * np.arange(len(u)), u=u, x=x + 1e-3 + noise)
    # to a spring's body a load is the same
    assert {"offset", "constant_force"} & {f.effect for f in found.findings}


@pytest.mark.parametrize("order", [1, 2])
def test_a_filtered_sensor_is_no_delay(tmp_path, order):
    u, w = steps(12000, 40, order), 2.0 * np.pi * 25.0
    A = np.zeros((2 + order, 2 + order))
    A[0, 1], A[1, :2] = 1.0, (-400.0, -2.0)
    if order == 1:
        A[2, [0, 2]] = w, -w
    else:
        A[2, 3], A[3, [0, 2, 3]] = 1.0, (w * w, -w * w, -2.0 * 0.6 * w)
    b = np.zeros(2 + order)
    b[1] = 2.0
    noise = 2e-6 * np.random.default_rng(4).standard_normal(len(u))
    found = diagnosed(tmp_path, SPRUNG, t=STEP_S * np.arange(len(u)), u=u, x=driven(u, A, b)[:, 2] + noise)
    (finding,) = found.findings
    if order == 1:  # one command, one sensor: a drive that lags does the same
        assert {"low_pass", "lag"} <= {finding.effect, *(other.effect for other in finding.also_fits)}
    else:
        assert (finding.effect, finding.confidence) == ("second_order_low_pass", "sure")
        assert finding.parameters["cutoff"].value == pytest.approx(25.0, rel=0.02)


@pytest.mark.parametrize("step", ["samples", "instants"])
def test_a_moving_average_is_one_where_its_null_is_seen(tmp_path, step):
    u, n = steps(12000, 40, 7), 20
    x = driven(u, np.array([[0.0, 1.0], [-400.0, -2.0]]), np.array([0.0, 2.0]))[:, 0]
    if step == "samples":
        shown = np.convolve(x, np.full(n, 1.0 / n))[: len(x)]
    else:
        area = CubicSpline(STEP_S * np.arange(len(x)), x).antiderivative()(STEP_S * np.arange(len(x)))
        shown = (area - np.concatenate([np.zeros(n), area[:-n]])) / (n * STEP_S)
    noise = 2e-6 * np.random.default_rng(4).standard_normal(len(u))
    (finding,) = diagnosed(tmp_path, SPRUNG, t=STEP_S * np.arange(len(u)), u=u, x=shown + noise).findings
    assert (finding.location, finding.effect, finding.confidence) == ("sensor_x", "moving_average", "sure")
    for name, truth in (("window", n * STEP_S), ("middle", 0.5 * (1.0 - (step == "samples") / n))):
        low, high = finding.parameters[name].ci95
        assert low < truth < high
        assert high - low < 0.01 * truth


def test_a_moving_average_whose_null_is_not_seen_is_no_sure_filter(tmp_path):
    u = steps(12000, 40, 7)
    x = driven(u, np.array([[0.0, 1.0], [-400.0, -2.0]]), np.array([0.0, 2.0]))[:, 0]
    shown = np.convolve(x, np.full(5, 0.2))[: len(x)] + 2e-6 * np.random.default_rng(4).standard_normal(len(u))
    (finding,) = diagnosed(tmp_path, SPRUNG, t=STEP_S * np.arange(len(u)), u=u, x=shown).findings
    could = {finding.effect, *(other.effect for other in finding.also_fits)}
    assert (finding.confidence, "moving_average" in could) == ("one_of", True)


def test_a_sensor_behind_a_play(tmp_path):
    u = steps(20000, 200, 5) * 0.3
    q = driven(u, np.array([[0.0, 1.0], [-800.0, -40.0]]), np.array([0.0, 800.0]))[:, 0]
    phi, at = np.zeros(len(q)), 0.0
    for k, value in enumerate(q.tolist()):
        at = phi[k] = min(max(at, value - 0.03), value + 0.03)
    noise = 2e-5 * np.random.default_rng(6).standard_normal(len(u))
    found = diagnosed(tmp_path, SERVO, t=STEP_S * np.arange(len(u)), u=u, phi=phi + noise)
    (finding,) = found.findings
    assert (finding.location, finding.effect, finding.confidence) == ("sensor_phi", "lost_motion", "sure")
    assert finding.parameters["width"].value == pytest.approx(0.06, rel=0.02)


def test_a_pendulum_let_go_comes_to_rest_by_its_friction(tmp_path):
    """Coulomb friction of 25 mN m; it rests in the last two thirds, which are said and judge nothing."""
    fine, n = 40, 3000
    h, q, v, rows = 4e-3 / fine, 1.2, 0.0, []
    for k in range(n * fine):
        if k % fine == 0:
            rows.append(q)
        torque = -0.6 * np.sin(q) - 0.0025 * v
        free = v + h * torque / 0.01
        hold = h * 0.025 / 0.01
        v = 0.0 if abs(free) <= hold else free - np.sign(free) * hold
        q += h * v
    count = 2.0 * np.pi / 4096
    theta = count * np.round(np.array(rows) / count)
    assert np.ptp(theta[2 * n // 3 :]) == 0.0
    found = diagnosed(tmp_path, PENDULUM, command="none", t=4e-3 * np.arange(n), theta=theta)
    assert found.verdict == "missing_physics"
    (friction,) = found.findings
    assert (friction.location, friction.effect, friction.confidence) == ("arm", "coulomb_friction", "sure")
    assert friction.parameters["torque"].value == pytest.approx(0.025, rel=0.05)
    assert any("is left out: there it rests" in note for note in found.notes)
