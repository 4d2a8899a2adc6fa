"""Each public function has an example in its docstring, and the examples run."""

import doctest
import importlib

import pytest

import dtbacklash as dtb

MODULES = ("api.diagnose", "api.experiments", "api.recordings", "api.rigs", "api.run", "recording.model",
           "recording.stamps", "units")  # fmt: skip
#: what is a class, or an exception, has its example where it is made
FUNCTIONS = ("design", "diagnose", "isolability", "load_rig", "plot_recording", "read_recording", "run", "save_rig")


@pytest.mark.parametrize("module", MODULES)
def test_the_examples_of_a_module_run(module):
    found = importlib.import_module(f"dtbacklash.{module}")
    result = doctest.testmod(found, optionflags=doctest.ELLIPSIS)
    assert result.failed == 0
    assert result.attempted > 0


@pytest.mark.parametrize("name", FUNCTIONS)
def test_each_public_function_has_an_example(name):
    assert set(FUNCTIONS) == {n for n in dtb.__all__ if n.islower() and not n.startswith("_")}
    assert ">>> " in getattr(dtb, name).__doc__
