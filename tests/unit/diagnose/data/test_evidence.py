"""Stretches over which losses are compared, and zeros that are free, of several recordings."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtbacklash.diagnose import Record
from dtbacklash.diagnose.data.compare import Block
from dtbacklash.diagnose.data.evidence import Evidence, stretch_of

BLOCK = Block("rig", ("x", "v"), 0.01, step_s=1e-3)


def record(number: int, samples: int, step_s: float = 1e-3) -> Record:
    held = np.arange(samples) >= samples // 2
    y = {"x": np.zeros(samples), "v": np.zeros(samples)}
    return Record(step_s, np.zeros(samples), y, ~held, held, recording=number, own_zero=number > 0)


def evidence_of(records: list[Record], block: Block = BLOCK) -> Evidence:
    return Evidence(None, records, [block], {}, {block.name: np.ones(2)}, stretch_of(records), None)


@given(st.lists(st.tuples(st.integers(50, 4000), st.sampled_from([1e-3, 2e-3])), min_size=2, max_size=5))
def test_no_stretch_crosses_a_border_between_recordings(lengths):
    records = [record(k, n, step) for k, (n, step) in enumerate(lengths)]
    evidence = evidence_of(records)
    # the residual is the number of the recording: a stretch of two would have a mean square between
    residuals = {"rig": [np.full((r.samples, 2), float(r.recording)) for r in records]}
    means, whose = evidence.stretches(residuals, "rig"), evidence.recordings_of_stretches()
    assert means.shape == (2, len(whose))
    assert means == pytest.approx(np.tile(whose.astype(float) ** 2, (2, 1)))
    assert set(whose.tolist()) == set(range(len(records)))  # each has one at least


def test_the_stretches_of_a_gap_count_on_within_a_recording():
    first, second = record(0, 1000), replace(record(0, 700), from_s=2.0)
    evidence = evidence_of([first, second])
    assert evidence.recordings_of_stretches().tolist() == [0] * (850 // evidence.stretch)


def test_what_is_correlated_counts_once_at_any_rate():
    fast, slow = record(0, 4000, 1e-3), record(1, 4000, 4e-3)
    each = [evidence_of([r]).correlated for r in (fast, slow)]
    assert each[0] == pytest.approx(4.0 * each[1])  # as long in seconds
    independent = sum(4000 / c for c in each)
    assert evidence_of([fast, slow]).correlated == pytest.approx(8000 / independent)


def test_a_free_zero_is_taken_off_further_recordings_only():
    rng = np.random.default_rng(0)
    block = replace(BLOCK, zeros=("x",))
    records = [record(0, 400), record(1, 300), replace(record(1, 200), from_s=1.0)]
    noise = [rng.normal(size=(r.samples, 2)) for r in records]
    off = [e + np.array([5.0, 7.0]) for e in noise]
    left = evidence_of(records, block).without_zeros(block, off)
    assert left[0] is off[0]
    assert np.concatenate(left[1:])[:, 0].mean() == pytest.approx(0.0, abs=1e-12)
    # one zero for both stretches of the recording, and none for the speed
    assert left[1] - noise[1] == pytest.approx(np.tile((left[1] - noise[1])[0], (300, 1)))
    assert (left[2] - noise[2])[0, 0] == pytest.approx((left[1] - noise[1])[0, 0])
    assert left[1][:, 1] == pytest.approx(off[1][:, 1])


def test_a_block_is_as_fast_in_seconds_at_any_rate():
    block = Block("rig", ("x",), 0.02, pulled="x", gains=(0.06, 0.9), step_s=2e-3)
    fast = block.at(5e-4)
    assert fast.tempo / 5e-4 == pytest.approx(block.tempo / 2e-3)
    assert fast.pull / 5e-4 == pytest.approx(block.pull / 2e-3)
    assert fast.gains == pytest.approx((0.015, 0.225))
    assert block.at(2e-3) is block
