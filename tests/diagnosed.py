"""Diagnoses made up for the tests of the report: one of each verdict, with signals from the simulator."""

import functools

import numpy as np

from dtbacklash.config.compose import compose
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate
from dtbacklash.report.diagnosis_figures import Curve, Force
from dtbacklash.report.diagnosis_page import View

STEP_S = 1e-3
NOISE = {"theta_m": 2e-4, "q3": 5e-7, "qm": 2e-5}


@functools.cache
def rig(name: str) -> Rig:
    from dtbacklash.physics.rig import build_rig

    return build_rig(compose("controller=open_loop", f"rig={name}").rig)


def command(duration_s: float, amplitude_v: float, seed: int = 1) -> np.ndarray:
    """Random steps of 0.25 s with a mean of zero."""
    levels = np.random.default_rng(seed).uniform(-amplitude_v, amplitude_v, round(duration_s / 0.25))
    return np.repeat(levels - levels.mean(), round(0.25 / STEP_S))


def curves(truth: Rig, nominal: Rig, extended: Rig, u: np.ndarray, seed: int = 2) -> list[Curve]:
    """What the sensors of `truth` see, with noise, and what the two models say."""
    random = np.random.default_rng(seed)
    real, plain, better = (simulate(r, u, STEP_S) for r in (truth, nominal, extended))
    shown = [name for name in NOISE if name in nominal.sensors]
    return [
        Curve(
            name, nominal.sensors[name].unit, real.t_s,
            real.sensors[name] + NOISE[name] * random.standard_normal(len(real.t_s)),
            plain.sensors[name], better.sensors[name] if extended is not nominal else plain.sensors[name],
            held_out_from_s=0.7 * float(real.t_s[-1]), noise_floor=NOISE[name],
        )
        for name in shown
    ]  # fmt: skip


def diagnosis(verdict: str, summary: str, held_out: dict, **more) -> dict:
    """A diagnosis.json of the right form."""
    return {
        "verdict": verdict, "summary": summary, "findings": [], "recalibrated": {},
        "fit": {
            "metric": "nrmse", "channels": ["theta_m", "q3"],
            "train": {name: value and 0.97 * value for name, value in held_out.items()}, "held_out": held_out,
            "noise_floor": 0.00041,
        },
        "candidates": [], "next_experiment": "",
    } | more  # fmt: skip


def parameter(value: float, unit: str, low: float, high: float) -> dict:
    """One fitted parameter."""
    return {"value": value, "unit": unit, "ci95": [low, high]}


def candidates(chosen: list[tuple[str, str]]) -> list[dict]:
    """A long list: the chosen ones, and what was ruled out."""
    ruled_out = [
        ("amplifier", "dead_zone", 402.0, 0.00062, "fits as well: cannot be told apart by u, theta_m, q3"),
        ("motor_bearing", "stribeck_friction", 91.2, 0.00043, "held-out error does not fall (0.1 standard errors)"),
        ("link_1", "stiffness_drift", 77.0, 0.031, "fits worse than Coulomb friction by 0.6 points"),
        ("motor_bearing", "cogging", 31.0, 0.034, "its interval spans zero"),
    ]
    ruled_out += [
        (place, effect, 9.1 - i, None, "score below the threshold of 9.5")
        for i, (place, effect) in enumerate(
            [(f"link_{k}", e) for k in (1, 2) for e in ("cubic_stiffness", "hysteresis", "dry_friction", "bumper")]
        )
    ]
    rows = [(place, effect, 1840.0 - 300 * i, 0.00042, "named") for i, (place, effect) in enumerate(chosen)]
    names = ("location", "effect", "score", "held_out", "verdict")
    return [dict(zip(names, row, strict=True)) for row in [*ruled_out[:1], *rows, *ruled_out[1:]]]


def friction_force(effect: str = "coulomb_friction", torque: float = 0.02) -> Force:
    """A recovered torque against speed."""
    random = np.random.default_rng(3)
    speed = np.linspace(-8.0, 8.0, 25)
    law = -torque * np.sign(speed)
    recovered = -torque * np.tanh(speed / 0.3) + 0.02 * torque * random.standard_normal(25)
    if not effect:
        recovered = recovered + 1.5 * torque * np.sin(speed)
        law = np.empty(0)
    error = np.full(25, 0.02 * torque)
    return Force("motor_bearing", effect, "speed of motor bearing", "rad/s", "N m", speed, recovered, error, law)


def missing() -> View:
    """Coulomb friction and backlash on the lead-screw rig."""
    nominal = rig("lead_screw")
    truth = nominal.with_effect("motor_bearing", "coulomb_friction", {"torque": 0.02})
    truth = truth.with_effect("gear", "backlash", {"half_gap": 0.349})
    u = command(30.0, 3.0)
    coulomb = {
        "location": "motor_bearing", "effect": "coulomb_friction",
        "parameters": {"torque": parameter(0.02, "N m", 0.0195, 0.0205)},
        "also_fits": [{"location": "amplifier", "effect": "dead_zone"}],
        "when": "84 % of the mismatch lies within 50 ms of a velocity reversal",
        "sentence": "Dry (Coulomb) friction of 0.02 N m acts at the motor_bearing.",
    }  # fmt: skip
    backlash = {
        "location": "gear", "effect": "backlash", "parameters": {"half_gap": parameter(0.349, "rad", 0.3481, 0.3499)},
        "also_fits": [], "when": "", "sentence": "The gear has backlash of 0.349 rad to each side.",
    }  # fmt: skip
    found = diagnosis(
        "missing_physics",
        "The motor bearing sticks and the gear has play. With both in the model, the error on held-out data "
        "falls from 12 % to the sensors' noise. A dead zone of the amplifier would look like the friction.",
        {"nominal": 0.12, "recalibrated": 0.091, "extended": 0.00042},
        findings=[coulomb, backlash],
        recalibrated={
            "k": {"nominal": 10000.0, "value": 9020.0, "unit": "N/m", "ci95": [9001.0, 9039.0]},
            "J": {"nominal": 5e-6, "value": 5.1e-6, "unit": "kg m^2", "ci95": [5.02e-6, 5.18e-6]},
        },
        candidates=candidates([("motor_bearing", "coulomb_friction"), ("gear", "backlash")]),
        next_experiment="Record the motor current i_m: it tells Coulomb friction from a dead zone (correlation 0.31 "
        "instead of 0.99).",
    )  # fmt: skip
    evidence = {"motor_bearing": 0.62, "gear": 0.31, "amplifier": 0.05, "sensor_q3": 0.02}
    return View(found, nominal, truth.with_parameters({"k": 9020.0}), evidence, curves(truth, nominal, truth, u),
                [friction_force()], ["12 missing samples were interpolated."], "bench_07.csv")  # fmt: skip


def drifting() -> View:
    """EMPS without friction: the nominal model leaves the picture; three findings at one element."""
    nominal = rig("emps")
    truth = nominal.with_effect("carriage", "coulomb_friction", {"force": 20.3})
    truth = truth.with_effect("carriage", "viscous_friction", {"coefficient": 203.5})
    truth = truth.with_effect("carriage", "constant_force", {"force": -3.16})
    t = np.arange(0, 25.0, STEP_S)
    u = 1.2 * np.sign(np.sin(2 * np.pi * t / 4)) * (1 + 0.3 * np.sin(2 * np.pi * t / 1.3))
    findings = [
        {"location": "carriage", "effect": effect, "parameters": {name: parameter(value, unit, low, high)},
         "also_fits": [], "when": None, "sentence": sentence}
        for effect, name, value, unit, low, high, sentence in (
            ("coulomb_friction", "force", 20.3, "N", 19.8, 21.4, "Dry friction of 20.3 N acts at the carriage."),
            ("viscous_friction", "coefficient", 203.5, "N s/m", 198.0, 209.0,
             "Viscous friction of 203.5 N s/m acts at the carriage."),
            ("constant_force", "force", -3.16, "N", -3.3, -3.02, "A constant force of -3.16 N acts at the carriage."),
        )
    ]  # fmt: skip
    found = diagnosis(
        "missing_physics", "The carriage has dry and viscous friction and is pushed by a constant force.",
        {"nominal": 11.3, "recalibrated": 9.4, "extended": 0.0031}, findings=findings,
        candidates=candidates([("carriage", f["effect"]) for f in findings]),
    )  # fmt: skip
    speed = np.linspace(-0.1, 0.1, 20)
    force = Force("carriage", "coulomb_friction", "speed of carriage", "m/s", "N", speed,
                  -20.3 * np.sign(speed) + np.random.default_rng(5).standard_normal(20), np.ones(20),
                  -20.4 * np.sign(speed))  # fmt: skip
    return View(found, nominal, truth, {"carriage": 0.98}, curves(truth, nominal, truth, u), [force], [], "emps")


def parameters() -> View:
    """A stiffness that is 10 % off."""
    nominal = rig("lead_screw")
    truth = nominal.with_parameters({"k": 9020.0})
    found = diagnosis(
        "parameters", "The links are 10 % softer than stated. Nothing else is needed to explain the recording.",
        {"nominal": 0.0113, "recalibrated": 0.00041, "extended": 0.00041},
        recalibrated={"k": {"nominal": 10000.0, "value": 9020.0, "unit": "N/m", "ci95": [9018.7, 9021.2]}},
        candidates=candidates([])[:3],
    )  # fmt: skip
    evidence = {"mass_1": 0.2, "link_1": 0.4, "link_2": 0.4}
    return View(found, nominal, truth, evidence, curves(truth, nominal, truth, command(12.0, 3.0)), source="soft.csv")


def consistent() -> View:
    """Nothing but noise."""
    nominal = rig("lead_screw")
    found = diagnosis(
        "consistent", "What the nominal model leaves unexplained is the sensors' noise.",
        {"nominal": 0.00041, "recalibrated": None, "extended": None}, candidates=candidates([])[5:],
    )  # fmt: skip
    return View(found, nominal, nominal, {}, curves(nominal, nominal, nominal, command(12.0, 3.0)), source="good.csv")


def unexplained() -> View:
    """A mismatch at the bearing that no law of the catalogue fits; its size is not known."""
    nominal = rig("lead_screw")
    truth = nominal.with_effect("motor_bearing", "cogging", {"torque": 0.01, "periods": 3.0, "phase": 0.0})
    somewhere = {"location": "motor_bearing", "effect": None, "parameters": {}, "also_fits": [], "when": "",
                 "sentence": "A torque of up to 40 mN m depending on the speed acts at the motor_bearing."}  # fmt: skip
    found = diagnosis(
        "unexplained", "The mismatch is real, 40 times the noise, and sits at the motor bearing. No effect of the "
        "catalogue explains it.", {"nominal": 0.043, "recalibrated": 0.041, "extended": 0.041}, findings=[somewhere],
        candidates=candidates([]), next_experiment="Turn the motor slowly and evenly in both directions.",
    )  # fmt: skip
    evidence = {"motor_bearing": 0.71, "amplifier": 0.2, "sensor_theta_m": 0.06}
    return View(found, nominal, nominal, evidence, curves(truth, nominal, nominal, command(12.0, 3.0)),
                [friction_force("")], source="odd.csv")  # fmt: skip


EACH = {
    "missing": missing, "drifting": drifting, "parameters": parameters, "consistent": consistent,
    "unexplained": unexplained,
}  # fmt: skip
