"""The settings of a diagnosis: each says its unit and reason, each is read, and others can be put in force."""

import json
import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from joblib import parallel_config

import dtbacklash
from dtbacklash.diagnose import diagnose_records
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.data.floor import quantum
from dtbacklash.diagnose.search.parts import marked
from dtbacklash.diagnose.settings import DiagnoseSettings, settings, using
from dtbacklash.diagnose.spread import spread
from dtbacklash.errors import UserError
from studies.ablation import _variants

from .conftest import recorded

NAMES = [one.name for one in fields(DiagnoseSettings)]
DIAGNOSE = Path(dtbacklash.__file__).parent / "diagnose"


def test_every_setting_says_its_unit_and_its_reason():
    documented = DiagnoseSettings().to_json()
    assert list(documented) == NAMES
    for name, said in documented.items():
        assert said["unit"], name
        assert len(said["reason"].split()) >= 3, name
        assert said["value"] == getattr(DiagnoseSettings(), name)
    assert json.loads(json.dumps(documented)) == documented


def test_every_setting_is_read_somewhere():
    sources = [path.read_text() for path in DIAGNOSE.rglob("*.py") if path.name != "settings.py"]
    read = {name for text in sources for name in re.findall(r"\.(\w+)", text)}
    assert [name for name in NAMES if name not in read] == []


def test_others_hold_for_the_evidence_until_the_end_and_after_an_error(rig):
    record = recorded(rig, seconds=4.0)
    usual = Evidence.gather(rig, [record]).stretch
    with using(replace(settings(), paired_stretches=24)):
        assert Evidence.gather(rig, [record]).stretch == 50 == usual // 2
    assert Evidence.gather(rig, [record]).stretch == usual

    def fail():
        with using(replace(settings(), counted_share=0.01)):
            raise RuntimeError

    before = settings()
    with pytest.raises(RuntimeError):
        fail()
    assert settings() is before


@pytest.mark.parametrize("backend", ["threading", "loky"])
def test_threads_and_processes_see_the_settings_that_are_in_force(backend):
    values = np.repeat(np.arange(20.0), 5)  # a fifth as many levels as samples
    assert quantum(values) == 1.0
    with parallel_config(backend=backend, n_jobs=2), using(replace(settings(), counted_share=0.1)):
        assert spread(quantum, [values] * 8) == [0.0] * 8
    with parallel_config(backend=backend, n_jobs=2):
        assert spread(quantum, [values] * 8) == [1.0] * 8


def test_the_ablation_moves_every_setting_to_both_sides_within_its_bounds():
    sides: dict[str, set[bool]] = {name: set() for name in NAMES}
    for name, how, value in _variants([]):
        usual = getattr(DiagnoseSettings(), name)
        replace(DiagnoseSettings(), **{name: value})
        assert (value > usual) == (how == "doubled")
        sides[name].add(value > usual)
    assert all(both == {False, True} for both in sides.values())


def test_a_setting_out_of_its_bounds_is_refused():
    with pytest.raises(UserError, match="judging_share"):
        DiagnoseSettings(judging_share=1.5)


def test_a_diagnosis_holds_the_settings_that_it_was_made_with(rig):
    record = recorded(rig, seconds=4.0)
    # turned round, so that it ends with the inspection
    turned = replace(record, y={**record.y, "theta_m": -record.y["theta_m"]})
    with using(replace(settings(), judging_share=0.25)):
        document = diagnose_records(rig, [turned]).to_json()
        assert marked([record])[0].judge.sum() == round(0.25 * record.held.sum())
    assert document["settings"]["judging_share"]["value"] == 0.25
    assert document["settings"]["pull_ratio"]["unit"] == "tempos"
    assert diagnose_records(rig, [turned]).settings == DiagnoseSettings()
