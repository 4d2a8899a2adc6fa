"""The guarded twin in the closed loop: random starts, noises, gaps and buffers (``python -m studies guard``)."""

import numpy as np
import pandas as pd
import pytest

from studies.campaign import Bench, guard_rows, guard_words, harmful, new_bench, random_case, run_campaign, run_case

pytestmark = pytest.mark.nightly

CASES, SEED = 100, 7


@pytest.fixture(scope="module")
def bench() -> Bench:
    return new_bench()


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    return run_campaign(CASES, SEED)


def test_no_guarded_estimate_makes_the_loop_worse(table: pd.DataFrame) -> None:
    assert int(harmful(table, "guarded").sum()) == 0
    # and whatever the noise does, not by more than 2 % of the moves
    assert table["harm_guarded"].max() < 0.02


def test_plain_bfgs_makes_it_worse(table: pd.DataFrame) -> None:
    """The same starts on the same buffers without the guard."""
    assert harmful(table, "plain").mean() > 0.4
    assert table["harm_plain"].max() > 1.0
    assert table["overshoot_plain_pct"].max() > 200.0


def test_the_guard_is_not_timid(table: pd.DataFrame) -> None:
    informative = table["informative"]
    assert informative.sum() > 0.2 * CASES
    # 98 % of a thousand; of the thirty or so here the share scatters by 3 %
    assert table["accepted"][informative].mean() > 0.8
    # what it accepts brings the loop to the exact one: micrometres, where the old estimate was far off
    far = table["accepted"] & (table["rms_old_um"] > 100.0)
    assert far.sum() >= 5
    assert table["rms_guarded_um"][far].median() < 0.05 * table["rms_old_um"][far].median()


def test_a_rejected_estimate_changes_nothing(table: pd.DataFrame) -> None:
    rejected = table[~table["accepted"]]
    assert len(rejected) > 0
    assert np.array_equal(rejected["guarded_deg"], rejected["old_deg"])
    assert (rejected["harm_guarded"] == 0.0).all()


def test_cases_are_repeatable(bench: Bench, table: pd.DataFrame) -> None:
    again = run_case(bench, random_case(SEED, 3))
    for column in ("gap_deg", "plain_deg", "guarded_deg", "rms_plain_um", "scatter_um"):
        assert again[column] == table[column][3]


def test_a_harmful_estimate_is_counted(table: pd.DataFrame) -> None:
    """The count can fail: one case made 2 % worse than its scatter allows is seen, and so is divergence."""
    spoiled = table.copy()
    scatter = 1e-3 * spoiled["scatter_um"] / spoiled["moves_rms_mm"]
    spoiled.loc[5, "harm_guarded"] = 2.0 * scatter[5] + 0.02
    spoiled.loc[6, "harm_guarded"] = np.inf
    spoiled.loc[7, "harm_guarded"] = np.nan
    rows = {row["what"]: row for row in guard_rows(spoiled)}
    assert (rows["guarded twin"]["worse"], rows["guarded twin"]["pass"]) == (3, "no")
    assert {row["what"]: row for row in guard_rows(table)}["guarded twin"]["pass"] == "yes"
    assert "accepted" in guard_words(table, SEED)[1]
