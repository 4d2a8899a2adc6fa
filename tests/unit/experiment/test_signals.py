"""References and gaps over time; files that are wrong are refused in the name of their key."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from told import refused

from dtbacklash.config.run import ProfileConfig, ReferenceConfig
from dtbacklash.errors import UserError
from dtbacklash.experiment import signals

T_S = np.arange(200_001) * 0.001


def gap_from(tmp_path, text, t_s=T_S):
    file = tmp_path / "gap.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return signals.gap_profile(ProfileConfig(kind="csv", path=str(file)), t_s)


def test_the_square_wave_starts_at_plus_and_changes_on_the_sample():
    r = signals.reference(ReferenceConfig(), T_S)
    changes = np.flatnonzero(np.diff(r)) + 1
    assert r[0] == 1.0
    assert list(changes) == [20_000 * k for k in range(1, 11)]
    assert set(np.unique(r)) == {-1.0, 1.0}


@pytest.mark.parametrize("sample_time_s", [0.001, 0.0007, 1 / 3000])
def test_changes_of_the_square_wave_do_not_drift_by_rounding(sample_time_s):
    t = np.arange(round(400 / sample_time_s)) * sample_time_s
    r = signals.reference(ReferenceConfig(period_s=0.42), t)
    edges = t[np.flatnonzero(np.diff(r)) + 1]
    k = np.round((edges - 0.5 * sample_time_s) / 0.21)
    assert np.all(edges - k * 0.21 > -1e-6)
    assert np.all(edges - k * 0.21 < sample_time_s * (1 + 1e-6))


def test_step_and_offset():
    r = signals.reference(ReferenceConfig(kind="step", amplitude_mm=2.0, t_start_s=0.3, offset_mm=0.5), T_S)
    assert r[299] == 0.5
    assert r[300] == 2.5
    assert r[-1] == 2.5


def test_a_trajectory_goes_between_the_levels_of_the_square_wave_with_bounded_jerk():
    config = ReferenceConfig(kind="trajectory", period_s=4.0, move_s=0.8)
    t = np.arange(8001) * 1e-3
    r, square = signals.reference(config, t), signals.reference(ReferenceConfig(period_s=4.0), t)
    rests = (t % 2.0 >= 0.8) & (t < 8.0)
    assert r[rests] == pytest.approx(square[rests])
    assert r[0] == 0.0
    # 60 times the distance over the time cubed, at the ends of a move
    assert np.abs(np.diff(r, 3)).max() / 1e-9 == pytest.approx(60 * 2.0 / 0.8**3, rel=0.02)
    with pytest.raises(UserError, match=r"^reference\.move_s="):
        ReferenceConfig(kind="trajectory", period_s=4.0, move_s=2.1)


def test_the_staircase_goes_up_and_down():
    config = ReferenceConfig(kind="staircase", step_mm=0.5, dwell_s=10.0, levels=3)
    r = signals.reference(config, T_S)
    assert list(r[5_000:105_000:10_000]) == [0.5, 1.0, 1.5, 1.0, 0.5, 0.0, 0.5, 1.0, 1.5, 1.0]


def test_the_multisine_has_its_band_its_size_and_its_seed():
    config = ReferenceConfig(kind="multisine", f_min_hz=0.5, f_max_hz=3.0, rms_mm=0.25, period_s=20.0)
    t = np.arange(20_000) * 0.001
    r = signals.reference(config, t, seed=3)
    spectrum = np.abs(np.fft.rfft(r)) / t.size
    lines = np.flatnonzero(spectrum > 1e-9) / 20.0
    assert lines.min() == 0.5
    assert lines.max() == 3.0
    assert np.sqrt(np.mean(r**2)) == pytest.approx(0.25, rel=1e-9)
    assert np.array_equal(r, signals.reference(config, t, seed=3))
    assert not np.allclose(r, signals.reference(config, t, seed=4))
    with refused(start="reference.period_s="):  # no line in its band
        signals.reference(ReferenceConfig(kind="multisine", f_min_hz=0.11, f_max_hz=0.12, period_s=10.0), T_S)


def test_the_s_curve_is_minimum_jerk():
    gap = signals.gap_profile(ProfileConfig(), T_S)
    x = 0.3
    assert gap[25_000] == 0.0
    assert gap[70_000] == pytest.approx(100 * (10 * x**3 - 15 * x**4 + 6 * x**5), rel=1e-12)
    assert gap[100_000] == pytest.approx(50.0)
    assert gap[175_000] == pytest.approx(100.0)
    # velocity and acceleration vanish at both ends
    assert np.abs(np.diff(gap)[[25_000, 174_999]]).max() < 1e-9


@pytest.mark.parametrize(("kind", "end"), [("s_curve", 80), ("ramp", 80), ("step", 80), ("wear", 80), ("constant", 5)])
def test_every_gap_goes_from_start_to_end_and_never_back(kind, end):
    gap = signals.gap_profile(ProfileConfig(kind=kind, start_deg=5.0, end_deg=float(end)), T_S)
    assert gap[0] == 5.0
    assert gap[-1] == pytest.approx(end)
    assert np.diff(gap).min() >= -1e-12


def test_wear_has_a_fast_a_steady_and_a_severe_phase():
    config = ProfileConfig(kind="wear", t_start_s=0.0, t_end_s=200.0)
    rate = np.gradient(signals.gap_profile(config, T_S), T_S)
    assert rate[0] > 3 * rate[100_000]
    assert rate[-1] > 3 * rate[100_000]
    assert rate[115_000] == pytest.approx(rate[100_000], rel=0.1)


def test_a_reference_file_is_held_or_interpolated(tmp_path):
    file = tmp_path / "r.csv"
    file.write_text("t_s,r_mm\n0,1\n0.3,2\n200,4\n")
    held = signals.reference(ReferenceConfig(kind="csv", path=str(file)), T_S)
    linear = signals.reference(ReferenceConfig(kind="csv", path=str(file), interpolation="linear"), T_S)
    assert list(held[[0, 299, 300, 199_999, 200_000]]) == [1, 1, 2, 2, 4]
    assert linear[150] == pytest.approx(1.5)


WRONG = {
    "NaN": ("t_s,gap_deg\n0,0\n100,nan\n200,1\n", "row 2"),
    "empty cell": ("t_s,gap_deg\n0,0\n100,\n200,1\n", "row 2"),
    "text": ("t_s,gap_deg\n0,0\n100,ten\n200,1\n", "ten"),
    "infinity": ("t_s,gap_deg\n0,0\n100,inf\n200,1\n", "row 2"),
    "time not increasing": ("t_s,gap_deg\n0,0\n100,1\n100,2\n200,3\n", "increase"),
    "negative gap": ("t_s,gap_deg\n0,0\n100,-1\n200,1\n", "negative"),
    "more than a turn": ("t_s,gap_deg\n0,0\n200,361\n", "360"),
    "too short": ("t_s,gap_deg\n0,0\n199,1\n", "covers 0 to 199 s"),
    "too late": ("t_s,gap_deg\n1,0\n200,1\n", "covers 1 to 200 s"),
    "missing column": ("t_s,gap_rad\n0,0\n200,1\n", "it has t_s,gap_rad"),
    "column twice": ("t_s,gap_deg,gap_deg \n0,0,0\n200,1,1\n", "once each"),
    "one row": ("t_s,gap_deg\n0,0\n", "two rows"),
    "no row": ("t_s,gap_deg\n", "two rows"),
    "empty": ("", "readable"),
    "not text": (b"\xff\xfe\x00\x01\x80", "readable"),
    "decimal comma": ("t_s,gap_deg\n0,0,1,5\n200,0,2,5\n", "readable"),
    "one cell too many": ("t_s,gap_deg\n0,1\n200,2,5\n", "readable"),
    "ragged": ("t_s,gap_deg\n0,0,0,0\n1\n2,3,4,5,6,7\n", ""),
    "hole": ("t_s,gap_deg\n" + "".join(f"{t},1\n" for t in range(201) if not 50 < t < 60), "hole from 50 to 60 s"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_file_is_refused_by_name(tmp_path, case):
    text, said = WRONG[case]
    with refused(said, key="profile.path"):
        gap_from(tmp_path, text)


def test_a_byte_order_mark_and_spaces_and_more_columns_are_fine(tmp_path):
    gap = gap_from(tmp_path, "\ufefft_s, gap_deg, note\n0, 0, new\n200, 10, worn\n")
    assert gap[100_000] == pytest.approx(5.0)


steps = st.lists(st.floats(0.01, 50.0), min_size=1, max_size=8)
gaps = st.floats(0.0, 360.0)


@settings(max_examples=60, deadline=None)
@given(steps=steps, data=st.data())
def test_a_valid_file_gives_what_linear_interpolation_gives(tmp_path_factory, steps, data):
    times = np.concatenate([[0.0], np.cumsum(steps)])
    values = data.draw(st.lists(gaps, min_size=times.size, max_size=times.size))
    rows = "".join(f"{t!r},{v!r}\n" for t, v in zip(times.tolist(), values, strict=True))
    t_s = np.linspace(0.0, times[-1], 301)
    found = gap_from(tmp_path_factory.mktemp("gap"), "t_s,gap_deg\n" + rows, t_s)
    assert np.array_equal(found, np.interp(t_s, times, values))
    assert found.min() >= 0.0


@settings(max_examples=60, deadline=None)
@given(steps=steps, data=st.data())
def test_one_bad_cell_anywhere_is_refused(tmp_path_factory, steps, data):
    times = np.concatenate([[0.0], np.cumsum(steps)])
    cells = [[repr(float(t)), "1.0"] for t in times]
    row, column = data.draw(st.integers(0, len(cells) - 1)), data.draw(st.integers(0, 1))
    bad = ["", "nan", "inf", "-inf", "x", "1,5", "1e999", "--", "-3.0" if column else "1e9"]
    cells[row][column] = data.draw(st.sampled_from(bad[:-1] if row == len(cells) - 1 and not column else bad))
    text = "t_s,gap_deg\n" + "".join(",".join(cell) + "\n" for cell in cells)
    with pytest.raises(UserError, match=r"^profile\.path="):
        gap_from(tmp_path_factory.mktemp("gap"), text, np.linspace(0.0, times[-1], 11))


@settings(max_examples=150, deadline=None)
@given(content=st.one_of(st.binary(max_size=200), st.text(alphabet='t_sgap_der,;"0123456789.\n -e', max_size=200)))
def test_whatever_the_file_holds_it_is_read_or_refused(tmp_path_factory, content):
    t_s = np.linspace(0.0, 1.0, 11)
    mistake = None
    try:
        found = gap_from(tmp_path_factory.mktemp("gap"), content, t_s)
    except UserError as error:
        mistake = error
    if mistake is None:
        assert np.all((found >= 0) & (found <= 360))
    else:
        assert str(mistake).startswith("profile.path=")
        assert "\n" not in str(mistake)
