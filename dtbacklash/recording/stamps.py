"""Time stamps: ``2026-03-01T10:00:00.001+01:00``, ``01.03.2026 10:00:00,001``, ``10:00:00.001``, dates of pandas."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd

from dtbacklash.arrays import Floats

DAY_S = 86400.0
STAMP = re.compile(
    r"(?:(?:(?P<iso>\d{4}[-/.]\d{1,2}[-/.]\d{1,2})|(?P<german>\d{1,2}\.\d{1,2}\.\d{2,4})|(?P<us>\d{1,2}/\d{1,2}/\d{2,4}))"
    r"(?:T|,?\s+))?(?P<h>\d{1,2}):(?P<m>\d{2})(?::(?P<s>\d{1,2}(?:[.,]\d*)?))?\s*(?P<zone>Z|UTC|[+-]\d{2}:?\d{2})?"
)
_ORDER = {"iso": ("%Y", "%m", "%d"), "german": ("%d", "%m", "%Y"), "us": ("%m", "%d", "%Y")}


def seconds(values: object) -> Floats | None:
    """(N,) seconds from the first stamp on, nan where there is none; None if these are no stamps.

    A clock without a date may pass midnight. Only differences count, so a zone matters only where it changes.

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
    if parts["h"].isna().any():
        return None
    s = sum(60.0**k * _number(parts[name]) for k, name in enumerate(("s", "m", "h")))
    zone = parts["zone"].where(parts["zone"].str.contains(":|[0-9]", na=False))
    sign = np.where(zone.str.startswith("-", na=False), -1.0, 1.0)
    s = s - sign * (3600.0 * _number(zone.str[1:3]) + 60.0 * _number(zone.str[-2:]))
    days = _days(parts)
    s = s - s[0] + DAY_S * (days - days[0])
    if parts[list(_ORDER)].isna().all(axis=None):
        s = s + DAY_S * np.concatenate(([0.0], np.cumsum(np.diff(s) < -0.5 * DAY_S)))
    result = np.full(len(texts), np.nan)
    result[filled.index] = s
    return result


def _number(texts: pd.Series) -> Floats:
    """(N,) numbers, 0 where nothing is written."""
    return pd.to_numeric(texts.str.replace(",", ".").fillna("0")).to_numpy(dtype=float)


def _days(parts: pd.DataFrame) -> Floats:
    """(N,) days since 1970, 0 without a date; raises ValueError where a date does not exist."""
    days = np.zeros(len(parts))
    for form, order in _ORDER.items():
        here = parts[form].notna().to_numpy()
        if here.any():
            codes, dates = pd.factorize(parts[form][here].str.replace(r"[/.]", "-", regex=True))
            years = "%y" if len(dates[0].split("-")[order.index("%Y")]) == 2 else "%Y"
            stamps = pd.to_datetime(pd.Series(dates), format="-".join(order).replace("%Y", years))
            days[here] = (stamps - pd.Timestamp(0)).dt.days.to_numpy()[codes]
    return days
