"""Several recordings from what a person writes."""

import numpy as np
import pytest

from dtbacklash.errors import UserError
from dtbacklash.recording import read_recording, read_together, sources_of


@pytest.fixture
def three(frame, save):
    for k, name in enumerate(("a.csv", "b.csv", "c.csv")):
        save(frame.iloc[1000 * k : 1000 * k + 900], name)


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("a.csv", ["a.csv"]),
        ("[a.csv,b.csv]", ["a.csv", "b.csv"]),
        ("[ a.csv , b.csv ]", ["a.csv", "b.csv"]),
        ("[a.csv]", ["a.csv"]),
        ("*.csv", ["a.csv", "b.csv", "c.csv"]),
        ("[c.csv,[ab].csv]", ["c.csv", "a.csv", "b.csv"]),
        ("['x,y.csv',emps:test]", ["x,y.csv", "emps:test"]),
        ("emps:train", ["emps:train"]),
    ],
)
def test_lists_and_patterns(three, written, meant):
    assert sources_of(written) == meant


def test_a_file_is_itself_whatever_its_name(frame, save):
    save(frame, "[1,2].csv")
    assert sources_of("[1,2].csv") == ["[1,2].csv"]


@pytest.mark.parametrize(
    ("written", "said"),
    [("[]", "lists no recording; write [a.csv,b.csv]"), ("run*.csv", "no file has such a name")],
)
def test_nothing_is_refused(written, said):
    with pytest.raises(UserError) as caught:
        sources_of(written)
    assert str(caught.value) == f"recording={written}: {said}"


def test_a_missing_file_is_named(three):
    with pytest.raises(UserError, match=r"recording=z.csv: no such file"):
        read_together("[a.csv,z.csv]", None)
    with pytest.raises(UserError, match=r"validation=z.csv: no such file"):
        read_together("[a.csv,b.csv]", "z.csv")


def test_one_is_read_as_ever(three):
    alone, judge = read_together("a.csv", None)
    assert judge is None
    assert np.array_equal(alone.channels["q3"], read_recording("a.csv").channels["q3"])
    _, judge = read_together("a.csv", "b.csv")
    assert judge.name == "b.csv"


@pytest.mark.parametrize("validation", ["2", 2, "b.csv", "./b.csv"])
def test_one_of_several_is_left_out(three, validation):
    recordings, judge = read_together("[a.csv,b.csv,c.csv]", validation)
    assert [r.name for r in recordings] == ["a.csv", "b.csv", "c.csv"]
    assert judge == 2


def test_other_recordings_judge(three):
    recordings, judges = read_together("[a.csv,b.csv]", "c*.csv")
    assert [r.name for r in recordings] == ["a.csv", "b.csv"]
    assert [r.name for r in judges] == ["c.csv"]


def test_the_file_of_a_mapping_is_that_of_one(three):
    with pytest.raises(UserError, match=r"recording.path=a.csv: is the file of one recording"):
        read_together("[emps,silverbox]", None, path="a.csv")


def test_options_hold_for_all(three):
    recordings, _ = read_together("*.csv", None, units={"q3": "mm"})
    plain, _ = read_together("*.csv", None)
    for one, other in zip(recordings, plain, strict=True):
        assert one.channels["q3"] == pytest.approx(1e-3 * other.channels["q3"])
