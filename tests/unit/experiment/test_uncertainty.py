"""The band of a prediction: by the covariance of a diagnosis, through the simulation."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from told import refusal

from dtbacklash import cli
from dtbacklash.config.compose import compose
from dtbacklash.experiment.run import run_scenario
from dtbacklash.files import write_json
from dtbacklash.physics.rig import build_rig

RUN = ("rig=pendulum", "controller=open_loop", "reference=multisine", "reference.rms_v=1", "duration_s=2")


def calibrated(errors, correlation=0.0):
    """A diagnosis of two parameters with relative standard errors."""
    config = compose(*RUN).rig
    names = list(errors)
    rows = {
        n: {"nominal": p.value, "value": p.value, "unit": p.unit, "ci95": [p.value - h, p.value + h]}
        for n, p in ((n, config.parameters[n]) for n in names)
        for h in [1.96 * errors[n] * p.value]
    }
    together = {a: {b: 1.0 if a == b else correlation for b in names} for a in names}
    Path("found").mkdir()
    write_json(Path("found/diagnosis.json"), {"calibration": {"parameters": rows, "correlation": together}})


def run(*words):
    assert cli.main(["run", *RUN, *words, "out=ran", "figures=false"]) == 0
    return pd.read_parquet("ran/trace.parquet"), json.loads(Path("ran/summary.json").read_text())


def names():
    return [n for n, p in compose(*RUN).rig.parameters.items() if p.tolerance > 0.0][:2]


def test_one_parameter_makes_the_band_of_a_simulation_to_both_sides(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (name, _) = names()
    calibrated({name: 0.02})
    trace, summary = run("uncertainty=found")

    value = compose(*RUN).rig.parameters[name].value
    low, high = (
        run_scenario(compose(*RUN, f"rig.parameters.{name}.value={value * s!r}")).trace["theta_m_rad"]
        for s in (0.98, 1.02)
    )
    here = trace["theta_rad"]
    half = 1.96 * np.sqrt(0.5 * ((low - here) ** 2 + (high - here) ** 2))
    assert half.max() > 1e-4
    assert np.allclose(trace["theta_rad_high"] - here, half, rtol=1e-6, atol=1e-12)
    assert np.allclose(here - trace["theta_rad_low"], half, rtol=1e-6, atol=1e-12)
    assert summary["uncertainty"]["directions"] == 1


def test_correlated_parameters_narrow_or_widen_the_band(tmp_path, monkeypatch):
    widths = {}
    for correlation in (-0.99, 0.0, 0.99):
        (tmp_path / str(correlation)).mkdir()
        monkeypatch.chdir(tmp_path / str(correlation))
        calibrated(dict.fromkeys(names(), 0.02), correlation)
        trace, _ = run("uncertainty=found")
        widths[correlation] = float((trace["theta_rad_high"] - trace["theta_rad_low"]).abs().mean())
    between = sorted((widths[-0.99], widths[0.99]))
    assert between[0] < widths[0.0] < between[1]


WHEEL = {"parameters": {"wheel": {"value": 1.0, "ci95": [0.9, 1.1]}}, "correlation": {"wheel": {"wheel": 1.0}}}


@pytest.mark.parametrize(("content", "said"), [
    (None, "uncertainty=found"), ({"calibration": None}, "uncertainty=found"),
    ({"calibration": WHEEL}, "fitted wheel, which the rig of this run has not"),
])  # fmt: skip
def test_a_folder_without_intervals_or_of_another_rig_is_refused(tmp_path, monkeypatch, capsys, content, said):
    monkeypatch.chdir(tmp_path)
    Path("found").mkdir()
    if content:
        write_json(Path("found/diagnosis.json"), content)
    assert said in refusal(capsys, "run", *RUN, "uncertainty=found", "out=ran")
    assert not Path("ran").exists()


def test_a_force_that_stays_unknown_widens_the_band_as_a_constant_one_does_for_a_stretch(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (name, _) = names()
    calibrated({name: 1e-9})
    (body,) = (e.name for e in build_rig(compose(*RUN).rig).elements.values() if e.trait.trait == "body")
    found = json.loads(Path("found/diagnosis.json").read_text())
    write_json(Path("found/diagnosis.json"), found | {"observed": {"slow": {body: 0.01}, "stretch_s": 0.5}})
    trace, summary = run("uncertainty=found")

    load = "{constant_load: {torque: TORQUE}}"
    low, high = (
        run_scenario(compose(*RUN, f"+rig.effects.{body}={load.replace('TORQUE', s)}")).trace["theta_m_rad"]
        for s in ("-0.01", "0.01")
    )
    here, first = trace["theta_rad"], trace["t_s"] <= 0.5
    half = 1.96 * np.sqrt(np.maximum.accumulate(0.5 * ((low - here) ** 2 + (high - here) ** 2)))
    band = trace["theta_rad_high"] - here
    assert half[first].max() > 1e-4
    assert np.allclose(band[first], half[first], rtol=1e-4, atol=1e-9)
    assert band.is_monotonic_increasing
    assert band.iloc[-1] < half.iloc[-1]
    assert summary["uncertainty"]["unknown_forces"] == 1
