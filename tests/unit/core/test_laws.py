"""Laws: those in C are the declared ones, and formulas give what Python makes of them."""

import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtbacklash.core import binding, build, library
from dtbacklash.core.library import LAWS, lib
from dtbacklash.errors import UserError
from dtbacklash.physics import catalogue
from dtbacklash.physics.catalogue import SHIPPED
from dtbacklash.physics.effects import slots, table
from dtbacklash.physics.effects.declare import Effect, Parameter, Role
from dtbacklash.physics.effects.formula import DEPTH_MAX, FUNCTIONS, Formula
from dtbacklash.physics.effects.slots import ROW, BodyEffort, arguments
from dtbacklash.physics.kernel import laws
from dtbacklash.physics.kernel import plant as pl

#: slot -> field and law, for each effect of the package that has one there
DECLARED = [
    (effect, slot, field, getattr(effect.slot, field))
    for effect in SHIPPED.values() for kinds in laws.SLOTS.values() for slot in kinds
    if isinstance(effect.slot, slot) for field in laws.fields_of(slot)
]  # fmt: skip


def test_each_declared_law_is_one_of_the_core_with_its_states_and_parameters_in_order():
    for effect, slot, field, law in DECLARED:
        name, where = law.__name__, f"{effect.kind}.{effect.name}.{field}"
        kind, states, parameters = LAWS[name]
        given = arguments(law, effect.slot.states, effect)
        assert kind == slot.__name__, where
        assert set(states) <= {one for one in given if isinstance(one, str)}, where
        if ROW in given:
            assert parameters == (ROW,), where
        else:
            places = {k: own for k, own in enumerate(parameters) if own}
            assert list(places) == sorted(one for one in given if isinstance(one, int)), where
            own_names = [n for n in law.__code__.co_varnames[: len(given)] if n not in effect.slot.states]
            assert list(places.values()) == own_names, where


def test_a_code_does_not_depend_on_what_was_compiled_before():
    """In a process of its own: a friction of a load is one of all frictions, though its slot is a kind of theirs."""
    code = (
        "from dtbacklash.physics.catalogue import SHIPPED\nfrom dtbacklash.physics.kernel import dispatch, laws\n"
        "each = [(slot, e) for kinds in laws.SLOTS.values() for slot in kinds for e in SHIPPED.values()"
        " if isinstance(e.slot, slot)]\n"
        "codes = [dispatch.code_of(effect) for _, effect in each]\n"
        "for code, (slot, effect) in zip(codes, each, strict=True):\n"
        "    assert dispatch.listed(slot)[code] == dispatch.calls_of(effect), effect.name\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_each_law_of_the_core_is_declared_and_found_in_its_source():
    text = (build.HERE / "laws.c").read_text()
    defined = re.findall(r"^double (\w+)\(", text, re.MULTILINE)
    assert sorted(LAWS) == sorted(defined)
    assert set(LAWS) == {law.__name__ for _, _, _, law in DECLARED}


def test_the_structs_of_the_slots_have_their_states_in_order():
    for kinds in laws.SLOTS.values():
        for slot in kinds:
            fields = library.ffi.typeof(slot.__name__).fields
            assert tuple(name for name, _ in fields) == slot.states


def test_what_both_sides_count_they_count_alike():
    named = {name: value for name, value in vars(pl).items() if name.isupper() and isinstance(value, int)}
    assert {name: getattr(lib, name) for name in named} == named
    assert len(named) > 40
    assert lib.STACK > 2 * DEPTH_MAX
    assert {f"OP_{name.upper()}" for name in FUNCTIONS} <= set(dir(lib))


@pytest.mark.parametrize(
    "shipped",
    {law.__name__: effect for effect, _, _, law in DECLARED}.values(),
    ids=lambda effect: effect.name,
)
def test_a_law_gives_what_its_declaration_gives(shipped):
    rng = np.random.default_rng(0)
    slot = next(one for kinds in laws.SLOTS.values() for one in kinds if isinstance(shipped.slot, one))
    states = {name: rng.uniform(-2.0, 2.0, 300) for name in slot.states}
    values = {p.name: p.typical for p in shipped.parameters}
    law = getattr(shipped.slot, laws.fields_of(slot)[0])
    row = [*values.values(), *[0.0] * (slots.ROW_PARAMETERS - len(values))]
    names = arguments(law, shipped.slot.states, shipped)
    expected = [
        law(
            *(
                row[one] if isinstance(one, int) else np.array(row) if one == ROW else float(states[one][k])
                for one in names
            )
        )
        for k in range(300)
    ]
    found = laws.values_of(shipped, values, **states)
    assert np.allclose(found, expected, rtol=1e-15, atol=0.0)


def test_table_weights_are_those_of_the_law():
    states, knots = np.linspace(-3.0, 3.0, 101), np.sort(np.random.default_rng(1).uniform(-2.0, 2.0, table.KNOTS))
    F = np.empty((table.KNOTS, len(states)))
    lib.dtb_table_weights(len(states), library.buffer(states), library.buffer(knots), library.buffer(F))
    assert np.allclose(F.T, table.weights(states, knots), rtol=0.0, atol=1e-15)


# ---- formulas ----

STATES = ("position", "velocity", "time")
LEAVES = st.one_of(st.sampled_from(["q", "v", "t", "a", "b", "pi"]), st.floats(0.01, 9.0).map(lambda x: f"{x:.3g}"))


def _joined(inner):
    return st.one_of(
        st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda one: f"({one[0]} {one[1]} {one[2]})"),
        st.tuples(inner, st.sampled_from(["2", "3", "0.5", "-1", "b"])).map(lambda one: f"({one[0]})**({one[1]})"),
        inner.map(lambda one: f"-({one})"),
        st.tuples(st.sampled_from([n for n, (least, _) in FUNCTIONS.items() if least == 1]), inner).map(
            "{0[0]}({0[1]})".format
        ),
        st.tuples(st.sampled_from(["min", "max"]), st.lists(inner, min_size=2, max_size=4)).map(
            lambda one: f"{one[0]}({', '.join(one[1])})"
        ),
    )


def valued(formula: Formula, at: np.ndarray, a: float, b: float) -> np.ndarray:
    """(N,) of a formula by the core at states (N, 3)."""
    places = {name: STATES.index(name) if name in STATES else None for name in formula.names}
    named = {name: name if place is not None else ("a", "b").index(name) for name, place in places.items()}
    made = laws.program(formula.program(), named, BodyEffort)
    law, row, out = library.ffi.new("Law *"), np.array([a, b]), np.empty(len(at))
    laws.fill(law, [made])
    law.p = parameters = library.buffer(row)
    lib.dtb_law_values(law, len(at), 3, library.buffer(at), library.buffer(out))
    del parameters
    return out


@given(text=st.recursive(LEAVES, _joined, max_leaves=12), seed=st.integers(0, 99))
def test_a_formula_gives_what_python_gives(text, seed):
    try:
        formula = Formula(text, STATES, ("a", "b"), "rig.laws.mine.law")
    except UserError:  # too long, or a part of it is no number
        return
    at = np.random.default_rng(seed).uniform(-3.0, 3.0, (50, 3))
    a, b = 0.7, 1.5
    given_values = dict(zip(STATES, at.T, strict=True)) | {"a": np.full(50, a), "b": np.full(50, b)}
    with np.errstate(all="ignore"):
        expected = formula.function()(*(given_values[name] for name in formula.names))
    found = valued(formula, at, a, b)
    expected = np.broadcast_to(expected, found.shape)
    assert np.array_equal(np.isnan(found), np.isnan(expected))
    close = np.isclose(found, expected, rtol=1e-9, atol=1e-12, equal_nan=True)
    assert close.all(), (found[~close], expected[~close])


def test_the_deepest_formula_stays_on_the_stack():
    text = "q"
    for _ in range(DEPTH_MAX - 1):
        text = f"1+({text})" if len(text) < 380 else text
    formula = Formula(text, STATES, (), "rig.laws.mine.law")
    depth = most = 0
    for operation, _ in formula.program():
        depth += 1 if operation in ("NAME", "CONSTANT") else -1
        most = max(most, depth)
    assert depth == 1
    assert DEPTH_MAX - 1 <= most < lib.STACK
    at = np.zeros((1, 3))
    at[0, 0] = 0.25
    assert valued(formula, at, 0.0, 0.0)[0] == DEPTH_MAX - 1 + 0.25


@pytest.mark.usefixtures("as_before")
def test_a_formula_of_an_effect_is_evaluated_by_the_core():
    parameters = (
        Parameter("size", "N m", 0.0, 1e3, 0.1, 0.0, role=Role.SIZE),
        Parameter("rate", "s/rad", 0.0, 9.0, 2.0),
    )
    effect = Effect("wobble", "rotor", parameters, "size sin(rate v)", BodyEffort("size*sin(rate*v)"), "a test",
                    "{size}.", conceal=lambda place, sign: (0.0, 0.0))  # fmt: skip
    catalogue.register(effect)
    v = np.linspace(-1.0, 1.0, 7)
    found = laws.values_of(effect, {"size": 0.1, "rate": 2.0}, velocity=v)
    assert np.allclose(found, 0.1 * np.sin(2.0 * v), rtol=1e-15)


def test_arrays_that_the_core_cannot_take_are_refused():
    for array in (np.zeros(3, dtype=np.float32), np.zeros((4, 4)).T[::2], np.zeros(3, dtype=complex)):
        with pytest.raises(ValueError, match="array"):
            library.buffer(array)
    with pytest.raises(ValueError, match="shape"):
        library.buffer(np.zeros(3), 4)


def test_a_law_of_another_slot_or_name_is_refused():
    effect = SHIPPED["rotor", "gravity"]
    with pytest.raises(KeyError, match="gravity"):
        laws.core_law(effect.slot.law, slots.Contact)
    other = replace(effect, name="other")
    assert laws.dispatch.code_of(other) < 0


def test_a_library_of_other_sources_is_refused(monkeypatch):
    monkeypatch.setattr(build, "digest", lambda library: "0" * 16)
    with pytest.raises(UserError, match=r"compile it: python -m dtbacklash\.core\.build"):
        binding.Binding(build.CORE)
