"""The log of a German, an English and an American lab, with every defect: read as it was, or refused in a line."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
import pytest

from dtbacklash.errors import UserError
from dtbacklash.recording import read_recording

STEP_S = 1e-3
N = 3000
K = np.arange(N)
T = STEP_S * K
U = 5.0 * np.sign(np.sin(2 * np.pi * 1.3 * T)) + np.sin(2 * np.pi * 4.1 * T)
X = 1.2 * np.sin(2 * np.pi * 1.3 * T) + 0.3 * np.cos(2 * np.pi * 3.7 * T)  # m
START = pd.Timestamp("2026-03-01 09:59:59.900")


@dataclass
class Lab:
    """How a lab writes: delimiter, decimal sign, the form of a stamp, how thousands are grouped, heads, remarks."""

    delimiter: str
    decimal: str
    stamp: str
    group: str
    heads: tuple[str, str, str]
    remark: str
    unit: float = 1.0  # of the position, in m

    def number(self, value: float, digits: int = 4, group: bool = False) -> str:
        text = f"{value:,.{digits}f}" if group else f"{value:.{digits}f}"
        return text.replace(",", "\0").replace(".", self.decimal).replace("\0", self.group)

    def time(self, t_s: float) -> str:
        return (START + pd.to_timedelta(round(1e6 * t_s), unit="us")).strftime(self.stamp)


LABS = {
    "german": Lab(";", ",", "%d.%m.%Y %H:%M:%S,%f", ".", ("Zeit", "u [V]", "x [mm]"), "Prüfstand 3; läuft", 1e-3),
    "english": Lab(",", ".", "%d/%m/%Y %H:%M:%S.%f", "", ("Time", "u (mV)", "x (m)"), "# rig 3, cold"),
    "american": Lab("\t", ".", "%m/%d/%Y %I:%M:%S.%f %p", ",", ("Timestamp", "u [V]", "x [um]"), "Bench 3", 1e-6),
}


@dataclass
class Log:
    """A table of texts before it is written, and the samples at which the reading is to be the truth."""

    lab: Lab
    rows: list[list[str]]
    exact: np.ndarray = field(default_factory=lambda: np.ones(N, dtype=bool))
    above: list[str] = field(default_factory=list)
    below: list[str] = field(default_factory=list)

    def write(self) -> bytes:
        lines = [*self.above, self.lab.delimiter.join(self.lab.heads)]
        return "\n".join([*lines, *map(self.lab.delimiter.join, self.rows), *self.below, ""]).encode()


def clean(lab: Lab) -> Log:
    volts = 1e3 if "mV" in lab.heads[1] else 1.0
    return Log(lab, [
        [lab.time(t), lab.number(volts * u), lab.number(x / lab.unit, 4 if lab.unit < 1.0 else 7)]
        for t, u, x in zip(T, U, X, strict=True)
    ])  # fmt: skip


def begins_at_rest(log: Log) -> None:
    """Whole zeros for half a second: no decimal sign there tells anything."""
    for row in log.rows[:500]:
        row[1:] = ["0", "0"]
    log.exact[:500] = False


def groups_thousands(log: Log) -> None:
    if log.lab.group:
        for row, x in zip(log.rows, X, strict=True):
            row[2] = log.lab.number(x / log.lab.unit, 4, group=True)


def loses_rows(log: Log) -> None:
    del log.rows[700:705]
    log.exact[700:705] = False


def has_a_gap(log: Log) -> None:
    del log.rows[1200:1400]
    log.exact[1200:1400] = False


def repeats_a_row(log: Log) -> None:
    log.rows.insert(900, list(log.rows[900]))


def misses_values(log: Log) -> None:
    for k in (50, 51, 2000):
        log.rows[k][2] = ""
        log.exact[k] = False


def writes_texts_for_values(log: Log) -> None:
    for k in (60, 1500):
        log.rows[k][2] = "OVERFLOW"
        log.exact[k] = False


def has_one_number_with_the_other_sign(log: Log) -> None:
    other = "." if log.lab.decimal == "," else ","
    value = log.lab.number(1.25).replace(log.lab.decimal, other)
    log.rows[1000][1] = f'"{value}"' if log.lab.delimiter == "," else value


def has_remarks(log: Log) -> None:
    log.above, log.below = [log.lab.remark, ""], ["", "end of log"]


def has_a_trailing_delimiter(log: Log) -> None:
    for row in log.rows:
        row.append("")


def spikes(log: Log) -> None:
    for k in (400, 1700):
        log.rows[k][2] = log.lab.number(500.0 / log.lab.unit)
        log.exact[k - 3 : k + 4] = False


def stops_early(log: Log) -> None:
    for row in log.rows[2600:]:
        row[2] = ""
    log.exact[2600:] = False


DEFECTS: dict[str, Callable[[Log], None]] = {
    name.__name__.replace("_", " "): name
    for name in (
        begins_at_rest, groups_thousands, loses_rows, has_a_gap, repeats_a_row, misses_values, writes_texts_for_values,
        has_one_number_with_the_other_sign, has_remarks, has_a_trailing_delimiter, spikes, stops_early,
    )
}  # fmt: skip
#: what no reader can tell from a number that means something else
REFUSED = {"has one number with the other sign"}


@pytest.mark.parametrize("defect", DEFECTS)
@pytest.mark.parametrize("lab", LABS)
def test_a_log_with_a_defect_is_read_as_it_was_or_refused(lab, defect, tmp_path):
    log = clean(LABS[lab])
    DEFECTS[defect](log)
    (tmp_path / "log.csv").write_bytes(log.write())
    if defect in REFUSED:
        with pytest.raises(UserError) as caught:
            read_recording(tmp_path / "log.csv")
        assert "in row 1001" in str(caught.value)
        assert "\n" not in str(caught.value)
        return
    found = read_recording(tmp_path / "log.csv")
    assert found.sample_time_s == pytest.approx(STEP_S, rel=1e-4)
    at = np.rint((found.t_s - found.t_s[0]) / STEP_S).astype(int)
    exact = log.exact[at[at < N]]
    assert exact.sum() == log.exact.sum()
    for channel, truth, rounding in (("u", U, 1e-4), ("x", X, 1e-7)):
        off = np.abs(found.channels[channel][: len(exact)] - truth[at[: len(exact)]])
        assert off[exact].max(initial=0.0) <= rounding
        assert np.nanmedian(off) < 0.1  # resampled, or filled in


@pytest.mark.parametrize("lab", LABS)
def test_what_a_defect_cost_is_said(lab, tmp_path):
    log = clean(LABS[lab])
    for defect in (loses_rows, has_a_gap, repeats_a_row, writes_texts_for_values, stops_early):
        defect(log)
    (tmp_path / "log.csv").write_bytes(log.write())
    head, notes = log.lab.heads[2], read_recording(tmp_path / "log.csv").notes
    assert notes == [
        f"Column {head} holds text ('OVERFLOW') in row 61 of the numbers, 2 times: missing values.",
        "Of 1 pair of rows at one time the later one counts.",
        "There is 1 gap, the widest 0.201 s at t = 1.204 s.",
        "5 missing samples were interpolated.",
        "196 rows at the ends, where a channel has no value, were cut off. "
        "Channel x stops at t = 2.803 s, and the recording at 2.999 s.",
        "Channel x: 2 missing values interpolated, at most 1 in a row.",
        "2 stretches are used: 0 to 1.204 s, 1.405 to 2.803 s; together 2604 samples.",
    ]
