"""A lab's CSV, German throughout, goes through one mapping to the right name."""

import json

import pandas as pd
import pytest

import dtbacklash as dtb

MAPPING = """\
rig: oscillator
files: [messung.csv]
time: Zeit
channels:
  u: "Spannung [mV]"
  x: "Laser [µm]"
"""


@pytest.mark.check
def test_stamps_commas_and_german_heads_lead_to_the_cubic_spring(process, tmp_path):
    frame = dtb.run(
        "rig=oscillator", "controller=open_loop", "reference=multisine", "reference.f_min_hz=1",
        "reference.f_max_hz=12", "rig.effects.spring.cubic_stiffness.k3=3e7", "duration_s=8", "seed=1",
    ).recording.to_frame()  # fmt: skip
    (position,) = [name for name in frame if name.endswith("_m")]
    times = pd.Timestamp("2026-03-01 23:59:57") + pd.to_timedelta(frame["t_s"], unit="s")
    pd.DataFrame({
        "Zeit": times.dt.strftime("%d.%m.%Y %H:%M:%S,%f"), "Zustand": "läuft",
        "Spannung [mV]": 1e3 * frame["u_v"], "Laser [µm]": 1e6 * frame[position],
    }).to_csv(tmp_path / "messung.csv", sep=";", decimal=",", index=False, encoding="utf-16")  # fmt: skip
    (tmp_path / "prüfstand.yaml").write_text(MAPPING.replace("x:", f"{position.removesuffix('_m')}:"))
    done = process("diagnose", "recording=prüfstand.yaml", "out=found")
    assert done.returncode == 0
    assert all(line.startswith("dtb: ") for line in done.stderr.splitlines())  # how far it is
    assert "error" not in done.stderr
    document = json.loads((tmp_path / "found" / "diagnosis.json").read_text())
    finding, *others = sorted(document["findings"], key=lambda one: one["location"] != "spring")
    assert (finding["location"], finding["effect"], finding["confidence"]) == ("spring", "cubic_stiffness", "sure")
    low, high = finding["parameters"]["k3"]["ci95"]
    assert low < 3e7 < high
    assert document["units"]["u"] == "mV (header)"
    assert "dtb run rig=found/rig.yaml controller=open_loop" in done.stdout
    if others:
        pytest.xfail("a lag of 0.3 ms is named beside it where a recording has no noise (KNOWN_GAPS.md)")
