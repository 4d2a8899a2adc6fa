"""The experiment that tells rivals apart: what it expects is what another recording shows, and limits are kept."""

import json
import math
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from told import refusal, refused

import dtbacklash as dtb
from dtbacklash import cli
from dtbacklash.api.rigs import load_rig
from dtbacklash.diagnosis import diagnose
from dtbacklash.diagnosis.experiments.design import Limits, chosen, designed
from dtbacklash.diagnosis.experiments.rivalry import Rival, Rivalry
from dtbacklash.diagnosis.explain import next_experiment
from dtbacklash.diagnosis.planning import Observed, OpenModel
from dtbacklash.files import json_text, write_json
from dtbacklash.physics.rig_file import rig_content, rig_yaml
from dtbacklash.physics.simulate import simulate
from dtbacklash.recording import Recording

FRICTION, LOAD = ("load", "coulomb_friction"), ("load", "constant_load")
STEP_S = 1e-3
T = STEP_S * np.arange(3000)
ONE_WAY = 3.0 + np.sin(2 * np.pi * T)
SWING = 2.0 * np.sin(2 * np.pi * T)


@pytest.fixture(scope="module")
def nominal():
    return load_rig("rotary_drive")


@pytest.fixture(scope="module")
def seen(nominal):
    rival = OpenModel(FRICTION, (LOAD,), rig_content(nominal.with_effect(*LOAD, {"torque": -0.02})), 1.0)
    return Observed(
        STEP_S, 3.0, 4.0, {"motor_rotor": 300.0, "load": 300.0}, {"motor_rotor": 80.0, "load": 80.0},
        {"theta_m": 1e-3, "theta_l": 1e-3}, {"motor_rotor": 1e-5, "load": 1e-5}, (rival,),
    )  # fmt: skip


@pytest.fixture(scope="module")
def rivalry(nominal, seen):
    known = {"torque": {"value": 0.02, "tolerance": 0.05}}
    rival = nominal.with_effect(*LOAD, {"torque": -0.02})
    return Rivalry(nominal.with_effect(*FRICTION, known), [Rival("constant load", rival, (LOAD,))], seen)


def limits(seen, **less):
    return Limits(**{"command": seen.command, "travel": seen.travel, "speed": seen.speed} | less)


def test_a_motion_that_reverses_tells_a_load_from_friction_and_another_does_not(rivalry):
    moving = np.concatenate([ONE_WAY[:1000], ONE_WAY])  # it is moving before the part that is compared
    still, swing = (rivalry.answer(rivalry.found, u).record for u in (moving, SWING))
    (told,) = rivalry.apart(swing)
    (tied,) = rivalry.apart(still)
    assert math.sqrt(told) > 100.0
    assert told > 10.0 * tied


def test_the_found_rig_is_not_told_from_itself(rivalry, seen):
    # a rival that holds the truth is told from it by nothing, whatever it began with
    twin = Rivalry(
        rivalry.found, [Rival("itself", rivalry.nominal.with_effect(*FRICTION, {"torque": 0.021}), (FRICTION,))], seen
    )
    (apart,) = twin.apart(twin.answer(twin.found, SWING).record, exactly=True)
    assert math.sqrt(apart) < 3.0


def test_a_design_keeps_its_limits_and_tells_more_than_a_drawn_multisine(rivalry, seen):
    within = limits(seen, command=2.0, travel={"motor_rotor": 60.0, "load": 60.0})
    found = designed(rivalry, within, 2.0, 8)

    best = found.best
    assert np.abs(best.u).max() <= 2.0 + 1e-9
    for rig in (rivalry.found, rivalry.rivals[0].rig):
        answer = rivalry.answer(rig, best.u)
        assert max(answer.travel.values()) <= 60.0 * (1 + 1e-9)
        assert max(answer.speed.values()) <= 80.0 * (1 + 1e-9)
    assert min(best.apart) >= min(found.beside.apart)
    assert math.sqrt(min(best.apart)) > 100.0


def test_the_best_of_given_commands_is_the_one_that_reverses(rivalry, seen):
    found = chosen(rivalry, limits(seen), {"one_way.csv": ONE_WAY, "swing.csv": SWING})
    assert found.best.kind == "swing.csv"
    assert [t.kind for t in found.commands] == ["swing.csv", "one_way.csv"]


def test_limits_that_nothing_keeps_are_refused(rivalry, seen):
    with refused("goes beyond command_max"):
        chosen(rivalry, limits(seen, command=0.5), {"swing.csv": SWING})
    with refused("commands=short.csv: at least 20 samples"):
        chosen(rivalry, limits(seen), {"swing.csv": SWING, "short.csv": SWING[:19]})


@pytest.mark.parametrize(
    ("less", "seconds", "said"),
    [
        ({"travel": {"load": 1e-12}}, 1.0, "travel.load=1e-12: allows no motion"),
        ({"speed": {"load": 1e-12}}, 1.0, "speed.load=1e-12: allows no motion"),
        ({"command": 1e-9}, 1.0, "command_max=1e-09: allows no motion"),
        ({}, 0.019, "duration_s=0.019: at least 20 samples, 0.02 s"),
    ],
)
def test_limits_that_allow_no_motion_are_one_line(rivalry, seen, less, seconds, said):
    twin = Rivalry(rivalry.found, [Rival("itself", rivalry.found, (FRICTION,))], seen)
    with refused(said):
        designed(twin, limits(seen, **less), seconds, 4)


def test_a_rival_that_moves_without_a_command_shortens_the_experiment(rivalry, seen):
    # the load turns what rests by 10 rad within a second: the machine could be that
    found = designed(rivalry, limits(seen, travel={"motor_rotor": 3.0, "load": 3.0}), 3.0, 4)
    assert found.drifts == "constant load"
    assert 0.2 < STEP_S * len(found.best.u) < 2.0
    for rig in (rivalry.found, rivalry.rivals[0].rig):
        assert max(rivalry.answer(rig, found.best.u).travel.values()) <= 3.0 * (1 + 1e-9)
    assert designed(rivalry, limits(seen), 1.0, 2).drifts == ""
    with refused("travel.load=1e-12: constant load moves so far without a command"):
        designed(rivalry, limits(seen, travel={"load": 1e-12}), 1.0, 4)


def test_ctrl_c_keeps_the_best_and_what_is_known_is_told_early(rivalry, seen):
    told = []

    def stop(share, text):
        told.append((share, text))
        if len(told) == 4:
            raise KeyboardInterrupt

    found = designed(rivalry, limits(seen), 1.0, 20, tell=stop)
    assert found.tries == 3
    assert min(found.best.apart) > 0.0
    assert "so far multisine tell the models apart by" in told[1][1]


def test_what_is_observed_comes_back_from_its_file(seen, tmp_path):
    write_json(tmp_path / "observed.json", seen.to_json())
    assert Observed.of(json.loads((tmp_path / "observed.json").read_text())) == seen


@pytest.fixture
def folder(tmp_path, monkeypatch, rivalry, seen):
    monkeypatch.chdir(tmp_path)
    Path("found").mkdir()
    write_json(Path("found/diagnosis.json"), {"observed": seen.to_json()})
    Path("found/rig.yaml").write_text(rig_yaml(rivalry.found))
    return tmp_path


def test_the_command_writes_a_command_that_a_run_takes(folder, capsys):
    assert cli.main(["design", "found", "tries=4", "duration_s=1", "travel={load: 1 rev}", "out=next"]) == 0
    out = capsys.readouterr().out
    assert "would be told" in out
    command = pd.read_csv("next/command.csv")
    assert list(command) == ["t", "u"]
    document = json.loads(Path("next/design.json").read_text())
    assert document["travel"]["load"] <= 2.0 * math.pi * (1 + 1e-9)

    words = next(line for line in out.splitlines() if line.startswith("To see it")).split()[5:]
    assert cli.main(["run", *words, "out=ran", "figures=false"]) == 0
    ran = pd.read_parquet("ran/trace.parquet")
    assert np.allclose(ran["u_v"][:-1], command["u"][: len(ran) - 1])
    own = simulate(load_rig("found/rig.yaml"), command["u"].to_numpy()[:-1], STEP_S).sensors["theta_l"]
    assert np.allclose(ran["theta_l_rad"], own)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "give the folder of a diagnosis"),
        (["nowhere"], "must be the folder of a diagnosis"),
        (["found", "travel={wheel: 1}"], "no such body; choose of motor_rotor, load"),
        (["found", "speed={load: 1 m}"], "a number above 0, in rad/s"),
        (["found", "commands=[none.csv]"], "is not a file"),
        (["found", "duration_s=0"], "must be positive"),
        (["closed"], "leaves nothing open"),
    ],
)
def test_a_wrong_choice_is_one_line(folder, capsys, seen, words, said):
    shutil.copytree("found", "closed")
    write_json(Path("closed/diagnosis.json"), {"observed": {**seen.to_json(), "open": []}})
    assert said in refusal(capsys, "design", *words, "out=next")
    assert not Path("next").exists()


@pytest.mark.parametrize(
    ("unlogged", "rivals", "changed", "model", "said", "ends"),
    [
        (True, True, False, "", "Log the command", True),
        (False, False, True, "", "What changed is open: `J_l` or `load.coulomb_friction.torque`.", True),
        (False, False, False, "", "Nothing is ambiguous in these recordings", False),
        (True, True, False, "arm.xml", "Log the command", False),  # a design simulates rigs, not models
        (True, False, False, "", "Log the command", False),
    ],
)
def test_what_is_open_ends_with_the_command(monkeypatch, unlogged, rivals, changed, model, said, ends):
    rival = SimpleNamespace(keys=(LOAD,), beaten=False)
    open_change = SimpleNamespace(title="J_l", also_fits=("load.coulomb_friction.torque",))
    monkeypatch.setattr(next_experiment, "changes", lambda c: (open_change,) if changed else None)
    c = SimpleNamespace(
        follows=True,
        model=SimpleNamespace(keys=(FRICTION,), rig=SimpleNamespace(config=SimpleNamespace(model=model))),
        judged=SimpleNamespace(rivals={FRICTION: (rival,)} if rivals else {}),
        seen=SimpleNamespace(unlogged=lambda rig: unlogged, stretches=()),
    )
    told = next_experiment.next_experiment(c, "missing physics", None)
    assert told.startswith(said)
    assert told.endswith(next_experiment.DESIGN) == ends


@pytest.mark.check
def test_a_change_that_is_open_can_be_designed_for(nominal, tmp_path):
    # after a stay in one direction nobody knows what holds the load back since
    rng, u = np.random.default_rng(3), np.concatenate([np.full(1500, 3.0), ONE_WAY, ONE_WAY])
    parts = []
    for name, rig in ("before", nominal), ("after", nominal.with_effect(*FRICTION, {"torque": 0.015})):
        shown = simulate(rig, u, STEP_S).sensors
        y = {c: shown[c][1500:-1] + 1e-3 * rng.standard_normal(len(u) - 1500) for c in ("theta_m", "theta_l")}
        parts.append(Recording(name, None, STEP_S, STEP_S * np.arange(len(u) - 1500), {"u": u[1500:], **y}, {}))
    found = dtb.diagnose(parts, nominal, compare="change")

    (change,) = found.diagnosis.changes
    assert change.also_fits
    assert found.next_experiment.endswith(next_experiment.DESIGN)
    found.save(tmp_path / "found")
    page = (tmp_path / "found" / "report.html").read_text()
    assert "dtb design ." in page
    best = dtb.design(tmp_path / "found", "tries=2", "duration_s=2").best
    assert len(best.apart) >= len(change.also_fits)


@pytest.mark.check
def test_a_diagnosis_leaves_what_a_design_starts_from(nominal):
    rng, u = np.random.default_rng(3), np.concatenate([np.full(1500, 3.0), ONE_WAY, ONE_WAY])
    shown = simulate(nominal.with_effect(*FRICTION, {"torque": 0.02}), u, STEP_S).sensors
    y = {c: shown[c][1500:-1] + 1e-3 * rng.standard_normal(len(u) - 1500) for c in ("theta_m", "theta_l")}
    recording = Recording("one way", None, STEP_S, STEP_S * np.arange(len(u) - 1500), {"u": u[1500:], **y}, {})
    found = diagnose(recording, nominal)

    assert "dtb design" in found.next_experiment
    seen = Observed.of(json.loads(json_text(found.to_json()))["observed"])
    assert {*seen.open[0].effects, seen.open[0].instead_of} == {FRICTION, LOAD}
    assert seen.command == pytest.approx(np.abs(u).max(), rel=1e-3)
    assert seen.noise == pytest.approx(dict.fromkeys(y, 1e-3), rel=0.3)
    for body, channel in (("motor_rotor", "theta_m"), ("load", "theta_l")):
        assert seen.travel[body] == pytest.approx(np.ptp(y[channel][: int(0.8 * len(recording.t_s))]), rel=0.05)
