"""Numbers that write their arithmetic down: the C text gives the same number, and the plant of other parameters."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nominal import nominal_rig
from reference import rigs

import dtbacklash
from dtbacklash.fmu.interface import PARAMETER, variables
from dtbacklash.fmu.machine import OWN, recording
from dtbacklash.fmu.recorded import Recorded, text_of
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.rig import SENSOR_PREFIX
from dtbacklash.physics.simulate import rig_half_gap

RIGS = sorted(path.stem for path in (Path(dtbacklash.__file__).parent / "conf" / "rig").glob("*.yaml"))
NOMINAL = [lambda name=name: nominal_rig(name) for name in RIGS]
OTHERS = [rigs.carriage, rigs.damper, rigs.two_inertias, rigs.geared, lambda: rigs.geared("rack"), rigs.served,
          rigs.served_carriage, rigs.oscillator]  # fmt: skip
#: by so much every parameter is changed
OTHER = 1.0625
NUMBERS = st.floats(0.25, 16.0)


def evaluated(text, p):
    """The number that a C expression gives; its operations are those of Python."""
    return eval(text, {"p": p, "pow": pow, "sqrt": math.sqrt, "INFINITY": math.inf})


@given(NUMBERS, NUMBERS, st.sampled_from([0.0, 1.0, 3.0]))
def test_the_text_gives_the_number(x, y, constant):
    a, b = Recorded(x, "p[0]", {}), Recorded(y, "p[1]", {})
    row = np.array([a, b, constant], dtype=object)
    row -= row * a
    found = [
        a + b, a - constant, constant - a, constant * b, a * constant, a / b, constant / a, a / (constant + 1.0), -a,
        a**2, np.sqrt(a * b), np.float64(2.0) * a, (np.array([constant, 2.0]) * b)[1], *row, *(1.0 / (row - 100.0)),
    ]  # fmt: skip
    plain = np.array([x, y, constant]) * (1.0 - 0.0)
    plain -= plain * x
    told = [
        x + y, x - constant, constant - x, constant * y, x * constant, x / y, constant / x, x / (constant + 1.0), -x,
        x**2, math.sqrt(x * y), 2.0 * x, 2.0 * y, *plain, *(1.0 / (plain - 100.0)),
    ]  # fmt: skip
    assert [float(one) for one in found] == told
    assert [evaluated(text_of(one), [x, y]) for one in found] == told


def test_each_decision_is_written_down():
    decisions = {}
    a = Recorded(2.0, "p[0]", decisions)
    assert a
    assert not a + 1.0 < 3.0
    assert max(a, 1.0) is a
    first = {"p[0] != 0.0": True, "(p[0] + 1.0) < 3.0": False}
    assert decisions in (first | {"1.0 > p[0]": False}, first | {"p[0] < 1.0": False})


def with_effects(rig):
    """The rig, and copies of it with one effect each."""
    yield rig
    for place in [*rig.elements, *(SENSOR_PREFIX + name for name in rig.sensors)]:
        for name, effect in rig.takes(place).items():
            values = {p.name: p.typical for p in effect.parameters}
            if effect.is_table:
                values |= {p.name: p.typical * (-1) ** k for k, p in enumerate(effect.parameters) if p.neutral == 0.0}
            yield rig.with_effect(place, name, values)


def changed(rig, offered):
    """The rig with every parameter that an FMU offers changed, where it may be so; and these values."""
    values = []
    for one in offered:
        value = one.start * OTHER
        fits = one.least <= value <= one.most and len(one.path) == 2
        values.append(value if fits else one.start)
        if fits:
            rig = rig.with_parameters({one.path[1]: value})
    for k, one in enumerate(offered):
        if len(one.path) == 4 and CATALOGUE.get((rig.kind_at(one.path[1]), one.path[2])) is not None:
            place, effect, name = one.path[1:]
            if not CATALOGUE[rig.kind_at(place), effect].is_table and one.least <= one.start * OTHER <= one.most:
                values[k] = one.start * OTHER
                rig = rig.with_effect(place, effect, {**rig.effects[place][effect], name: values[k]})
    return rig, values


@pytest.mark.parametrize("make", [*NOMINAL, *OTHERS], ids=lambda make: make().config.name)
def test_other_parameters_make_the_plant_that_python_assembles(make):
    tried = 0
    for rig in with_effects(make()):
        try:
            compile_plant(rig, 1e-3)
        except dtbacklash.errors.UserError:  # an effect that cannot act in this rig
            continue
        offered, decisions = [one for one in variables(rig) if one.causality == PARAMETER], {}
        recorded = recording(rig, offered, decisions)
        found = compile_plant(recorded, 1e-3)
        other, p = changed(rig, offered)
        plant = compile_plant(other, 1e-3)
        if any(evaluated(text, p) != answer for text, answer in decisions.items()):
            continue
        for name in OWN:
            made = [evaluated(text_of(value), p) for value in getattr(found, name).ravel()]
            np.testing.assert_array_equal(made, getattr(plant, name).ravel(), err_msg=f"{rig.effects} {name}")
        assert evaluated(text_of(rig_half_gap(recorded)), p) == rig_half_gap(other)
        tried += 1
    assert tried > 2
