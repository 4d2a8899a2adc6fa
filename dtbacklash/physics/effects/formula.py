"""Formulas that users write, as functions: read by a whitelist of what may stand in them, never evaluated as Python.

A formula is numbers, ``pi``, names of states and parameters, ``+ - * / **``, brackets and the functions of
:data:`FUNCTIONS`. Its tree (:mod:`ast`) is checked node by node, and rebuilt from what is allowed.
"""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from dtbacklash import units
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.physics.effects.slots import Law

#: function -> the least and the largest number of its arguments
FUNCTIONS: Final = {
    **dict.fromkeys(("abs", "sign", "sin", "cos", "tan", "atan", "exp", "log", "sqrt", "tanh"), (1, 1)),
    "min": (2, 6), "max": (2, 6),
}  # fmt: skip
#: what they are in the function that is made: they take floats and arrays alike, and overflow to infinity
_MADE_OF: Final = {
    "abs": np.abs, "sign": np.sign, "sin": np.sin, "cos": np.cos, "tan": np.tan, "atan": np.arctan, "exp": np.exp,
    "log": np.log, "sqrt": np.sqrt, "tanh": np.tanh, "min": np.minimum, "max": np.maximum,
}  # fmt: skip
#: of these the argument is a plain number, and so is what they give
_OF_NUMBERS: Final = ("sin", "cos", "tan", "exp", "log", "tanh", "atan")
_OPERATORS: Final = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow)
#: bounds of a formula: its signs, and how deep its brackets and operators stand in one another
LENGTH_MAX, DEPTH_MAX = 400, 30
#: numbers in it are below this
LARGEST = 1e100
#: short names of states, as people write them
SHORT: Final = {
    "q": "position", "v": "velocity", "t": "time", "s": "stretch", "ds": "stretch_rate", "u": "command", "i": "current",
    "z": "memory",
}  # fmt: skip
_FOREIGN: Final = re.compile(r"[^A-Za-z0-9_+\-*/().,\s]")


class Formula:
    """A checked formula.

    Attributes
    ----------
    text : as it was written, in Python's spacing. names : the states (by their long names) and the parameters in it.
    """

    def __init__(self, text: object, states: Collection[str], parameters: Collection[str], key: str) -> None:
        """Check a formula.

        Parameters
        ----------
        text : what the user wrote. states : long names of what it may ask for. parameters : of its effect.
        key : the dotted name for the error.

        Raises
        ------
        UserError : whatever the text is, if it is not a formula of these.
        """
        self.key, self._states, self._parameters = key, states, parameters
        self.names: list[str] = []
        if not isinstance(text, str):
            raise UserError(key, text, "a formula in words, e.g. -drag*abs(v)*v")
        written = " ".join(text.split())
        if not written:
            raise UserError(key, "(empty)", "a formula, e.g. -drag*abs(v)*v")
        if len(written) > LENGTH_MAX:
            raise UserError(key, f"{written[:40]}... ({len(written)} signs)", f"at most {LENGTH_MAX} signs")
        if foreign := _FOREIGN.search(written):
            hint = "; a power is written **" if foreign.group() == "^" else ""
            raise UserError(key, written, f"numbers, names, + - * / ** ( ) , and no {foreign.group()!r}{hint}")
        tree = self._parsed(written)
        self._tree = self._checked(tree, 0)
        self.text = ast.unparse(tree)

    def _parsed(self, written: str) -> ast.expr:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about `1if 2` and the like, which is refused
            try:
                return ast.parse(written, mode="eval").body
            except (SyntaxError, ValueError, RecursionError, MemoryError):
                raise UserError(self.key, written, "is no formula: a bracket, an operator or a name is wrong") from None

    def _checked(self, node: ast.expr, depth: int) -> ast.expr:
        """The node again, made of what is allowed, with the states' long names and numbers as floats."""
        made = self._made(node, depth)
        if not isinstance(made, (ast.Name, ast.Constant)) and not self._names_in(made):
            self._check_number(made)
        return made

    @staticmethod
    def _names_in(made: ast.expr) -> bool:
        """Whether a checked node has the name of a state or a parameter."""
        return any(isinstance(one, ast.Name) and one.id not in FUNCTIONS for one in ast.walk(made))

    def _check_number(self, made: ast.expr) -> None:
        """Refuse what has no value although nothing in it varies, such as ``1/0`` and ``(0 - 8)**0.5``."""
        whole = ast.fix_missing_locations(ast.Expression(made))
        try:
            with np.errstate(all="ignore"):
                value = eval(compile(whole, f"<{self.key}>", "eval"), {"__builtins__": {}, **_MADE_OF})
        except ArithmeticError:
            value = math.nan
        if isinstance(value, complex) or not math.isfinite(value):
            raise UserError(self.key, _shown(made), "a part without a name that gives a finite number")

    def _made(self, node: ast.expr, depth: int) -> ast.expr:
        if depth > DEPTH_MAX:
            raise UserError(self.key, "(a formula)", f"brackets and operators at most {DEPTH_MAX} deep")
        if isinstance(node, ast.Constant):
            return self._number(node)
        if isinstance(node, ast.Name):
            return self._named(node.id)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.UAdd, ast.USub)):
            return ast.UnaryOp(node.op, self._checked(node.operand, depth + 1))
        if isinstance(node, ast.BinOp) and isinstance(node.op, _OPERATORS):
            return ast.BinOp(self._checked(node.left, depth + 1), node.op, self._checked(node.right, depth + 1))
        if isinstance(node, ast.Call):
            return self._call(node, depth)
        raise UserError(self.key, _shown(node), f"{_in_words(node)} is not allowed; numbers, names, + - * / **, "
                        f"{', '.join(FUNCTIONS)}")  # fmt: skip

    def _number(self, node: ast.Constant) -> ast.expr:
        value = node.value
        if isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < LARGEST:
            return ast.Constant(float(value))
        allowed = f"a number below {LARGEST:g}" if type(value) in (int, float) else "is no number, such as 2.5 or 1e-3"
        raise UserError(self.key, _shown(node), allowed)

    def _named(self, name: str) -> ast.expr:
        if name == "pi":
            return ast.Constant(math.pi)
        if name in FUNCTIONS and name not in self._parameters:
            raise UserError(self.key, name, f"is a function: write what it is of in brackets, {name}(...)")
        long = name if name in self._parameters else SHORT.get(name, name)
        if long not in self._states and long not in self._parameters:
            shorts = {long: short for short, long in SHORT.items()}
            known = [f"{s} ({shorts[s]})" if s in shorts else s for s in self._states]
            raise UserError(
                self.key, name, f"states {', '.join(known)}; parameters {', '.join(self._parameters) or '(none)'}"
            )
        if long not in self.names:
            self.names.append(long)
        return ast.Name(long, ast.Load())

    def _call(self, node: ast.Call, depth: int) -> ast.expr:
        name = node.func.id if isinstance(node.func, ast.Name) else _shown(node.func)
        if name not in FUNCTIONS or not isinstance(node.func, ast.Name):
            raise UserError(self.key, f"{name}()", f"is no function here; choose one of {', '.join(FUNCTIONS)}")
        least, most = FUNCTIONS[name]
        if node.keywords or not least <= len(node.args) <= most:
            many = str(least) if least == most else f"{least} to {most}"
            raise UserError(self.key, _shown(node), f"{name} takes {many} argument{'s' * (most > 1)}")
        given = [self._checked(one, depth + 1) for one in node.args]
        while len(given) > 2:  # the least of several, two by two
            given[:2] = [ast.Call(ast.Name(name, ast.Load()), given[:2], [])]
        return ast.Call(ast.Name(name, ast.Load()), given, [])

    def function(self) -> Law:
        """The function of its names, in their order: of floats or arrays."""
        module = ast.parse(f"def formula({', '.join(self.names)}): pass")
        made = module.body[0]
        assert isinstance(made, ast.FunctionDef)
        made.body = [ast.Return(self._tree)]
        ast.fix_missing_locations(module)
        # what is kept of compiled code names a module; there is nothing else to be found from inside
        space: dict[str, Any] = {"__name__": __name__, "__builtins__": {}, **_MADE_OF}
        exec(compile(module, f"<{self.key}>", "exec"), space)
        space["formula"].formula = self
        made_function: Law = space["formula"]
        return made_function

    def source(self, name: str) -> str:
        """The function as Python's source, of floats; it calls the functions of :data:`FUNCTIONS` by their names."""
        return f"def {name}({', '.join(self.names)}):\n    return {ast.unparse(self._tree)}"

    def program(self) -> list[tuple[str, Any]]:
        """The formula as operations of a stack machine, in the order in which it carries them out.

        ``NAME`` and ``CONSTANT`` put the value of a name and a number on the stack; each other one replaces the last
        one or two numbers on it, and is named as in ``core/laws.h``.
        """
        return _program(self._tree)

    def dimension(self, known: Mapping[str, units.Dimension | None]) -> units.Dimension | None:
        """The dimension of what it gives, from those of its names; None where it cannot be told.

        0 has any, and a number that is not whole: it may stand for a measured value.

        Raises
        ------
        UserError : a sum of what differs, or a function of numbers of what is none.
        """
        return self._dimension(self._tree, known)

    def _dimension(self, node: ast.expr, known: Mapping[str, units.Dimension | None]) -> units.Dimension | None:
        if isinstance(node, ast.Constant):
            value = _value(node)
            return units.NUMBER if (value != 0.0 and value.is_integer()) or value == math.pi else None
        if isinstance(node, ast.Name):
            return known.get(node.id)
        if isinstance(node, ast.UnaryOp):
            return self._dimension(node.operand, known)
        if isinstance(node, ast.BinOp):
            return self._of_operator(node, known)
        assert isinstance(node, ast.Call)
        assert isinstance(node.func, ast.Name)
        found = [self._dimension(one, known) for one in node.args]
        if node.func.id in _OF_NUMBERS:
            if found[0] not in (None, units.NUMBER):
                raise UserError(self.key, _shown(node), f"{node.func.id} takes a plain number, not "
                                f"{units.of_dimension(found[0])}")  # fmt: skip
            return units.NUMBER
        if node.func.id == "sign":
            return units.NUMBER
        if node.func.id == "sqrt":
            return units.power(found[0], 0.5)
        return self._same(node, found)

    def _of_operator(self, node: ast.BinOp, known: Mapping[str, units.Dimension | None]) -> units.Dimension | None:
        left, right = self._dimension(node.left, known), self._dimension(node.right, known)
        if isinstance(node.op, (ast.Add, ast.Sub)):
            return self._same(node, [left, right])
        if isinstance(node.op, ast.Pow):
            exponent = node.right.operand if isinstance(node.right, ast.UnaryOp) else node.right
            if isinstance(exponent, ast.Constant):
                sign = -1.0 if isinstance(node.right, ast.UnaryOp) and isinstance(node.right.op, ast.USub) else 1.0
                return units.power(left, sign * _value(exponent))
            if right not in (None, units.NUMBER):
                raise UserError(self.key, _shown(node), f"an exponent is a number, not {units.of_dimension(right)}")
            return units.NUMBER if left == units.NUMBER else None
        return units.times(left, right if isinstance(node.op, ast.Mult) else units.power(right, -1.0))

    def _same(self, node: ast.expr, found: list[units.Dimension | None]) -> units.Dimension | None:
        told = [one for one in found if one is not None]
        for one in told[1:]:
            if one != told[0]:
                two = f"{units.of_dimension(told[0])} and {units.of_dimension(one)}"
                raise UserError(self.key, _shown(node), f"{two} cannot be added or compared")
        return told[0] if told else None


_BINARY: Final = {
    ast.Add: "ADD", ast.Sub: "SUBTRACT", ast.Mult: "MULTIPLY", ast.Div: "DIVIDE", ast.Pow: "POWER",
}  # fmt: skip


def _program(node: ast.expr) -> list[tuple[str, Any]]:
    """The operations of a part of a checked formula."""
    if isinstance(node, ast.Constant):
        return [("CONSTANT", _value(node))]
    if isinstance(node, ast.Name):
        return [("NAME", node.id)]
    if isinstance(node, ast.UnaryOp):
        return _program(node.operand) + [("NEGATIVE", None)] * isinstance(node.op, ast.USub)
    if isinstance(node, ast.BinOp):
        if isinstance(node.op, ast.Pow) and isinstance(node.right, ast.Constant) and _value(node.right) == 2.0:
            return [*_program(node.left), ("SQUARE", None)]
        return [*_program(node.left), *_program(node.right), (_BINARY[type(node.op)], None)]
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    return [step for one in node.args for step in _program(one)] + [(node.func.id.upper(), None)]


#: what people write who think of Python, as they would call it
_WORDS: Final = {
    ast.Attribute: "an attribute", ast.IfExp: "a condition (if ... else)", ast.BoolOp: "`and` or `or`",
    ast.Tuple: "a comma outside of a function's brackets", ast.Starred: "a * with nothing before it",
    ast.UnaryOp: "`not`",
}  # fmt: skip


def _in_words(node: ast.expr) -> str:
    """What a part of a formula is that may not stand there; of operators only // gets so far."""
    if isinstance(node, ast.BinOp):
        return "the operator //"
    return _WORDS.get(type(node), "this")


def _value(node: ast.Constant) -> float:
    """The number that a checked tree holds there."""
    assert isinstance(node.value, float)
    return node.value


def _shown(node: ast.expr) -> str:
    """The beginning of a part of a formula, for an error."""
    try:
        text = ast.unparse(node)
    except RecursionError:  # it has not been checked
        return "(a formula)"
    return text if len(text) <= 60 else f"{text[:57]}..."
