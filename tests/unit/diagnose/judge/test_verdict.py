"""The verdict, from what is left and how sure the names are; and which parameters had to move."""

from types import SimpleNamespace

import numpy as np
import pytest
from ringing import blade, known, recorded

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.intervals import standard_errors
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.judge.verdict import BlockLeft, decide, moved_parameters
from dtbacklash.diagnose.shown import Explained

#: mean squares in floors: without and with what was found; more than noise is left of 100
BEFORE, SMALL, LARGE, NOISE = 101.0, 11.0, 51.0, 1.0
KEYS, MOVED = (("gear", "backlash"),), {"k": (1.0, 0.1)}


def verdict(
    keys=(), moved=None, after=NOISE, sure=False, enough=None, beats=True, depends=False, other=(1.0, 1.0)
) -> str:  # fmt: skip
    """Of a block with two channels; other : mean squares of the second, before and after."""
    squares = [{"rig": np.array(pair)} for pair in ((BEFORE, other[0]), (after, other[1]))]
    nominal, fitted = (SimpleNamespace(residuals=each) for each in squares)
    evidence = SimpleNamespace(mean_square=lambda residuals, part: residuals)
    model = SimpleNamespace(keys=keys, nominal=nominal, fitted=fitted, evidence=evidence)
    left = {"rig": BlockLeft((after - 1.0) / (BEFORE - 1.0), after > NOISE, 0.0)}
    return decide(model, left, depends, sure, Explained(None, None, {}, enough, beats), moved or {})


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, "consistent"),
        ({"moved": MOVED}, "parameters"),
        ({"keys": KEYS, "sure": True}, "missing_physics"),
        ({"keys": KEYS, "moved": MOVED}, "missing_physics"),  # several names would do, and one of them is needed
        ({"keys": KEYS, "sure": True, "after": SMALL}, "missing_physics"),
        ({"keys": KEYS, "sure": True, "after": LARGE}, "unexplained"),
        ({"keys": KEYS, "after": SMALL}, "unexplained"),
        ({"moved": MOVED, "after": SMALL}, "unexplained"),
        ({"after": LARGE}, "unexplained"),
        # what is left depends on a state: it is no noise, however small
        ({"depends": True}, "unexplained"),
        ({"keys": KEYS, "sure": True, "depends": True}, "missing_physics"),
        # what the user accepts
        ({"after": LARGE, "enough": True}, "consistent"),
        ({"moved": MOVED, "after": LARGE, "enough": True}, "parameters"),
        ({"keys": KEYS, "after": LARGE, "enough": True}, "missing_physics"),
        ({"after": LARGE, "enough": False}, "unexplained"),
        ({"enough": False}, "consistent"),
        # not even a constant is beaten
        ({"keys": KEYS, "sure": True, "after": SMALL, "beats": False}, "unexplained"),
        ({"enough": True, "beats": False}, "unexplained"),
        # the worst channel counts, of those that show the mismatch
        ({"keys": KEYS, "sure": True, "after": SMALL, "other": (3.0, 2.5)}, "unexplained"),
        ({"keys": KEYS, "sure": True, "after": SMALL, "other": (1.5, 1.4)}, "missing_physics"),
    ],
)
def test_the_verdict(given, expected):
    assert verdict(**given) == expected


def test_a_trifle_of_a_tolerance_that_was_needed_is_said():
    """A nominal rig that leaves more than noise does not agree with the recording."""
    rig = known(blade())
    evidence = Evidence.gather(rig, [recorded(blade(k_1=3000.0 * 1.01), 33, 6000)])
    fitted = fit(evidence, rig, nominal_free(rig))
    moved = moved_parameters(evidence, rig, fitted, standard_errors(evidence, fitted))
    value, error = moved["k_1"]
    assert value == pytest.approx(3030.0, abs=4.0 * error)
    exact = Evidence.gather(rig, [recorded(blade(), 34, 6000)])
    fitted = fit(exact, rig, nominal_free(rig))
    assert moved_parameters(exact, rig, fitted, standard_errors(exact, fitted)) == {}
