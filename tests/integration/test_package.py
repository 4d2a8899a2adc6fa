"""Wheel and source distribution: they build, hold what a user needs, and run away from the checkout."""

import email
import os
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

from dtbacklash.benchmark.plan import VERSION
from dtbacklash.version import __version__

pytest.importorskip("hatchling", reason="the extra `dev`")
ROOT = Path(__file__).resolve().parents[2]
PLATFORM = sysconfig.get_platform().replace("-", "_").replace(".", "_")
WHEEL = f"dtbacklash-{__version__}-py3-none-{PLATFORM}.whl"
SDIST = f"dtbacklash-{__version__}"
#: what the program reads at run time, beside its modules
DATA = ("dtbacklash/conf", "dtbacklash/remote/schemas", "dtbacklash/report/templates")
#: what only the repository needs
OUTSIDE = {"tests", "benchmarks", "studies", "docs", "conf"}


def _build(source: Path, target: Path) -> None:
    words = [sys.executable, "-m", "hatchling", "build", "--directory", str(target)]
    done = subprocess.run(words, cwd=source, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the wheel and the source distribution of this checkout."""
    folder = tmp_path_factory.mktemp("built")
    _build(ROOT, folder)
    return folder


@pytest.fixture(scope="module")
def unpacked(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the content of the wheel."""
    folder = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(built / WHEEL) as wheel:
        wheel.extractall(folder)
    return folder


def _files(folder: Path) -> set[str]:
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def test_the_wheel_holds_the_package_its_data_and_the_license(unpacked: Path) -> None:
    packed = _files(unpacked)
    assert {f"dtbacklash/{name}" for name in _files(ROOT / "dtbacklash")} <= packed
    for folder in DATA:
        assert any(name.startswith(f"{folder}/") for name in packed)
    assert f"{SDIST}.dist-info/licenses/LICENSE" in packed


def test_the_wheel_holds_nothing_that_only_the_repository_needs(unpacked: Path) -> None:
    tops = {path.name for path in unpacked.iterdir()}
    assert tops == {"dtbacklash", "hydra_plugins", f"{SDIST}.dist-info"}
    assert not tops & OUTSIDE


def test_the_metadata_names_license_authors_and_version(unpacked: Path) -> None:
    said = email.message_from_string((unpacked / f"{SDIST}.dist-info" / "METADATA").read_text(encoding="utf-8"))
    assert said["License-Expression"] == "BSD-3-Clause"
    assert said["Author"] == "The dtbacklash authors"
    assert said["Version"] == __version__
    assert said["Keywords"]
    assert said.get_all("Classifier")


def test_citation_license_and_project_agree() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert cited["version"] == __version__
    assert cited["license"] == project["license"]
    assert cited["authors"] == project["authors"]
    benchmark = next(one for one in cited["references"] if one["type"] == "data")
    assert (benchmark["version"], benchmark["license"]) == (VERSION, project["license"])
    page, _, anchor = benchmark["notes"].split()[-1].partition("#")
    assert f"## {anchor.capitalize().replace('-', ' ')}\n" in (ROOT / page).read_text(encoding="utf-8")
    assert f"## [{__version__}] - {cited['date-released']}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert project["authors"][0]["name"] in (ROOT / "LICENSE").read_text(encoding="utf-8")


def test_the_source_distribution_builds_the_same_wheel(built: Path, unpacked: Path, tmp_path: Path) -> None:
    with tarfile.open(built / f"{SDIST}.tar.gz") as sdist:
        sdist.extractall(tmp_path, filter="data")
    source = tmp_path / SDIST
    assert {"LICENSE", "CITATION.cff", "README.md", "Makefile", "hatch_build.py", "tests", "docs"} <= {
        p.name for p in source.iterdir()
    }
    _build(source, tmp_path / "again")
    with zipfile.ZipFile(tmp_path / "again" / WHEEL) as wheel:
        assert set(wheel.namelist()) == _files(unpacked)


def test_dtb_runs_from_the_wheel_in_an_empty_folder(unpacked: Path, tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(unpacked)}

    def python(*words: str) -> str:
        options = {"cwd": tmp_path, "env": environment, "capture_output": True, "text": True, "timeout": 120}
        done = subprocess.run([sys.executable, *words], check=False, **options)
        assert done.returncode == 0, done.stderr
        return done.stdout

    where = python("-c", "import dtbacklash, hydra_plugins; print(dtbacklash.__file__, *hydra_plugins.__path__)")
    assert where.startswith(str(unpacked))
    assert str(unpacked / "hydra_plugins") in where
    assert "nimc_twin" in python("-m", "dtbacklash.cli", "run", "--help")
    assert "lead_screw" in python("-m", "dtbacklash.cli", "run", "--cfg", "job")
    assert "emps" in python("-m", "dtbacklash.cli", "recordings")
    for module in ("dtbacklash.core", "dtbacklash.prove.simulator"):
        assert str(unpacked) in python("-c", f"from {module} import library; print(library.__file__, library.lib)")


def pins(name: str) -> set[str]:
    lines = (ROOT / name).read_text(encoding="utf-8").splitlines()
    return {line.rstrip(" \\") for line in lines if "==" in line}


def test_what_runs_need_is_pinned_as_for_the_tests_and_holds_none_of_their_tools() -> None:
    runs, everything = pins("requirements.lock"), pins("requirements-all.lock")
    assert runs < everything
    names = {line.partition("==")[0] for line in runs}
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [*wanted["optional-dependencies"]["build"], *wanted["optional-dependencies"]["remote"]]
    assert {line.partition(">=")[0] for line in [*wanted["dependencies"], *extras]} <= names
    assert not {"pytest", "mypy", "mkdocs", "cmake", "distributed"} & names
