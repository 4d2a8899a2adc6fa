"""Names matched with what is hidden: each rule once where it holds, and once where it does not."""

import pytest

from dtbacklash.scoring.truth import Matching

DRAG, PLAY, DELAY = ("table", "viscous_friction"), ("gear", "backlash"), ("table", "delay")


@pytest.mark.parametrize(
    ("names", "also", "one_of", "pairs", "right", "false"),
    [
        ([DRAG], [()], [], {0: 0}, {0}, set()),
        ([DELAY], [()], [], {}, set(), {0}),
        ([DELAY, DRAG], [(DRAG,), ()], [], {0: 1}, {1}, {0}),  # its own name comes first
        ([DELAY], [(DRAG,)], [], {0: 0}, set(), set()),  # fits as well, by its own words: not right, not false
        ([DELAY], [(DRAG,)], [0], {0: 0}, {0}, set()),
        ([DELAY], [(DRAG, ("gear", "lag"))], [0], {0: 0}, {0}, set()),
        ([DELAY, ("gear", "lag")], [(DRAG,), (DRAG,)], [0, 1], {0: 0}, {0}, {1}),  # one name for one thing
    ],
)
def test_names_are_right_or_false_one_to_one(names, also, one_of, pairs, right, false):
    found = Matching([DRAG], names, (), [set(each) for each in also], one_of)
    assert (found.pairs, found.right, found.false) == (pairs, right, false)


def test_what_is_allowed_is_neither_right_nor_false():
    found = Matching([DRAG], [PLAY, DELAY, DELAY], [PLAY], [set(), {PLAY}, {PLAY}], [1])
    assert (found.right, found.harmless, found.false) == (set(), {0, 1}, {2})


def test_a_place_counts_whatever_is_named_there():
    found = Matching([DRAG, PLAY], [DELAY])
    assert (found.exact, found.placed) == (set(), {0})
    assert Matching([], []).pairs == {}
