"""What an experiment would show before it is made: sizes, angles, and what is advised."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from told import refusal

from dtbacklash import cli
from dtbacklash.api.experiments import isolable
from dtbacklash.api.rigs import load_rig
from dtbacklash.config.commands import IsolabilityConfig
from dtbacklash.config.compose import compose_for
from dtbacklash.config.grammar import GRAMMARS
from dtbacklash.diagnosis.engine.fit import FitProblem
from dtbacklash.diagnosis.engine.motion import motion_of
from dtbacklash.diagnosis.experiments.isolability import SHOWS, isolability
from dtbacklash.diagnosis.experiments.planned import planned
from dtbacklash.physics.simulate import simulate
from dtbacklash.recording import Recording

STEP_S = 1e-3
NOISE = {"theta_m": 1e-3, "theta_l": 1e-3, "i_m": 5e-3}
MOTOR, LOAD = "motor_rotor", "load"


def recorded(rig, u, sensors=tuple(NOISE)):
    shown, rng = simulate(rig, u, STEP_S).sensors, np.random.default_rng(0)
    y = {name: shown[name][: len(u)] + size * rng.standard_normal(len(u)) for name, size in NOISE.items()}
    channels = {"u": u, **{name: y[name] for name in sensors}}
    return Recording("plan", None, STEP_S, STEP_S * np.arange(len(u)), channels, {})


def plan(direction):
    t = STEP_S * np.arange(8000)
    swing = np.sin(2 * np.pi * 0.5 * t) + 0.5 * np.sin(2 * np.pi * 3 * t)
    return (3 * (1 - np.exp(-t / 0.3)) if direction == "one" else 0.0) + swing * (t > (direction == "one"))


@pytest.fixture(scope="module")
def drive():
    return load_rig("rotary_drive")


def test_one_direction_confuses_what_both_directions_tell_apart(drive):
    one, both = (isolability(drive, recorded(drive, plan(way))) for way in ("one", "both"))

    pair = (MOTOR, "coulomb_friction"), (MOTOR, "constant_load")
    assert one.one_way == (MOTOR, LOAD)
    assert one.sine(*pair) < 0.05
    assert both.one_way == ()
    assert both.sine(*pair) > 0.95
    assert both.sine((MOTOR, "viscous_friction"), (MOTOR, "asymmetric_friction")) > 0.95
    # a law that differs by a sign is not asked about where there is none
    assert (MOTOR, "asymmetric_friction") in one.hidden
    # a stiff shaft: nobody knows where a friction acts
    assert both.sine((MOTOR, "coulomb_friction"), (LOAD, "coulomb_friction")) < 0.2


def test_what_tells_a_confused_pair_apart_is_computed(drive):
    u = plan("one")
    found = isolability(drive, recorded(drive, u), turned=lambda: recorded(drive, np.concatenate([u, -u])))

    said = next(p for p in found.pairs if {p.first[1], p.second[1]} == {"coulomb_friction", "constant_load"})
    assert "turned around" in said.advice
    assert said.sentence.startswith("Co")
    assert found.pairs[0].advice


@pytest.mark.parametrize("key", [(LOAD, "viscous_friction"), (MOTOR, "quadratic_drag"), ("sensor_theta_l", "delay")])
def test_an_effect_of_the_size_that_shows_is_five_standard_errors_in_an_exact_pass(drive, key):
    recording = recorded(drive, plan("both"))
    effect = next(e for e in isolability(drive, recording).effects if e.key == key)

    p = planned(drive, recording, 0.01)
    gains = p.segments.gains(p.segments.nominal, p.noise_levels)
    problem = FitProblem(p.segments, p.segments.nominal, (), motion_of(p.segments, p.segments.nominal, gains), 1.0)
    x = problem.start()
    base = problem.residuals(x, gains)
    added = p.segments.nominal.with_effect(*key, {**effect.at, effect.parameter: effect.shows_from})
    moved = np.zeros_like(base)
    moved[: problem.innovation_rows] = p.segments.residuals(added, gains) - base[: problem.innovation_rows]
    J = problem.jacobian(x, gains, base)
    left = moved - J @ np.linalg.lstsq(J, moved, rcond=1e-10)[0]
    assert np.linalg.norm(left) == pytest.approx(SHOWS, rel=0.05)


@pytest.mark.parametrize(
    ("word", "said"),
    [("record=[theta_x]", "no such sensor; choose of theta_m, theta_l, i_m"), ("command=none.csv", "is not a file"),
     ("controller=imc", "controller"), ("command=still.csv", "moves nothing")],
)  # fmt: skip
def test_a_wrong_plan_is_one_line(tmp_path, monkeypatch, capsys, word, said):
    monkeypatch.chdir(tmp_path)
    pd.DataFrame({"t": STEP_S * np.arange(1000), "u": 0.0}).to_csv("still.csv", index=False)
    assert said in refusal(capsys, "isolability", "rig=rotary_drive", word, "out=found")
    assert not Path("found").exists()


def test_a_sensor_that_is_left_out_is_advised_where_it_helps(drive):
    words = ("rig=pendulum", "reference.rms_v=2", "duration_s=6")
    config = compose_for(GRAMMARS["isolability"], IsolabilityConfig, *words, "record=[theta]")
    alone, whole = isolable(config), isolable(compose_for(GRAMMARS["isolability"], IsolabilityConfig, *words))
    helped = [p for p in alone.pairs if "omega recorded as well" in p.advice]
    assert all(whole.sine(p.first, p.second) > p.sine for p in helped)
    assert not {p for p, _ in (e.key for e in alone.effects)} & {"sensor_omega"}


def test_the_command_writes_sizes_matrix_and_page(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    pd.DataFrame({"t": STEP_S * np.arange(4001), "u": np.append(plan("both")[:4000], 0.0)}).to_csv(
        "plan.csv", index=False
    )

    assert cli.main(["isolability", "rig=rotary_drive", "command=plan.csv", "out=found"]) == 0
    out = capsys.readouterr().out
    assert "cannot be told apart" in out
    assert "taken as exact" in out
    document = json.loads(Path("found/isolability.json").read_text())
    matrix = pd.read_csv("found/matrix.csv", index_col=0)
    sizes = pd.read_csv("found/effects.csv")
    assert list(matrix.columns) == [f"{row.location}.{row.effect}" for row in sizes.itertuples()]
    assert np.allclose(matrix, matrix.T)
    assert len(document["confused"]) == int(((matrix.to_numpy() < 0.2).sum() - len(matrix)) / 2)
    assert Path("found/figures/matrix.png").stat().st_size > 10_000
