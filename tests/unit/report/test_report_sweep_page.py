"""The page of a sweep: every job in a row, links to their pages, reasons of those that failed."""

import numpy as np
import pandas as pd
import synthetic
from page_reader import Reader

from dtbacklash.report.sweep import page

AXES = {"controller": ["imc", "nimc_twin"], "twin.delay_s": [0, 4]}


def written(folder, table, axes):
    page.write(folder, table, axes)
    reader = Reader()
    reader.feed((folder / "report.html").read_text(encoding="utf-8"))
    return " ".join(" ".join(reader.text).split()), reader


def test_every_job_has_its_row_and_leads_to_its_own_page(tmp_path):
    table = synthetic.sweep_table(AXES)
    table["folder"] = [
        f"delay={d},controller={c} #1" for c, d in zip(table.controller, table["twin.delay_s"], strict=True)
    ]
    for name in table["folder"][:2]:
        (tmp_path / name).mkdir()
        (tmp_path / name / "report.html").touch()
    text, reader = written(tmp_path, table, list(AXES))
    links = [a for a in reader.addresses if not a.startswith("data:")]
    assert links == [
        "delay%3D0%2Ccontroller%3Dimc%20%231/report.html",
        "delay%3D4%2Ccontroller%3Dimc%20%231/report.html",
    ]
    assert "Sweep over controller and twin.delay_s" in text
    assert "3 of 4 jobs done" in text
    assert "controller=nimc_twin, twin.delay_s=0 controller.k_theta_v_per_rad=900: the loop diverged" in text
    assert text.count("A cross is a failed job") == 1
    assert sum(a.startswith("data:image/png") for a in reader.addresses) == 1
    assert set(reader.anchors) <= set(reader.ids)


def test_the_page_begins_with_the_winner_of_each_figure_of_merit(tmp_path):
    table = pd.DataFrame({
        "controller": ["imc", "pid", "lqg", "mpc"], "overshoot_pct_max": [0.5, 2.0, 1.0, 0.0],
        "settling_time_s_max": [1.0, 1.0, np.nan, 0.1], "peak_voltage_v": [4.0, 4.0, 4.0, 1.0],
        "status": ["done", "done", "done", "failed"], "error": ["", "", "", "diverged"],
    })  # fmt: skip
    found = page.winners(table, ["controller"])
    assert [list(row) for row in found.rows] == [
        ["largest overshoot [%]", "controller=imc", "0.5", "0.5 below controller=lqg (1, 50 % less)"],
        ["longest settling time [s]", "controller=imc; controller=pid", "1", "the other does not settle"],
    ]
    text, _ = written(tmp_path, table, ["controller"])
    assert text.index("The best of each figure of merit") < text.index("jobs done")
    assert page.winners(table[:1], ["controller"]).rows == []


def test_a_finished_figure_is_shown_and_not_drawn_anew(tmp_path):
    (tmp_path / "sweep.png").write_bytes(b"a figure")
    _, reader = written(tmp_path, synthetic.sweep_table(AXES), list(AXES))
    assert [a for a in reader.addresses if a.startswith("data:")] == ["data:image/png;base64,YSBmaWd1cmU="]


def test_a_move_that_does_not_settle_is_told_and_text_is_escaped(tmp_path):
    table = synthetic.sweep_table(AXES)
    table.loc[0, "settling_time_s_max"] = np.nan
    table.loc[2, "error"] = "<b>bold</b>"
    text, _ = written(tmp_path, table, list(AXES))
    assert text.count("not settled") == 1
    assert "<b>bold</b>" in text  # as text: a tag would not be in it


def test_any_table_over_jobs_makes_a_page(tmp_path):
    """Results of another kind of job: words and numbers of whatever name, and no figure of a run."""
    table = pd.DataFrame({"recording": ["a.csv", "b.csv"], "verdict": ["consistent", "parameters"],
                          "held_out": [1.02, 1.1], "status": ["done", "done"], "error": ["", ""]})  # fmt: skip
    text, reader = written(tmp_path, table, ["recording"])
    assert "1 done a.csv consistent 1.02 2 done b.csv parameters 1.1" in text
    assert reader.addresses == []
    assert "What failed" not in text
