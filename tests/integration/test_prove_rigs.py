"""Concealed, diagnosed blind, opened and scored on every kind of rig; recordings of six seconds."""

from dataclasses import replace

import pytest
from nominal import nominal_rig

from dtbacklash.campaign.backends import Workers
from dtbacklash.prove import conceal, run, seal
from dtbacklash.prove import draw as drawing
from dtbacklash.prove.draw import draw
from dtbacklash.prove.score import score

pytestmark = pytest.mark.check

HIDDEN = {
    "two_mass_stage": "carriage.coulomb_friction", "rotary_drive": "shaft.backlash", "pendulum": "disk.gravity",
    "oscillator": "spring.cubic_stiffness",
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n == "rotary_drive" else pytest.mark.nightly) for n in HIDDEN]
)
def test_a_rig_is_concealed_diagnosed_and_scored(name, tmp_path, monkeypatch):
    monkeypatch.setattr(drawing, "DURATION_S", (6, 6))
    rig, folder = nominal_rig(name), tmp_path / "bench"
    key = seal.read_or_make_key(seal.key_path(folder))
    secret = draw(5, rig, "single", HIDDEN[name], "minimal")
    conceal.write_case(folder / "a", replace(secret, rig=name), rig, key)
    plan = run.Plan(tmp_path / "out", folder=folder)
    cases, by, tell = run.given_cases(plan), Workers(jobs=1), lambda *_: None
    run.diagnose_missing(plan, cases, by, tell)
    secrets = run.open_seals(plan, cases)
    run.ask_oracle(plan, cases, secrets, by, tell)
    (case,) = run.gather(plan, cases, secrets)
    assert (case.error, case.rig) == ("", name)
    assert case.verdict in ("missing_physics", "unexplained")
    held = case.oracle["held_out"]
    assert held["oracle"] < 1.3
    found = score([case])
    assert (found.cases, found.failed, found.oracle_failed) == (1, 0, 0)
    assert found.figure("strict").every_of == 1
