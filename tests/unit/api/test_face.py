"""The names of the package: there, lazy, and found by people and tools."""

import ast
import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import dtbacklash as dtb


def python(code: str, *extra: str) -> str:
    """Run code in a process of its own; returns what it prints."""
    answer = subprocess.run([sys.executable, *extra, "-c", code], capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    return answer.stdout


def test_the_import_loads_nothing():
    code = (
        "import sys, typing, importlib, types, __future__\n"
        "before = set(sys.modules)\n"
        "import dtbacklash\n"
        "print(sorted(set(sys.modules) - before))"
    )
    assert python(code).strip() == "['dtbacklash', 'dtbacklash.version']"


def test_every_name_is_there():
    for name in dtb.__all__:
        assert getattr(dtb, name) is not None
    assert set(dir(dtb)) == set(dtb.__all__)
    with pytest.raises(AttributeError, match="no attribute 'runn'"):
        dtb.runn  # noqa: B018


CALLED = """
import dtbacklash as dtb
from dtbacklash import diagnose
for call in (dtb.diagnose, diagnose):
    try:
        call("no_such_file.csv", "lead_screw")
    except dtb.UserError as error:
        print(error)
"""


@pytest.mark.check
def test_diagnose_is_a_function_of_the_face():
    lines = python(CALLED).splitlines()
    assert len(lines) == 2
    assert all(line.startswith("recording=no_such_file.csv: no such file") for line in lines)


def test_diagnose_shows_its_signature_and_its_help(capsys):
    import dtbacklash.diagnosis.records  # noqa: F401

    assert inspect.isfunction(dtb.diagnose)
    assert list(inspect.signature(dtb.diagnose).parameters)[:2] == ["recording", "rig"]
    help(dtb.diagnose)
    assert "Parameters" in capsys.readouterr().out


def test_type_checkers_are_told_every_name():
    tree = ast.parse(Path(dtb.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    told = {alias.name: node.module for node in block.body for alias in node.names}
    assert set(told) == set(dtb.__all__) - {"__version__"}
    for name, module in told.items():
        assert getattr(dtb, name) is getattr(importlib.import_module(module), name)


@pytest.mark.nightly
def test_a_type_checker_finds_a_mistake(tmp_path):
    file = tmp_path / "user.py"
    file.write_text(
        "import dtbacklash as dtb\n"
        "rig: dtb.Rig = dtb.load_rig('lead_screw')\n"
        "result = dtb.run('controller=imc', rig=rig)\n"
        "reveal_type(result.moves)\n"
        "found = dtb.diagnose(result.recording, rig, jobs=2)\n"
        "reveal_type(found.rig)\n"
        "dtb.run(rigg=rig)\n"
    )
    words = ["--ignore-missing-imports", "--follow-imports=silent", "--cache-dir", str(tmp_path / "cache"), str(file)]
    answer = subprocess.run([sys.executable, "-m", "mypy", *words], capture_output=True, text=True, check=False)
    assert 'Revealed type is "pandas' in answer.stdout
    assert 'Revealed type is "dtbacklash.physics.rig.Rig"' in answer.stdout
    assert 'Unexpected keyword argument "rigg"' in answer.stdout
    assert answer.stdout.count("error:") == 1
