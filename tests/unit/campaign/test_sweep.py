"""Names of jobs, their status, the table."""

import pandas as pd
import pytest

from dtbacklash import files
from dtbacklash.campaign import sweep
from dtbacklash.campaign.application import APPLICATIONS, find
from dtbacklash.commands import hydra_task
from dtbacklash.commands.run import APPLICATION as RUN
from dtbacklash.commands.run import FIGURES as FIGURES_OF_MERIT
from dtbacklash.config.hydra_app import sweep_name


def job(folder, name="seed=1", mark="abc"):
    return sweep.SweepJob(name, {"seed": name.split("=")[1]}, [name], folder / name, mark)


def finish(one, mark="abc"):
    one.folder.mkdir()
    (one.folder / "summary.json").write_text("{}")
    one.tell({"status": "done", "fingerprint": mark, "figures": {"overshoot_pct_max": 1.5}})


def test_a_job_is_named_by_its_choices():
    choices = {"controller": "imc", "twin.delay_s": "0"}
    assert sweep.job_name(choices, []) == "controller=imc,twin.delay_s=0"


def test_names_that_a_file_cannot_have_stay_apart():
    names = {sweep.job_name({"rig": path}, [f"rig={path}"]) for path in ("a/b.yaml", "a-b.yaml", "a b.yaml")}
    assert len(names) == 3
    assert all("/" not in name and " " not in name for name in names)
    assert len(sweep.job_name({"rig": "x" * 500}, ["x"])) <= sweep.NAME_LENGTH


def test_the_same_command_finds_its_sweep_again_in_any_order():
    assert sweep_name(["a=1,2", "b=3"])[-8:] == sweep_name(["b=3", "a=1,2"])[-8:]
    assert sweep_name(["a=1,2"]) != sweep_name(["a=1,3"])
    assert sweep_name(["rig=lead_screw,emps", "seed=1"], "diagnose").startswith("diagnose_rig_seed_")


@pytest.mark.parametrize("name", APPLICATIONS)
def test_an_application_is_found_by_its_name(name):
    assert find(name).name == name


def test_a_done_job_counts_only_with_its_settings_and_its_folder(tmp_path):
    one = job(tmp_path)
    assert not one.done()
    finish(one)
    assert one.done()
    one.fingerprint = "other"
    assert one.status() == {}
    one.fingerprint = "abc"
    (one.folder / "summary.json").unlink()
    assert one.status() == {}


def test_a_broken_status_file_means_not_done(tmp_path):
    one = job(tmp_path)
    finish(one)
    one.record.write_text('{"status": "do')
    assert not one.done()


def test_status_files_have_no_nan(tmp_path):
    one = job(tmp_path, "job=1")
    one.tell({"figures": {"settling_time_s_max": float("nan")}})
    assert files.read_json(tmp_path / "status" / "job=1.json") == {"figures": {"settling_time_s_max": None}}


@pytest.mark.parametrize(
    ("entries", "expected"),
    [
        ([{"status": "done"}, {"status": "done"}], 0),
        ([{"status": "done"}, {"status": "failed", "by_input": True}], 1),
        ([{"status": "failed", "by_input": True}] * 2, 2),
        ([{"status": "failed", "by_input": True}, {"status": "failed", "by_input": False}], 1),
    ],
)
def test_exit_codes(tmp_path, capsys, entries, expected):
    jobs = [job(tmp_path, f"seed={i}", "") for i in range(len(entries))]
    for one, entry in zip(jobs, entries, strict=True):
        one.folder.mkdir()
        (one.folder / "summary.json").write_text("{}")
        one.tell({"fingerprint": "", "error": "why", "figures": {"overshoot_pct_max": 1.0}, **entry})
    found = sweep.finish(tmp_path, jobs, RUN, kept=0)
    assert found.exit_code == expected
    table = pd.read_csv(tmp_path / "sweep.csv")
    assert list(table["status"]) == [entry["status"] for entry in entries]
    assert (tmp_path / "sweep.png").stat().st_size > 1000
    assert not list(tmp_path.rglob(".*"))
    assert hydra_task.report(found) == expected
    assert capsys.readouterr().err.count("failed: why") == sum(e["status"] == "failed" for e in entries)


def test_the_table_has_a_row_a_job_and_whole_numbers(tmp_path):
    jobs = [job(tmp_path, "seed=1"), job(tmp_path, "seed=2")]
    entries = [{"status": "done", "figures": {"n_estimations": 9}}, {"status": "failed", "error": "diverged"}]
    table = sweep.gather(jobs, entries, FIGURES_OF_MERIT)
    assert list(table.columns) == ["seed", *FIGURES_OF_MERIT, "status", "error"]
    assert table["n_estimations"].tolist()[0] == 9
    assert table.to_csv(index=False).splitlines()[2] == "2,,,,,,failed,diverged"


def test_the_run_of_another_sweep_is_not_counted_as_ones_own(tmp_path):
    one = job(tmp_path)
    finish(one, "other settings")
    found = sweep.finish(tmp_path, [one], RUN, kept=0)
    assert found.exit_code == 1
    assert "another sweep, with other settings" in found.table["error"][0]
    assert found.table["overshoot_pct_max"].isna().all()


def test_a_worker_that_met_a_full_disk_is_no_wrong_input(tmp_path):
    one = job(tmp_path)
    one.died(OSError(28, "No space left on device"))
    assert one.status()["by_input"] is False
    assert one.status()["error"].endswith("cannot be written: the disk is full")
