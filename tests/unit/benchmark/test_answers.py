"""Answers as people and programs write them: what is wrong is told in one line, and stops nothing."""

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from stage_words import MACHINES, PLACES

from dtbacklash.benchmark.answers import Row, factor_between, prediction, read
from dtbacklash.errors import UserError

HEAD = "case,place,effect,size,unit,low,high,certainty\n"


def test_a_spreadsheets_file_is_read(answers):
    head = "\ufeffCase;Place;Effect;Size;Unit;Low;High;Certainty"
    row = "1;Top Plate;viscous damping;19,5;N s/m;18;21;0,9"
    found = read(answers("\r\n".join([head, row, ";;;;;;;", ""])), MACHINES, PLACES)
    assert found.problems == []
    assert found.rows == {"001": [Row("001", "table", "viscous_friction", 19.5, "N s/m", 18.0, 21.0, 0.9)]}


def test_columns_of_no_use_may_be_missing(answers):
    found = read(answers("case,place,effect\n003,spring,other\n"), MACHINES, PLACES)
    assert found.rows == {"003": [Row("003", "spring", "unlisted")]}


@pytest.mark.parametrize(("row", "said"), [
    ("9,table,delay,,,,,", "no case '9'"), ("1,tabel,delay,,,,,", "did you mean table"),
    ("1,table,magic,,,,,", "not in the vocabulary"), ("1,table,delay,much,s,,,", "size 'much' is no number"),
    ("1,table,delay,1,s,3,2,", "low 3 is above high 2"), ("1,table,delay,nan,s,,,", "not finite"),
    ("1,table,delay,,,,,1.2", "certainty 1.2 is not from 0 to 1"), ("1,table,delay,0,5,s,,,0,9", "more cells than"),
    ("1,table,delay,0,5,,,", "unit '5' is a number"), ('1,"table,delay,,,,,', "unexpected end of data"),
    (f"1,{'x' * 300},delay,,,,,", f"'{'x' * 40}' is not"), (f"{'8' * 300},table,delay", f"no case '{'8' * 40}'"),
    ("2,table,lag,,,,,", "is named twice"),
])  # fmt: skip
def test_a_wrong_row_gets_one_line_and_the_others_count(answers, row, said):
    found = read(answers(f"{HEAD}2,table,lag,,,,,\n{row}\n3,spring,other,,,,,\n"), MACHINES, PLACES)
    (problem,) = found.problems
    assert said in problem
    assert "answers.csv, line 3" in problem
    assert len(problem) < 150
    assert set(found.rows) == {"002", "003"}


def test_answers_that_were_made_for_another_benchmark_are_told(answers):
    places = {**PLACES, "pendulum": {"disk": "disk", "table": "table"}}
    rows = "1,disk,gravity\n2,disk,lag\n44,table,lag\n3,table,lag\n3,dsik,lag\n"
    found = read(answers("case,place,effect\n" + rows), MACHINES, places)
    assert found.problems[:2] == [
        "answers.csv: 3 of 5 rows are about cases that this benchmark lacks, or places of other machines; "
        "were they made for another benchmark?",
        "answers.csv, line 2: case 001 is of stage, which has no place 'disk'; the row is left out",
    ]
    assert list(found.rows) == ["003"]
    assert len(read(answers("case,place,effect\n1,disk,gravity\n"), MACHINES, places).problems) == 1


def test_cases_that_were_left_out_are_not_counted(answers):
    folder = answers(HEAD + "2,table,lag,,,,,\n")
    (folder / "cases.txt").write_text("1\n003 77\n")
    found = read(folder, MACHINES, PLACES)
    assert found.cases == ["001", "003"]
    assert [p.partition(":")[0] for p in found.problems] == ["cases.txt", "answers.csv, line 2"]


def test_a_column_that_stands_there_twice_is_refused(answers):
    with pytest.raises(UserError, match="two columns size"):
        read(answers("case,place,effect,size,Size\n1,table,delay,1,2\n"), MACHINES, PLACES)


def test_without_a_column_that_is_needed_there_is_no_score(answers):
    with pytest.raises(UserError, match="lacks the column effect"):
        read(answers("case,place\n1,table\n"), MACHINES, PLACES)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=300) | st.lists(st.lists(st.text(max_size=8), max_size=9), max_size=6))
def test_nothing_that_stands_below_the_heads_stops_it(answers, rows):
    body = rows if isinstance(rows, bytes) else "\n".join(",".join(row) for row in rows).encode("utf-8", "replace")
    found = read(answers(HEAD.encode() + body), MACHINES, PLACES)
    assert all("\n" not in problem for problem in found.problems)
    assert all(0.0 <= row.certainty <= 1.0 and case in MACHINES for case, there in found.rows.items() for row in there)


@pytest.mark.parametrize(("unit", "size"), [("mm", 0.0195), ("m", 19.5), ("", 19.5), ("N", None), ("what", None)])
def test_a_size_is_brought_into_the_unit_of_the_truth(unit, size):
    assert Row("001", "table", "backlash", 19.5, unit).size_in("m")[0] == pytest.approx(size)


@pytest.mark.parametrize(("written", "unit", "factor"), [
    ("N*s/m", "N s/m", 1.0), ("Ns/m", "N s/m", 1.0), ("N·s/m", "N s/m", 1.0), ("mNs/m", "N s/m", None),
    ("kg m2", "kg m^2", 1.0), ("kg cm²", "kg m^2", 1e-4), ("%", "1", 0.01), ("%", "", 0.01), ("1", "", 1.0),
    ("1/s", "Hz", 1.0), ("rad/s", "Hz", 0.5 / math.pi), ("Hz", "rad/s", 2.0 * math.pi), ("rad/s", "1/s", None),
    ("rpm", "rad/s", math.pi / 30), ("Nms/rad", "N m s/rad", 1.0), ("N m s", "N m s/rad", 1.0), ("g", "kg", 1e-3),
    ("mm", "m", 1e-3), ("1", "N", None), ("furlong", "m", None), ("N", "furlong", None), ("kHz", "Hz", 1e3),
])  # fmt: skip
def test_units_are_read_as_people_write_them(written, unit, factor):
    assert factor_between(written, unit) == (None if factor is None else pytest.approx(factor))


@pytest.mark.parametrize(("text", "said"), [
    ("y\n1\n", "lacks the column x"), ("x\n1\n", "1 rows, and the test has 2"), ("", "001.csv: "),
])  # fmt: skip
def test_a_wrong_prediction_is_told(tmp_path, text, said):
    (tmp_path / "001.csv").write_text(text)
    found, problem = prediction(tmp_path, "001", {"x": 2})
    assert found is None
    assert said in problem
    assert prediction(tmp_path, "002", {"x": 2}) == (None, "")


def test_a_comma_at_the_end_of_each_row_moves_no_column(tmp_path):
    (tmp_path / "001.csv").write_text("x,y\n1,5,\n2,6,\n")
    found, problem = prediction(tmp_path, "001", {"x": 2})
    assert problem == ""
    assert found["x"].tolist() == [1.0, 2.0]
