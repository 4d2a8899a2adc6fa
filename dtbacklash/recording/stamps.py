"""Time stamps as loggers write them, of one form in a column: ISO, German, American, a clock; dates of pandas."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from dtbacklash.arrays import Floats

if TYPE_CHECKING:
    import pandas as pd

HOUR_S, DAY_S = 3600.0, 86400.0
STAMP = re.compile(
    r"(?:(?:(?P<iso>\d{4}[-/.]\d{1,2}[-/.]\d{1,2})|(?P<german>\d{1,2}\.\d{1,2}\.\d{2,4})|(?P<us>\d{1,2}/\d{1,2}/\d{2,4})"
    r"|(?P<named>\d{1,2}[- ][A-Za-z]{3}[- ]\d{2,4})|(?P<compact>\d{8}(?=T\d)))(?:T|,?\s+))?"
    r"(?:(?P<h>\d{1,3}):\d{2}(?::\d{1,2}(?:[.,:]\d*)?)?|(?P<m2>\d{1,2}):\d{2}[.,]\d+|(?<=T)(?P<h3>\d{2})\d{4}(?:[.,]\d*)?)"
    r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?P<zone>Z|UTC|[+-]\d{2}:?\d{2})?"
)
#: the fields of a date, of a time of day, of a time in the hour, and of those without separators, in their order
_FIELDS = {
    "iso": "%Y %m %d", "german": "%d %m %Y", "us": "%m %d %Y", "named": "%d %b %Y", "compact": "%Y%m%d",
    "h": "%H %M %S %f", "m2": "%M %S %f", "h3": "%H%M%S %f",
}  # fmt: skip
_FRACTION = re.compile(r"[.,:]%f")


def seconds(values: object) -> Floats | None:
    """(N,) seconds from the first stamp on, nan where there is none; None if these are no stamps.

    A clock without a date may pass midnight, one without hours the hour. Only differences count, so a zone matters only
    where it changes.

    >>> seconds(["01.03.2026 23:59:59,5", "02.03.2026 00:00:01"]).tolist()
    [0.0, 1.5]
    """
    import pandas as pd

    array = np.asarray(values)
    if array.dtype.kind in "mM":
        return _from_first(pd.Series(array.reshape(-1)))
    texts = pd.Series(array.reshape(-1)).astype("string").str.strip()
    filled = texts[texts.notna() & ~texts.str.lower().isin(["", "nan", "nat", "na", "null", "none", "-"])]
    first = STAMP.fullmatch(filled.iloc[0]) if len(filled) else None
    if first is None:
        return None
    form, turn = _form(first)
    if first["half"]:
        filled = filled.str.replace(".m", "m", case=False).str.rstrip(".")
    ways = [_read(filled, one) for one in dict.fromkeys([form, form.replace("%m/%d", "%d/%m")])]
    if turn == DAY_S and ways[0].isna().any():  # more than a day
        ways = [pd.to_timedelta(filled.str.replace(",", "."), errors="coerce")]
    whole = [stamps for stamps in ways if not stamps.isna().any()]
    if not whole:
        return None
    s = _from_first(min(whole, key=lambda stamps: stamps.max() - stamps.min()))  # a log does not jump by a month
    if turn:
        s = s + turn * np.concatenate(([0.0], np.cumsum(np.diff(s) < -0.5 * turn)))
    result = np.full(len(texts), np.nan)
    result[filled.index] = s
    return result


def _read(texts: pd.Series, form: str) -> pd.Series:
    """Dates of one form, whole seconds maybe without a fraction; NaT where it is another one."""
    import pandas as pd

    stamps = pd.to_datetime(texts, format=form, utc=True, errors="coerce")
    plain, tenths = _FRACTION.sub("", form), re.sub(r"%S(?!.%f)", "%S.%f", form)
    for other in dict.fromkeys([plain, tenths]):
        if other != form and (rest := stamps.isna()).any():
            stamps[rest] = pd.to_datetime(texts[rest], format=other, utc=True, errors="coerce")
    return stamps


def _from_first(stamps: pd.Series) -> Floats:
    """(N,) seconds of dates or durations from the first one on."""
    import pandas as pd

    first = stamps.dropna().iloc[:1]
    since = pd.TimedeltaIndex(stamps - (first.iloc[0] if len(first) else pd.NaT))
    return np.asarray(since.total_seconds(), dtype=float)


def _form(first: re.Match[str]) -> tuple[str, float]:
    """The form of a stamp as strptime writes it, and after how many seconds it begins anew (0: it has a date)."""
    kinds = [kind for kind in _FIELDS if first[kind]]
    order = iter(" ".join(_FIELDS[kind] for kind in kinds).split())
    form = first[0]
    for name, directive in (("zone", "UTC" if first["zone"] == "UTC" else "%z"), ("half", "%p")):
        if first[name]:
            form = form[: first.start(name)] + directive + form[first.end(name) :]
    form = re.sub(r"\d+|(?<=\d[- ])[A-Za-z]{3}(?=[- ])", lambda _: next(order), form)
    if first["half"]:
        form = form.replace("%H", "%I")
    if kinds[0] in ("german", "us", "named") and re.search(r"\D\d\d$", first[kinds[0]]):
        form = form.replace("%Y", "%y")
    return form, {"h": DAY_S, "h3": DAY_S, "m2": HOUR_S}.get(kinds[0], 0.0)
