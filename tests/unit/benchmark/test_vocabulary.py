"""The published words: all effects of the catalogue, in a person's spellings."""

import csv

import pytest

from dtbacklash.benchmark import vocabulary
from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.scoring.truth import UNLISTED, WRONG_PARAMETER


def test_each_effect_that_can_be_hidden_has_a_word_with_its_size():
    with vocabulary.FILE.open(encoding="utf-8") as file:
        sizes = {row["effect"]: set(filter(None, row["size"].split(";"))) for row in csv.DictReader(file)}
    known: dict[str, set[str]] = {WRONG_PARAMETER: set(), UNLISTED: set()}
    for (_, name), effect in CATALOGUE.items():
        if not effect.is_table:
            known.setdefault(name, set()).add(effect.size.name)
    assert sizes == known


@pytest.mark.parametrize("written", ["Coulomb friction", "coulomb_friction", " COULOMB-friction ", "coulomb"])
def test_spellings_and_synonyms_mean_the_same(written):
    assert vocabulary.word_of(written, vocabulary.effects()) == "coulomb_friction"


def test_a_word_that_is_near_is_named():
    with pytest.raises(ValueError, match="did you mean backlash"):
        vocabulary.word_of("backlsh", vocabulary.effects())


def test_no_spelling_stands_for_two_words():
    with pytest.raises(ValueError, match="stands for"):
        vocabulary.table([("a", ["x y"]), ("b", ["x-y"])])
