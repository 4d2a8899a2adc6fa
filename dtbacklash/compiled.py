"""How the inner loops are compiled: numba's options, and where the compiled code is kept.

A file of compiled code is named by everything that decides it (:func:`fingerprint`): the code of the function and of
the functions that it calls, the constants that they read, the types of the arguments, the versions of the libraries. So
a changed law or constant is compiled anew, wherever it stands, and a changed docstring, comment or other module is not.
"""

import enum
import hashlib
import os
import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core import sigutils
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic
from numba.core.serialize import dumps
from numba.core.types.containers import BaseTuple

from dtbacklash import files
from dtbacklash.errors import UserError

#: of these only the names count: their versions are part of each key, or of Python's
LIBRARIES = ("builtins", "cmath", "llvmlite", "math", "numba", "numpy", "operator")
CONSTANTS = (bool, int, float, complex, str, bytes, type(None), np.generic, np.dtype)


def cache_folder() -> Path:
    """Where compiled code is kept; the package itself may lie in a folder that cannot be written to."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR") or numba.config.CACHE_DIR:
        return Path(chosen)
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "dtbacklash" / "numba"


def is_cold(dispatcher: Any) -> bool:
    """Whether a compiled function has never run on this machine, as it is now: its first call compiles it."""
    return not any(cache_folder().glob(f"{_stem(dispatcher)}-*"))


class Unknown(Exception):
    """A function reads something of which it cannot be told whether it has changed."""


def fingerprint(function: Any) -> str:
    """Hash of what decides the compiled code of a function, beside the types of its arguments.

    That is its own code without docstring, comments and line numbers, numba's options, and the functions, constants
    and named tuples that it names, wherever they are defined, with all that these name in turn.

    Raises
    ------
    Unknown : it names something else.
    """
    reached = [function]
    texts = [_described(one, reached) for one in reached]  # which grows meanwhile
    return _hash(texts)


def _described(function: Any, reached: list[Any]) -> str:
    """One function in words; the functions that it names are called by their place in ``reached``."""
    plain = getattr(function, "py_func", function)
    # compiled code names its module, which must be there when it is loaded
    words: list[Any] = [plain.__module__, sorted(getattr(function, "targetoptions", {}).items()), plain.__defaults__]
    codes, names = [plain.__code__], []
    for code in codes:
        constants = code.co_consts
        if code is plain.__code__ and plain.__doc__ is not None and constants[:1] == (plain.__doc__,):
            constants = (None, *constants[1:])
        codes += [one for one in constants if isinstance(one, CodeType)]
        names += [name for name in code.co_names if name not in names]
        words += [code.co_code, code.co_names, code.co_varnames, code.co_freevars, code.co_flags, code.co_argcount]
        words += [_value(one, (), reached) for one in constants if not isinstance(one, CodeType)]
    words += [_value(cell.cell_contents, names, reached) for cell in plain.__closure__ or ()]
    space = plain.__globals__
    words += [(name, _value(space[name], names, reached)) for name in names if name in space]
    return repr(words)


def _value(value: Any, names: list[str] | tuple[str, ...], reached: list[Any]) -> Any:
    """What a function names, in words; of a module the ``names`` that it names."""
    if isinstance(value, CONSTANTS):
        return repr(value)
    if isinstance(value, (tuple, list)):
        return [_value(one, names, reached) for one in value]
    if isinstance(value, frozenset):
        return sorted(map(repr, value))
    if isinstance(value, np.ndarray):
        return str(value.dtype), value.shape, value.tobytes()
    if (getattr(value, "__module__", None) or "").partition(".")[0] in LIBRARIES and not isinstance(value, Dispatcher):
        return value.__module__, getattr(value, "__qualname__", type(value).__name__)
    value = value._defn if isinstance(value, _Intrinsic) else value
    if isinstance(value, (Dispatcher, FunctionType)):
        if not any(one is value for one in reached):
            reached.append(value)
        return next(place for place, one in enumerate(reached) if one is value)
    if isinstance(value, ModuleType):
        if value.__name__.partition(".")[0] in LIBRARIES:
            return value.__name__
        return [(name, _value(vars(value)[name], names, reached)) for name in names if name in vars(value)]
    if isinstance(value, type):
        members = [(one.name, repr(one.value)) for one in value] if issubclass(value, enum.Enum) else []
        return value.__qualname__, getattr(value, "_fields", ()), members
    if isinstance(value, np.ufunc):
        return value.__name__
    raise Unknown(f"{type(value).__name__} {value!r}")


def _hash(words: Any) -> str:
    return hashlib.sha256(repr(words).encode()).hexdigest()[:24]


def _layout(kind: Any) -> Any:
    """A type of numba in words, with the names in its named tuples, which numba leaves out."""
    if not isinstance(kind, BaseTuple):
        return repr(kind)
    made_of = getattr(kind, "instance_class", tuple)
    names = (made_of.__module__, made_of.__qualname__, getattr(kind, "fields", ()))
    return type(kind).__name__, names, [_layout(one) for one in kind.types]


def _stem(dispatcher: Any) -> str:
    return f"{dispatcher.py_func.__qualname__.rpartition('.')[2]}-{fingerprint(dispatcher)}"


class _Kept(NullCache):
    """The compiled code of one function on disk: a file for each state of its code and each types of arguments."""

    def __init__(self, dispatcher: Any) -> None:
        self.dispatcher = dispatcher

    @property
    def cache_path(self) -> str:
        """The folder that it is kept in."""
        return str(cache_folder())

    def _file(self, signature: Any, codegen: Any) -> Path:
        arguments = [_layout(kind) for kind in sigutils.normalize_signature(signature)[0]]
        versions = (numba.__version__, llvmlite.__version__, np.__version__, sys.version_info[:2])
        return cache_folder() / f"{_stem(self.dispatcher)}-{_hash([arguments, codegen.magic_tuple(), versions])}.nbc"

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """What numba compiled before, or None."""
        target_context.refresh()
        try:
            kept = pickle.loads(self._file(signature, target_context.codegen()).read_bytes())
        except (OSError, EOFError, pickle.UnpicklingError, Unknown):
            return None
        return CompileResult._rebuild(target_context, *kept)

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep what numba has compiled; where it cannot be written, it is compiled anew the next time."""
        if result.library.has_dynamic_globals or not all(lifted.can_cache for lifted in result.lifted):
            return
        with suppress(UserError, Unknown):
            files.write_bytes(self._file(signature, result.codegen), dumps(result._reduce()))


def kept(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """numba's ``njit`` with these options, whose functions are kept in :func:`cache_folder`."""
    decorator = numba.njit(error_model="numpy", **options)

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = decorator(function)
        dispatcher._cache = _Kept(dispatcher)
        return dispatcher

    return decorate


#: No fast-math: results repeat to the last bit.
#: ``_nrt=False`` takes the counting of references out of the loop: it may not allocate, and a call costs 1 ns
#: instead of 0.5 us (the plant is a tuple of twenty arrays, each counted at each call).
compiled = kept(_nrt=False)

#: For what the inner loop calls every time: a call that is not inlined passes the plant's two hundred words (0.15 us).
inlined = kept(_nrt=False, forceinline=True)

#: The same for functions that allocate.
compiled_allocating = kept()

#: The laws: small enough to be part of every function that calls them.
law = kept(inline="always")


@compiled
def copy(source, target):
    """target = source, element by element (a slice assignment would allocate)."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@compiled
def clear(target):
    """target = 0."""
    for i in range(target.shape[0]):
        target[i] = 0.0
