"""Numbers that write down their arithmetic as C, so that what Python makes of them can be made anew without it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


class Recorded(float):
    """A number that knows the C expression that gives it; so does whatever follows from it, by the same operations.

    Parameters
    ----------
    value : the number. text : the expression. decisions : to which each yes or no that is asked of the number is added,
        with its condition in C; what follows from the number shares it.
    """

    def __new__(cls, value: float, text: str, decisions: dict[str, bool]) -> Recorded:
        made = super().__new__(cls, value)
        made.text, made.decisions = text, decisions
        return made

    text: str
    decisions: dict[str, bool]

    def _new(self, value: float, text: str) -> Recorded:
        return Recorded(value, text, self.decisions)

    def __neg__(self) -> Recorded:
        return self._new(-float(self), f"(-{self.text})")

    def sqrt(self) -> Recorded:
        """Its square root; NumPy calls it on arrays of objects."""
        return self._new(float(np.sqrt(float(self))), f"sqrt({self.text})")

    def __bool__(self) -> bool:
        return self._decide(float(self) != 0.0, f"{self.text} != 0.0")

    def _decide(self, answer: bool, condition: str) -> bool:
        self.decisions[condition] = answer
        return answer

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **settings: Any) -> Any:
        """Arrays and NumPy's numbers beside it: element by element, with the operations of this class."""
        boxed = [one if isinstance(one, np.ndarray) else _box(one) for one in inputs]
        return getattr(ufunc, method)(*(one.astype(object) for one in boxed), **settings)


def _box(value: Any) -> np.ndarray:
    box = np.empty((), dtype=object)
    box[()] = float(value) if isinstance(value, np.generic) else value
    return box


def text_of(value: float) -> str:
    """A number as C has it: its expression, or all its digits."""
    if isinstance(value, Recorded):
        return value.text
    plain = repr(float(value))
    return {"inf": "INFINITY", "-inf": "-INFINITY", "nan": "NAN"}.get(plain, f"({plain})" if plain[0] == "-" else plain)


def _simpler(name: str, a: float, b: float) -> float | None:
    """What an operation with 0 or 1 gives without it: the same number but for the sign of a zero; None of any other."""
    first, last = (None if isinstance(one, Recorded) else float(one) for one in (a, b))
    if (name == "mul" and 0.0 in (first, last)) or (name == "truediv" and first == 0.0):
        return 0.0
    if (name in ("add", "sub") and last == 0.0) or (name in ("mul", "truediv") and last == 1.0):
        return a
    if (name == "add" and first == 0.0) or (name == "mul" and first == 1.0):
        return b
    return -b if name == "sub" and first == 0.0 else None


def _operation(name: str, form: str, of: Callable[[float, float], float]) -> None:
    def record(self: Recorded, a: float, b: float) -> Any:
        if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
            return NotImplemented
        found = _simpler(name, a, b)
        return found if found is not None else self._new(of(float(a), float(b)), form.format(text_of(a), text_of(b)))

    def forward(self: Recorded, other: Any) -> Any:
        return record(self, self, other)

    def backward(self: Recorded, other: Any) -> Any:
        return record(self, other, self)

    setattr(Recorded, f"__{name}__", forward)
    setattr(Recorded, f"__r{name}__", backward)


def _comparison(name: str, sign: str, of: Callable[[float, float], bool]) -> None:
    def compare(self: Recorded, other: Any) -> bool:
        return self._decide(of(float(self), float(other)), f"{self.text} {sign} {text_of(other)}")

    setattr(Recorded, f"__{name}__", compare)


for _name, _form, _of in (
    ("add", "({} + {})", lambda a, b: a + b), ("sub", "({} - {})", lambda a, b: a - b),
    ("mul", "({} * {})", lambda a, b: a * b), ("truediv", "({} / {})", lambda a, b: a / b),
    ("pow", "pow({}, {})", lambda a, b: a**b),
):  # fmt: skip
    _operation(_name, _form, _of)
for _name, _sign, _is in (
    ("lt", "<", lambda a, b: a < b), ("le", "<=", lambda a, b: a <= b), ("gt", ">", lambda a, b: a > b),
    ("ge", ">=", lambda a, b: a >= b),
):  # fmt: skip
    _comparison(_name, _sign, _is)
