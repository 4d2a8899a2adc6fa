"""How recordings are cut into what is fitted to, what chooses and what judges."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtbacklash.diagnose import Record
from dtbacklash.diagnose.data.evidence import by_recording, stretch_of
from dtbacklash.diagnose.search.parts import divided, for_judgement, marked
from dtbacklash.diagnose.settings import SETTINGS

#: (samples, sample time) of a recording, and into how many stretches a gap cuts it
LENGTHS = st.lists(
    st.tuples(st.integers(200, 6000), st.sampled_from([5e-4, 1e-3, 2e-3]), st.integers(1, 3)), min_size=1, max_size=5
)


def recording(number: int, samples: int, step_s: float, pieces: int, judges: bool | None = None) -> list[Record]:
    """The stretches of one, without signals; judges : None: its last 40 % are held out, else all or nothing is."""
    held = np.arange(samples) >= 0.6 * samples if judges is None else np.full(samples, judges)
    ends = np.linspace(0, samples, pieces + 1).astype(int)
    return [
        Record(step_s, np.zeros(b - a), {"x": np.zeros(b - a)}, ~held[a:b], held[a:b], a * step_s, recording=number)
        for a, b in pairwise(ends)
    ]


def joined(records: list[Record], part: str) -> np.ndarray:
    return np.concatenate([getattr(r, part) for r in records])


@given(LENGTHS)
def test_each_recording_is_fitted_chosen_by_and_judged_with_its_end(lengths):
    given_records = [r for k, one in enumerate(lengths) for r in recording(k, *one)]
    records = divided(given_records)
    assert [r.samples for r in records] == [r.samples for r in given_records]
    for (samples, _, _), own in zip(lengths, by_recording(records), strict=True):
        train, held, judge = (joined(own, part) for part in ("train", "held", "judge"))
        assert np.all(train.astype(int) + held + judge == 1)  # every sample has one purpose
        judging = round(SETTINGS.judging_share * (~(np.arange(samples) < 0.6 * samples)).sum())
        assert judge.sum() == judging
        assert judge[samples - judging :].all()
        assert train.sum() == pytest.approx(0.6 * samples, abs=10)  # each turn is whole samples


@given(LENGTHS)
def test_a_recording_is_marked_as_if_it_were_alone(lengths):
    together = marked([r for k, one in enumerate(lengths) for r in recording(k, *one)])
    for k, one in enumerate(lengths):
        alone = marked(recording(0, *one))
        own = [r for r in together if r.recording == k]
        assert all(np.array_equal(a.judge, b.judge) for a, b in zip(own, alone, strict=True))


@given(LENGTHS.filter(lambda lengths: len(lengths) > 1), st.data())
def test_what_judges_alone_is_not_fitted_before_the_end(lengths, data):
    out = data.draw(st.integers(0, len(lengths) - 1))
    records = divided([r for k, one in enumerate(lengths) for r in recording(k, *one, judges=k == out)])
    for k, own in enumerate(by_recording(records)):
        assert joined(own, "train").any() == (k != out)
        assert joined(own, "held").any() == (k == out)
        assert joined(own, "judge").any() == (k == out)


@pytest.mark.parametrize("steps", [(1e-3, 1e-3), (1e-3, 4e-3)])
def test_the_parts_take_turns_in_each_recording(steps):
    records = divided([r for k, step in enumerate(steps) for r in recording(k, round(60.0 / step), step, 1)])
    for own in by_recording(records):
        changes = np.abs(np.diff(joined(own, "held").astype(int))).sum()
        assert changes > 3


def test_a_stretch_lasts_as_long_at_any_rate():
    fast, slow = recording(0, 8000, 1e-3, 1), recording(1, 2000, 4e-3, 1)
    assert stretch_of(slow) == stretch_of(fast) // 4
    both = [*fast, *slow]
    assert stretch_of(both) == pytest.approx(2 * stretch_of(slow), abs=2)  # twice the time, in samples of the slow one


def test_judging_the_last_fit_takes_all_else():
    from dtbacklash.diagnose.data.evidence import Evidence

    records = divided([*recording(0, 3000, 1e-3, 1), *recording(1, 2000, 1e-3, 1)])
    evidence = Evidence(None, records, [], {}, {}, stretch_of(records), None)
    last = for_judgement(evidence)
    for before, after in zip(records, last.records, strict=True):
        assert np.array_equal(after.held, before.judge)
        assert np.array_equal(after.train, ~before.judge)
    assert not any(r.judge.any() for r in last.records)
