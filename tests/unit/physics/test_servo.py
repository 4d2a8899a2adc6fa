"""A drive with a position loop: what it does to motion, its limits, and what is refused of it."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from reference import rigs

from dtbacklash.config.rig import RigConfig
from dtbacklash.errors import UserError
from dtbacklash.physics.bodies import natural_frequencies_hz
from dtbacklash.physics.rig import build_rig
from dtbacklash.physics.simulate import simulate

STEP_S = 1e-3
PAGE = Path(__file__).resolve().parents[3] / "docs" / "machine.md"


def test_its_loop_is_a_spring_to_where_it_is_told():
    p = rigs.served_carriage().config.parameters
    own = np.sqrt(p["K_p"].value / p["M"].value) / (2 * np.pi)
    assert natural_frequencies_hz(rigs.served_carriage()) == pytest.approx([own], rel=1e-12)


def test_without_a_speed_loop_there_is_no_speed_limit():
    config = rigs.served().config
    servo = {k: v for k, v in config.elements["servo"].items() if k != "speed_gain"}
    alone = build_rig(replace(config, elements={**config.elements, "servo": servo}))
    limited = alone.with_effect("servo", "effort_limit", {"effort": 0.5})
    assert np.isfinite(simulate(limited, np.ones(50), STEP_S).sensors["theta"]).all()
    with pytest.raises(UserError, match=r"rig.effects.servo.speed_limit.speed=2.0: needs a servo with a speed_gain"):
        simulate(alone.with_effect("servo", "speed_limit", {"speed": 2.0}), np.ones(50), STEP_S)


def test_a_lag_of_an_actuator_is_exact():
    """x'' = F/M (1 - exp(-t/T)) from rest."""
    lag, t = 0.03, STEP_S * np.arange(501)
    rig = rigs.carriage().with_effect("motor", "lag", {"time": lag})
    x = simulate(rig, np.ones(500), STEP_S).sensors["q"]
    expected = 35.0 / 95.0 * (0.5 * t**2 - lag * t - lag**2 * np.expm1(-t / lag))
    assert np.allclose(x, expected, rtol=0, atol=1e-12)


def test_the_rig_of_the_docs_is_one():
    (block,) = re.findall(r"```yaml\n(elements.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    rig = build_rig(RigConfig(**yaml.safe_load(block), sensors={"theta": {"of": "arm", "quantity": "position"}}))
    assert rig.command_unit == "rad"
    assert rig.tolerances == {"servo": {"speed_limit": {"speed": 0.1}}}
    assert np.isfinite(simulate(rig, np.ones(20), STEP_S).sensors["theta"]).all()
