"""The settings of a diagnosis: each says its unit and reason, each is read, and a report holds them."""

import json
import re
from dataclasses import fields
from pathlib import Path

import dtbacklash
from dtbacklash.diagnosis.settings import SETTINGS, DiagnoseSettings

NAMES = [one.name for one in fields(DiagnoseSettings)]
DIAGNOSE = Path(dtbacklash.__file__).parent / "diagnosis"


def test_every_setting_says_its_unit_and_its_reason():
    documented = SETTINGS.to_json()
    assert list(documented) == NAMES
    for name, said in documented.items():
        assert said["unit"], name
        assert len(said["reason"].split()) >= 3, name
        assert said["value"] == getattr(SETTINGS, name)
    assert json.loads(json.dumps(documented)) == documented


def test_every_setting_is_read_somewhere():
    sources = [path.read_text() for path in DIAGNOSE.rglob("*.py") if path.name != "settings.py"]
    read = {name for text in sources for name in re.findall(r"\b(?:SETTINGS|rules)\.(\w+)", text)}
    assert read - {"to_json"} == set(NAMES)
