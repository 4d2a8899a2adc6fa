"""From a person's words to Hydra's overrides and back."""

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from told import refused

from dtbacklash.config import hydra_app
from dtbacklash.config.grammar import GRAMMARS, RUN
from dtbacklash.errors import UserError

DIAGNOSE, PROVE = GRAMMARS["diagnose"], GRAMMARS["prove"]

STRANGE = [
    "a b.csv", "ä.csv", "it's.csv", "a,b.csv", "a=b.csv", "(1).csv", "a:b", "x\\y.csv", "100%.csv", "$1.csv", "null",
]  # fmt: skip


@pytest.mark.parametrize(
    ("grammar", "words", "expected"),
    [
        (RUN, ["out=x"], ["hydra.run.dir=x"]),
        (RUN, ["-m", "out=x"], ["-m", "hydra.sweep.dir=x"]),
        (RUN, ["-v"], ["hydra.verbose=[dtbacklash]"]),
        (RUN, ["--cfg", "job"], ["--cfg", "job"]),
        (RUN, ["+rig.effects.gear.backlash.half_gap=1"], ["++rig.effects.gear.backlash.half_gap=1"]),
        (RUN, ["sensors.noise.q3_mm=1"], ["++sensors.noise.q3_mm=1"]),
        (RUN, ["experiment=null"], []),
        (RUN, ["reference.rms_v=2", "controller=open_loop"], ["reference.rms_mm=2", "controller=open_loop"]),
        (RUN, ["controller.limit_v=12 V"], ["controller.limit_v=12.0"]),
        (
            RUN,
            ["twin.delay_s='200 ms'", "sensors.noise.q3_mm=1 um"],
            ["twin.delay_s=0.2", "++sensors.noise.q3_mm=0.001"],
        ),
        (RUN, ["-m", "twin.delay_s=200 ms,4"], ["-m", "twin.delay_s=0.2,4"]),
        (RUN, ["reference.rms_v=2 kV", "controller=open_loop"], ["reference.rms_mm=2000.0", "controller=open_loop"]),
        (RUN, ["rig.effects.gear.backlash.half_gap=1 deg"], ["++rig.effects.gear.backlash.half_gap=1 deg"]),
        (RUN, ["seed=3 V"], ["seed=3 V"]),
        (DIAGNOSE, ["recording=bench.csv"], ["recording.source=bench.csv"]),
        (DIAGNOSE, ["units={q3: mm, v: m/s}"], ["++recording.units.q3=mm", "++recording.units.v=m/s"]),
        (DIAGNOSE, ["recording.units.q3=mm"], ["++recording.units.q3=mm"]),
        (DIAGNOSE, ["-m", "recording=a.csv,b.csv"], ["-m", "recording.source=a.csv,b.csv"]),
        (DIAGNOSE, ["-m", "recording='a, b.csv',c.csv"], ["-m", "recording.source='a, b.csv',c.csv"]),
        (DIAGNOSE, ["recording=[a.csv,b.csv]"], ["recording.source='[a.csv,b.csv]'"]),
        (DIAGNOSE, ["recording=data/*.csv", "validation=2"], ["recording.source='data/*.csv'", "validation=2"]),
        (DIAGNOSE, ["-m", "recording=[a.csv,b.csv],c.csv"], ["-m", "recording.source='[a.csv,b.csv]',c.csv"]),
        (DIAGNOSE, ["-m", "recording=glob(*)"], ["-m", "recording.source=glob(*)"]),
        (PROVE, ["--quick", "docs=null"], ["quick=true", "docs=null"]),
    ],
)
def test_words_become_overrides(grammar, words, expected):
    assert hydra_app.overrides(grammar, words) == expected


@pytest.mark.parametrize("path", STRANGE)
def test_a_path_reaches_the_setting_sign_by_sign(path):
    for key in ("hydra.run.dir", "profile.path", "rig"):
        written = "out" if key == "hydra.run.dir" else key
        if path == "null" and key != "hydra.run.dir":
            continue
        word = path if written == "out" or "," not in path else f'"{path}"'
        (override,) = hydra_app.overrides(RUN, [f"{written}={word}"]) if path != "null" else [f"{key}=null"]
        (parsed,) = OverridesParser.create().parse_overrides([override])
        assert parsed.get_key_element() == key
        assert str(parsed.value()) == path or path == "null"


@pytest.mark.parametrize("path", STRANGE[:-1])
def test_what_was_quoted_is_shown_as_it_was_written(path):
    assert hydra_app.unquoted(hydra_app.quoted(path)) == path


def test_a_comma_without_quotes_is_a_path_if_there_is_such_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match="give several with -m"):
        hydra_app.overrides(DIAGNOSE, ["recording=a,b.csv"])
    (tmp_path / "a,b.csv").touch()
    assert hydra_app.overrides(DIAGNOSE, ["recording=a,b.csv"]) == ["recording.source='a,b.csv'"]


def test_a_home_folder_is_found(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "my.yaml").touch()
    assert hydra_app.overrides(RUN, ["rig=~/my.yaml"]) == [f"rig={tmp_path}/my.yaml"]


def test_a_file_that_is_not_there_is_not_the_rig_of_its_name(monkeypatch, tmp_path):
    """Hydra takes ``oscillator.yaml`` for the option ``oscillator``."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=r"rig=oscillator.yaml: no such file; the rig that comes with dtb is rig=osc"):
        hydra_app.overrides(RUN, ["rig=oscillator.yaml"])
    (tmp_path / "oscillator.yaml").touch()
    assert hydra_app.overrides(RUN, ["rig=oscillator.yaml"]) == ["rig=oscillator.yaml"]


def test_a_folder_is_no_rig_but_may_hold_one(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    for folder in ("rigs", "emps"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "mine.yaml").touch()
    for word in ("rigs", str(tmp_path / "rigs")):
        with pytest.raises(UserError, match=r"rigs: is a folder; give a rig's file in it \(mine.yaml\)"):
            hydra_app.overrides(RUN, [f"rig={word}"])
    assert hydra_app.overrides(RUN, ["rig=emps"]) == ["rig=emps"]  # it comes with dtb


@pytest.mark.parametrize(
    ("grammar", "words", "line"),
    [
        (RUN, ["out=a", "hydra.run.dir=b"], "hydra.run.dir=b: is given twice; the first is a"),
        (RUN, ["out="], "out=: give a folder"),
        (RUN, ["~seed"], "seed=~: a setting cannot be removed"),
        (RUN, ["recording=emps"], "recording=emps: is a recording to diagnose (dtb diagnose recording=emps)"),
        (RUN, ["reference.rms_v=2", "controller=imc"], "reference.rms_v=2: is a voltage, which the reference of contr"),
        (RUN, ["reference.rms_v=2", "reference.rms_mm=2", "controller=open_loop"], "reference.rms_mm=2: is given "),
        (RUN, ["controller.limit_v=12 mm"], "controller.limit_v=12 mm: must be in V"),
        (RUN, ["twin.delay_s=2 weeks"], "twin.delay_s=2 weeks: the unit weeks is unknown; written as in N/mm"),
        (DIAGNOSE, ["--recording", "x.csv"], "option=--recording: a setting has no dashes: write recording=x.csv"),
        (DIAGNOSE, ["--hold-out=a"], "option=--hold-out=a: a setting has no dashes: write hold_out=a"),
        (RUN, ["--twin.delay_s"], "option=--twin.delay_s: a setting has no dashes: write twin.delay_s=VALUE"),
        (RUN, ["--quick"], "option=--quick: choose one of --cfg"),
        (DIAGNOSE, ["recording="], "recording=: give a value"),
        (DIAGNOSE, ["units=mm"], "units=mm: must be a mapping, e.g. units='{q3: mm}'"),
        (RUN, ["rig.laws=packaged"], "rig.laws=packaged: must be a mapping, e.g. rig.laws.dahl_friction=packaged"),
        (RUN, ["rig.effects=x"], "rig.effects=x: must be a mapping, e.g. rig.effects.motor_bearing.coulomb_friction."),
        (PROVE, ["n"], "argument=n: write key=value"),
    ],
)
def test_a_mistake_names_what_was_written(grammar, words, line):
    with refused(start=line):
        hydra_app.overrides(grammar, words)


@pytest.mark.parametrize("name", GRAMMARS)
def test_each_command_has_its_primary_config_and_names_its_jobs(name):
    from importlib import resources

    text = (resources.files("dtbacklash.conf") / f"{name}.yaml").read_text(encoding="utf-8")
    assert f"- {name}_schema" in text
    assert f"job: {{name: {name}}}" in text


def test_the_name_of_a_recording_is_a_file_name():
    assert hydra_app.file_name("data/bench 1.csv.gz") == "bench_1"
    assert hydra_app.file_name("silverbox:arrow") == "silverbox_arrow"
    assert hydra_app.file_name(None) == "recording"
    assert hydra_app.file_name("[data/a.csv,data/b.csv]") == "a"
    assert hydra_app.file_name("data/*.csv") == "recording"
    assert hydra_app.file_name("data/run*.csv") == "run"
