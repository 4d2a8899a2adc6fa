"""What a diagnosis on its way says of its stages."""

import pytest

from dtbacklash.diagnosis.preliminary import DRAWING, READING, Stages


@pytest.mark.parametrize(
    ("depth", "stages"),
    [("full", [1, 2, 3, 3, 4, 5, 6]), ("quick", [1, 2, 3, 3, 3, 4, 5]), ("none", [1, 2, 2, 2, 2, 3, 4])],
)
def test_each_step_is_of_a_stage_and_the_last_is_not_yet_done(depth, stages):
    told = Stages(depth)
    steps = [(READING, 0.0), ("recalibrating", 0.02), ("round 1", 0.1), ("trying others", 0.5), ("rivals", 0.75),
             ("modelling", 0.9), (DRAWING, 1.0)]  # fmt: skip
    for stage, step in zip(stages, steps, strict=True):
        assert told.reached(*step) == (f"stage {stage} of {told.number}, {step[0]}", (stage - 1) / told.number)
    assert told.number == stages[-1]


def test_the_share_done_never_falls():
    told = Stages("full")
    shares = [told.reached("a step", counted)[1] for counted in (0.02, 0.1, 0.5, 0.3, 0.04, 0.6, 0.1, 0.9)]
    assert shares == sorted(shares)
