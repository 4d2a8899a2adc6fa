"""A setting is declared once: its check, its help and its row in the docs say the same."""

import math
from dataclasses import dataclass, field

import pytest
from told import refused

from dtbacklash.config.grammar import GRAMMARS
from dtbacklash.config.setting import INPUT, Declared, check, declared, setting


@dataclass
class Inner:
    """A section."""

    size_mm: float = setting(1.0, "how large", above=0, at_most=5)
    kind: str = setting("round", "which form", choices={"round": "", "square": ""})

    def __post_init__(self) -> None:
        check(self, "inner.")


@dataclass
class Outer:
    """A schema."""

    inner: Inner = field(default_factory=Inner)
    count: int | None = setting(None, "how many", at_least=1)
    file: str | None = setting(None, "which", path=INPUT, word="source")
    free: dict[str, float] = setting(dict, "anything")
    quick: bool = setting(False, "less", flag="--quick")

    def __post_init__(self) -> None:
        check(self)


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda: Inner(size_mm=0.0), "inner.size_mm=0.0: must be positive and at most 5 mm"),
        (lambda: Inner(size_mm=math.nan), "inner.size_mm=nan: must be finite and positive and at most 5 mm"),
        (lambda: Inner(kind="flat"), "inner.kind=flat: choose one of round, square"),
        (lambda: Outer(count=0), "count=0: must be at least 1"),
    ],
)
def test_a_value_out_of_bounds_is_one_line(make, line):
    with refused(whole=line):
        make()
    assert Outer(count=None, quick=True).quick is True  # none and truth are no numbers


def test_the_schema_lists_its_settings_in_order():
    found = {one.key: one for one in declared(Outer)}
    assert list(found) == ["inner.size_mm", "inner.kind", "count", "file", "free", "quick"]
    assert found["inner.size_mm"].unit == "mm"
    assert found["file"].word == "source"
    assert found["count"].plain_kind is int
    assert found["free"].is_mapping
    shown = [(one.shown(), one.allowed()) for one in found.values()]
    assert shown == [
        ("1", "positive and at most 5"), ("round", "round, square"), ("null", "at least 1"), ("null", ""), ("{}", ""),
        ("false", "true, false"),
    ]  # fmt: skip


@pytest.mark.parametrize("name", GRAMMARS)
def test_every_setting_of_every_command_says_what_it_means(name):
    for one in GRAMMARS[name].settings.values():
        assert isinstance(one, Declared)
        assert one.about.meaning
        assert one.about.meaning[0].islower() or one.about.meaning.split()[0].isupper() or "`" in one.about.meaning[:2]
