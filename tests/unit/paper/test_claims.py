"""Every claim could fail: what it is about is spoilt (or mended), and the verdict turns."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from dtbacklash.paper import backlash_claims, linear_claims, novelty_claims, run_experiments, twin_claims
from dtbacklash.paper.claim import Claim, between
from dtbacklash.paper.experiments import SCENARIOS, Experiments

Spoil = Callable[[Experiments], Experiments]


@pytest.fixture(scope="module")
def experiments() -> Experiments:
    return run_experiments()


def with_run(x: Experiments, name: str, **parts: object) -> Experiments:
    """The experiments with one run changed; its moves are taken as they are."""
    return replace(x, runs={**x.runs, name: replace(x.runs[name], **parts)})


def with_twin(name: str, **settings: object) -> Spoil:
    def spoil(x: Experiments) -> Experiments:
        config = copy.deepcopy(x.runs[name].config)
        for key, value in settings.items():
            setattr(config.twin, key, value)
        return with_run(x, name, config=config)

    return spoil


def scaled(name: str, table: str, column: str, factor: float) -> Spoil:
    def spoil(x: Experiments) -> Experiments:
        frame: pd.DataFrame = getattr(x.runs[name], table)
        return with_run(x, name, **{table: frame.assign(**{column: factor * frame[column]})})

    return spoil


def instead(name: str, other: str) -> Spoil:
    """Run and moves of another experiment in the place of this one's."""

    def spoil(x: Experiments) -> Experiments:
        return replace(x, runs={**x.runs, name: x.runs[other]}, moves={**x.moves, name: x.moves[other]})

    return spoil


def slower(x: Experiments) -> Experiments:
    for name in ("fig13", "no_delay", "unguarded"):
        x = scaled(name, "estimates", "wall_s", 100.0)(x)
    return x


TURNS: dict[str, tuple[Callable[[Experiments], list[Claim]], Spoil, str]] = {
    "the former filter": (
        novelty_claims.novelty_filter, with_twin("fig14", novelty_filter="cheby2"),
        "Novelty filter: cut-off over omega_d",
    ),
    "a slow twin": (
        twin_claims.estimator, slower, "time that the twin simulates over the time that an estimate takes",
    ),
    "a slow observer": (
        twin_claims.estimator, with_twin("fig13", observer_pole_rad_s=20.0),
        "settling time of the twin's linear estimator",
    ),
    "no time to settle": (
        twin_claims.estimator, with_twin("fig13", settle=100), "estimator's error from sample k_s on, over its largest",
    ),
    "an index as loud as the noise": (
        novelty_claims.noise, scaled("noise", "trace", "novelty_mm", 10.0),
        "Largest index of the same run over the threshold, a sensor with 0.05 mm of noise",
    ),
    "a sensor without noise": (
        novelty_claims.noise, instead("noise", "no_gap"),
        "Share of the time at rest in which the amplitude of the raw error is above the threshold, a sensor with "
        "0.05 mm of noise",
    ),
    "the three events by a hair": (
        novelty_claims.figure_14, scaled("fig14", "trace", "novelty_mm", 0.5),
        "Fig. 14: index at the weakest event over the threshold",
    ),
    "springs as they were": (
        novelty_claims.tracked_frequency, instead("soft", "fig8"),
        "Frequency of the transient over the nominal omega_d, springs 20 % softer",
    ),
    "Fig. 13 without a twin": (twin_claims.figure_13, instead("fig13", "fig14"), "Fig. 13: overshoot"),
    "no model of the gap": (
        backlash_claims.exact, instead("exact", "linear"),
        "NIMC with the exact gap of 100 deg: rms distance from q3 without a gap, over that of linear IMC",
    ),
    "a disturbance that stays": (
        linear_claims.disturbance, scaled("force", "trace", "q3_mm", 1.01),
        "error that a constant force on mass 3 leaves, over what it is without feedback",
    ),
    "two modes": (
        linear_claims.figure_4, instead("fig4", "fig6"), "Fig. 4: share of the transient's power in the dominant mode",
    ),
    "a structure that is not felt": (  # a claim that is known to fail: it has to be seen when it begins to hold
        linear_claims.load, instead("load", "fig6"),
        "Fig. 6: what the structure's load on the motor changes, the paper's internal model",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", TURNS)
def test_a_claim_turns_with_what_it_is_about(experiments: Experiments, case: str) -> None:
    claims, spoil, name = TURNS[case]
    before, after = ({c.claim: c.passed for c in claims(x)}[name] for x in (experiments, spoil(experiments)))
    assert before != after


def test_the_play_operator_is_not_compared_with_itself(experiments: Experiments) -> None:
    name = "Fig. 7: play operator against (16) and (17), integrated step by step"
    spoilt = replace(
        experiments.play, theta_d_deg=experiments.play.theta_d_deg + np.where(experiments.play.t_s > 5, 2, 0)
    )
    found = {c.claim: c.passed for c in linear_claims.figure_7(replace(experiments, play=spoilt))}
    assert not found[name]


def test_every_experiment_is_used_by_a_run_of_its_own(experiments: Experiments) -> None:
    assert set(experiments.runs) == set(experiments.moves) == set(SCENARIOS)


@pytest.mark.parametrize("ours", [math.nan, math.inf, -math.inf, 0.9, 2.1])
def test_what_is_no_number_or_outside_fails_and_says_why(ours: float) -> None:
    claim = between("a claim", "1", "about one", ours, "m", 1.0, 2.0, "as it is said", "it is not")
    assert not claim.passed
    assert claim.reason.endswith("It fails because it is not")
