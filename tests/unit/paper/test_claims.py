"""The table of the paper's claims is whole, and what is no number fails."""

import math
import re
from types import SimpleNamespace

import pytest

from dtbacklash.paper.claims import STATISTICS, check, statements
from dtbacklash.paper.experiments import FORCE_N, NOISE_MM, OPTIMIZERS


def test_the_table_has_the_keys_that_it_explains_and_uses_every_statistic() -> None:
    needed = {"claim", "section", "paper", "statistic", "why"}
    used = set()
    for row in statements():
        assert needed <= set(row) <= needed | {"of", "unit", "at_least", "at_most", "failing"}, row["claim"]
        assert {"at_least", "at_most"} & set(row), row["claim"]
        bounds = [row.get(key) for key in ("at_least", "at_most")]
        used |= {row["statistic"], *(b for b in bounds if isinstance(b, str))}
        used |= set(re.findall(r"\{(\w+)", row.get("failing", "")))
    assert used == set(STATISTICS)


def test_the_numbers_in_the_table_are_those_of_the_experiments() -> None:
    text = " ".join(f"{row['claim']} {row['why']}" for row in statements())
    assert f"a force of {FORCE_N:g} N" in text
    assert text.count(f"a sensor with {NOISE_MM:g} mm of noise") == 2
    assert f"with {len(OPTIMIZERS)} other optimizers" in text
    (runs,) = [row["of"]["runs"] for row in statements() if "other optimizers" in row["claim"]]
    assert tuple(runs) == OPTIMIZERS


@pytest.mark.parametrize("ours", [math.nan, math.inf, -math.inf, 0.9, 2.1])
def test_what_is_no_number_or_outside_fails_and_says_why(ours: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(STATISTICS, "found", lambda _: ours)
    row = {"claim": "a claim", "section": "1", "paper": "about one", "statistic": "found"}
    row |= {"at_least": 1.0, "at_most": 2.0, "why": "as it is said", "failing": "{found:.1f} is not"}
    claim = check(row, SimpleNamespace())
    assert not claim["pass"]
    assert claim["reason"] == f"as it is said. It fails because {ours:.1f} is not"
