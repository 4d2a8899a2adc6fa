"""A law that somebody else has compiled: a function of C, by its address."""

from __future__ import annotations

import ctypes
import inspect
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.physics.effects.slots import Law

_KIND = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_double))
_ANY_KIND: Any = _KIND.__base__


class CLaw:
    """``double law(const double *states, const double *parameters)``: SI, as its slot and its effect declare them.

    Attributes
    ----------
    address : of the function, which has to stay there. reads : the states that it reads.
    """

    def __init__(self, function: Any, *reads: str) -> None:
        """Take a function at its address.

        Parameters
        ----------
        function : a pointer of ctypes or cffi, what has an ``address`` (numba's ``cfunc``), or a number.
        reads : names of states of the slot.

        Raises
        ------
        UserError : it is no function with an address.
        """
        self.address, self.reads, self._function = _address_of(function), reads, function

    def function(self, states: Sequence[str], parameters: Sequence[str], key: str) -> Law:
        """The function of the states that it reads and of all parameters: of floats.

        Raises
        ------
        UserError : it reads what is no state of its slot.
        """
        for one in self.reads:
            if one not in states:
                raise UserError(key, one, f"a state of the slot: {', '.join(states)}")
        names, call = [*self.reads, *parameters], _KIND(self.address)

        def law(*given: float) -> float:
            value = dict(zip(names, given, strict=True))
            at, p = ([value.get(name, 0.0) for name in group] for group in (states, parameters))
            return float(call((ctypes.c_double * len(at))(*at), (ctypes.c_double * len(p))(*p)))

        kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
        made: Any = law
        made.__signature__ = inspect.Signature([inspect.Parameter(name, kind) for name in names])
        made.c_law = self
        return law


def c_law_of(law: Law) -> CLaw | None:
    """The function of C that a law is; None where it is none."""
    return getattr(law, "c_law", None)


def _address_of(function: Any) -> int:
    """Of a function in any of the forms in which Python has one."""
    found = getattr(function, "address", function)
    if type(found).__module__ == "_cffi_backend":
        from dtbacklash.core.library import ffi

        found = int(ffi.cast("intptr_t", found))
    elif isinstance(found, (_ANY_KIND, ctypes.c_void_p)):
        found = ctypes.cast(found, ctypes.c_void_p).value
    if isinstance(found, bool) or not isinstance(found, int) or found <= 0:
        raise UserError(
            "a law in C", function, "a pointer to a function of ctypes or cffi, numba's cfunc, or an address"
        )
    return found
