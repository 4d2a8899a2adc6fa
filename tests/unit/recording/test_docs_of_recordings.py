"""What docs/recordings.md shows is so: its examples run, one after the other."""

import re
from pathlib import Path

import pytest
import yaml

from dtbacklash import units
from dtbacklash.recording import load_mapping, read_recording

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "recordings.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_the_examples_run(tmp_path):
    (tmp_path / "bench").mkdir()
    mapping = next(text for text in blocks("yaml") if "bench/mine.yaml" in text)
    (tmp_path / "bench" / "mine.yaml").write_text(mapping)
    space: dict[str, object] = {}
    assert len(blocks("python")) == 2
    for example in blocks("python"):
        exec(compile(example, "docs/recordings.md", "exec"), space)
    assert load_mapping("bench/mine.yaml").command == "held"


def test_the_example_of_a_file_is_read(tmp_path):
    first, *rows = blocks("csv")[0].splitlines()
    many = [f"{0.001 * k:.3f}," + rows[k % 3].partition(",")[2] for k in range(120)]
    (tmp_path / "bench.csv").write_text("\n".join([first, *many]))
    recording = read_recording("bench.csv")
    assert recording.channels["x1"][2] == pytest.approx(12.4e-6)
    assert recording.channels["x2"][2] == pytest.approx(11.8e-6)


def test_the_example_of_a_rig_declares_units():
    sensors = yaml.safe_load(blocks("yaml")[0])["sensors"]
    assert {name: s["recorded_in"] for name, s in sensors.items()} == {"x1": "mm", "theta": "deg"}


def test_the_units_that_it_lists_are_known():
    listed = re.search(r"Known units are (.*?)\. `µ`", PAGE, re.DOTALL)
    assert listed is not None
    for unit in re.split(r"[,;]\s+", listed.group(1)):
        assert unit in units.UNITS
