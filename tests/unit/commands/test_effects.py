"""``dtb effects``: what there is, with law, unit and place; one in detail; mistakes in one line."""

import re
import subprocess
import sys

import pytest
from told import refusal

from dtbacklash import cli
from dtbacklash.config.groups import PACKAGED
from dtbacklash.physics.catalogue import CATALOGUE

DRAG = """\
acts_on: [carriage, mass]
law: -drag*abs(v)*v
parameters: {drag: {unit: N s^2/m^2, low: 0, start: 5}}
"""


def answer(capsys, *words):
    code = cli.main(["effects", *words])
    return code, *capsys.readouterr()


def test_all_effects_are_listed_by_kind_with_laws_and_units(capsys):
    code, out, err = answer(capsys)
    assert (code, err) == (0, "")
    kind, listed = "", set()
    of_kinds, asked_for = out.split("of the package, where a rig asks for it (rig.laws.NAME=packaged):\n")
    assert re.search(r" dahl_friction +-level\*z, z' = \(v - abs\(v\)\*z\)/reach  \(rotor, carriage, mass\)", asked_for)
    laws = [line for line in out.splitlines() if line.startswith("   ")]
    assert len({re.match(r"   \S+ +", line).end() for line in laws}) == 1  # one column through all kinds
    for line in of_kinds.splitlines():
        kind = line if line and not line.startswith(" ") else kind
        listed |= {(kind, line.split()[0])} if line.startswith("   ") else set()
    assert listed == set(CATALOGUE)
    assert "cubic_stiffness" in out
    assert "(force [N], speed [m/s])" in out


def test_a_rig_is_listed_with_its_places(capsys):
    code, out, _ = answer(capsys, "rig=two_mass_stage")
    assert code == 0
    assert "carriage (carriage)\n" in out
    assert "mass (table)\n" in out
    assert "sensor (sensor_x_c, sensor_x_t)\n" in out
    assert not any(line.startswith("gear") for line in out.splitlines())


def test_one_effect_in_detail(capsys):
    _, out, _ = answer(capsys, "stribeck_friction", "rig=emps")
    assert out.startswith("stribeck_friction at carriage (carriage)\n  law     -force exp(-(v/speed)^2) sign(v)\n")
    assert "    speed [m/s]                  1e-09 to 100000, usually 0.02, shape\n" in out
    assert "rotor" not in out


@pytest.mark.parametrize("name", sorted({name for _, name in CATALOGUE}))
def test_what_a_report_says_is_shown_with_usual_values(capsys, name):
    _, out, _ = answer(capsys, name)
    said = [line for line in out.splitlines() if line.startswith("  said ")]
    assert len(said) == sum(name == other for _, other in CATALOGUE)
    assert not [line for line in said if set("{}") & set(line)]


def test_only_a_size_is_said_to_do_nothing(capsys):
    """A drive that brakes again from 0 V on still lets a body coast without a command."""
    _, out, _ = answer(capsys, "coasting", "rig=pendulum")
    assert "The drive lets the rotor coast: without a command it brakes it by 0.001 N m s/rad less.\n" in out
    assert "usually 0.001, does nothing at 0, size\n" in out
    assert "usually 0, 0 if not given, shape\n" in out


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("zzz",), "effects=zzz: choose one of absorber"),
        (("coulomb",), "effects=coulomb: did you mean coulomb_friction? dtb effects lists all"),
        (("backlsh",), "effects=backlsh: did you mean backlash?"),
        (("gravity", "rig=emps"), "effects=gravity: choose one of"),
        (("--all",), "option=--all: dtb effects takes"), (("a", "b"), "argument=a b: write dtb effects [NAME]"),
        (("rug=emps",), "rug=emps: no such setting"), (("rig=nowhere",), "rig=nowhere: choose one of"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(capsys, words, line):
    assert refusal(capsys, "effects", *words).startswith(line)


def test_a_wrong_law_in_a_rigs_file_is_one_line(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (PACKAGED / "rig" / "emps.yaml").read_text()
    law = "{acts_on: carriage, law: drag.real*v, parameters: {drag: {start: 1}}}"
    (tmp_path / "mine.yaml").write_text(f"{text}\nlaws:\n  tank: {law}\n")
    line = refusal(capsys, "effects", "rig=mine.yaml")
    assert line.startswith("rig.laws.tank.law=drag.real: an attribute is not allowed; numbers, names")


def test_help_names_the_folder(capsys):
    _, out, _ = answer(capsys, "--help")
    assert "usage: dtb effects [NAME] [rig=RIG]" in out
    assert "conf/effect/*.yaml" in out


def in_folder(folder, *words):
    done = subprocess.run([sys.executable, "-m", "dtbacklash.cli", *words], cwd=folder, capture_output=True, text=True,
                          check=False, timeout=300)  # fmt: skip
    return done.returncode, done.stdout, done.stderr


def test_the_laws_of_a_folder_are_listed_and_a_wrong_one_is_named(tmp_path):
    (tmp_path / "conf" / "effect").mkdir(parents=True)
    file = tmp_path / "conf" / "effect" / "tank.yaml"
    file.write_text(DRAG)
    code, out, err = in_folder(tmp_path, "effects", "rig=emps")
    assert (code, err) == (0, "")
    assert re.search(r"^ \* tank +-drag \* abs\(v\) \* v  \(drag \[N s\^2/m\^2\]\)$", out, flags=re.MULTILINE)
    file.write_text(DRAG.replace("abs(v)", "open(v)"))
    code, out, err = in_folder(tmp_path, "effects")
    assert (code, out) == (2, "")
    assert err.startswith("dtb: error: conf/effect.tank.law=open(): is no function here; choose one of abs")
    assert err.count("\n") == 1
