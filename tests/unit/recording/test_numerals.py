"""A table in any dialect, precision, notation and beginning is read as it was written, or refused; never otherwise."""

import csv
import io
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dtbacklash.recording.refusal import Refused
from dtbacklash.recording.tables import read_table

ROWS = 120
#: delimiter, decimal sign, what groups thousands
DIALECTS = [
    *((delimiter, ".", "") for delimiter in ",;\t| "), *((delimiter, ",", "") for delimiter in ",;\t "),
    (";", ".", ","), ("\t", ".", ","), (",", ".", ","), (";", ".", "'"), (",", ".", "\u2019"), ("\t", ".", "\u202f"),
    (";", ",", "."), ("\t", ",", "."), (" ", ",", "."), (",", ",", "."), (";", ",", " "),
    ("\t", ",", "\u00a0"), (";", ",", "'"),
]  # fmt: skip
NOTATIONS = ("fixed", "short", "exponent", "whole")
BEGINNINGS = ("as the rest", "zeros", "whole", "exponents", "missing", "texts")


def written(value: float, notation: str, digits: int, decimal: str, group: str) -> tuple[str, float]:
    """A number as a logger writes it, and what it says."""
    text = {
        "fixed": f"{value:,.{digits}f}", "short": f"{round(value, digits):,}", "exponent": f"{value:.{digits}e}",
        "whole": f"{round(value):,}",
    }[notation]  # fmt: skip
    if notation == "short":
        text = text.removesuffix(".0")
    said = float(Decimal(text.replace(",", "")))
    return text.replace(",", "\0").replace(".", decimal).replace("\0", group), said


@st.composite
def tables(draw):
    """The bytes of a file; the true values, a column each (NaN: missing); whether a number contradicts the others."""
    delimiter, decimal, group = draw(st.sampled_from(DIALECTS))
    quoting = draw(st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL, csv.QUOTE_NONE]))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    columns, truths = [], []
    for name in ["p", *draw(st.sampled_from([["u"], ["u", "x"], ["u", "x", "y"]]))]:
        notation, digits = draw(st.sampled_from(NOTATIONS)), draw(st.sampled_from([0, 1, 2, 3, 3, 3, 4, 6, 9]))
        size, offset = 10.0 ** draw(st.integers(-2, 6)), draw(st.sampled_from([0.0, 0.0, 1.0, 1e3]))
        rest = draw(st.sampled_from([0, 3, 50, 110]))
        beginning = draw(st.sampled_from(BEGINNINGS[:-2] if name in "pu" else BEGINNINGS))
        few = draw(st.booleans())  # different values
        values = np.arange(ROWS) * size / 100 if name == "p" else random.standard_normal(ROWS) * size
        values = random.choice(values[:3], ROWS) if few and name != "p" else values
        cells = []
        for k, value in enumerate(values + offset * size):
            text, said = written(value, notation, digits, decimal, group)
            if k < rest and beginning != "as the rest":
                text, said = {
                    "zeros": ("0", 0.0), "missing": ("", np.nan), "texts": ("OVER", np.nan),
                    "whole": written(value, "whole", 0, decimal, group),
                    "exponents": written(value, "exponent", digits, decimal, group),
                }[beginning]  # fmt: skip
            cells.append((text, said))
        columns.append([name, *(text for text, _ in cells)])
        truths.append(np.array([said for _, said in cells]))
    slip = draw(st.booleans()) and draw(st.booleans())
    # where hardly a number has the sign, one with the other sign is no slip: it tells
    slip = slip and sum(decimal in text for column in columns for text in column) > ROWS // 3
    if slip:  # one number as somebody else writes it
        k, j = draw(st.integers(1, ROWS)), draw(st.integers(0, len(columns) - 1))
        alone = not any(decimal in text for text in columns[j])  # nothing tells 2,250 from 2250 there
        digits = draw(st.sampled_from([2, 4] if alone else [2, 3, 4]))
        value = Decimal(f"{float(np.nan_to_num(truths[j][k - 1])) + 0.25:.{digits}f}")
        columns[j][k] = str(value).replace(".", "," if decimal == "." else ".")
        truths[j][k - 1] = float(value)
    out = io.StringIO()
    rows = list(zip(*columns, strict=True))
    if quoting == csv.QUOTE_NONE or delimiter == " ":
        out.write("\n".join(delimiter.join(text or "-" for text in row) for row in rows) + "\n")
    else:
        csv.writer(out, delimiter=delimiter, quoting=quoting).writerows(rows)
    plain = quoting != csv.QUOTE_NONE or delimiter not in (decimal, group)
    return out.getvalue().encode(), truths, slip or not plain


def check(content: bytes, truths: list[np.ndarray]) -> list[str]:
    """Compare what is read with the truth; returns what was refused."""
    try:
        table = read_table(content, "a.csv")
    except Refused as refusal:
        return [str(refusal)]
    if table.numbered:  # its names do not fit its columns: it takes a mapping
        return ["no names"]
    refused = []
    names = ["p", "u", "x", "y"][: len(truths)]
    for name, truth in zip(names, truths, strict=True):
        column = table.columns.get(name)
        assert column is not None, (name, list(table.columns))
        if column.values is None:
            refused.append(f"{name} {column.unusable}")
            continue
        assert len(column.values) == ROWS, (name, table.notes)
        wrong = ~((column.values == truth) | np.isnan(truth) & np.isnan(column.values))
        assert not wrong.any(), (name, column.values[wrong][:5], truth[wrong][:5])
    return refused


def read(rows: list[str], heads: str = "t;u;x") -> dict:
    """The columns of a table by their names."""
    return read_table("\n".join([heads, *rows]).encode(), "a.csv").columns


REST = ["0;0;0"] * 500


def test_the_sign_is_decided_on_the_whole_table_and_on_all_columns():
    columns = read([*REST, *(f"{k};3,75{k % 10};{k % 7},5" for k in range(1, 90))])
    assert columns["u"].values[-1] == 3.759
    columns = read([*REST, *(f"{k};3,75{k % 10};{k % 7}.5" for k in range(1, 90))])
    assert columns["u"].values[-1] == 3759.0
    assert columns["x"].values[-1] == 5.5


@pytest.mark.parametrize(("value", "name"), [("-14.2026", "commas"), ("1.202", "commas"), ("1.202,5,1", "")])
def test_a_number_that_contradicts_the_others_is_refused_with_its_row(value, name):
    rows = [f"0,{k:04d};{k % 9},12{k % 10}0;0" for k in range(200)]
    rows[149] = f"0,0149;{value};0"
    column = read(rows)["u"]
    if name:
        assert column.values is None
        said = f"holds '{value}' in row 150 of the numbers, and the numbers of the file have decimal {name}"
        assert column.unusable == f"{said}: write it like them"
    else:  # no number in any writing: a reading that failed
        assert np.isnan(column.values[149])
        assert "holds text ('1.202,5,1') in row 150" in column.unusable


def test_where_nothing_tells_a_group_from_a_fraction_the_file_is_refused():
    rows = [f"{k};{1 + k % 9},{100 + k};7" for k in range(200)]
    assert "row 1 of the numbers, and 199 more like it, and no number of the file tells" in read(rows)["u"].unusable
    counting = read([f"{k:,};{1 + k % 9},{100 + k % 99};7" for k in range(900, 1100)])  # it does not go back at 1,000
    assert counting["t"].values[-1] == 1099.0
    assert counting["u"].values[0] == 1100 + 900 % 99 + 1000 * (900 % 9) - 0.0


def test_a_single_number_makes_no_thousands_of_all_the_others():
    rows = [f"{k};{1 + k % 7}.{257 + k % 9};0" for k in range(200)]
    assert read(["0,25;1.257;0", *rows])["u"].unusable.startswith("holds '1.257' in row 1 of the numbers, and 200 more")
    many = [f"{k},25;{1 + k % 7}.{257 + k % 9};0" for k in range(200)]  # with as many decimal commas they are whole
    assert read(many)["u"].values[0] == 1257.0


@pytest.mark.parametrize("delimiter", [";", "\t", "|"])
def test_blanks_in_whole_numbers_part_no_columns(delimiter):
    rows = [
        delimiter.join(f"{x:,}" for x in (100 * k, k % 3, (-1) ** k * 37 * k)).replace(",", " ") for k in range(120)
    ]
    columns = read(rows, delimiter.join("tux"))
    assert columns["t"].values[-1] == 11900.0
    assert columns["x"].values[-1] == -37.0 * 119


@pytest.mark.parametrize(("head", "row"), [("t\tu theta", "{}\t{} {}"), ("# t\tu theta", "{}\t{} {}"),
                                           ("t\tu\ttheta", "{}\t{} {}")])  # fmt: skip
def test_two_columns_that_a_blank_parts_stay_two(head, row):
    columns = read([row.format(k, 100 + k, 200 + k) for k in range(120)], head)
    assert [(name, one.values[-1]) for name, one in columns.items()] == [("t", 119.0), ("u", 219.0), ("theta", 319.0)]


@pytest.mark.parametrize(("head", "row", "name"), [
    ("t;u;a b", "{};0.000;{} {}", "'a b'"), ("t;u;a", "{};0.000;{} {}", "'a'"), ("t\tu", "{}\t{} {}", "'u'"),
    ("t,u,a b", "{},0.5,{} {}", "'a b'"), ("0;5;99 199", "{};5;{} {}", "number 3"),
    ("t|u|a b c", "{}|5|{} {} 300", "'a b c'"),
])  # fmt: skip
def test_one_number_or_two_is_refused_with_its_column(head, row, name):
    with pytest.raises(Refused, match=rf"a column \({name}\) with '\d+ \d+.*', which may be one number or several"):
        read([row.format(k, 100 + k, 200 + k) for k in range(120)], head)


def test_three_groups_below_one_name_are_one_number():
    columns = read([f"{k};5;1 {k:03d} 250" for k in range(120)], "t;u;x [mm]")
    assert columns["x [mm]"].values[-1] == 1119250.0


def test_groups_between_commas_are_refused_where_the_first_rows_failed():
    rows = [f"{k / 100},{'1,000.2' if k % 3 == 2 else 999.5},{'OVER' if k < 3 else k % 5}" for k in range(120)]
    with pytest.raises(Refused, match="a comma in a number cannot be told"):
        read(rows, "p,u,x")


def test_a_row_of_too_many_numbers_and_a_text_is_no_line_above_the_numbers():
    rows = "\n".join(f"{k},{k % 3},{k % 5},{k % 7 / 10}" for k in range(120))
    with pytest.raises(Refused, match=r"has a row of 5 fields \(0, 25, 0, OVER, 1.3\) above its 4 columns"):
        read_table(f"p,u,x,y\n0,25,0,OVER,1.3\n{rows}".encode(), "a.csv")


def test_decimal_commas_between_commas_are_refused():
    rows = [f"0,{k:03d},{k % 9},25" for k in range(200)]
    with pytest.raises(Refused, match="has 4 columns of whole numbers below no names"):
        read(rows, "t,u")


RELAXED = settings(deadline=None, suppress_health_check=list(HealthCheck))


@pytest.mark.check
@settings(RELAXED, max_examples=300, derandomize=True)
@given(table=tables())
def test_a_table_is_read_as_it_was_written_or_refused(table):
    check(*table[:2])


@pytest.mark.nightly
@settings(RELAXED, max_examples=10_000)
@given(table=tables())
def test_ten_thousand_tables_are_read_as_they_were_written_or_refused(table):
    check(*table[:2])


LOGGED = [
    ("t,y\n" + "\n".join(f"{0.1 * k:.3f},{135 + 20 * np.sin(k / 17):.3f}" for k in range(600)), "y", 135.0),
    ("t,u\n0.000,1.250\n1.000,1.260\n2.000,1.280\n3.000,1.300", "u", 1.25),
    ("t;u\n0;0,5\n1;1,234\n2;1,250", "u", 0.5),
    ("t u y\n" + "\n".join(f"{k / 10} {150 + k / 2} {300.0 - k}".replace(".", ",") for k in range(60)), "y", 300.0),
]


@pytest.mark.parametrize(("text", "column", "first"), LOGGED)
def test_numbers_of_three_decimals_are_read_where_any_number_tells_the_sign(text, column, first):
    assert read_table(text.encode(), "a.csv").columns[column].values[0] == first


def test_a_remark_above_the_heads_is_no_head():
    rows = "\n".join(f"1,{k},257.3" for k in range(1, 60))
    with pytest.raises(Refused, match="a comma in a number cannot be told"):
        read_table(f"# rig 3, cold, wet\nt,u\n{rows}".encode(), "a.csv")
