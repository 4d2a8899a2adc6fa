"""A compiled library as it is loaded, and arrays as it takes them."""

import importlib
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from dtbacklash.core import build
from dtbacklash.errors import UserError

#: struct -> the arrays that it points to, which have to be there as long
_pointed_to: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()


def _load(library: build.Library) -> Any:
    """The module that :mod:`.build` has written.

    Raises
    ------
    UserError : it is not there, or was made of other sources.
    """
    try:
        declared = importlib.import_module(library.module)
    except ImportError:
        declared = None
    if declared is None or build.digest(library) != declared.SOURCES:
        state = "not compiled" if declared is None else "compiled from other sources"
        raise UserError(library.module.rpartition(".")[0], state, "compile it: python -m dtbacklash.core.build")
    return declared


class Binding:
    """A library: what was read off its sources (``declared``), and its functions (``lib``).

    Its functions release the interpreter's lock.
    """

    def __init__(self, library: build.Library) -> None:
        self.declared = _load(library)
        self.ffi = self.declared.ffi
        self.lib = self.ffi.dlopen(str(library.file))
        kinds = ((np.float64, "double"), (np.int64, "int64_t"), (np.bool_, "unsigned char"))
        self._kinds = {np.dtype(ours): self.ffi.typeof(f"{theirs}[]") for ours, theirs in kinds}

    def buffer(self, array: np.ndarray, *shape: int) -> Any:
        """The numbers of an array, which the library reads or fills; what is returned keeps the array.

        Parameters
        ----------
        array : C-contiguous, of float64, int64 or bool. shape : that it must have; empty for any.

        Raises
        ------
        ValueError : it is none of these.
        """
        if shape and array.shape != shape:
            raise ValueError(f"an array of shape {array.shape} where {shape} is asked for")
        if array.dtype not in self._kinds or not array.flags.c_contiguous:
            raise ValueError(f"an array of {array.dtype} that is not contiguous, or of no kind that a library takes")
        return self.ffi.from_buffer(self._kinds[array.dtype], array)

    def copied(self, array: np.ndarray, *shape: int) -> Any:
        """The same of an array that the library only reads: of floats, made contiguous where it is not."""
        return self.buffer(np.ascontiguousarray(array, dtype=np.float64), *shape)

    def calls(self) -> "Calls":
        """For functions of Python that the library calls."""
        return Calls(self.ffi)

    def struct(self, kind: str, **fields: Any) -> Any:
        """A struct of the library, by its name in a header; the arrays that it points to live as long as it does.

        fields : numbers, of a pointer an address; arrays, as for :meth:`buffer`; structs made so.
        """
        inside = dict(self.ffi.typeof(kind).fields)
        kept = {name: self.buffer(value) if isinstance(value, np.ndarray) else value for name, value in fields.items()}
        made = self.ffi.new(f"{kind} *", {name: self._field(inside[name].type, v) for name, v in kept.items()})
        _pointed_to[made] = kept
        return made

    def _field(self, kind: Any, value: Any) -> Any:
        """A value as a field of a struct takes it."""
        if kind.kind == "struct":
            return value[0]
        return self.ffi.cast(kind, value) if kind.kind in ("pointer", "function") and isinstance(value, int) else value


class Calls:
    """Functions of Python that a library calls; what one raises, :meth:`check` raises after the library's own call."""

    def __init__(self, ffi: Any) -> None:
        self._ffi = ffi
        self._raised: list[BaseException] = []

    def __call__(self, kind: str, function: Any) -> Any:
        """The function as the library takes it; it gives nothing back."""

        def note(_kind: Any, mistake: BaseException, _trace: Any) -> None:
            self._raised.append(mistake)

        return self._ffi.callback(kind, function, onerror=note)

    def check(self) -> None:
        """Raise what was raised first, if anything was."""
        if self._raised:
            raise self._raised.pop(0)
