"""A mutation test: a number of the diagnosis that is halved or doubled is noticed by a test, or by a golden case."""

import ast
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import dtbacklash

pytestmark = pytest.mark.nightly

PACKAGE, TESTS = Path(dtbacklash.__file__).parent, Path(__file__).resolve().parents[1]
#: module of the diagnosis -> the tests nearest to it, and those of its constants whose change they do not notice (of
#: some only one change): a number for which somebody finds a test leaves the list
MODULES = {
    "engine/horizons": (
        "engine/test_horizons.py",
        "STRETCHES/2 LONGER.0 LONGER.1 LONGER.2 FOLLOWS STEPS STEPS_LONGER ORDER CLIPPED*2",
    ),
    "engine/resampling": (
        "engine/test_resampling.py",
        "NOISE_RATIO OPENING NUMERICAL COUNTED_SHARE/2 OFTEN/2 SETS_MAX",
    ),
    "engine/intervals": (
        "engine/test_intervals.py",
        "NORMAL95 ALONE LEAST_SEEN PASSES MOVED CHANGE WIDE POLISHED NEAR PROFILE_STEPS",
    ),
    "records": ("test_records.py", "PIECES*2 PIECE_SAMPLES_MIN RESTS REACH*2 PART_SAMPLES_MIN"),
    "explain/calibration": ("test_calibration.py", "BLIND_TOLERANCES TAKES_PART ALIKE_RATIO*2"),
    "explain/sentences": ("explain/test_sentences.py", "NEAR_S.1 NEAR_S.2 NEAR_S.3 MOVES WORTH_SAYING"),
}
UNSEEN = pytest.mark.xfail(reason="no test near it notices", run=False)
CHANGES = {"*2": lambda x: 2 * x, "/2": lambda x: type(x)(x / 2)}


def numbers(module: str) -> dict[str, ast.Constant]:
    """The numbers in the constants of a module, by name; several in one constant are counted. None: it is gone."""
    file = PACKAGE / "diagnosis" / f"{module}.py"
    tree = ast.parse(file.read_text(encoding="utf-8") if file.exists() else "")
    found = [(node.targets[0], node.value) for node in tree.body if isinstance(node, ast.Assign)]
    each = [p for t, v in found for p in (zip(t.elts, v.elts) if isinstance(t, ast.Tuple) else [(t, v)])]  # noqa: B905
    names = [(t.id, v) for t, v in each if isinstance(t, ast.Name) and t.id.isupper()]
    inside = {t: [n for n in ast.walk(v) if type(getattr(n, "value", "")) in (int, float)] for t, v in names}
    return {f"{t}.{k}" if len(ns) > 1 else t: n for t, ns in inside.items() for k, n in enumerate(ns)}


CASES = [
    pytest.param(m, name, change, marks=UNSEEN if {name, name + change} & set(unseen.split()) else ())
    for m, (_, unseen) in MODULES.items() for name in numbers(m) for change in CHANGES
]  # fmt: skip


def test_the_lists_are_of_what_there_is() -> None:
    for module, (_, unseen) in MODULES.items():
        assert {one[:-2] if one[-2:] in CHANGES else one for one in unseen.split()} <= set(numbers(module)), module


@pytest.mark.parametrize(("module", "name", "change"), CASES)
def test_a_number_that_is_changed_is_noticed(module: str, name: str, change: str, tmp_path: Path) -> None:
    shutil.copytree(PACKAGE, tmp_path / "dtbacklash", ignore=shutil.ignore_patterns("__pycache__"))
    file, number = tmp_path / "dtbacklash" / "diagnosis" / f"{module}.py", numbers(module)[name]
    text = file.read_text(encoding="utf-8").splitlines(keepends=True)
    line, other = text[number.lineno - 1], repr(CHANGES[change](number.value))
    text[number.lineno - 1] = line[: number.col_offset] + other + line[number.end_col_offset :]
    file.write_text("".join(text), encoding="utf-8")
    near = [TESTS / "unit" / "diagnosis" / MODULES[module][0], TESTS / "integration" / "test_golden.py"]
    words = ["-c", TESTS.parent / "pyproject.toml", "-x", "-n0", "-m", "not nightly", *near]
    command = [sys.executable, "-m", "pytest", *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stdout[-2000:]
