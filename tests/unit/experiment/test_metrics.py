"""The metrics against responses whose overshoot and settling time are known in closed form."""

import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dtbacklash.experiment.metrics import MOVE_COLUMNS, move_table, step_metrics, tracking_rms_mm

T_S = 0.001

seeded = settings(deadline=None, derandomize=True)


def trace(r, q3, u=None):
    r, q3 = np.asarray(r, dtype=float), np.asarray(q3, dtype=float)
    u = np.zeros(r.size) if u is None else u
    return pd.DataFrame({"t_s": np.arange(r.size) * T_S, "r_mm": r, "q3_mm": q3, "u_v": u})


def square(moves, hold_s):
    """A reference that takes each of the values in turn for hold_s."""
    return np.repeat(np.asarray(moves, dtype=float), round(hold_s / T_S))


@seeded
@given(tau=st.floats(0.05, 0.5), target=st.floats(-5, 5).filter(lambda x: abs(x) > 0.01), start=st.floats(-3, 3))
def test_first_order_lag_settles_after_tau_ln_100_and_never_overshoots(tau, target, start):
    if abs(target - start) < 0.01:
        target = start + 1.0
    t = np.arange(0, 4, T_S)
    y = target + (start - target) * np.exp(-t / tau)
    found = step_metrics(t, y, np.zeros(t.size), target, start)
    assert found.overshoot_pct == pytest.approx(0, abs=1e-9)
    # crossing interpolated between samples: far closer than a sample
    assert found.settling_time_s == pytest.approx(tau * math.log(100), abs=2e-5)


@seeded
@given(zeta=st.floats(0.05, 0.9), sign=st.sampled_from([-1.0, 1.0]))
def test_second_order_overshoot_is_that_of_the_textbook(zeta, sign):
    omega, t = 10.0, np.arange(0, 20, T_S)
    damped = omega * math.sqrt(1 - zeta**2)
    ring = np.cos(damped * t) + zeta / math.sqrt(1 - zeta**2) * np.sin(damped * t)
    y = sign * 2 * (1 - np.exp(-zeta * omega * t) * ring)
    found = step_metrics(t, y, np.zeros(t.size), sign * 2)
    assert found.overshoot_pct == pytest.approx(100 * math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2)), abs=0.01)


@seeded
@given(
    scale=st.floats(0.01, 100), offset=st.floats(-10, 10), shift=st.floats(0, 1000), sign=st.sampled_from([-1.0, 1.0])
)
def test_metrics_do_not_depend_on_the_size_place_and_time_of_the_move(scale, offset, shift, sign):
    t = np.arange(0, 3, T_S)
    y = 1 - np.exp(-2 * t) * np.cos(15 * t)
    plain = step_metrics(t, y, y, 1.0)
    moved = step_metrics(t + shift, offset + sign * scale * y, y, offset + sign * scale, offset)
    assert moved.overshoot_pct == pytest.approx(plain.overshoot_pct, rel=1e-6)
    assert moved.settling_time_s == pytest.approx(plain.settling_time_s, abs=1e-6)


def test_a_wider_band_is_entered_earlier():
    t = np.arange(0, 3, T_S)
    y = 1 - np.exp(-t / 0.2)
    narrow, wide = (step_metrics(t, y, y, 1.0, band=band).settling_time_s for band in (0.01, 0.02))
    assert narrow == pytest.approx(0.2 * math.log(100), abs=1e-5)
    assert wide == pytest.approx(0.2 * math.log(50), abs=1e-5)


LATE = np.where(np.arange(1000) == 700, 1.05, 1.0)  # one excursion long after the first arrival


@pytest.mark.parametrize(("y", "settling_s"), [
    ([0, 0.5, 0.9], math.nan), ([0, 1, math.nan], math.nan), ([math.nan] * 3, math.nan), ([1, 1, 1], 0.0),
    (LATE, 0.7005),
])  # fmt: skip
def test_settling_counts_the_last_time_that_the_band_is_left(y, settling_s):
    t = T_S * np.arange(len(y))
    u = np.resize([1.0, -47.1, 20.0], len(y))
    found = step_metrics(t, y, u, 1.0)
    assert found.settling_time_s == pytest.approx(settling_s, abs=5e-4, nan_ok=True)
    assert found.peak_voltage_v == pytest.approx(47.1)
    assert y is not LATE or found.overshoot_pct == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (([0, 1], [0, 1], [0, 1], 0.0), "target"), (([0, 1], [0, 1, 2], [0, 1], 1.0), "length"),
        (([], [], [], 1.0), "length"), (([0, 1], [0, 1], [0, 1], math.nan), "target"),
    ],
)  # fmt: skip
def test_arguments_without_meaning_are_refused(arguments, word):
    with pytest.raises(ValueError, match=word):
        step_metrics(*arguments)
    with pytest.raises(ValueError, match="band"):
        step_metrics([0, 1], [0, 1], [0, 1], 1.0, band=0.0)


def test_one_row_a_move_with_the_first_from_rest():
    r = square([1, -1, 1], 1.0)
    u = np.zeros(r.size)
    u[[0, 1000, 2500]] = [3.0, -7.0, 5.0]
    table = move_table(trace(r, r, u))
    assert list(table.columns) == MOVE_COLUMNS
    assert table["move"].tolist() == [1, 2, 3]
    assert table["t_s"].tolist() == pytest.approx([0.0, 1.0, 2.0])
    assert table["from_mm"].tolist() == [0, 1, -1]
    assert table["to_mm"].tolist() == [1, -1, 1]
    assert table["peak_voltage_v"].tolist() == [3, 7, 5]


NOISE = 1 + 1e-14 * np.random.default_rng(0).standard_normal(2000)


@pytest.mark.parametrize(("r", "at_s"), [
    (square([0, 2], 1.0), [1.0]),  # it rests at first
    (np.append(square([1, -1], 1.0), 1.0), [0.0, 1.0]),  # the square wave turns again at the very last sample
    (np.append(square([1, 2, 1], 0.1), 1.0), [0.0, 0.1, 0.2]),  # a hold of exactly a tenth of a second
    (square([1, -1], 1.0) * NOISE, [0.0, 1.0]),  # rounding is no change
    (np.concatenate([square([1], 1.0), np.linspace(1, 3, 1000)]), [0.0]),  # ends where a ramp begins that is no move
])  # fmt: skip
def test_what_is_a_move(r, at_s):
    table = move_table(trace(r, r))
    assert table["t_s"].tolist() == pytest.approx(at_s)
    assert table["overshoot_pct"].tolist() == pytest.approx([0] * len(at_s), abs=0.3)


@pytest.mark.parametrize(
    "r",
    [
        np.zeros(2000),
        np.sin(np.arange(4000) * T_S * 7) + 0.3 * np.sin(np.arange(4000) * T_S * 23),
        np.linspace(0, 1, 3000),
        square([1, -1] * 20, 0.05),  # it never holds for 0.1 s
    ],
    ids=["rest", "multisine", "ramp", "too fast"],
)
def test_a_reference_without_moves_gives_an_empty_table_of_the_right_types(r):
    table = move_table(trace(r, r))
    assert table.empty
    assert list(table.columns) == MOVE_COLUMNS
    assert table["move"].dtype == np.int64
    assert table["settling_time_s"].dtype == np.float64


def test_a_ramp_from_one_rest_to_another_is_a_move_from_where_it_sets_out():
    ramp = np.linspace(1, 3, 1000)
    r = np.concatenate([square([1], 1.0), ramp, square([3, 0], 1.0)])
    table = move_table(trace(r, r))
    assert table["from_mm"].tolist() == [0, 1, 3]
    assert table["to_mm"].tolist() == [1, 3, 0]
    assert table["settling_time_s"].tolist() == pytest.approx([0, 0.99, 0], abs=0.01)


def test_a_move_that_does_not_settle_before_the_next_is_nan():
    r = square([1, -1], 0.3)
    q3 = np.concatenate([np.linspace(0, 0.8, 300), np.linspace(0.8, -1, 300)])
    table = move_table(trace(r, q3))
    assert math.isnan(table["settling_time_s"][0])
    assert table["settling_time_s"][1] < 0.3


@seeded
@given(values=st.lists(st.integers(-5, 5), min_size=1, max_size=8), hold=st.integers(110, 300))
def test_every_change_of_a_staircase_is_found(values, hold):
    r = np.repeat(np.array(values, dtype=float), hold)
    expected = sum(a != b for a, b in zip([0, *values], values, strict=False))
    table = move_table(trace(r, r))
    assert len(table) == expected
    assert (table["from_mm"] != table["to_mm"]).all()


def test_tracking_error_of_a_sine_a_quarter_period_late():
    t = np.arange(10_000) * T_S
    found = tracking_rms_mm(trace(np.sin(2 * np.pi * t), np.cos(2 * np.pi * t)))
    assert found == pytest.approx(1.0, rel=1e-6)  # sin - cos has amplitude sqrt(2)
