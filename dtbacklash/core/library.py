"""The compiled core as it is loaded, and arrays as it takes them."""

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from dtbacklash.core import build
from dtbacklash.errors import UserError


def _load() -> Any:
    """The module that :mod:`.build` has written.

    Raises
    ------
    UserError : it is not there, or was made of other sources.
    """
    try:
        from dtbacklash.core import _declared
    except ImportError:
        _declared = None  # type: ignore[assignment]
    if _declared is None or build.digest() != _declared.SOURCES:
        state = "not compiled" if _declared is None else "compiled from other sources"
        raise UserError("dtbacklash.core", state, "compile it: python -m dtbacklash.core.build")
    return _declared


_declared = _load()
ffi = _declared.ffi
#: law of ``laws.c`` -> its slot, the states that it asks for, its parameters by place
LAWS: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = _declared.LAWS
#: its functions release the interpreter's lock
lib = ffi.dlopen(str(build.HERE / build.LIBRARY))

_doubles, _integers, _flags = (ffi.typeof(f"{kind}[]") for kind in ("double", "int64_t", "unsigned char"))
#: struct -> the arrays that it points to, which have to be there as long
_pointed_to: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()
_KINDS = {np.dtype(np.float64): _doubles, np.dtype(np.int64): _integers, np.dtype(np.bool_): _flags}


def buffer(array: np.ndarray, *shape: int) -> Any:
    """The numbers of an array, which the core reads or fills; what is returned keeps the array.

    Parameters
    ----------
    array : C-contiguous, of float64, int64 or bool. shape : that it must have; empty for any.

    Raises
    ------
    ValueError : it is none of these.
    """
    if shape and array.shape != shape:
        raise ValueError(f"an array of shape {array.shape} where {shape} is asked for")
    if array.dtype not in _KINDS or not array.flags.c_contiguous:
        raise ValueError(f"an array of {array.dtype} that is not contiguous, or of no kind that the core takes")
    return ffi.from_buffer(_KINDS[array.dtype], array)


def copied(array: np.ndarray, *shape: int) -> Any:
    """The same of an array that the core only reads: of floats, made contiguous where it is not."""
    return buffer(np.ascontiguousarray(array, dtype=np.float64), *shape)


def struct(kind: str, **fields: Any) -> Any:
    """A struct of the core, by its name in a header; the arrays that it points to live as long as it does.

    fields : numbers, of a pointer an address; arrays, as for :func:`buffer`; structs made so.
    """
    inside = dict(ffi.typeof(kind).fields)
    kept = {name: buffer(value) if isinstance(value, np.ndarray) else value for name, value in fields.items()}
    made = ffi.new(f"{kind} *", {name: _field(inside[name].type, value) for name, value in kept.items()})
    _pointed_to[made] = kept
    return made


def _field(kind: Any, value: Any) -> Any:
    """A value as a field of a struct takes it."""
    if kind.kind == "struct":
        return value[0]
    return ffi.cast(kind, value) if kind.kind in ("pointer", "function") and isinstance(value, int) else value
