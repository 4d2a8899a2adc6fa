"""What is given to Python's doors by mistake ends in one line; a DataFrame is read as a file is."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from told import refused

import dtbacklash as dtb
from dtbacklash.api.progress import shown
from dtbacklash.diagnosis.explain.warnings import GAIN, said_first
from dtbacklash.recording import Recording
from dtbacklash.recording.wrong_units import Doubt


@pytest.fixture(scope="module")
def rig():
    return dtb.load_rig("pendulum")


@pytest.fixture(scope="module")
def frame(rig):
    result = dtb.run("controller=open_loop", "reference=multisine", "duration_s=4", rig=rig)
    return result.recording.to_frame()[["t_s", "u_v", "theta_rad"]].round({"theta_rad": 4})


SOUND = pd.DataFrame({"t": 1e-3 * np.arange(500), "u": np.sin(0.01 * np.arange(500)),
                      "theta": np.cos(0.01 * np.arange(500))})  # fmt: skip
MISTAKES = {
    "a list of words": (lambda rig: dtb.run(["controller=imc"]), "write run(*words)"),
    "a number for a word": (lambda rig: dtb.run(3), "argument=3: must be text"),
    "text for parameters": (lambda rig: rig.with_parameters("text"), "rig.parameters=text: must be a mapping"),
    "text for a number": (lambda rig: rig.with_parameters({"J": "x"}), "rig.parameters.J=x: must be a number"),
    "a number for a recording": (lambda rig: dtb.diagnose(3, rig), "recording=3: must be a recording, a DataFrame"),
    "nothing for a recording": (lambda rig: dtb.diagnose(None), "recording=None: must be"),
    "a frame without channels": (lambda rig: dtb.diagnose(pd.DataFrame({"a": [1.0]}), rig), "lacks the column u"),
    "a frame for a file": (
        lambda rig: dtb.read_recording(pd.DataFrame({"a": [1.0]})),
        "recording=a DataFrame: must be",
    ),
    "a number for rows": (lambda rig: dtb.read_recording("a.csv", rows=5), "rows=5: must be [first row"),
    "a list of units": (lambda rig: dtb.read_recording("a.csv", units=["mm"]), "units=['mm']: must be a map"),
    "text for a step": (
        lambda rig: dtb.read_recording("a.csv", sample_time_s="1"),
        "sample_time_s=1: must be positive s",
    ),
    **{
        f"text for {key}": (lambda rig, key=key: dtb.diagnose(SOUND, rig, **{key: "x"}), f"{key}=x: must be {said}")
        for key, said in (
            ("jobs", "a whole number"),
            ("enough", "a mapping"),
            ("held_out", "above 0"),
            ("progress", "True, False or a function"),
        )
    },
    "a number for a path": (lambda rig: dtb.save_rig(rig, 3), "path=3: must be the path"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_a_mistake_gets_its_line(case, rig):
    door, said = MISTAKES[case]
    with refused(said):
        door(rig)


@pytest.mark.parametrize("door", ["frame", "recording read without a rig", "file"])
def test_every_door_checks_the_units(door, rig, frame, tmp_path):
    wrong = frame.assign(theta_rad=np.rad2deg(frame.theta_rad))
    wrong.to_csv(tmp_path / "bench.csv", index=False)
    given = {"frame": wrong, "file": tmp_path / "bench.csv"}.get(door)
    if given is None:
        given = dtb.read_recording(tmp_path / "bench.csv")
    with pytest.raises(dtb.UserError, match="channel theta looks to be in a wrong unit: it was read in rad"):
        dtb.diagnose(given, rig, search="none")


def test_a_command_that_does_nothing_is_said_first(rig, frame):
    still = Recording.from_frame(frame.assign(u_v=0.0), rig=rig)
    assert still.notes[0].startswith("The command u is 0 from beginning to end while theta moves")
    assert Recording.from_frame(frame.assign(u_v=2.0), rig=rig).notes[0].startswith("The command u is constant, 2 V,")
    without = Recording.from_frame(frame.assign(u_v=0.0), rig=rig, command="none")
    assert not any("while theta moves" in note for note in without.notes)


@pytest.mark.parametrize(
    ("verdict", "findings", "said"),
    [
        ("missing_physics", [("amplifier", "saturation")], "It is not: saturation at the amplifier explains it."),
        ("missing_physics", [("sensor_theta", GAIN)], "the unit is wrong, or the sensor's gain"),
        ("unexplained", [], "check the unit first"),
        ("consistent", [], "It is not: the rig as it is explains it."),
    ],
)
def test_a_doubt_about_a_unit_is_settled_in_the_end(verdict, findings, said, frame, monkeypatch):
    rig = SimpleNamespace(config=SimpleNamespace(commands={}))
    found = SimpleNamespace(suspected="", verdict=verdict, summary="All else.", recalibrated={}, nominal=rig,
                            findings=[SimpleNamespace(location=at, effect=name) for at, name in findings])  # fmt: skip
    monkeypatch.setattr("dtbacklash.diagnosis.explain.warnings.replace", lambda found, first, summary: summary)
    doubt = Doubt("theta", "its values are about a factor 6.28 too small")
    summary = said_first(found, [Recording.from_frame(frame)], [doubt])
    assert summary.startswith("theta looked to be in a wrong unit: its values are about a factor 6.28 too small. ")
    assert said in summary
    assert summary.endswith("All else.")


def test_progress_in_python_is_that_of_the_command_line(capsys):
    with shown(True, "diagnosing") as tell:
        tell(0.5, "searching; so far backlash")
    assert capsys.readouterr().err.endswith("dtb: after 0 s: backlash\n")
