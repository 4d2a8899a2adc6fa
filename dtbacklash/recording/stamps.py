"""Time stamps as loggers write them, of one form in a column: ISO, German, American, a clock; dates of pandas."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd

from dtbacklash.arrays import Floats

HOUR_S, DAY_S = 3600.0, 86400.0
STAMP = re.compile(
    r"(?:(?:(?P<iso>\d{4}[-/.]\d{1,2}[-/.]\d{1,2})|(?P<german>\d{1,2}\.\d{1,2}\.\d{2,4})|(?P<us>\d{1,2}/\d{1,2}/\d{2,4})"
    r"|(?P<named>\d{1,2}[- ][A-Za-z]{3}[- ]\d{2,4})|(?P<compact>\d{8}(?=T\d)))(?:T|,?\s+))?"
    r"(?:(?P<h>\d{1,2}):(?P<m>\d{2})(?::(?P<s>\d{1,2}(?:[.,:]\d*)?))?|(?P<m2>\d{1,2}):(?P<s2>\d{2}[.,]\d+)"
    r"|(?<=T)(?P<h3>\d{2})(?P<m3>\d{2})(?P<s3>\d{2}(?:[.,]\d*)?))"
    r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?P<zone>Z|UTC|[+-]\d{2}:?\d{2})?"
)
_ORDER = {"iso": "%Y-%m-%d", "german": "%d-%m-%Y", "us": "%m-%d-%Y", "named": "%d-%b-%Y", "compact": "%Y%m%d"}


def seconds(values: object) -> Floats | None:
    """(N,) seconds from the first stamp on, nan where there is none; None if these are no stamps.

    A clock without a date may pass midnight, one without hours the hour. Only differences count, so a zone matters only
    where it changes.

    >>> seconds(["01.03.2026 23:59:59,5", "02.03.2026 00:00:01"]).tolist()
    [0.0, 1.5]
    """
    array = np.asarray(values)
    if array.dtype.kind in "mM":
        counts = array.astype("datetime64[ns]" if array.dtype.kind == "M" else "timedelta64[ns]").astype(np.int64)
        missing = np.isnat(array)
        first = counts[~missing][0] if not missing.all() else 0
        return np.where(missing, np.nan, (counts - first) * 1e-9)
    texts = pd.Series(array.reshape(-1)).astype("string").str.strip()
    filled = texts[texts.notna() & ~texts.str.lower().isin(["", "nan", "nat", "na", "null", "none", "-"])]
    if not len(filled) or STAMP.fullmatch(filled.iloc[0]) is None:
        return None
    parts = filled.str.extract(rf"^{STAMP.pattern}$")
    if parts["m"].fillna(parts["m2"]).fillna(parts["m3"]).isna().any():
        return None
    h, m, s = (_number(parts[name].fillna(parts[f"{name}3"])) for name in "hms")
    s = s + _number(parts["s2"]) + 60.0 * (m + _number(parts["m2"])) + HOUR_S * h
    half = parts["half"].str[0].str.lower().fillna("").to_numpy(str)
    s = s + 0.5 * DAY_S * ((half == "p") - 1.0 * ((half != "") & (h == 12)))
    zone = parts["zone"].where(parts["zone"].str.contains(":|[0-9]", na=False))
    sign = np.where(zone.str.startswith("-", na=False), -1.0, 1.0)
    s = s - sign * (HOUR_S * _number(zone.str[1:3]) + 60.0 * _number(zone.str[-2:]))
    days = _days(parts)
    s = s - s[0] + DAY_S * (days - days[0])
    if parts[list(_ORDER)].isna().all(axis=None):
        turn = HOUR_S if parts["m2"].notna().all() else DAY_S
        s = s + turn * np.concatenate(([0.0], np.cumsum(np.diff(s) < -0.5 * turn)))
    result = np.full(len(texts), np.nan)
    result[filled.index] = s
    return result


def _number(texts: pd.Series) -> Floats:
    """(N,) numbers, 0 where nothing is written."""
    return pd.to_numeric(texts.str.replace("[,:]", ".", regex=True).fillna("0")).to_numpy(dtype=float)


def _days(parts: pd.DataFrame) -> Floats:
    """(N,) days since 1970, 0 without a date; raises ValueError where a date does not exist."""
    days = np.zeros(len(parts))
    for form, order in _ORDER.items():
        here = parts[form].notna().to_numpy()
        if here.any():
            codes, dates = pd.factorize(parts[form][here].str.replace(r"[/. ]", "-", regex=True))
            short = order.endswith("%Y") and len(dates[0].rpartition("-")[2]) == 2
            stamps = pd.to_datetime(pd.Series(dates), format=order.replace("%Y", "%y") if short else order)
            days[here] = (stamps - pd.Timestamp(0)).dt.days.to_numpy()[codes]
    return days
