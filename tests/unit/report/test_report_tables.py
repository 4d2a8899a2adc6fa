"""Terminal tables and numbers: narrow, plain, nothing eaten as markup."""

import io
import math

import numpy as np
import pandas as pd
import pytest
import synthetic

from dtbacklash.experiment.metrics import move_table
from dtbacklash.report.components import tables
from dtbacklash.report.components.numbers import fixed, number, powers, quantity
from dtbacklash.report.paper.page import claims_table, failures
from dtbacklash.report.run.text import estimates_table, moves_table
from dtbacklash.report.sweep.page import terminal

AXES = {"controller": ["imc", "nimc_fixed", "nimc_twin", "nimc_novelty"], "profile": ["s_curve", "step"],
        "twin.delay_s": [0, 4]}  # fmt: skip


def printed(*renderables, encoding="utf-8"):
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding)
    tables.show(*renderables, file=stream)
    stream.flush()
    return raw.getvalue().decode(encoding)


@pytest.fixture(scope="module")
def moves():
    return move_table(synthetic.trace_table(None))


def everything(moves):
    sweep = synthetic.sweep_table(AXES)
    return [
        *map(tables.of, (moves_table(moves), estimates_table(synthetic.estimates_table()), terminal(sweep, list(AXES)),
                         claims_table(synthetic.claims_table(), reasons=False))),
        *failures(synthetic.claims_table()),
    ]  # fmt: skip


def test_every_table_fits_into_a_hundred_columns_without_control_codes(moves):
    text = printed(*everything(moves))
    assert max(len(line) for line in text.splitlines()) <= 100
    assert "\x1b" not in text
    assert "at [s]" in text
    assert "bounds [0, 180]" in text
    assert "?0.5 V" in printed(*everything(moves), encoding="ascii")  # no error
    unsettled = moves.assign(settling_time_s=math.nan)
    assert "not settled" in printed(tables.of(moves_table(unsettled)))


def test_a_failed_job_and_a_failed_claim_are_told_with_their_reason():
    assert printed(tables.of(terminal(synthetic.sweep_table(AXES), list(AXES)))).count("FAILED") == 1
    claims = synthetic.claims_table()
    assert "estimates are unbiased: the paper says" in " ".join(failures(claims))
    assert printed(tables.of(claims_table(claims, reasons=False))).count("pass") == 5


def test_columns_that_a_table_does_not_have_are_left_out():
    short = synthetic.sweep_table(AXES)[["controller", "overshoot_pct_max", "status", "error"]]
    text = printed(tables.of(terminal(short, ["controller"])))
    assert "settling" not in text
    assert "nimc_novelty" in text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (47.1239, "47.1"), (0.8024, "0.802"), (3, "3"), (100.0, "100"), (0.0, "0"), (1234.5, "1234"),
        (2.0, "2"),
        (1e-9, "1 \N{MULTIPLICATION SIGN} 10⁻⁹"), (2.5e7, "2.5 \N{MULTIPLICATION SIGN} 10⁷"),
        (math.nan, "-"), (None, "-"), (pd.NA, "-"),
        ("almost 100 %", "almost 100 %"), (True, "yes"),
        (np.bool_(False), "no"), (np.float64(0.5), "0.5"), (math.inf, "inf"), (-0.04567, "-0.0457"),
    ],
)  # fmt: skip
def test_numbers_have_three_digits(value, text):
    assert number(value) == text


def test_a_terminal_and_a_text_get_the_same_number():
    assert [number(v, plain=True) for v in (1e-9, 2.5e7, -3e-12)] == ["1e-9", "2.5e7", "-3e-12"]
    assert powers("3.135e-12, at most 1e-06 mm") == (
        "3.135 \N{MULTIPLICATION SIGN} 10⁻¹², at most 1 \N{MULTIPLICATION SIGN} 10⁻⁶ mm"
    )


def test_fixed_decimals_and_units():
    assert fixed(-1e-9, 2) == "0.00"
    assert fixed(math.nan, 2, "never") == "never"
    assert fixed(None, 1) == "-"
    assert quantity(0.02, "N m") == "0.02 N m"
    assert quantity(0.05, "1") == "0.05"
