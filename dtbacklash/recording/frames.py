"""From a DataFrame to columns, as from a file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dtbacklash.recording import heads as heads_of
from dtbacklash.recording.heads import TIME
from dtbacklash.recording.refusal import Refused
from dtbacklash.recording.table import Table, with_clocks
from dtbacklash.recording.tables import from_arrays

if TYPE_CHECKING:
    import pandas as pd

    from dtbacklash.arrays import Floats


def frame_table(frame: pd.DataFrame) -> Table:
    """The columns of a frame; its index is the column ``t`` unless it only counts the rows.

    Raises
    ------
    Refused : no frame, no rows, or two columns of one name.
    """
    import pandas as pd

    if not isinstance(frame, pd.DataFrame):
        raise Refused(f"must be a DataFrame, not a {type(frame).__name__}")
    heads = [str(head) for head in frame.columns]
    double = next((head for head in heads if heads.count(head) > 1), None)
    if double is not None:
        raise Refused(f"has two columns named {double}")
    if not len(frame) or not heads:
        raise Refused("is empty")
    arrays: dict[str, object] = {}
    if not isinstance(frame.index, pd.RangeIndex) and not any(heads_of.is_time(head) for head in heads):
        arrays[str(frame.index.name or TIME)] = _times(frame.index)
    for head, (_, column) in zip(heads, frame.items(), strict=True):
        kind = column.dtype
        missing = pd.api.types.is_extension_array_dtype(kind) and pd.api.types.is_numeric_dtype(kind)
        arrays[head] = column.to_numpy(dtype=float, na_value=np.nan) if missing else column.to_numpy()
    return with_clocks(from_arrays(arrays, whole=True))


def _times(index: pd.Index) -> Floats:
    """Seconds, from the first row where the index holds dates."""
    import pandas as pd

    if isinstance(index, pd.DatetimeIndex):
        index = index - index[0]
    if isinstance(index, pd.TimedeltaIndex):
        return index.total_seconds().to_numpy(dtype=float)
    try:
        return index.to_numpy(dtype=float)
    except (TypeError, ValueError):
        raise Refused("has neither a column t nor an index of times") from None
