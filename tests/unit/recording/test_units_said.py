"""Every way in which a unit may be said, with every way in which a file may be read, gives the same values in SI."""

import gzip
import json
from functools import cache

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from dtbacklash import units
from dtbacklash.errors import UserError
from dtbacklash.recording import Recording, read_pair, read_recording, read_together

RELAXED = settings(max_examples=60, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
SAMPLES = 300
#: channel -> SI unit, and a name that a lab may have given its column
CHANNELS = {"t": ("s", "Zeit"), "u": ("V", "Spannung AO 0"), "x": ("m", "Laser"), "theta": ("rad", "Winkel Welle 2"),
            "n": ("rad/s", "Drehzahl"), "i": ("A", "Kanal A"), "f": ("N", "Kraft")}  # fmt: skip
HEADS = ("{} [{}]", "{}[{}]", "{} ({})", "{} {{{}}}", "{}_{}", "{} / {}", "{}, {}", "{} in {}", "{} {}", "[{1}] {0}")
FILES = ("comma.csv", "german.csv", "tabs.txt", "frame.parquet", "frame.json", "frame.csv.gz")


TIMES = 1e-3 * np.arange(SAMPLES)
TABLE = pd.DataFrame({"t": TIMES} | {c: np.sin((20 + 3 * k) * TIMES + k) for k, c in enumerate(list(CHANNELS)[1:])})


@cache
def a_rig():
    """A motor with the sensors of an angle, a speed and a current."""
    from machine_cases import rig

    elements = {
        "amplifier": {"kind": "amplifier", "drives": "circuit"},
        "circuit": {"kind": "motor_circuit", "resistance": "R", "inductance": "L", "torque_constant": "k",
                    "emf_constant": "k", "drives": "shaft"},
        "shaft": {"kind": "rotor", "inertia": "J"},
    }  # fmt: skip
    sensors = {"theta": {"of": "shaft", "quantity": "position"}, "n": {"of": "shaft", "quantity": "velocity"},
               "i": {"of": "circuit", "quantity": "current"}}  # fmt: skip
    return rig(elements, sensors, R=2.0, L=1e-3, k=0.05, J=2e-4)


def write(folder, name: str, frame: pd.DataFrame, line: list[str] | None = None):
    """Save a frame; ``line`` is one of units below the names."""
    file = folder / name
    if name.endswith(".parquet"):
        frame.to_parquet(file, index=False)
    elif name.endswith(".json"):
        file.write_text(json.dumps({"columns": list(frame), "data": frame.to_numpy().tolist()}))
    else:
        sign = {"comma.csv": ",", "german.csv": ";", "tabs.txt": "\t"}.get(name, ",")
        head = pd.DataFrame([line], columns=list(frame)).to_csv(sep=sign, index=False) if line else ""
        decimal = "," if name == "german.csv" else "."
        body = frame.to_csv(sep=sign, index=False, decimal=decimal, header=not line)
        content = (head + body).encode()
        file.write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    return file


@st.composite
def sayings(draw):
    channel = draw(st.sampled_from(list(CHANNELS)))
    unit = draw(st.sampled_from(units.of_kind(CHANNELS[channel][0])))
    say = draw(st.sampled_from([*HEADS, "line", "mapping", "units="]))
    return channel, unit, say, draw(st.sampled_from(FILES)), draw(st.booleans()), draw(st.booleans())


@RELAXED
@given(saying=sayings(), how=st.sampled_from(["read", "pair", "together", "frame"]))
@example(saying=("n", "rpm", "{} [{}]", "german.csv", True, True), how="read")
@example(saying=("n", "U/min", "{} / {}", "german.csv", True, True), how="pair")
@example(saying=("t", "ms", "{} [{}]", "comma.csv", True, True), how="read")
@example(saying=("x", "um", "{} [{}]", "comma.csv", True, False), how="together")
def test_a_unit_is_heard_however_it_is_said(saying, how, tmp_path_factory):  # noqa: PLR0912
    rig, table = a_rig(), TABLE
    channel, unit, say, name, mapped, with_rig = saying
    folder = tmp_path_factory.mktemp("said")
    factor = units.UNITS[unit].factor
    names = {c: lab if mapped else c for c, (_, lab) in CHANNELS.items()}
    if with_rig:
        names = {c: n for c, n in names.items() if c in ("t", "u") or c in rig.sensors}
        if channel not in names:
            return
    elif not mapped:  # without a rig a column is a channel by its unit, but not behind a mere blank; i_A is a name
        names = {c: n for c, n in names.items() if c in ("t", "u", "theta", channel)}
        if (say == "{} {}" and channel not in ("t", "u", "theta")) or (say == "{}_{}" and unit == "A"):
            return
    if say == "mapping" and not mapped:
        return
    said = {c: n if with_rig or not mapped else f"{n} [{CHANNELS[c][0]}]" for c, n in names.items()}
    heads = said | {channel: say.format(names[channel], unit) if say in HEADS else names[channel]}
    values = {head: table[c] / factor if c == channel else table[c] for c, head in heads.items()}
    line = [unit if c == channel else CHANNELS[c][0] for c in names] if say == "line" else None
    if line and not name.endswith((".csv", ".txt", ".gz")):
        return
    frame = pd.DataFrame(values)
    file = write(folder, name, frame, line)
    given = {channel: unit} if say == "units=" else {}
    options = {"rig": rig if with_rig else None, "units": given, "trust_units": True}
    if mapped:
        entries = {c: {"column": head} | ({"unit": unit} if say == "mapping" and c == channel else {})
                   for c, head in heads.items()}  # fmt: skip
        mapping = {"files": [name], "time": entries.pop("t"), "channels": entries}
        source = folder / "lab.yaml"
        source.write_text(yaml.safe_dump(mapping))
    else:
        source = file
    if how == "frame" and not mapped and not line:
        found = Recording.from_frame(frame, **options)
    elif how == "pair":
        found, _ = read_pair(str(source), share=0.34, **options)
    elif how == "together":
        found = read_together(str(source), None, **options)[0]
    else:
        found = read_recording(str(source), **options)
    for c in names:
        seen = found.t_s if c == "t" else found.channels[c]
        assert np.allclose(seen, table[c][: len(seen)], rtol=1e-9, atol=1e-12), (c, saying)
    assert found.assumed_units[channel].startswith(f"{unit} (")


def test_a_mapping_that_contradicts_the_head_is_said(tmp_path):
    frame = TABLE[["t", "u", "x"]].rename(columns={"x": "Laser [um]"})
    frame.to_csv(tmp_path / "a.csv", index=False)
    channels = {"u": "u", "x": {"column": "Laser [um]", "unit": "mm"}}
    (tmp_path / "lab.yaml").write_text(yaml.safe_dump({"files": ["a.csv"], "time": "t", "channels": channels}))
    found = read_recording(str(tmp_path / "lab.yaml"))
    assert "Channel x is read in mm, as the mapping says, though the header says um." in found.notes
    assert np.allclose(found.channels["x"], 1e-3 * TABLE.x)


def named(tmp_path, head: str, **options) -> Recording:
    TABLE[["t", "u", "x"]].rename(columns={"x": head}).to_csv(tmp_path / "a.csv", index=False)
    mapping = {"files": ["a.csv"], "time": "t", "channels": {"u": "u", "x": head}}
    (tmp_path / "lab.yaml").write_text(yaml.safe_dump(mapping))
    return read_recording(str(tmp_path / "lab.yaml"), **options)


def test_a_bracket_that_holds_no_unit_is_asked_about(tmp_path):
    with pytest.raises(UserError, match=r"is in Striche, which is no known unit; give units={x: UNIT}"):
        named(tmp_path, "Laser [Striche]")


def test_a_last_word_that_is_a_unit_of_another_kind_is_a_part_of_the_name(tmp_path):
    assert np.allclose(named(tmp_path, "Kanal A", units={"x": "m"}).channels["x"], TABLE.x)
