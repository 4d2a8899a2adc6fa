"""Where compiled code is kept, what decides that it is compiled anew, and whether compiling is measured."""

import gc
import importlib
import os
import pkgutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

import dtbacklash
from dtbacklash import compiled

#: a compiled module, and one that it reads from and that is compiled in part only
MAIN = '''
import math
from typing import NamedTuple
import numpy as np
from dtbacklash.compiled import compiled, inlined
import {name}_parts as parts
from {name}_parts import LIMITS, law

class Pair(NamedTuple):
    first: float
    second: float

@inlined
def inner(x):
    return math.exp(x) if abs(x) < LIMITS[1] else parts.RATE * np.sqrt(x)

@compiled
def outer(x, pair):
    """What it does."""
    # how it does it
    return inner(law(x)) + 1.5 * pair.first
'''
PARTS = '''
from dtbacklash.compiled import law as compiled_law

RATE, UNUSED, LIMITS = 2.0, 5.0, (0.0, 1.0)

@compiled_law
def law(x):
    """A law."""
    return 3.0 * x

def plain(x):
    return 4.0 * x
'''


@pytest.fixture
def edited(tmp_path, monkeypatch):
    """Replace words in MAIN and PARTS and import MAIN: (old, new), ... -> module."""
    monkeypatch.syspath_prepend(tmp_path)

    def forget():
        for module in [module for module in sys.modules if module.startswith("edited_")]:
            del sys.modules[module]
        for file in tmp_path.glob("edited_*.py"):
            file.unlink()

    def of(*changes, name="edited_main"):
        forget()
        main, parts = MAIN.format(name=name), PARTS
        for old, new in changes:
            assert old in main + parts
            main, parts = main.replace(old, new), parts.replace(old, new)
        (tmp_path / f"{name}.py").write_text(main)
        (tmp_path / f"{name}_parts.py").write_text(parts)
        importlib.invalidate_caches()
        return importlib.import_module(name)

    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # two states of a file may have the same time and size
    yield of
    forget()


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(("1.5", "1.25"), id="a constant of its own"),
        pytest.param(("0.0, 1.0", "0.0, 0.5"), id="a constant of another module"),
        pytest.param(("RATE, UNUSED, LIMITS = 2.0", "RATE, UNUSED, LIMITS = 2.5"), id="an attribute of another module"),
        pytest.param(("3.0 * x", "-3.0 * x"), id="a law in another module"),
        pytest.param(("np.sqrt", "np.cbrt"), id="a function of a library"),
        pytest.param(("math.exp", "np.exp"), id="a library"),
        pytest.param(("@inlined", "@compiled"), id="numba's options of what it calls"),
        pytest.param(("pair.first", "pair.second"), id="a member"),
    ],
)
def test_what_decides_the_result_is_compiled_anew(edited, change):
    assert compiled.fingerprint(edited().outer) != compiled.fingerprint(edited(change).outer)


def test_what_moves_into_another_module_is_compiled_anew(edited):
    """Compiled code names its module, which may not be there any more when it is loaded."""
    here, there = edited(), edited(name="edited_other")
    assert compiled.fingerprint(here.inner) != compiled.fingerprint(there.inner)


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(('"""What it does."""', '"""Does it."""'), id="docstring"),
        pytest.param(('"""A law."""', '"""The law.\n\n    More.\n    """'), id="docstring of a law, and line numbers"),
        pytest.param(("# how it does it", "# so\n    # and so"), id="comment"),
        pytest.param(("5.0", "6.0"), id="a constant that it does not read"),
        pytest.param(("4.0 * x", "4.5 * x"), id="a function that is not compiled"),
    ],
)
def test_what_decides_nothing_is_not(edited, change):
    assert compiled.fingerprint(edited().outer) == compiled.fingerprint(edited(change).outer)


def test_members_in_another_order_are_compiled_anew(edited, tmp_path, monkeypatch):
    """numba's own key leaves out the names in a named tuple: a stale function would read the wrong member."""
    monkeypatch.setattr(compiled, "cache_folder", lambda: tmp_path / "kept")
    swap = ("first: float\n    second: float", "second: float\n    first: float")
    before, after = edited(), edited(swap)
    assert compiled.fingerprint(before.outer) == compiled.fingerprint(after.outer)
    assert before.outer(0.0, before.Pair(first=1.0, second=2.0)) == 2.5
    assert after.outer(0.0, after.Pair(first=1.0, second=2.0)) == 2.5


def test_of_a_dictionary_it_cannot_be_told(edited):
    module = edited(("LIMITS[1]", "LIMITS[1] + 0.0 * len(THING)"), ("import math", "import math\nTHING = {}"))
    with pytest.raises(compiled.Unknown, match="dict"):
        compiled.fingerprint(module.outer)


def test_of_all_that_is_compiled_here_it_can_be_told():
    for module in pkgutil.walk_packages(dtbacklash.__path__, "dtbacklash."):
        if module.name.rpartition(".")[2] not in ("__main__", "dtbacklash_slave", "_core", "_simulator"):
            importlib.import_module(module.name)
    # not isinstance: it reads through a weak proxy, whose object may be gone
    all_of_them = [one for one in gc.get_objects() if issubclass(type(one), Dispatcher)]
    ours = [one for one in all_of_them if (one.py_func.__module__ or "").startswith("dtbacklash.")]
    assert ours
    assert all(compiled.fingerprint(one) for one in ours)
    assert all(isinstance(one._cache, compiled._Kept) for one in ours)


def test_the_same_types_give_the_same_file_and_others_another(tmp_path, monkeypatch):
    monkeypatch.setattr(compiled, "cache_folder", lambda: tmp_path)
    for size, dtype in ((3, float), (4, float), (3, np.int64)):
        fresh = compiled.compiled(compiled.copy.py_func)
        fresh(np.ones(size, dtype), np.zeros(size, dtype))
    assert len(list(tmp_path.glob("copy-*.nbc"))) == 2


def test_ours_are_kept_in_our_folder():
    assert Path(compiled.copy.stats.cache_path) == compiled.cache_folder()


def test_functions_of_others_are_kept_where_they_always_were():
    def twice(x):
        return 2 * x

    assert compiled.cache_folder() not in Path(numba.njit(cache=True)(twice).stats.cache_path).parents


def test_a_folder_of_the_users_wins(tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "set"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    assert compiled.cache_folder() == tmp_path / "set"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "asked"))
    assert compiled.cache_folder() == tmp_path / "asked"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_to_is_no_error(tmp_path, monkeypatch):
    tmp_path.chmod(0o500)
    monkeypatch.setattr(compiled, "cache_folder", lambda: tmp_path)
    target = np.zeros(3)
    compiled.compiled(compiled.copy.py_func)(np.ones(3), target)
    assert target.tolist() == [1.0, 1.0, 1.0]


def test_a_broken_file_is_made_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(compiled, "cache_folder", lambda: tmp_path)
    for _ in range(2):
        target = np.zeros(3)
        compiled.compiled(compiled.copy.py_func)(np.ones(3), target)
        assert target.tolist() == [1.0, 1.0, 1.0]
        (file,) = tmp_path.glob("copy-*.nbc")
        assert file.stat().st_size > 100
        file.write_bytes(b"broken")


def test_what_is_kept_on_disk_is_not_compiled_again(tmp_path):
    code = (
        "from dtbacklash.compiled import copy, is_cold\nimport numpy as np\n"
        "cold = is_cold(copy)\ncopy(np.ones(3), np.zeros(3))\nprint(cold, copy.stats.cache_misses != {})"
    )
    answers = []
    for _ in range(2):
        environment = {"NUMBA_CACHE_DIR": str(tmp_path), "PATH": "/usr/bin:/bin", "PYTHONPATH": ":".join(sys.path)}
        answer = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
        )
        answers.append(answer.stdout.split())
    assert answers[0][0] == "True"
    assert answers[1][0] == "False"
