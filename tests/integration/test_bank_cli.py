"""`twin.on_alarm=bank` in a whole run: what was named, the model taken up at rest, the columns that say so."""

import json

import numpy as np
import pandas as pd
import pytest
from told import one_line, refused

from dtbacklash.config.compose import compose
from dtbacklash.experiment.run import run_scenario

pytestmark = pytest.mark.check

AGING = (
    "experiment=aging", "profile=constant", "profile.start_deg=20", "profile.end_deg=20",
    "controller.gap_hat_deg=20",
    "reference.period_s=32", "changes=[{at_s:10,parameters:{k:7000}}]", "figures=false",
)  # fmt: skip


@pytest.fixture(scope="module")
def aged():
    return run_scenario(compose(*AGING, "duration_s=64", "twin.indexes=[frequency,structure]"))


def test_the_spring_is_named_and_the_loop_settles_again(aged):
    found = aged.estimates["found"].to_list()
    assert found[0].startswith("k: k -30")
    assert set(found[1:]) <= {"nothing"}
    overshoot = aged.moves["overshoot_pct"].to_list()
    assert overshoot[1] > 3.0
    assert max(overshoot[2:]) < 0.5 * overshoot[1]


def test_the_voltage_does_not_jump_when_the_model_changes(aged):
    trace, row = aged.trace, aged.estimates.iloc[0]
    k = int(np.searchsorted(trace["t_s"], row["t_applied_s"] - 1e-9))
    u = trace["u_v"].to_numpy()
    near = np.abs(np.diff(u[k - 200 : k + 1500]))
    assert near.max() < 1.5 * np.abs(np.diff(u[k - 1000 : k - 200])).max() + 0.05
    held = slice(k + 1500, k + 4000)
    assert np.abs(trace["q3_mm"][held] - trace["r_mm"][held]).max() < 0.01


def test_the_indexes_go_on_with_the_new_model(aged):
    """The frequency of the mode is that of the new belief, and what the structure leaves over is small again."""
    trace = aged.trace
    before, after = trace["t_s"].between(16, 20), trace["t_s"].between(48, 52)
    assert trace["structure_mm"][after].max() < 0.3 * trace["structure_mm"][before].max()


def test_of_the_paper_s_twin_the_table_is_as_it_was():
    run = run_scenario(compose(*AGING, "duration_s=20", "twin.on_alarm=estimate"))
    assert "found" not in run.estimates


def test_the_command_writes_what_was_found(typed, tmp_path):
    code, _, err = typed("run", *AGING, "duration_s=24", "out=aged")
    assert code == 0, err
    table = pd.read_csv(tmp_path / "aged" / "estimates.csv")
    assert table["found"].iloc[0].startswith("k: k -30")
    summary = json.loads((tmp_path / "aged" / "summary.json").read_text())
    assert summary["estimates"][0]["found"] == table["found"].iloc[0]
    assert summary["n_attempts"] == len(table)


FITS = "{at_s:4,parameters:{k:7000}}"


@pytest.mark.parametrize(("change", "key", "allowed"), [
    ("{at_s:3,parameters:{q:1}}", "changes[1].parameters.q", "unknown parameter"),
    ("{at_s:3,parameters:{k:-1}}", "changes[1].parameters.k", "above 0"),
    ("{at_s:3,effects:{1:{compliance:{compliance:1e-5}}}}", "changes[1].effects.1", "unknown location"),
    ("{at_s:3,effects:{screw:{rust:{depth:1}}}}", "changes[1].effects.screw.rust", "takes"),
    ("{at_s:3,effects:{screw:{compliance:null}}}", "changes[1].effects.screw.compliance", "there is none"),
    ("{at_s:3,effects:{motor_bearing:{coulomb_friction:{torque:1e10}}}}",
     "changes[1].effects.motor_bearing.coulomb_friction.torque", "from 0"),
    ("{at_s:3,effects:{screw:{compliance:{compliance:1e-5}}}}", "changes[1]", "keeps the bodies"),
    ("{at_s:3,effects:{gear:{backlash:{half_gap:0.3}}}}", "changes[1].effects.gear.backlash", "profile.*"),
])  # fmt: skip
def test_a_change_that_does_not_fit_the_rig_is_refused(change, key, allowed):
    """Named with its place in the list, whatever the order of the times."""
    with refused(allowed, key=key):
        run_scenario(compose("duration_s=5", "controller=nimc_fixed", f"changes=[{FITS},{change}]"))


@pytest.mark.parametrize(("words", "said"), [
    (("changes=[{at_s:1,effects:{gear:{backlash:{half_gap:0.3}}}}]",), "changes[0].effects.gear.backlash="),
    (("changes=[{at_s:inf,parameters:{k:7000}}]",), "changes[0].at_s=inf: must be a finite number"),
    (("changes=[{at_s:1,parameters:{k:abc}}]",), "changes[0].parameters.k=abc: a finite number, SI"),
    (("experiment=aging",), "changes[0].at_s=130.0: must be at most 1.999 s, as the run ends at duration_s=2 s"),
])  # fmt: skip
def test_the_command_refuses_a_change_in_one_line_and_leaves_nothing(typed, tmp_path, words, said):
    assert said in one_line(typed("run", *words, "duration_s=2", "out=aged"))
    assert not list(tmp_path.iterdir())


@pytest.mark.nightly
def test_the_model_is_taken_up_on_the_side_of_the_gap_where_the_motor_lies(tmp_path):
    """Far from zero, after a move down: the sign of the angle says nothing of the side."""
    (tmp_path / "r.csv").write_text("t_s,r_mm\n0,3\n15,2\n30,3\n45,2\n60,2\n")
    run = run_scenario(compose(
        "controller=nimc_twin", "twin.on_alarm=bank", "model=lead_screw", "rig.parameters.k.value=8000",
        "profile=constant", "profile.start_deg=40", "controller.gap_hat_deg=40", "sensors=encoder", "reference=csv",
        f"reference.path={tmp_path / 'r.csv'}", "duration_s=60",
    ))  # fmt: skip
    assert run.estimates["found"].iloc[0].startswith("k: k -20")
    overshoot = run.moves["overshoot_pct"].to_list()
    assert max(overshoot[2:]) < 0.5 * overshoot[1]


@pytest.mark.nightly
def test_of_a_machine_that_is_as_believed_nothing_is_named_without_any_noise():
    run = run_scenario(compose(
        "controller=nimc_twin", "twin.on_alarm=bank", "profile=constant", "profile.start_deg=30",
        "controller.gap_hat_deg=30", "reference.period_s=16", "duration_s=30",
    ))  # fmt: skip
    assert len(run.estimates) > 2
    assert set(run.estimates["found"]) <= {"nothing"}
