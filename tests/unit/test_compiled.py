"""Where compiled code is kept, and whether compiling is measured."""

import subprocess
import sys
from pathlib import Path

import numba
import pytest

from dtbacklash import compiled
from dtbacklash.experiment import loop
from dtbacklash.prove.simulator import laws


def kept_in(dispatcher) -> Path:
    """The folder of a function's compiled code."""
    return Path(dispatcher._cache.cache_path)


@pytest.mark.parametrize("dispatcher", [loop.run_segment, compiled.copy, laws.amplify])
def test_ours_are_kept_in_our_folder(dispatcher):
    assert compiled.cache_folder() in kept_in(dispatcher).parents


def test_functions_of_others_are_kept_where_they_always_were():
    def twice(x):
        return 2 * x

    before = numba.config.CACHE_DIR
    ours, theirs = compiled.compiled(twice), numba.njit(cache=True)(twice)
    assert before == numba.config.CACHE_DIR
    assert compiled.cache_folder() in kept_in(ours).parents
    assert compiled.cache_folder() not in kept_in(theirs).parents


def test_the_setting_comes_back_when_decorating_fails(monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")

    def broken(function):
        assert numba.config.CACHE_DIR
        raise RuntimeError("no")

    with pytest.raises(RuntimeError, match="no"):
        compiled.kept(broken)(len)
    assert numba.config.CACHE_DIR == ""


def test_a_folder_of_the_users_wins(tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "set"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    assert compiled.cache_folder() == tmp_path / "set"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "asked"))
    assert compiled.cache_folder() == tmp_path / "asked"
    assert compiled.is_cold()


def test_compiling_is_measured_and_loading_is_not(tmp_path):
    code = (
        "import numba\nfrom dtbacklash.compiled import compiled, compiling, copy\nimport numpy as np\n"
        "with compiling() as spent:\n    copy(np.ones(3), np.zeros(3))\n"
        "print(spent())"
    )
    seconds = []
    for _ in range(2):
        environment = {"NUMBA_CACHE_DIR": str(tmp_path), "PATH": "/usr/bin:/bin", "PYTHONPATH": ":".join(sys.path)}
        answer = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
        )
        seconds.append(float(answer.stdout))
    assert seconds[0] > 0.01
    assert seconds[1] == 0.0
