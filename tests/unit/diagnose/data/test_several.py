"""Several recordings: their names, what they have in common, which of them judges."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnose import diagnose
from dtbacklash.diagnose.data.several import Several, names_of
from dtbacklash.errors import UserError
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


def test_only_what_all_have_is_compared(rig):
    several = Several.of([recording("a.csv", 1), recording("b.csv", 2, "x")], None, rig)
    assert [sorted(r.channels) for r in several.recordings] == [["u", "x"]] * 2
    (note,) = several.notes
    assert note == "v is in a.csv only and is not used: compared are the channels that all recordings have (x)."


def test_nothing_in_common_is_refused(rig):
    with pytest.raises(UserError) as caught:
        Several.of([recording("a.csv", 1, "x"), recording("b.csv", 2, "v")], None, rig)
    said = "recording=a.csv, b.csv: have no channel of this rig in common: a.csv has x; b.csv has v"
    assert str(caught.value) == said


@pytest.mark.parametrize("which", [2, "2", "b.csv", "bench/b.csv"])
def test_one_of_them_may_judge(rig, which):
    several = Several.of([recording(f"{n}.csv", k) for k, n in enumerate("abc")], which, rig)
    assert several.judging == "b.csv"
    records = several.records(rig, 0.4)
    assert [bool(r.train.all()) for r in records] == [True, False, True]
    assert [bool(r.held.all()) for r in records] == [False, True, False]
    assert [r.own_zero for r in records] == [False, True, True]


def test_others_may_judge(rig):
    several = Several.of([recording("a.csv", 1)], [recording("b.csv", 2), recording("c.csv", 3, samples=300)], rig)
    assert several.judging == "b.csv, c.csv"
    assert [r.samples for r in several.records(rig, 0.4)] == [400, 400, 300]


@pytest.mark.parametrize("which", [0, 3, "d.csv"])
def test_a_validation_that_is_none_of_them_is_refused(rig, which):
    with pytest.raises(UserError, match=r"is none of the recordings; choose one of 1 \(a.csv\), 2 \(b.csv\)"):
        Several.of([recording("a.csv", 1), recording("b.csv", 2)], which, rig)


def test_the_same_samples_twice_are_refused(rig):
    with pytest.raises(UserError, match="holds 400 samples of"):
        diagnose([recording("a.csv", 1), recording("b.csv", 1)], rig)


def test_all_may_not_judge(rig):
    with pytest.raises(UserError, match="leaves no recording to fit to"):
        Several.of([recording("a.csv", 1)], 1, rig)
