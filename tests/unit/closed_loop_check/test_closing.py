"""The loop with each belief: what is found makes it as good as knowing the truth."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.closed_loop_check import COLUMNS, VARIANTS, compare, record, recording_of, table
from dtbacklash.config.compose import compose
from dtbacklash.physics.rig import build_rig

WORDS = ("sensors=encoder", "figures=false", "duration_s=62", "profile=constant", "profile.start_deg=40",
         "controller.gap_hat_deg=40")  # fmt: skip
TRUE = ("rig.parameters.k.value=8000", "rig.effects.motor_bearing.coulomb_friction.torque=0.03")


@pytest.fixture(scope="module")
def runs():
    config = compose(*WORDS, *TRUE)
    return compare(config, nominal_rig(), build_rig(config.rig))


def test_what_is_found_is_as_good_as_the_truth(runs):
    rows = table(runs).set_index("belief")
    assert list(rows.index) == list(VARIANTS)
    assert list(rows.reset_index().columns) == COLUMNS
    # here what was found is the truth: the same loop, to the last bit
    assert np.array_equal(runs["both"].trace["q3_mm"], runs["truth"].trace["q3_mm"])
    assert rows.loc["both", "overshoot_pct"] < 0.5 * rows.loc["nominal", "overshoot_pct"]
    assert rows.loc["both", "accepted"] >= rows.loc["nominal", "accepted"]


def test_a_loop_that_diverged_has_no_figures(runs):
    rows = table({**runs, "both": None}).set_index("belief")
    assert rows.loc["both", "overshoot_pct"] == np.inf
    assert rows.loc["both", "accepted"] == 0


def test_the_machine_is_recorded_in_a_loop_that_believes_in_its_nominal_rig():
    config = compose(*WORDS, *TRUE)
    run = record(config, nominal_rig())
    recording = recording_of(run)
    assert run.rig.effects == build_rig(config.rig).effects
    assert {"u", "r", "theta_m", "q3"} <= set(recording.channels)
    assert recording.channels["q3"].std() > 2e-4
    assert replace(run.config, task="run") == run.config


def test_the_machine_is_recorded_before_it_changes():
    """A change of the loop may come after the end of the recording, which is shorter."""
    config = compose(*WORDS, "changes=[{at_s:10,parameters:{k:7000}},{at_s:50,parameters:{k:6000}}]")
    nominal = nominal_rig()
    changed, plain = record(config, nominal), record(compose(*WORDS), nominal)
    assert config.duration_s > changed.t_s[-1]
    assert np.array_equal(changed.trace["q3_mm"], plain.trace["q3_mm"])
