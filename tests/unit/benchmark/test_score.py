"""Each figure of the score on answers whose score is known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from told import refused

from dtbacklash.benchmark.files import truth_of
from dtbacklash.benchmark.score import error_ratio, score_folder
from dtbacklash.config.benchmark import ScoreConfig
from dtbacklash.errors import UserError
from dtbacklash.report.benchmark import page

HEAD = "case,place,effect,size,unit,low,high,certainty\n"
RIGHT = [0.0, 1.1, 2.1, 1.1]


@pytest.fixture
def scored(bench, answers):
    """Scores a table of answers with predictions."""
    return lambda text, **predictions: score_folder(answers(HEAD + text, **predictions), bench, None, "all", "tool")


def counts(score, *names):
    return [(score.figure(name).right, score.figure(name).of) for name in names]


def test_a_right_answer_is_right_in_every_figure(scored):
    score = scored("1,table,viscous_friction,21,N s/m,19,23,1\n3,spring,unlisted,,,,,1\n", _001=RIGHT)
    names = "named", "place", "nothing", "false_names", "no_false_name", "size", "coverage"
    assert counts(score, *names) == [(2, 2), (2, 2), (1, 1), (0, 2), (3, 3), (1, 1), (1, 1)]
    assert score.figure("named", "lifelike").of == 1


def test_a_case_without_a_prediction_counts_as_infinite(scored):
    one = scored("", _001=RIGHT).figure("prediction")
    assert (one.of, one.value) == (3, np.inf)
    assert "1 of 3 cases predicted" in one.what
    assert one.low == pytest.approx(np.sqrt(3) / 2)  # an error of one oracle's in three of four samples
    two = scored("", _001=RIGHT, _002=RIGHT).figure("prediction")
    assert two.value == pytest.approx(np.sqrt(3) / 2)


def test_a_wrong_name_at_the_right_place_is_false_and_locates(scored):
    score = scored("1,table,delay,,,,,1\n3,spring,cubic_stiffness,,,,,0.9\n")
    assert counts(score, "named", "place", "false_names", "no_false_name") == [(0, 2), (2, 2), (2, 2), (1, 3)]


def test_an_unsure_name_counts_for_the_calibration_alone(scored):
    score = scored("1,table,viscous_friction,,,,,0.3\n1,spring,delay,,,,,0.3\n")
    assert counts(score, "named", "false_names", "no_false_name") == [(0, 2), (0, 0), (3, 3)]
    assert [(b.right, b.of) for b in score.bins] == [(1, 2)]
    assert score.bins[0].certainty == pytest.approx(0.3)


def test_a_small_thing_that_the_machine_has_is_neither_right_nor_false(scored):
    score = scored("2,table,delay,,,,,1\n")
    assert counts(score, "named", "nothing", "false_names", "no_false_name") == [(0, 2), (1, 1), (0, 0), (3, 3)]
    assert score.bins == []
    worse = scored("2,table,delay,,,,,1\n2,spring,delay,,,,,1\n")
    assert counts(worse, "nothing", "false_names", "no_false_name") == [(0, 1), (1, 1), (2, 3)]


def test_open_and_sealed_answers_are_counted_apart(bench, answers):
    (bench / "cases" / "002" / "case.yaml").write_text('{"machine": "stage", "split": "scored"}')
    answer = bench / "cases" / "002" / "answer.json"
    answer.write_text(answer.read_text().replace("development", "scored"))
    folder = answers(HEAD + "1,table,viscous_friction,,,,,1\n")
    assert ScoreConfig().split == "scored"
    assert score_folder(folder, bench, None, "scored", "tool").cases == 1
    every = score_folder(folder, bench, None, "all", "tool")
    assert (every.figure("named", "development").right, every.figure("named", "scored").of) == (1, 0)
    (folder / "cases.txt").write_text("1\n")
    with pytest.raises(UserError, match="it has such of development"):
        score_folder(folder, bench, None, "scored", "tool")


def test_a_real_recording_without_a_copy_counts_where_it_is_named(bench, answers):
    (bench / "cases" / "003" / "case.yaml").write_text('{"machine": "stage", "split": "real"}')
    assert score_folder(answers(HEAD), bench, None, "all", "tool").cases == 2
    assert score_folder(answers(HEAD + "3,spring,other,,,,,1\n"), bench, None, "all", "tool").cases == 3
    folder = answers(HEAD)
    (folder / "cases.txt").write_text("1 3")
    assert score_folder(folder, bench, None, "real", "tool").cases == 1


def test_a_size_that_is_off_and_an_interval_that_misses(scored):
    score = scored("1,table,viscous_friction,23,N s/m,22,24,1\n")
    assert counts(score, "size", "coverage") == [(0, 1), (0, 1)]


def test_a_size_in_a_unit_of_another_kind_is_told(scored):
    score = scored("1,table,viscous_friction,20,parsec,,,1\n1,spring,delay,1,parsec,,,1\n")
    assert counts(score, "named", "size") == [(1, 2), (0, 1)]
    (problem,) = score.problems
    assert "case 001: 'parsec' is no unit for table viscous_friction (N s/m)" in problem


def test_a_prediction_that_runs_away_is_a_large_number(bench):
    truth = truth_of(bench / "cases" / "001", None)
    assert error_ratio(truth, {"x": np.array([0.0, np.nan, 1e300, -np.inf])}) == pytest.approx(1e6 * np.sqrt(0.75))
    assert error_ratio(truth, None) == np.inf
    assert error_ratio(replace(truth, test={}), None) is None


def test_the_page_and_its_tables_say_the_same(scored, tmp_path):
    score = scored("1,table,delay,,,,,1\nx,y\n")
    page.write(score, tmp_path / "score")
    rows = pd.read_csv(tmp_path / "score" / "score.csv")
    assert len(rows) == len(score.figures)
    assert rows.set_index(["name", "group"]).loc[("place", "all"), "value"] == 0.5
    text = (tmp_path / "score" / "report.html").read_text(encoding="utf-8")
    assert "answers.csv, line 3" in text
    assert "1/2" in text
    titles = {group: page.figures_table(score, group).title for group in ("all", "single", "lifelike")}
    assert titles == {"all": "tool: 3 cases", "single": "tool: 1 cases", "lifelike": "tool: 1 cases"}


def test_sealed_answers_need_their_key(bench, answers):
    (bench / "cases" / "001" / "answer.json").unlink()
    said = "key=(missing): the scored cases are sealed; give key=FILE, or split=development"
    with refused(whole=said):
        score_folder(answers(HEAD), bench, None, "all", "tool")
    with refused(start=f"key={bench / 'none.key'}: "):
        score_folder(answers(HEAD), bench, bench / "none.key", "all", "tool")


def test_what_is_no_benchmark_is_refused(tmp_path, answers):
    with pytest.raises(UserError, match="holds no case"):
        score_folder(answers(HEAD), tmp_path / "none", None, "all", "tool")
