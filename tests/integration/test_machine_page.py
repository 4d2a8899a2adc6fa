"""``docs/machine.md`` to the letter: its commands, one after the other in an empty folder."""

import re
import shlex
from pathlib import Path

import pytest
import yaml

from dtbacklash.api.rigs import load_rig

PAGE = (Path(__file__).parents[2] / "docs" / "machine.md").read_text(encoding="utf-8")
COMMANDS = [line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL) for line in block.splitlines()]
QUICK = [line for line in COMMANDS if "diagnose" not in line and "found" not in line]


def followed(typed, lines):
    told = []
    for line in lines:
        program, *words = shlex.split(line, comments=True)
        assert program == "dtb"
        code, out, err = typed(*words)
        assert (code, err) == (0, ""), line
        told.append(out)
    return told


@pytest.mark.check
def test_what_comes_before_a_diagnosis(typed, tmp_path):
    told = followed(typed, QUICK)
    assert len(told) >= 6
    assert any("gravity holds disk at 0°, about which it swings:" in out for out in told)
    assert (tmp_path / "bench_recording.png").is_file()


@pytest.mark.nightly
def test_all_of_it(typed, tmp_path):
    followed(typed, COMMANDS)
    assert (tmp_path / "found" / "rig.yaml").is_file()


@pytest.mark.parametrize("kinds", [("servo", "amplifier"), ()])
def test_the_pieces_of_rigs_are_rigs(kinds):
    """Those that are whole: elements with what is known of them; parameters that are held, bounded and tied."""
    blocks = [yaml.safe_load(one) for one in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)]
    if kinds:
        (servo,) = (one for one in blocks if set(kinds) <= set(one.get("elements", {})))
        rig = load_rig({**servo, "sensors": {"theta": {"of": "arm", "quantity": "position"}}})
        assert rig.effects["servo"]["speed_limit"]["speed"] == 6.3
        return
    (tied,) = (one["parameters"] for one in blocks if "k2" in one.get("parameters", {}))
    ends = [{"kind": "mass", "mass": f"{m} kg"} for m in (1, 2, 3)]
    links = {f"link_{n}": {"kind": "link", "between": [f"m{n}", f"m{n + 1}"], "stiffness": f"k{n}"} for n in (1, 2)}
    drive = {"motor": {"kind": "actuator", "gain": "g", "drives": "m1"}}
    rig = load_rig({
        "parameters": {**tied, "g": {"value": "3 N/V"}}, "sensors": {"x": {"of": "m3", "quantity": "position"}},
        "elements": {**drive, **{f"m{n}": one for n, one in enumerate(ends, 1)}, **links},
    })  # fmt: skip
    assert {rig.elements[f"link_{n}"].values["stiffness"] for n in (1, 2)} == {20e3}
    assert rig.config.parameters["k1"].max == 25e3
