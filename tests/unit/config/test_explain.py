"""Errors in words: which of them are somebody's mistake."""

import errno

from dtbacklash.config.explain import explain


def test_a_reader_of_the_output_that_has_gone_is_nobodys_mistake():
    assert explain(BrokenPipeError(errno.EPIPE, "Broken pipe"), []) is None


def test_a_folder_that_cannot_be_made_is():
    mistake = explain(PermissionError(errno.EACCES, "Permission denied", "/nowhere"), [])
    assert mistake is not None
    assert str(mistake) == "hydra.run.dir=/nowhere: cannot be written: permission denied"
