"""Every setting refuses what makes no sense, in one line that names it."""

import math

import pytest
from told import refused

from dtbacklash.config import run

REFUSED = [
    (run.ControllerConfig, {"structure": "pd"}, "controller.structure"),
    (run.ControllerConfig, {"structure": "pid"}, "controller.reconfigure"),
    (run.ControllerConfig, {"k_theta_v_per_rad": 0.0}, "controller.k_theta_v_per_rad"),
    (run.ControllerConfig, {"k_theta_v_per_rad": math.nan}, "controller.k_theta_v_per_rad"),
    (run.ControllerConfig, {"tau_r_s": -1.0}, "controller.tau_r_s"),
    (run.ControllerConfig, {"gap_hat_deg": -1.0}, "controller.gap_hat_deg"),
    (run.ControllerConfig, {"structure": "imc"}, "controller.reconfigure"),
    (run.ControllerConfig, {"internal_model": "none"}, "controller.internal_model"),
    (run.ProfileConfig, {"kind": "sinus"}, "profile.kind"),
    (run.ProfileConfig, {"end_deg": -1.0}, "profile.end_deg"),
    (run.ProfileConfig, {"end_deg": 400.0}, "profile.end_deg"),
    (run.ProfileConfig, {"start_deg": math.inf}, "profile.start_deg"),
    (run.ProfileConfig, {"t_start_s": 175.0}, "profile.t_end_s"),
    (run.ProfileConfig, {"running_in_share": 0.6}, "profile.severe_share"),
    (run.ProfileConfig, {"severe_from": 1.0}, "profile.severe_from"),
    (run.ProfileConfig, {"kind": "constant", "start_deg": 1.0, "end_deg": 2.0}, "profile.end_deg"),
    (run.ProfileConfig, {"kind": "csv"}, "profile.path"),
    (run.ReferenceConfig, {"kind": "sinus"}, "reference.kind"),
    (run.ReferenceConfig, {"period_s": 0.0}, "reference.period_s"),
    (run.ReferenceConfig, {"amplitude_mm": math.nan}, "reference.amplitude_mm"),
    (run.ReferenceConfig, {"levels": 0}, "reference.levels"),
    (run.ReferenceConfig, {"kind": "multisine", "f_max_hz": 0.01}, "reference.f_max_hz"),
    (run.ReferenceConfig, {"kind": "csv"}, "reference.path"),
    (run.TwinConfig, {"delay_s": -1.0}, "twin.delay_s"),
    (run.TwinConfig, {"delay_s": math.inf}, "twin.delay_s"),
    (run.TwinConfig, {"settle": 1000}, "twin.settle"),
    (run.TwinConfig, {"buffer": 1}, "twin.buffer"),
    (run.TwinConfig, {"gap_max_deg": 0.0}, "twin.gap_max_deg"),
    (run.TwinConfig, {"novelty_filter": "bessel"}, "twin.novelty_filter"),
    (run.OptimizerConfig, {"name": "guess"}, "optimizer.name"),
    (run.OptimizerConfig, {"max_evaluations": 0}, "optimizer.max_evaluations"),
    (run.OptimizerConfig, {"tolerance": 0.0}, "optimizer.tolerance"),
    (run.SensorsConfig, {"noise": {"q3_mm": -1.0}}, "sensors.noise.q3_mm"),
    (run.SensorsConfig, {"resolution": {"q3_mm": math.nan}}, "sensors.resolution.q3_mm"),
    (run.SolverConfig, {"substeps": -1}, "solver.substeps"),
    (run.RecordingOutConfig, {"save": "seen.txt"}, "recording.save"),
    (run.RecordingOutConfig, {"save": "no/such/folder/seen.csv"}, "recording.save"),
    (run.RunConfig, {"duration_s": 0.0}, "duration_s"),
    (run.RunConfig, {"duration_s": math.nan}, "duration_s"),
    (run.RunConfig, {"duration_s": 1e9}, "duration_s"),
    (run.RunConfig, {"duration_s": 1.00005}, "duration_s"),
    (run.RunConfig, {"sample_time_s": -0.001}, "sample_time_s"),
    (run.RunConfig, {"seed": -1}, "seed"),
    (run.RunConfig, {"duration_s": 0.9}, "twin.buffer"),
    (run.RunConfig, {"controller": run.ControllerConfig(gap_hat_deg=200.0)}, "controller.gap_hat_deg"),
    (run.RunConfig, {"sensors": run.SensorsConfig(noise={"q9_mm": 1.0})}, "sensors.noise.q9_mm"),
    (run.RunConfig, {"reference": run.ReferenceConfig(kind="multisine", f_max_hz=501.0)}, "reference.f_max_hz"),
]


def bank(**values):
    return {"twin": run.TwinConfig(on_alarm="bank", **values)}


REFUSED += [
    (run.TwinConfig, {"bank_buffer": 10_001}, "twin.bank_buffer"),
    (run.RunConfig, {"duration_s": 1.4, **bank()}, "twin.bank_buffer"),
    (run.RunConfig, bank(bank_buffer=500), "twin.bank_buffer"),
    (run.RunConfig, bank(settle=900, bank_rest=600), "twin.bank_buffer"),
]


@pytest.mark.parametrize(("kind", "values", "key"), REFUSED, ids=[f"{k}-{i}" for i, (_, _, k) in enumerate(REFUSED)])
def test_refuses_in_one_line_that_names_the_key(kind, values, key):
    with refused(key=key, start=f"{key}="):
        kind(**values)


def test_the_defaults_are_the_papers_scenario():
    config = run.RunConfig()
    assert config.samples == 200_000
    assert (config.twin.delay_s, config.twin.buffer, config.twin.settle) == (4.0, 1000, 400)
    assert config.controller.tau_r_s == pytest.approx(1 / 6)
    assert run.ControllerConfig(k_theta_v_per_rad=1e6).k_theta_v_per_rad == 1e6  # a run says that it diverges
    controller = run.ControllerConfig(name="imc", structure="imc", reconfigure="never")
    assert run.RunConfig(controller=controller, duration_s=0.5).samples == 500  # without a twin there is no buffer


def test_the_buffer_of_the_bank_counts_only_where_the_bank_is_asked():
    never = run.ControllerConfig(structure="imc", reconfigure="never")
    assert run.RunConfig(duration_s=1.4, controller=never, **bank(bank_buffer=500)).samples == 1400
    assert run.RunConfig(duration_s=1.4, twin=run.TwinConfig(bank_buffer=500)).samples == 1400
    assert run.RunConfig(duration_s=1.5, **bank(bank_buffer=501)).samples == 1500  # twin.buffer is not used then


WRONG_CHANGES = [
    ("abc", "", "a mapping with at_s"),
    ({"parameters": {"k": 7000.0}}, "", "a mapping with at_s"),
    ({"at_s": 1}, "", "and parameters or effects"),
    ({"at_s": 1, "parameter": {"k": 7000.0}}, "", "and parameters or effects"),
    *(({"at_s": at_s, "parameters": {"k": 1.0}}, ".at_s", "a finite number, at least 0 s")
      for at_s in ("abc", None, True, math.inf, math.nan, -1.0, 10**400)),
    *(({"at_s": at_s, "parameters": {"k": 1.0}}, ".at_s", "at most 1.999 s, as the run ends at duration_s=2 s")
      for at_s in (1000, 2.0, 1.9996)),
    *(({"at_s": 1, "parameters": wrong}, ".parameters", "a mapping name -> finite number")
      for wrong in ("abc", None, {})),
    *(({"at_s": 1, "parameters": {"k": wrong}}, ".parameters.k", "a finite number")
      for wrong in ("abc", "7000", True, None, math.nan, math.inf, {"value": 1.0})),
    *(({"at_s": 1, "effects": wrong}, ".effects", "a mapping element") for wrong in (["a"], None, {}, "abc")),
    ({"at_s": 1, "effects": {1: 2}}, ".effects.1", "a mapping effect"),
    ({"at_s": 1, "effects": {"motor_bearing": {}}}, ".effects.motor_bearing", "a mapping effect"),
    ({"at_s": 1, "effects": {"motor_bearing": "coulomb_friction"}}, ".effects.motor_bearing", "a mapping effect"),
    ({"at_s": 1, "effects": {"motor_bearing": {"coulomb_friction": 0.05}}}, ".effects.motor_bearing.coulomb_friction",
     "a mapping parameter"),
    ({"at_s": 1, "effects": {"motor_bearing": {"coulomb_friction": {"torque": "abc"}}}},
     ".effects.motor_bearing.coulomb_friction.torque", "a finite number"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "way", "allowed"), WRONG_CHANGES)
def test_a_change_of_the_wrong_form_is_refused(change, way, allowed):
    right = {"at_s": 1.999, "parameters": {"k": 7000}, "effects": {"motor_bearing": {"coulomb_friction": None}}}
    with refused(allowed, key="changes[1]" + way):
        run.RunConfig(duration_s=2.0, changes=[right, change])
