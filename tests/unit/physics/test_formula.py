"""Formulas that users write: whatever the text, a function or a UserError, and nothing of it is run."""

import math
import string
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from told import refused

from dtbacklash import units
from dtbacklash.errors import UserError
from dtbacklash.physics.effects.formula import DEPTH_MAX, FUNCTIONS, LENGTH_MAX, Formula

STATES, PARAMETERS = ("position", "velocity", "time"), ("a", "b")


def formula(text):
    return Formula(text, STATES, PARAMETERS, "law")


def value(text, **given):
    made = formula(text)
    return made.function()(*(given[name] for name in made.names))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("-a*abs(v)**b*sign(v)", -2.0 * 3.0**1.5 * -1.0),
        ("a * sin(pi*q) + 2", 2.0 * math.sin(math.pi * 0.3) + 2.0),
        ("max(a, b, v, 0.5)", 2.0),
        ("min(a, b, v, 0.5)", -3.0),
        ("  velocity\n +a ", -1.0),
        ("+a - -b", 3.5),
        ("1_000*a", 2000.0),
    ],
)
def test_a_formula_gives_what_it_says(text, expected):
    given = {"a": 2.0, "b": 1.5, "velocity": -3.0, "position": 0.3}
    assert value(text, **given) == pytest.approx(expected, rel=1e-15)


def test_a_function_of_numpy_takes_arrays_and_overflows_to_infinity():
    v = np.array([-2.0, 0.0, 1e3])
    with np.errstate(all="ignore"):
        assert value("exp(v)", velocity=v)[2] == math.inf


#: a text -> what its line names
REFUSED = {
    "1/0*a": "1.0 / 0.0: a part without a name", "a*10**400": "a part without a name", "(0-8)**0.5*v": "a part without",
    "log(0)*a": "a part without", "a + 0**(0-1)": "a part without",
    "": "(empty)", "   ": "(empty)", "__import__('os').system('x')": "no \"'\"",
    "v.real": "an attribute is not allowed",
    "a.__class__.__mro__": "an attribute", "open(a)": "open(): is no function here; choose one of abs, sign",
    "eval(a)": "eval(): is no function", "v(a)": "v(): is no function", "(abs)(v)(a)": "is no function",
    "a if v else b": "a condition (if ... else) is not allowed", "lambda: 1": "no ':'", "[a]": "no '['",
    "a and b": "`and` or `or` is not allowed", "await v": "this is not allowed",
    "not a": "`not` is not allowed", "a // b": "the operator // is not allowed", "a % b": "no '%'",
    "a @ b": "no '@'", "a < b": "no '<'",
    "-a*v^b": "a power is written **", "w": "w: states position (q), velocity (v), time (t); parameters a, b",
    "slip_speed": "states position",
    "abs": "abs: is a function: write what it is of in brackets, abs(...)", "sin(v, a)": "sin takes 1 argument",
    "min(a)": "min takes 2 to 6",
    "abs(*a)": "a * with nothing before it", "abs(v": "is no formula", "a b": "is no formula",
    "import os": "is no formula",
    "1e999": "a number below 1e+100", "True": "is no number, such as 2.5", "None": "is no number", "1j": "is no number",
    "9" * 390: "a number below", "a, b": "a comma outside of a function's brackets", "..." : "is no number",
    "µ": "no 'µ'",
    "a" * (LENGTH_MAX + 1): f"at most {LENGTH_MAX} signs", "-" * (DEPTH_MAX + 1) + "a": f"at most {DEPTH_MAX} deep",
    "+".join("a" * (DEPTH_MAX + 2)): f"at most {DEPTH_MAX} deep", "(" * 199 + "a" + ")" * 199: "", "a" + ".a" * 190: "",
    "not " * 99 + "a": "",
}  # fmt: skip


@pytest.mark.parametrize("text", REFUSED, ids=lambda text: text[:20])
def test_what_is_no_formula_is_refused_in_its_name(text):
    if text.startswith("((("):  # brackets that change nothing are no depth
        assert formula(text).text == "a"
        return
    with refused(REFUSED[text], start="law="):
        formula(text)


@pytest.mark.parametrize("said", [None, 5, 2.0, True, ["a"], {"a": 1}, b"a"])
def test_what_is_no_text_is_refused(said):
    with pytest.raises(UserError, match="a formula in words"):
        formula(said)


WORDS = st.sampled_from([
    *FUNCTIONS, "a", "b", "v", "q", "velocity", "pi", "1", "2.5", "1e-3", "+", "-", "*", "/", "**", "(", ")", ",", ".",
    "=",
    "__import__", "'os'", "exec", "lambda", "if", "else", "for", "in", "[", "]", "{", "}", ":", ":=", "@", "x", " ",
    "\n",
    "await", "yield", "f'{a}'", "\\", "\0", "#", ";", "é",
])  # fmt: skip


@given(st.one_of(st.text(max_size=60), st.lists(WORDS, max_size=25).map("".join),
                 st.text(string.ascii_letters + "()+-*/., ", max_size=450)))  # fmt: skip
def test_any_text_is_a_formula_or_a_user_error(text):
    with suppress(UserError):
        check(formula(text))


def check(made):
    """A formula reaches nothing but its names and the functions, whatever its text is."""
    assert set(made.names) <= {*STATES, *PARAMETERS}
    made.dimension({})
    function = made.function()
    assert set(function.__code__.co_names) <= set(FUNCTIONS)  # nothing else can be reached from inside
    assert function.__code__.co_varnames == tuple(made.names)
    with np.errstate(all="ignore"):
        assert isinstance(float(function(*(np.float64(1.0 + n) for n, _ in enumerate(made.names)))), float)


LEAVES = st.sampled_from(["a", "b", "v", "q", "t", "1", "0.5", "pi"])
FORMULAS = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from([" + ", "-", "*", "/"]), inner).map(lambda p: f"({p[0]}{p[1]}{p[2]})"),
        st.tuples(st.sampled_from(["abs", "sin", "tanh", "sign", "-"]), inner).map(lambda p: f"{p[0]}({p[1]})"),
        st.tuples(inner, inner).map(lambda p: f"max({p[0]}, {p[1]})"),
    ),
    max_leaves=12,
)


@given(FORMULAS)
def test_a_formula_calculates_as_python_would(text):
    made = formula(text)
    given = dict(
        zip(("a", "b", "velocity", "position", "time"), map(np.float64, (2.0, 1.5, -3.0, 0.3, 7.0)), strict=True)
    )
    short = {"v": given["velocity"], "q": given["position"], "t": given["time"], "a": given["a"], "b": given["b"]}
    space = {"abs": abs, "sin": np.sin, "tanh": np.tanh, "sign": np.sign, "max": max, "pi": math.pi, **short}
    with np.errstate(all="ignore"):
        try:
            expected = float(eval(text, {"__builtins__": {}}, space))
        except ZeroDivisionError:  # of two plain numbers
            return
        got = made.function()(*(given[name] for name in made.names))
    if not math.isnan(expected):
        assert float(got) == pytest.approx(expected, rel=1e-12, nan_ok=True)


N, M_S = units.dimension_of("N"), units.dimension_of("m/s")


@pytest.mark.parametrize(
    ("text", "known", "gives"),
    [
        ("a*v", {"a": "N s/m", "velocity": "m/s"}, "N"), ("-a*abs(v)*v", {"a": "N s^2/m^2", "velocity": "m/s"}, "N"),
        ("a*tanh(v/b)", {"a": "N", "velocity": "m/s", "b": "m/s"}, "N"),
        ("a*abs(v)**b", {"a": "N", "velocity": "m/s"}, "?"),
        ("sqrt(a*a)", {"a": "N"}, "N"), ("a/v**2", {"a": "N", "velocity": "m/s"}, "kg/m"), ("a*0.5", {"a": "N"}, "?"),
        ("a*v**-1", {"a": "W", "velocity": "m/s"}, "N"), ("2*a + max(a, 3*a)", {"a": "V"}, "V"), ("sign(v)", {}, "1"),
    ],
)  # fmt: skip
def test_the_unit_of_what_a_formula_gives(text, known, gives):
    assert units.of_dimension(formula(text).dimension({n: units.dimension_of(u) for n, u in known.items()})) == gives


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a + v", "N and m/s cannot be added or compared"), ("exp(v)", "exp takes a plain number, not m/s"),
        ("max(a, v)", "cannot be added or compared"), ("2**v", "an exponent is a number, not m/s"),
    ],
)  # fmt: skip
def test_units_that_do_not_fit_are_refused(text, said):
    with pytest.raises(UserError, match=said):
        formula(text).dimension({"a": N, "velocity": M_S})
