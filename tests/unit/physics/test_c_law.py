"""Laws that somebody else has compiled: called at their addresses, and what is no such law refused."""

import ctypes
import subprocess
from types import SimpleNamespace

import cffi
import numpy as np
import pytest
from reference import rigs
from told import refused

from dtbacklash.core import build
from dtbacklash.physics.catalogue import register
from dtbacklash.physics.drawing import drawing_of, law_curve
from dtbacklash.physics.effects.c_law import CLaw
from dtbacklash.physics.effects.declare import Effect, Parameter, Role
from dtbacklash.physics.effects.slots import BodyEffort, BodyMemory, Contact, asked
from dtbacklash.physics.simulate import simulate

pytestmark = pytest.mark.usefixtures("as_before")

SOURCE = """
#include <math.h>
double weight(const double *at, const double *p) { return p[0] * sin(at[0] + p[1]); }
double lag(const double *at, const double *p) { return -p[0] * at[0]; }
double rate(const double *at, const double *p) { return (at[2] - at[0]) / p[1]; }
double level(const double *at, const double *p) { return p[0] * (1.0 + p[1] * at[1]); }
"""
STEP_S = 1e-3
#: slot with formulas, and their functions in C with the states that these read
LAWS = {
    "weight": (BodyEffort("a*sin(q + b)"), BodyEffort, [("weight", "position")]),
    "lag": (BodyMemory("-a*z", "(v - z)/b"), BodyMemory, [("lag", "memory"), ("rate", "memory", "velocity")]),
    "level": (Contact("a*(1 + b*direction)"), Contact, [("level", "direction")]),
}
VALUES = {"a": 0.02, "b": 0.3}


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    folder = tmp_path_factory.mktemp("c")
    (folder / "laws.c").write_text(SOURCE)
    words = [*build.compiler(), "-O2", "-fPIC", "-shared", "-o", str(folder / "laws.so"), str(folder / "laws.c"), "-lm"]
    subprocess.run(words, check=True)
    return folder / "laws.so"


def effect(name, slot):
    parameters = (
        Parameter("a", "N m", 0.0, 10.0, 0.01, 0.0, role=Role.SIZE),
        Parameter("b", "1", -3.2, 3.2, 0.0, role=Role.SHAPE),
    )
    return Effect(name, "rotor", parameters, "a law", slot, "a test", "{a} at the {location}.",
                  conceal=lambda place, sign: (place.force_most, 0.1 * place.force))  # fmt: skip


def positions(name):
    rig, u = rigs.lead_screw(), rigs.random_steps(600, 30, 4.0)
    return simulate(rig.with_effect("motor_bearing", name, VALUES), u, STEP_S).sensors["q3"]


@pytest.mark.parametrize("name", LAWS)
def test_a_law_in_c_acts_and_is_drawn_as_its_formula(library, name):
    formulas, kind, functions = LAWS[name]
    loaded = ctypes.CDLL(str(library))
    in_c = kind(*(CLaw(getattr(loaded, function), *reads) for function, *reads in functions))
    both = [effect("mine", formulas), effect("mine_in_c", in_c)]
    for one in both:
        register(one)
    mine, theirs = (positions(one.name) for one in both)
    np.testing.assert_allclose(theirs, mine, rtol=0, atol=1e-12 * np.ptp(mine))
    plain = simulate(rigs.lead_screw(), rigs.random_steps(600, 30, 4.0), STEP_S).sensors["q3"]
    assert np.abs(mine - plain).max() > 1e-3 * np.ptp(plain)
    assert asked(both[0]) == asked(both[1])
    drawn = [drawing_of(one) for one in both]
    assert (drawn[0] is None) == (drawn[1] is None)
    if drawn[0]:
        curves = [law_curve(one, VALUES, {}, (-2.0, 2.0))[1] for one in drawn]
        np.testing.assert_allclose(curves[1], curves[0], rtol=1e-12, atol=1e-15)


def test_any_form_of_a_pointer_to_a_function_is_taken(library):
    ffi = cffi.FFI()
    ffi.cdef("double weight(const double *at, const double *p);")
    by_cffi, by_ctypes = ffi.dlopen(str(library)).weight, ctypes.CDLL(str(library)).weight
    address = ctypes.cast(by_ctypes, ctypes.c_void_p)
    compiled = SimpleNamespace(address=address.value)  # as of numba's cfunc
    found = {CLaw(one, "position").address for one in (by_cffi, by_ctypes, address, address.value, compiled)}
    assert found == {address.value}


@pytest.mark.parametrize("wrong", [None, 0, True, "weight", 1.5, abs])
def test_what_has_no_address_is_refused(wrong):
    with refused("a law in C=", "a pointer to a function of ctypes or cffi, numba's cfunc, or an address"):
        CLaw(wrong, "position")


def test_what_is_no_state_of_the_slot_is_refused():
    with refused("effect mine.law=current: a state of the slot: position, velocity, time"):
        effect("mine", BodyEffort(CLaw(4096, "current")))


def test_a_function_of_python_is_refused_and_what_is_allowed_told():
    def weight(position, a, b):
        return a * np.sin(position + b)

    with refused('effect mine.law=weight(): a formula as text, e.g. "size*sin(position)", or a C function'):
        register(effect("mine", BodyEffort(weight)))


def test_a_formula_that_is_none_is_refused_in_the_name_of_the_effect():
    with refused("effect mine.law=w: states position (q), velocity (v), time (t), command (u); parameters a, b"):
        effect("mine", BodyEffort("a*sin(w)"))
