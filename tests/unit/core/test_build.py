"""How the libraries are compiled: by which compiler, without a warning, and sound under sanitizers."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from dtbacklash.core import build

TESTS = Path(__file__).parents[2]
needs_cc = pytest.mark.skipif(not shutil.which("cc"), reason="needs cc")
LIBRARIES = (build.CORE, build.SIMULATOR)
each_library = pytest.mark.parametrize("library", LIBRARIES, ids=lambda one: one.name)
WARNINGS = ["-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror"]


def unit(library):
    return library.folder / f"{library.name}.c"


def test_the_compiler_is_the_chosen_one_or_cc_or_that_of_a_package(monkeypatch):
    monkeypatch.setenv("CC", "clang -m64")
    assert build.compiler() == ["clang", "-m64"]
    monkeypatch.delenv("CC")
    monkeypatch.setattr(build.shutil, "which", lambda name: f"/usr/bin/{name}")
    assert build.compiler() == ["cc"]
    monkeypatch.setattr(build.shutil, "which", lambda name: None)
    monkeypatch.setattr(build.importlib.util, "find_spec", lambda name: object())
    assert build.compiler() == [sys.executable, "-m", "ziglang", "cc"]
    monkeypatch.setattr(build.importlib.util, "find_spec", lambda name: None)
    assert build.compiler() == []


def test_without_a_compiler_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setattr(build, "compiler", list)
    monkeypatch.setattr(build, "is_current", lambda library: False)
    with pytest.raises(SystemExit, match=r"^dtbacklash: needs a C compiler: install cc .*ziglang.*$") as stopped:
        build.make()
    assert "\n" not in str(stopped.value)


def test_what_is_there_is_not_compiled_again(monkeypatch):
    monkeypatch.setattr(build, "compiler", lambda: pytest.fail("compiled"))
    build.make()
    monkeypatch.setattr(build, "digest", lambda library: "another")
    assert not any(build.is_current(library) for library in LIBRARIES)


def test_a_source_that_changes_makes_its_own_library_anew(tmp_path):
    for library in LIBRARIES:
        copy = library._replace(folder=tmp_path / library.name)
        shutil.copytree(library.folder, copy.folder)
        assert build.is_current(copy)
        with (copy.folder / "laws.c").open("a") as file:
            file.write("/* another */")
        assert not build.is_current(copy)
        assert build.is_current(library)


@each_library
def test_a_library_includes_files_of_its_own_folder_alone(library):
    sources = [file.read_text() for file in library.folder.glob("*.[ch]")]
    included = {name for text in sources for name in re.findall(r'#include "(.*)"', text)}
    assert included == {file.name for file in library.folder.glob("*.[ch]")} - {unit(library).name}


@needs_cc
def test_flags_that_only_some_compilers_know_are_left_out_elsewhere(tmp_path):
    picky = tmp_path / "picky"
    picky.write_text('#!/bin/sh\ncase "$*" in *-fno-tree*) exit 1;; esac\n')
    picky.chmod(0o755)
    assert build.flags([str(picky)]) == build.FLAGS
    assert set(build.FLAGS) <= set(build.flags(["cc"]))


@needs_cc
@each_library
def test_the_sources_give_no_warning(library):
    done = subprocess.run(
        ["cc", *build.FLAGS, *WARNINGS, "-fsyntax-only", str(unit(library))],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")


#: libraries in another place, in a process that has loaded the sanitizer
SANITIZED = """
import sys
from pathlib import Path
from dtbacklash.core import build
build.Library.file = property(lambda library: Path(sys.argv[1]) / library.name)
import pytest
raise SystemExit(pytest.main(["-m", "", "-p", "no:cacheprovider", *sys.argv[2:]]))
"""


@needs_cc
@pytest.mark.check
def test_the_libraries_are_sound_under_sanitizers(tmp_path):
    """Reads and writes stay in their arrays, and nothing is undefined, wherever the tests of equality lead."""
    sanitize = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    for library in LIBRARIES:
        words = ["cc", *build.FLAGS, *sanitize, str(unit(library)), "-o", str(tmp_path / library.name), "-lm"]
        subprocess.run(words, check=True)
    asan = subprocess.run(["cc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=True).stdout
    preload = f"{asan.strip()}:libstdc++.so.6"  # what Matplotlib throws is looked for there when the sanitizer begins
    environment = os.environ | {"LD_PRELOAD": preload, "ASAN_OPTIONS": "detect_leaks=0"}
    here = Path(__file__).parent
    names = ("test_equality.py", "test_laws.py", "test_twin_core.py", "test_control_core.py",
             "../twin/gap/test_model_error.py", "../twin/gap/test_estimate.py", "../prove/test_simulator.py",
             "../prove/test_simulator_rigs.py")  # fmt: skip
    tests = ["-k", "not with_each_of_its", *(str(here / name) for name in names)]
    done = subprocess.run(
        [sys.executable, "-c", SANITIZED, str(tmp_path), *tests], cwd=TESTS.parent, env=environment,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    assert " passed" in done.stdout
