"""Errors in words: which of them are somebody's mistake."""

import errno

import pytest
from told import refusal

from dtbacklash.config.explain import explain
from dtbacklash.config.grammar import GRAMMARS, kind_of


def test_a_reader_of_the_output_that_has_gone_is_nobodys_mistake():
    assert explain(BrokenPipeError(errno.EPIPE, "Broken pipe"), []) is None


def test_a_folder_that_cannot_be_made_is():
    mistake = explain(PermissionError(errno.EACCES, "Permission denied", "/nowhere"), [])
    assert mistake is not None
    assert str(mistake) == "hydra.run.dir=/nowhere: cannot be written: permission denied"


@pytest.mark.parametrize(
    ("command", "key", "said"),
    [
        ("diagnose", "recording.rows", "a list of whole numbers"),
        ("design", "commands", "a list of texts"),
        ("run", "twin.indexes", "a list of frequency, motor, structure"),
    ],
)
def test_of_a_list_it_is_said_what_it_holds(command, key, said):
    assert kind_of(key, GRAMMARS[command]) == said


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("seed=1,2", "takes one value here; give several with -m (a sweep)"),
        ("controller=1,2", "takes one value here; give several with -m (a sweep)"),
        ("controller.limit_v=1,2", "write a decimal point (1.2); with -m a comma separates several values"),
    ],
)
def test_a_decimal_comma_is_meant_only_where_a_number_has_decimals(capsys, word, said):
    assert refusal(capsys, "run", word) == f"{word}: {said}\n"
