"""``dtb run``: the exit code."""

import pytest

from dtbacklash.commands.run import never_answered


@pytest.mark.parametrize(
    ("remote", "in_vain"),
    [
        (None, False),
        ({"requests": 0, "answered": 0}, False),
        ({"requests": 3, "answered": 0}, True),
        ({"requests": 3, "answered": 1}, False),
    ],
)
def test_a_twin_elsewhere_was_asked_in_vain(remote, in_vain):
    assert never_answered({} if remote is None else {"remote": remote}) is in_vain
