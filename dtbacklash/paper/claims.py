"""Every checkable statement of the paper, in its order: the table ``claims.yaml``, and how a row of it is checked."""

import math
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from inspect import getmembers, isfunction
from string import Formatter
from typing import Any

import pandas as pd

from dtbacklash import yaml_files
from dtbacklash.paper import linear_statistics, statistics, twin_statistics
from dtbacklash.paper.experiments import Experiments

#: name -> what measures it
STATISTICS: dict[str, Callable[..., Any]] = {
    name: function
    for module in (statistics, linear_statistics, twin_statistics)
    for name, function in getmembers(module, isfunction)
    if function.__module__ == module.__name__ and not name.startswith("_")
}


@cache
def statements() -> tuple[dict[str, Any], ...]:
    """The rows of ``claims.yaml``, whose head says what each key means."""
    text = files("dtbacklash.paper").joinpath("claims.yaml").read_text(encoding="utf-8")
    return tuple(yaml_files.read(text))


def all_claims(x: Experiments) -> pd.DataFrame:
    """Check every statement; columns as in ``claims.csv``."""
    return pd.DataFrame([check(statement, x) for statement in statements()])


def check(statement: dict[str, Any], x: Experiments) -> dict[str, Any]:
    """The row of ``claims.csv``: measure what a statement is about and compare it with its bounds.

    NaN is within no bounds. Where the statement fails, the reason says why, if that is known.
    """
    ours = float(STATISTICS[statement["statistic"]](x, **statement.get("of", {})))
    low, high = (_bound(statement.get(key), x) for key in ("at_least", "at_most"))
    passed = (low is None or low <= ours) and (high is None or ours <= high) and math.isfinite(ours)
    reason = statement["why"]
    if not passed and "failing" in statement:
        reason += f". It fails because {_filled(statement['failing'], x)}"
    unit = statement.get("unit", "")
    return {
        "claim": statement["claim"],
        "section": statement["section"],
        "paper": statement["paper"],
        "ours": f"{ours:.4g} {unit}".strip(),
        "tolerance": f"{_tolerance(low, high)} {unit}".strip(),
        "pass": passed,
        "reason": reason,
    }


def _filled(text: str, x: Experiments) -> str:
    """The text with what the statistics in its braces give."""
    names = {name.partition("[")[0] for _, name, _, _ in Formatter().parse(text) if name}
    return text.format(**{name: STATISTICS[name](x) for name in names})


def _bound(bound: float | str | None, x: Experiments) -> float | None:
    """A bound as a number; a text is the name of a statistic."""
    return float(STATISTICS[bound](x)) if isinstance(bound, str) else bound


def _tolerance(low: float | None, high: float | None) -> str:
    if low is None:
        return f"at most {high:.4g}"
    if high is None:
        return f"at least {low:.4g}"
    return f"{low:.4g} to {high:.4g}" if low < high else f"exactly {low:.4g}"
