"""A recording may begin in mid-motion, and in several stretches: what its first states are is found."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nominal import nominal_rig

from dtbacklash.config.rig import ParameterConfig, RigConfig
from dtbacklash.diagnose import Record, diagnose, diagnose_records, records_of
from dtbacklash.diagnose.data.compare import predict, residual
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.data.first_state import first_state, moves, stands
from dtbacklash.diagnose.data.in_motion import with_start
from dtbacklash.diagnose.data.pull import cut
from dtbacklash.diagnose.data.records import long_enough
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.simulate import simulate
from dtbacklash.recording import Recording
from dtbacklash.report.diagnosis.figures import curve_figure

from ..conftest import COUNTS, STEP_S, TEMPO_RAD_S, command, recorded


def piece(record: Record, start: int, stop: int) -> Record:
    """Some of the samples; the last 30 % of all of them judge."""
    y = {c: v[start:stop] for c, v in record.y.items()}
    return Record(STEP_S, record.u[start:stop], y, record.train[start:stop], record.held[start:stop], start * STEP_S)


def started(rig: Rig, record: Record) -> Record:
    return with_start(rig, cut(rig, tuple(record.y), STEP_S, TEMPO_RAD_S), record)


def in_floors(rig: Rig, record: Record) -> np.ndarray:
    """Root mean square of what each channel leaves, in noise floors."""
    evidence = Evidence.gather(rig, [record])
    left = [np.std(residual(rig, b, evidence.records[0]), axis=0) / evidence.floor[b.name] for b in evidence.blocks]
    return np.concatenate(left)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(1, 9000), start=st.integers(500, 5000))
def test_the_truth_leaves_noise_wherever_a_recording_begins(rig, seed, start):
    assert in_floors(rig, piece(recorded(rig, 8.0, seed), start, 8001)).max() < 1.2


def test_from_rest_nothing_is_fitted(rig):
    """But for a few where a fast motor has its speed within a sample: there a fitted start is as good."""
    fitted = [seed for seed in range(1, 41) if started(rig, recorded(rig, 4.0, seed)).begins]
    assert len(fitted) <= 2
    record = recorded(rig, 4.0, 1)
    assert started(rig, record).begins is None


def test_a_motion_at_the_first_sample_is_seen(rig):
    whole = recorded(rig, 8.0)
    assert all(started(rig, piece(whole, k, 8001)).begins for k in range(300, 3300, 100))


@pytest.mark.parametrize(
    ("place", "effect", "values"),
    [
        ("gear", "backlash", {"half_gap": 0.5}),
        ("motor_bearing", "coulomb_friction", {"torque": 0.03}),
        ("link_1", "hysteresis", {"displacement": 1e-4, "share": 0.3}),
        ("mass_2", "absorber", {"mass_ratio": 0.1, "frequency": 6.0}),
    ],
)
def test_an_effect_begins_in_its_own_state(rig, place, effect, values):
    known = {p.name: p.typical for p in _parameters(rig, place, effect)}
    truth = rig.with_effect(place, effect, known | {k: v for k, v in values.items() if k in known})
    whole = recorded(truth, 9.0, 7)
    from_rest, later = in_floors(truth, whole).max(), in_floors(truth, piece(whole, 3000, 9001)).max()
    assert later < 1.1 * max(from_rest, 1.0)


def _parameters(rig, place, effect):
    from dtbacklash.physics.catalogue import find

    return find(rig.kind_at(place), effect, place).parameters


def test_an_unmeasured_speed_is_found(rig):
    """The motor's encoder alone: the first speed of the free motor is what makes the first samples right."""
    record = piece(recorded(rig, 6.0, 3), 2000, 6001)
    record = replace(record, y={"theta_m": record.y["theta_m"]})
    (block,) = cut(rig, ("theta_m",), STEP_S, TEMPO_RAD_S)
    left, from_rest = (np.sqrt(np.mean(residual(rig, block, r)[:50] ** 2)) for r in (started(rig, record), record))
    assert left < 1.3 * COUNTS["theta_m"] / np.sqrt(12)
    assert from_rest > 3 * left


@pytest.mark.nightly
def test_a_start_in_motion_is_consistent_and_friction_is_named(rig):
    document = diagnose_records(rig, [piece(recorded(rig), 3000, 12001)]).to_json()
    assert (document["verdict"], document["findings"]) == ("consistent", [])
    truth = rig.with_effect("motor_bearing", "coulomb_friction", {"torque": 0.02})
    whole = recorded(truth)
    stretches = [piece(whole, 2500, 7000), piece(whole, 7061, 12001)]
    document = diagnose_records(rig, stretches).to_json()
    assert document["verdict"] == "missing_physics"
    assert [(f["location"], f["effect"]) for f in document["findings"]] == [("motor_bearing", "coulomb_friction")]
    low, high = document["findings"][0]["parameters"]["torque"]["ci95"]
    assert low <= 0.02 <= high


def test_time_goes_on_in_a_later_stretch(rig):
    drifting = rig.with_effect("link_1", "stiffness_drift", {"rate": 0.02})
    record = piece(recorded(drifting, 12.0, 5), 6000, 12001)
    assert in_floors(drifting, record).max() < 1.1
    assert in_floors(drifting, replace(record, from_s=0.0)).max() > 1.5


def test_short_stretches_are_left_out_and_counted(rig):
    whole = recorded(rig, 6.0)
    records = [piece(whole, 0, 3000), piece(whole, 3100, 3400), piece(whole, 3500, 6001)]
    kept, notes = long_enough(rig, records)
    assert [r.samples for r in kept] == [3000, 2501]
    assert "1 of 3 stretches (300 samples) is left out" in notes[0]
    only = [piece(whole, 0, 300)]
    assert long_enough(rig, only) == (only, ())


def slider() -> Rig:
    return build_rig(
        RigConfig(
            "slider", parameters={"M": ParameterConfig(2.0, "kg", 0.05), "g": ParameterConfig(4.0, "N/V")},
            elements={"amplifier": {"kind": "amplifier", "drives": "motor"},
                      "motor": {"kind": "actuator", "gain": "g", "drives": "slide"},
                      "slide": {"kind": "carriage", "mass": "M"}},
            sensors={"x": {"of": "slide", "quantity": "position"}},
        )
    )  # fmt: skip


def test_both_sides_of_a_dropout_are_fitted_judged_and_drawn():
    rig, n = slider(), 6000
    t = np.arange(n) * STEP_S
    u = 3.0 * np.sin(2 * np.pi * 1.3 * t) + 2.0 * np.sin(2 * np.pi * 4.1 * t + 1.0)
    seen = simulate(rig, u[:-1], STEP_S).sensors["x"] + 1e-5 * np.random.default_rng(4).standard_normal(n)
    frame = pd.DataFrame({"t": t, "u": u, "x": seen})[700:]
    frame.loc[3000:3060, "x"] = np.nan
    recording = Recording.from_frame(frame, rig=rig)
    records = records_of(recording, rig, True, True)
    assert [r.samples for r in records] == [2300, 2939]
    assert sum(int(r.held.sum()) for r in records) == round(0.4 * recording.samples)
    assert records[1].from_s == pytest.approx(2.361)
    found = diagnose(recording, rig)
    assert found.verdict == "consistent"
    (curve,) = found.shown.curves
    assert len(curve.t_s) == recording.samples
    assert np.diff(curve.t_s).max() == pytest.approx(0.062)
    assert any("in 2 stretches" in note for note in found.notes)
    line = curve_figure(curve).axes[0].lines[0]
    assert np.isnan(np.asarray(line.get_ydata())).sum() >= 1


@settings(max_examples=10, deadline=None)
@given(speed=st.floats(0.02, 2.0), place=st.floats(-3.0, 3.0))
def test_a_slider_that_coasts_keeps_its_speed(speed, place):
    """Newton: without a force the position is a straight line, and the simulation takes it up from the first sample."""
    n = 2000
    t = np.arange(n) * STEP_S
    noise = 1e-5 * np.random.default_rng(1).standard_normal(n)
    record = Record(STEP_S, np.zeros(n), {"x": place + speed * t + noise}, t < 1.4, t >= 1.4)
    rig = slider()
    (block,) = cut(rig, ("x",), STEP_S, TEMPO_RAD_S)
    free = replace(block, gains=(0.0, 0.0))
    assert np.abs(predict(rig, free, started(rig, record))[:, 0] - (place + speed * t)).max() < 5e-6


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_first_state_is_least_squares(truth):
    t = np.linspace(0.0, 1.0, 60)
    basis = np.column_stack([np.cos(3 * t), np.sin(3 * t), np.exp(-2 * t)])
    measured = (basis @ np.array(truth))[:, None]
    found = first_state(
        lambda x: (basis @ x)[:, None], measured, np.array([1e-3]), np.zeros(3), np.full(3, 10.0), np.full(3, np.inf)
    )
    assert np.allclose(found, truth, atol=1e-5)


def test_a_state_stays_within_its_reach_and_a_known_one_where_it_is():
    found = first_state(
        lambda x: np.full((9, 1), x[0] + x[1]), np.full((9, 1), 5.0), np.array([0.1]), np.array([1.0, 0.0]),
        np.array([0.0, 1.0]), np.array([np.inf, 2.0]),
    )  # fmt: skip
    assert found.tolist() == [1.0, 2.0]


def test_a_simulation_that_runs_away_leaves_the_guess():
    guess = np.array([0.3])
    found = first_state(
        lambda x: np.full((5, 1), np.nan), np.zeros((5, 1)), np.ones(1), guess, np.ones(1), np.full(1, np.inf)
    )
    assert np.array_equal(found, guess)


@pytest.mark.parametrize("noise", [1e-6, 1e-4])
def test_rest_and_motion_are_told_apart(noise):
    t = np.arange(300) * STEP_S
    scatter = noise * np.random.default_rng(2).standard_normal(len(t))
    assert not moves(5.0 * t**2 + scatter, noise, speed=False)
    assert not moves(scatter, noise, speed=False)
    assert not moves(0.5 * (t - 0.01 * (1 - np.exp(-t / 0.01))) + scatter, noise, speed=False)
    assert moves(0.5 * t + 5.0 * t**2 + scatter, noise, speed=False)
    assert moves(0.02 + scatter, noise, speed=True)


@pytest.mark.parametrize("samples", [40, 3000])
def test_a_position_at_rest_is_known_better_than_by_one_sample(samples):
    at = np.arange(samples)
    motion = 2.0 + 3e-7 * at**2 - 1e-11 * at**3
    rng = np.random.default_rng(2)
    errors = [stands(motion + rng.normal(0.0, 0.01, samples), 0.01) - 2.0 for _ in range(200)]
    assert np.sqrt(np.mean(np.square(errors))) < 0.006
    assert abs(np.mean(errors)) < 0.002


def test_a_position_that_no_smooth_motion_pictures_is_its_first_sample():
    jumping = np.where(np.arange(1000) % 2, 5.0, -5.0)
    assert stands(jumping, 0.01) == -5.0


def test_a_counted_position_stands_where_its_first_counts_say():
    """Half a count of a beginning that is pictured for too long once was a preload of the spring behind it."""
    t, count = STEP_S * np.arange(2000), 1e-4
    seen = count * np.round((2e-3 * np.sin(2.0 * np.pi * t**2) * t + 0.1 * count) / count)
    assert stands(seen, count / np.sqrt(12.0)) == pytest.approx(0.0, abs=0.15 * count)


def test_what_is_not_measured_begins_where_no_spring_pulls_it():
    """A stage that stands off its zero: its table is not seen, and is no 5 mm away from the carriage."""
    stage = nominal_rig("two_mass_stage")
    u, away = command(4.0, 3), 5e-3
    seen = simulate(stage, u[:-1], STEP_S).sensors["x_c"] + away
    mask = np.arange(len(u)) < 0.7 * len(u)
    record = started(stage, Record(STEP_S, u, {"x_c": seen}, mask, ~mask))
    assert record.begins is None
    (block,) = cut(stage, ("x_c",), STEP_S, TEMPO_RAD_S)
    assert np.abs(residual(stage, block, record)).max() < 2e-3 * away
