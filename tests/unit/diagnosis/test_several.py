"""Several recordings: their names, what they share, which of them judges."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nominal import nominal_rig
from told import refused

import dtbacklash as dtb
from dtbacklash.diagnosis.several import Several, names_of
from dtbacklash.physics.simulate import simulate
from dtbacklash.recording import Recording


@pytest.fixture(scope="module")
def rig():
    return nominal_rig("oscillator")


def recording(name: str, seed: int, channels: str = "xv", samples: int = 400, folder: str = "bench") -> Recording:
    rng = np.random.default_rng(seed)
    values = {c: rng.normal(size=samples) for c in ("u", *channels)}
    return Recording(name, Path(folder) / name, 1e-3, 1e-3 * np.arange(samples), values, dict.fromkeys(values, ""))


def test_two_of_one_name_are_called_by_their_folders_or_numbers():
    assert names_of([recording("a.csv", 1), recording("b.csv", 2)]) == ["a.csv", "b.csv"]
    assert names_of([recording("a.csv", 1), recording("a.csv", 2, folder="cold")]) == ["bench/a.csv", "cold/a.csv"]
    assert names_of([replace(recording("a", 1), source=None)] * 2) == ["a (1)", "a (2)"]


def test_each_keeps_its_own_channels_and_that_is_said(rig):
    several = Several.of([recording("a.csv", 1), recording("b.csv", 2, "x"), recording("c.csv", 3, "v")], None, rig)
    assert [sorted(r.y) for r in several.records(rig, 0.4)] == [["v", "x"], ["x"], ["v"]]
    assert several.notes == ("x is in a.csv and b.csv only.", "v is in a.csv and c.csv only.")


@pytest.mark.parametrize(("which", "hold_out"), [(2, None), ("2", None), ("b.csv", None), ("bench/b.csv", None),
                                                 (None, 2), (None, "2"), (None, "b"), (None, "b.csv")])  # fmt: skip
def test_one_of_them_may_judge(rig, which, hold_out):
    several = Several.of([recording(f"{n}.csv", k) for k, n in enumerate("abc")], which, rig, hold_out)
    assert (several.judging, several.turns) == ("b.csv", False)
    records = several.records(rig, 0.4)
    assert [bool(r.train.all()) for r in records] == [True, False, True]
    assert [bool(r.held.all()) for r in records] == [False, True, False]
    assert [r.recording for r in records] == [0, 1, 2]


A, B = recording("a.csv", 1), recording("b.csv", 2)
NONE = "is none of the recordings; choose one of 1 (a.csv), 2 (b.csv)"


@pytest.mark.parametrize(("given", "which", "hold_out", "said"), [
    ([A, recording("b.csv", 2, "w")], None, None, "recording=b.csv: has no channel of this rig (x, v)"),
    *(([A, B], which, None, f"validation={which}: {NONE}") for which in (0, 3, "d.csv")),
    ([A, recording("b.csv", 1)], None, None, "recording=b.csv: is equal to a.csv, sample by sample: give each once"),
    ([A], 1, None, "validation=1: leaves no recording to fit to"),
    ([A, B], None, "d", f"hold_out=d: {NONE}; or turns, or ends"),
    ([A, B], 2, "turns", "hold_out=turns: says what judges, and so does validation=2: give one"),
    ([replace(A, rig="emps"), replace(B, rig="disk")], None, None,
     "recording=b.csv: is of the rig disk, and a.csv of emps: several are of one"),
])  # fmt: skip
def test_what_is_no_set_of_recordings_is_refused(rig, given, which, hold_out, said):
    with refused(start=said):
        Several.of(given, which, rig, hold_out)


def test_others_may_judge(rig):
    several = Several.of([recording("a.csv", 1)], [recording("b.csv", 2), recording("c.csv", 3, samples=300)], rig)
    assert several.judging == "b.csv, c.csv"
    assert [r.samples for r in several.records(rig, 0.4)] == [400, 400, 300]


def counted(name: str, seed: int, channel: str = "x") -> Recording:
    """A run of one command that begins and ends at rest; counts are often equal in two of them."""
    one = recording(name, 1, channel, 2000)
    u = np.clip(np.arange(2000) - 500, 0, 1000) * 1e-3
    read = np.round(20.0 * u + 0.2 * np.random.default_rng(seed).standard_normal(2000))
    return replace(one, channels={"u": u, channel: read})


def test_two_runs_of_one_command_are_two_recordings(rig):
    a, b = counted("a.csv", 1), counted("b.csv", 2)
    assert np.mean(a.channels["x"] == b.channels["x"]) > 0.5
    assert Several.of([a, b], None, rig).names == Several.of([a, b], 2, rig).names == ["a.csv", "b.csv"]


def test_one_command_seen_by_two_sensors_is_no_copy(rig):
    assert Several.of([counted("a.csv", 1), counted("b.csv", 1, "v")], None, rig).notes


@pytest.mark.parametrize("turned", [False, True])
def test_what_judges_may_not_be_part_of_what_is_fitted_to(rig, turned):
    whole = recording("a.csv", 1)
    both = [whole, replace(whole.section(100, 300), name="b.csv")]
    with refused("holds 200 samples of the recording itself"):
        Several.of(both[::-1] if turned else both, "b.csv", rig)
    assert Several.of(both, None, rig).judging == ""


def test_three_are_left_out_in_turn_and_two_judge_by_their_ends(rig):
    three = [recording(f"{n}.csv", k) for k, n in enumerate("abc")]
    several = Several.of(three, None, rig)
    assert several.turns
    assert all(r.train.all() and r.held.all() for r in several.records(rig, 0.4))
    assert [r.name for r in several.records(rig, 0.4)] == ["a.csv", "b.csv", "c.csv"]
    for few, how in ((three[:2], None), (three, "ends")):
        ends = Several.of(few, None, rig, how)
        assert not ends.turns
        assert [int(r.held.sum()) for r in ends.records(rig, 0.4)] == [160] * len(few)
        assert not any((r.train & r.held).any() for r in ends.records(rig, 0.4))
    assert Several.of(three[:2], None, rig, "turns").turns
    assert not Several.of(three, "b.csv", rig).turns


def one_way(nominal, sign: float, seed: int) -> Recording:
    """A drive with dry friction of 0.02 N m at its load, turning in one direction only, from when it turns."""
    rng, step, start = np.random.default_rng(seed), 1e-3, 1500
    t = step * np.arange(3000)
    u = 3.0 + np.sin(2.0 * np.pi * (0.9 + 0.1 * seed) * t) + 0.5 * np.sin(2.0 * np.pi * 3.3 * t + seed)
    u = sign * np.concatenate([np.full(start, 3.0), u])
    shown = simulate(nominal.with_effect("load", "coulomb_friction", {"torque": 0.02}), u, step).sensors
    noise = {"theta_m": 1e-3, "theta_l": 1e-3, "i_m": 2e-3}
    y = {c: shown[c][start:-1] + n * rng.standard_normal(len(t)) for c, n in noise.items()}
    return Recording("plus" if sign > 0 else "minus", None, step, t, {"u": u[start:], **y}, {})


@pytest.mark.check
def test_what_one_direction_leaves_open_the_other_settles():
    nominal = nominal_rig("rotary_drive")
    plus, minus = one_way(nominal, 1.0, 1), one_way(nominal, -1.0, 2)
    (alone,) = dtb.diagnose(plus, nominal).diagnosis.findings
    open_between = {(alone.location, alone.effect), *((a.location, a.effect) for a in alone.also_fits)}
    assert alone.confidence == "one_of"
    assert {("load", "constant_load"), ("load", "coulomb_friction")} <= open_between
    (both,) = dtb.diagnose([plus, minus], nominal).diagnosis.findings
    assert (both.location, both.effect, both.confidence, both.also_fits) == ("load", "coulomb_friction", "sure", ())
    low, high = both.parameters["torque"].ci95
    assert low < 0.02 < high < 1.05 * low


@pytest.mark.check
def test_half_a_sample_of_delay_in_one_of_three_is_seen_there_only(rig):
    """In all three together it leaves 0.5 % of what moves the mass, and the shared delay is next to nothing."""
    step_s, n = 1e-3, 4000
    t, parts = step_s * np.arange(n), []
    for k in range(3):
        rng = np.random.default_rng(k)
        u = sum(rng.uniform(0.5, 2.0) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.7, 2.3, 6.1, 11.3))
        late = rig if k else rig.with_effect("amplifier", "delay", {"time": 0.5 * step_s})
        shown = simulate(late, u, step_s).sensors
        y = {c: v[:n] + 1e-3 * np.std(v) * rng.standard_normal(n) for c, v in shown.items()}
        parts.append(Recording(f"{'abc'[k]}.csv", None, step_s, t, {"u": u, **y}, {}))
    found = dtb.diagnose(parts, rig, jobs=1).diagnosis
    (one,) = found.findings
    assert (one.location, one.effect) in {("amplifier", "delay"), ("shaker", "lag")}
    assert "It is seen in a.csv only." in one.sentence
