"""From a file's bytes, gzipped or not, or from a DataFrame, to named columns."""

from __future__ import annotations

import io
import json
import re
import sys
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.recording import heads, stamps, text
from dtbacklash.recording.refusal import NoTable, Refused
from dtbacklash.recording.table import Column, Table, with_clocks

if TYPE_CHECKING:
    import pandas as pd
    from typing_extensions import TypeIs

FORMATS = "CSV, Excel .xlsx, Parquet, MATLAB .mat, NumPy .npz or JSON, gzipped or not"
BYTES_MAX = 4 << 30  # of an unpacked file; beyond this the memory, not the reader, is the limit
COLUMNS_MAX = 256  # a matrix wider than this is not one column a channel

_JSON = re.compile(rb"(\xef\xbb\xbf)?\s*[\[{]\s*[\[{}\]\"\d.-]")
_GZIP = b"\x1f\x8b"
_HDF5 = b"\x89HDF\r\n\x1a\n"


def load(file: Path) -> bytes:
    """Return the unpacked content of ``file`` (raises Refused)."""
    try:
        return unpacked(file.read_bytes())
    except OSError as error:
        raise Refused(f"cannot be read: {(error.strerror or str(error)).lower()}") from error
    except MemoryError as error:
        raise Refused("does not fit into the memory") from error


def read_table(content: bytes, name: str, rows: tuple[int, int] | None = None) -> Table:
    """Read the columns of a file's ``content``; its format is known by the content, hardly by its ``name``.

    rows : those to read, half-open; None: all.

    Raises
    ------
    Refused : no known format, damaged, or without columns.
    """
    if not content.strip():
        raise Refused("is empty")
    kind, reader = _reader(content, name)
    try:
        table = text.read(content, rows) if reader is text.read else reader(content)
    except Refused:
        raise
    except Exception as error:  # the parsers of damaged files raise whatever they meet first
        reason = next(iter(str(error).splitlines()), "") or type(error).__name__
        raise Refused(f"is damaged: it cannot be read as {kind} ({reason[:80]})") from error
    if not any(column.values is not None for column in table.columns.values()):
        raise Refused(f"holds no columns of numbers ({kind})")
    return with_clocks(table if rows is None or reader is text.read else table.cut(*rows))


def unpacked(content: bytes) -> bytes:
    """Return ``content`` without its gzip, if it has one.

    Raises
    ------
    Refused : a damaged or endless archive.
    """
    if not content.startswith(_GZIP):
        return content
    result, rest = [], content
    try:
        while rest.startswith(_GZIP):  # an archive may have several members
            engine = zlib.decompressobj(wbits=31)
            result.append(engine.decompress(rest, BYTES_MAX))
            if not engine.eof:
                too_large = bool(engine.unconsumed_tail)
                raise Refused("unpacks to more than 4 GB" if too_large else "is damaged: its gzip ends too early")
            rest = engine.unused_data
    except zlib.error as error:
        raise Refused("is damaged: its gzip cannot be unpacked") from error
    return b"".join(result)


def _reader(content: bytes, name: str) -> tuple[str, Callable[[bytes], Table]]:
    head = content[:512]
    if head.startswith(b"PAR1"):
        return "Parquet", _parquet
    if head.startswith(_HDF5) or b"MATLAB 7.3 MAT-file" in head[:128]:
        return "MATLAB 7.3", _matlab73
    if head.startswith(b"MATLAB 5.0 MAT-file"):
        return "MATLAB 5", _matlab5
    if head.startswith(b"PK\x03\x04"):
        return ("Excel", _excel) if _is_excel(content) else ("NumPy .npz", _npz)
    if text.is_utf16(head):
        return "CSV", text.read
    if _JSON.match(head):
        return "JSON", _json
    if b"\0" in head or name.lower().removesuffix(".gz").endswith((".mat", ".parquet", ".npz", ".npy")):
        raise Refused(f"is not a recording that can be read: {FORMATS}")
    return "CSV", text.read


def _is_excel(content: bytes) -> bool:
    try:
        return "xl/workbook.xml" in zipfile.ZipFile(io.BytesIO(content)).namelist()
    except zipfile.BadZipFile:
        return False


def _excel(content: bytes) -> Table:
    """The first sheet with a table, as the text that it shows: heads, a line of units and remarks as in a CSV."""
    import pandas as pd

    try:
        book = pd.ExcelFile(io.BytesIO(content))
    except ImportError:
        raise Refused("is an Excel file, which needs openpyxl: pip install 'dtbacklash[excel]'") from None
    for number, name in enumerate(book.sheet_names):
        sheet = pd.read_excel(book, sheet_name=name, header=None, dtype=object)
        try:
            table = text.read(sheet.to_csv(sep="\t", header=False, index=False).encode(), decimal=".")
        except NoTable:
            continue
        if number:
            table.notes.append(f"Sheet {name} is read: none before it holds a table of numbers.")
        return table
    raise NoTable("holds no table of numbers with at least two columns in any sheet")


def _parquet(content: bytes) -> Table:
    from pyarrow import parquet

    frame = parquet.read_table(io.BytesIO(content)).to_pandas(ignore_metadata=True)
    return from_arrays(dict(frame.items()), whole=True)


def _matlab5(content: bytes) -> Table:
    from scipy.io import loadmat

    return from_arrays(_flat(loadmat(io.BytesIO(content), simplify_cells=True)))  # type: ignore[arg-type]


def _matlab73(content: bytes) -> Table:
    try:
        import h5py
    except ImportError:
        raise Refused("is a MATLAB 7.3 file, which needs h5py: pip install 'dtbacklash[matlab]'") from None
    arrays: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("#") and item.dtype.kind in "fiu":
            arrays[name.replace("/", ".")] = item[()].T  # MATLAB stores by columns

    with h5py.File(io.BytesIO(content), "r") as file:
        file.visititems(visit)
    return from_arrays(arrays)


def _npz(content: bytes) -> Table:
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return from_arrays({name: archive[name] for name in archive.files})


def _json(content: bytes) -> Table:
    try:
        data = json.loads(content)
    except json.JSONDecodeError:  # a line for each row
        data = [json.loads(line) for line in content.splitlines() if line.strip()]
    if isinstance(data, list):
        data = {"data": data}
    names = data.get("columns")
    rows = data.get("data", data.pop("rows", None))
    if isinstance(names, dict):  # {"columns": {"t": [...], ...}}
        return from_arrays(_flat({**data, **names}))
    if isinstance(rows, list) and rows and isinstance(rows[0], dict):
        import pandas as pd

        rest = {key: value for key, value in data.items() if key not in ("data", "columns")}
        return from_arrays({**_flat(rest), **{str(n): c for n, c in pd.json_normalize(rows).items()}})
    table = from_arrays(_flat({key: value for key, value in data.items() if key not in ("data", "columns")}))
    if isinstance(rows, dict):
        return from_arrays(_flat({**table.constants, **rows}))
    if rows is not None:
        matrix = np.array(rows, dtype=float)
        if matrix.ndim != 2 or (names is not None and len(names) != matrix.shape[1]):
            raise Refused("must hold `data` as rows of one length, one number for each of `columns`")
        labels = [str(name) for name in names] if names is not None else map(str, range(matrix.shape[1]))
        table.columns = {name: Column(values) for name, values in zip(labels, matrix.T, strict=True)}
    return table


def _flat(tree: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Structures inside structures as dotted names; MATLAB's own entries and texts left out."""
    result: dict[str, Any] = {}
    for key, value in tree.items():
        if str(key).startswith("__") or isinstance(value, (str, bytes, bool)):
            continue
        if isinstance(value, dict):
            result |= _flat(value, f"{prefix}{key}.")
        else:
            result[f"{prefix}{key}"] = value
    return result


def is_frame(value: object) -> TypeIs[pd.DataFrame]:
    """Tell whether a value is a DataFrame, without importing pandas."""
    return "pandas" in sys.modules and isinstance(value, sys.modules["pandas"].DataFrame)


def frame_table(frame: pd.DataFrame) -> Table:
    """The columns of a DataFrame; its index is the column ``t`` unless it only counts the rows.

    Raises
    ------
    Refused : no frame, no rows, two columns of one name, or an index of something else than times.
    """
    if not is_frame(frame):
        raise Refused(f"must be a DataFrame, not a {type(frame).__name__}")
    names = [str(name) for name in frame.columns]
    double = next((name for name in names if names.count(name) > 1), None)
    if double is not None:
        raise Refused(f"has two columns named {double}")
    if not len(frame) or not names:
        raise Refused("is empty")
    import pandas as pd

    index = frame.index
    apart = not isinstance(index, pd.RangeIndex) and not any(map(heads.is_time, names))
    arrays: dict[str, object] = {str(index.name or heads.TIME): index.to_numpy()} if apart else {}
    for name, (_, column) in zip(names, frame.items(), strict=True):
        kind = column.dtype
        missing = pd.api.types.is_extension_array_dtype(kind) and pd.api.types.is_numeric_dtype(kind)
        arrays[name] = column.to_numpy(dtype=float, na_value=np.nan) if missing else column.to_numpy()
    table = from_arrays(arrays, whole=True)
    if apart and next(iter(table.columns.values())).values is None:
        raise Refused("has neither a column t nor an index of times")
    return with_clocks(table)


def from_arrays(arrays: Mapping[str, object], whole: bool = False) -> Table:
    """Vectors and the columns of matrices are columns, single numbers constants.

    Of several lengths the commonest counts. ``whole`` : each entry is a column, however short.
    """
    table = Table()
    for head, value in arrays.items():
        clock = _clock(value)
        name, unit = (head, "") if clock is None else (heads.bare(head), "s")
        try:
            array = _real(value) if clock is None else clock
        except Refused as refusal:
            table.columns[name] = Column(unusable=str(refusal))
            continue
        if array.size == 1 and not whole:
            table.constants[name] = float(array.reshape(-1)[0])
        elif array.ndim == 1 or (array.ndim == 2 and 1 in array.shape):
            table.columns[name] = Column(array.reshape(-1), unit)
        elif array.ndim == 2 and min(array.shape) <= COLUMNS_MAX:
            matrix = array if array.shape[0] >= array.shape[1] else array.T
            alone = len(arrays) == 1
            table.numbered = alone
            table.columns |= {str(j) if alone else f"{name}.{j}": Column(column) for j, column in enumerate(matrix.T)}
    lengths = Counter(len(c.values) for c in table.columns.values() if c.values is not None)
    length = max(lengths, key=lambda length: (lengths[length] * (length > 1), length), default=0)
    for column in table.columns.values():
        if column.values is not None and len(column.values) != length:
            column.unusable = f"has {len(column.values)} values, and the others {length}"
            column.values = None
    return table


def _clock(value: object) -> Floats | None:
    """The seconds of time stamps, as dates or as text, from the first one on; None for anything else."""
    kind = getattr(np.asarray(value), "dtype", np.dtype(object)).kind
    try:
        return stamps.seconds(value) if kind in "mMUO" and np.ndim(np.asarray(value)) == 1 else None
    except (TypeError, ValueError):
        return None


def _real(value: object) -> Floats:
    """An array of real numbers (raises Refused: a phrase that says what it is instead)."""
    try:
        array = np.asarray(value)
        if np.iscomplexobj(array):
            if np.any(array.imag):
                raise Refused("is complex: give its real part, its size or its phase as a column")
            array = array.real
        if array.dtype.kind not in "fiub" and array.dtype != object:
            raise Refused("holds no numbers")
        return array.astype(float)
    except (TypeError, ValueError, OverflowError) as error:
        raise error if isinstance(error, Refused) else Refused("holds no numbers") from error
