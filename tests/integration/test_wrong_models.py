"""The guarded twin in loops whose model is wrong (``python -m studies wrong_models``)."""

import math

import numpy as np
import pandas as pd
import pytest

from dtbacklash.config.compose import compose
from dtbacklash.physics.rig import build_rig
from studies.wrong_models import WAYS, live, random_case, run_wrong_models, wrong_model_rows, wrong_model_words

pytestmark = pytest.mark.nightly

CASES, SEED = 40, 23


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    return run_wrong_models(CASES, SEED)


def test_no_loop_is_worse_but_those_that_the_exact_gap_makes_worse(table: pd.DataFrame) -> None:
    rows = {row["what"]: row for row in wrong_model_rows(table)}
    assert rows["guarded twin"]["worse"] == rows["guarded twin"]["despite"]
    assert rows["old estimate kept"]["worse"] == 0


def test_more_right_estimates_are_accepted(table: pd.DataFrame) -> None:
    rows = {row["what"]: row for row in wrong_model_rows(table)}
    assert rows["guarded twin"]["right_over_former"] > 1.5
    assert rows["guarded twin"]["right"] > 0.65 * rows["guarded twin"]["estimations"]
    assert f"{rows['guarded twin']['right']} of" in wrong_model_words(table, SEED)[1]


def test_a_worse_loop_is_counted(table: pd.DataFrame) -> None:
    spoiled = table.copy()
    spoiled.loc[3, ["worse_guarded", "worse_exact"]] = True, False
    row = next(row for row in wrong_model_rows(spoiled) if row["what"] == "guarded twin")
    assert row["worse"] == row["despite"] + 1
    assert row["pass"] == "no"


@pytest.mark.parametrize(
    ("overrides", "error_deg", "accepted"),
    [
        (["rig.parameters.k.value=8000"], 0.2, 9),
        (["rig.parameters.k.value=8000", "sensors=encoder"], 0.5, 9),
        (["rig.effects.screw.compliance.compliance=1e-5"], 7.0, 9),
    ],
)
def test_rigs_whose_wrong_estimates_the_likelihood_ratio_refuses(
    overrides: list[str], error_deg: float, accepted: int
) -> None:
    config = compose("controller=nimc_twin", "profile.t_start_s=50", "profile.t_end_s=150", *overrides)
    believed = build_rig(compose("controller=nimc_twin").rig)
    found = live(config, believed, WAYS["guarded"])
    taken = found.estimates[found.estimates["accepted"]]
    error = (taken["gap_deg"] - taken["true_gap_deg"]).abs()
    assert len(taken) == accepted
    assert error.max() < error_deg
    assert (error < 2.0 * taken["std_deg"] + 0.1).all()
    assert found.overshoot_pct < live(config, believed, None).overshoot_pct - 3.0


def test_friction_that_looks_like_a_gap_is_not_taken_where_there_is_none() -> None:
    """Ground friction moves every estimate by about 7 deg; its standard error says so."""
    overrides = ("rig.effects.mass_3.ground_friction.force=0.2", "rig.parameters.c.value=45")
    config = compose("controller=nimc_twin", *overrides)
    found = live(config, build_rig(compose("controller=nimc_twin").rig), WAYS["guarded"]).estimates
    error = np.abs(found["gap_deg"] - found["true_gap_deg"])
    assert not found["accepted"][found["true_gap_deg"] < 5.0].any()
    assert (error < 3.0 * found["std_deg"]).all()
    assert (found["std_deg"] > 3.0).all()


def test_cases_are_repeatable() -> None:
    base = compose("controller=nimc_twin", "profile=constant")
    one, again, other = (random_case(base, SEED, i) for i in (1, 1, 2))
    assert (one.drawn, one.config) == (again.drawn, again.config)
    assert one.drawn != other.drawn
    assert all(math.isfinite(size) for size in one.drawn.values())
