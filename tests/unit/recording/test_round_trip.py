"""What is written by a run, or concealed, is read back in the units that the rig declares."""

import numpy as np
import pandas as pd
import pytest
from nominal import nominal_rig

from dtbacklash.api.run_files import simulate_and_write
from dtbacklash.config.compose import compose
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import build_rig
from dtbacklash.physics.rig_file import rig_yaml
from dtbacklash.prove.conceal import conceal
from dtbacklash.prove.draw import record
from dtbacklash.prove.seal import open_seal
from dtbacklash.recording import read_recording


@pytest.mark.parametrize(
    ("words", "unit"),
    [((), "mm"), (("rig.sensors.q3.recorded_in=um", "rig.sensors.q2.recorded_in=m"), "um"),
     (("rig.sensors.q3.recorded_in=null",), "")],
)  # fmt: skip
def test_a_run_writes_what_the_rig_declares(words, unit, tmp_path):
    file = tmp_path / "seen.csv"
    config = compose("controller=nimc_fixed", "profile=constant", "duration_s=3", "figures=false",
                     f"recording.save={file}", *words)  # fmt: skip
    result = simulate_and_write(config, tmp_path / "run", "dtb run ...")
    written = pd.read_csv(file)
    assert list(written) == ["t", "r", "u", "theta_m", "q3", "i_m", "q2"]
    assert result.rig.sensors["q3"].recorded_in == unit
    assert np.allclose(written.q3 * {"mm": 1.0, "um": 1e-3, "": 1e3}[unit], result.trace.q3_mm, rtol=1e-12)
    recording = read_recording(file, rig=result.rig)
    for name, values in recording.channels.items():
        assert np.allclose(values, result.seen[name], rtol=1e-12, atol=0), name
    said = f"{unit} (declared by the rig)" if unit else "m (assumed)"
    assert recording.assumed_units["q3"] == recording.assumed_units["r"] == said


def test_a_concealed_recording_is_read_back_in_si(tmp_path, monkeypatch):
    monkeypatch.setattr("dtbacklash.prove.draw.DURATION_S", (3, 3))
    rig = build_rig(compose("rig=lead_screw", "rig.sensors.q3.recorded_in=um").rig)
    case = conceal(3, rig, tmp_path / "hidden", kind="nothing", instruments="minimal")
    _, run = record(open_seal(case, tmp_path / "hidden.key"), rig)
    recording = read_recording(case / "recording.csv.gz", rig=rig)
    assert recording.assumed_units["q3"] == "um (declared by the rig)"
    assert np.allclose(recording.channels["q3"], run.seen["q3"], rtol=1e-10, atol=1e-15)


def test_a_sensor_declares_a_unit_of_its_own_kind(tmp_path):
    config = compose("rig=lead_screw")
    with pytest.raises(UserError, match=r"rig.sensors.q3.recorded_in=deg: a unit of m: m, cm, mm"):
        build_rig(compose("rig=lead_screw", "rig.sensors.q3.recorded_in=deg").rig)
    (tmp_path / "again.yaml").write_text(rig_yaml(build_rig(config.rig)))
    again = build_rig(compose(f"rig={tmp_path / 'again.yaml'}").rig)
    assert again.sensors == build_rig(config.rig).sensors
    assert again.sensors["q3"].unit == "m"
    assert again.output_sensor().name == "q3"


def test_a_rig_file_is_data(tmp_path, monkeypatch):
    monkeypatch.setenv("SECRET", "in the environment")
    text = rig_yaml(nominal_rig("lead_screw"))
    file = tmp_path / "mine.yaml"
    file.write_text(text.replace("DC motor", "${oc.env:SECRET}"))
    with pytest.raises(UserError, match=r"mine.yaml: holds .* is not resolved in a file"):
        compose(f"rig={file}")
    (tmp_path / "conf" / "rig").mkdir(parents=True)
    file.rename(tmp_path / "conf" / "rig" / "mine.yaml")
    with pytest.raises(UserError, match=r"rig=conf/rig/mine\.yaml: holds"):
        compose("rig=mine")
    (tmp_path / "conf" / "rig" / "mine.yaml").write_text(text)
    assert compose("rig=mine").rig.name == "lead_screw"
