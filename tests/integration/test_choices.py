"""Every choice of every config group is run end to end, to its report, in this process; short, figures not drawn."""

import json
from pathlib import Path

import pytest
from hydra.core.global_hydra import GlobalHydra

from dtbacklash import cli
from dtbacklash.config.grammar import RUN
from dtbacklash.config.groups import packaged_options

pytestmark = [pytest.mark.check, pytest.mark.usefixtures("undrawn")]

FILES = {"profile": "t_s,gap_deg\n0,0\n300,90\n", "reference": "t_s,r_mm\n0,0\n0.5,1\n300,1\n"}
LAW = "A: [[1]]\nB: [[0, 0, 0]]\nC: [0]\nD: [1, -1, 0]\n"
#: what makes a choice short; the paper's controllers are for its kind of rig, and the twin needs a full buffer
SHORT = ("duration_s=1.2", "twin.buffer=200", "twin.settle=100")
CHOICES = [(group, option) for group in RUN.groups for option in packaged_options(group)]
CHOICES.remove(("experiment", "close_the_loop"))  # has a test of its own, with a recording that says something


@pytest.mark.parametrize(("group", "option"), CHOICES, ids=[f"{g}-{o}" for g, o in CHOICES])
def test_a_choice_runs_to_its_report(group, option, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = [f"{group}={option}", *SHORT, "out=run"]
    if group == "rig" and option != "lead_screw":
        words += ["controller=open_loop"]
    if group != "experiment":  # figures of each experiment, elsewhere of none: they take the time
        words += ["figures=false"]
    if option == "csv":
        Path("signal.csv").write_text(FILES[group])
        words += [f"{group}.path=signal.csv"]
    if group == "optimizer":  # it must be asked: a step inside the run, answered at once
        words += ["reference=square", "reference.period_s=1", "twin.delay_s=0", "optimizer.max_evaluations=20"]
    if option == "state_space":
        Path("law.yaml").write_text(LAW)
        words += ["controller.file=law.yaml"]
    if option == "aging":
        words += ["changes=[{at_s:0.6,parameters:{k:9000}}]", "twin.bank_buffer=700"]
    if option == "remote":  # nobody is there: the run goes on without
        monkeypatch.setenv("DTB_TWIN_KEY", "5a" * 32)
        words += ["twin.broker=127.0.0.1:1", "twin.timeout_s=0.2"]
    GlobalHydra.instance().clear()
    assert cli.main(["run", *words]) == 0, capsys.readouterr().err
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert "</html>" in page
    assert bool(list(tmp_path.glob("run/figures/*.png"))) == (group == "experiment")
    if group in ("profile", "reference"):
        assert summary["config"][group]["kind"] == option
    if group in ("controller", "optimizer"):
        assert summary["config"][group]["name"] == option
    if group == "optimizer":
        assert summary["n_estimations"] >= 1
