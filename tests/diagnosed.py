"""Diagnoses made up for the tests of the report: one of each verdict, with signals from the simulator."""

import functools
from dataclasses import replace

import numpy as np
from nominal import nominal_rig

from dtbacklash.diagnosis.findings import (
    Alternative,
    Calibration,
    Confidence,
    Finding,
    Formula,
    Modelled,
    ParameterEstimate,
    Recalibrated,
)
from dtbacklash.diagnosis.plot_data import (
    Curve,
    Explained,
    FitTable,
    FreeRunning,
    LawShown,
    Left,
    ModelErrors,
    PlotData,
    RecordingUsed,
    Work,
)
from dtbacklash.diagnosis.result import Candidate, Check, Diagnosis, Limit, Located, RemainingLaw
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.drawing import drawing_of, law_curve
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

STEP_S = 1e-3
NOISE = {"theta_m": 2e-4, "q3": 5e-7, "qm": 2e-5}


def command(duration_s: float, amplitude_v: float, seed: int = 1) -> np.ndarray:
    """Random steps of 0.25 s with a mean of zero."""
    levels = np.random.default_rng(seed).uniform(-amplitude_v, amplitude_v, round(duration_s / 0.25))
    return np.repeat(levels - levels.mean(), round(0.25 / STEP_S))


def curves(truth: Rig, nominal: Rig, extended: Rig, u: np.ndarray, seed: int = 2) -> tuple[Curve, ...]:
    """What the sensors of `truth` see, with noise, and what the two models say."""
    random = np.random.default_rng(seed)
    real, plain, better = (simulate(r, u, STEP_S) for r in (truth, nominal, extended))
    shown = [name for name in NOISE if name in nominal.sensors]
    return tuple(
        Curve(
            name, nominal.sensors[name].unit, real.t_s,
            real.sensors[name] + NOISE[name] * random.standard_normal(len(real.t_s)),
            plain.sensors[name], better.sensors[name] if extended is not nominal else plain.sensors[name],
            held_out_from_s=0.8 * float(real.t_s[-1]), noise_floor=NOISE[name],
        )
        for name in shown
    )  # fmt: skip


def made(verdict: str, summary: str, held_out: tuple, rigs: tuple[Rig, Rig], shown: PlotData, **more) -> Diagnosis:
    """A diagnosis of the right form; held_out : errors of the three models. rigs : nominal and extended."""
    train = ModelErrors(*(value and 0.97 * value for value in held_out))
    fit = FitTable("nrmse", ("theta_m", "q3"), train, ModelErrors(*held_out), 0.00041)
    given = {
        "findings": (), "recalibrated": {}, "candidates": (), "located": None, "next_experiment": "",
        "free_running": FreeRunning(ModelErrors(64.7, None, 0.06), ModelErrors(64.7, None, 0.06)),
        "checks": (
            Check("residual of q3 is noise", 1.03, "<", 1.2, True, "mean square; more is unexplained", "the recording"),
            Check("residual of q3 is white", 210.0, "<", 31.4, False, "Ljung-Box Q; more has a structure",
                  "Ljung and Box, Biometrika 65 (1978) 297"),
        ),
        "limits": (
            Limit("motor_bearing", "stribeck_friction", "torque", "N m", {"speed": 1.0}, upper95=3.1e-4),
            Limit("gear", "backlash", "gap", "rad", upper95=2.4e-4),
            Limit("amplifier", "saturation", "limit", "V", lower95=6.2),
            Limit("mass_3", "absorber", "mass", "kg", {"frequency": 9.0}),
        ),
        "explained": Explained(
            0.98, 0.9, {"q3": Left(5e-7, "m", 0.0004, 1.02)}, unknown={"motor_bearing": {"before": 0.2, "after": 0.1,
            "force": 0.02, "unit": "N m"}},
            causes={f"{f.location}.{f.effect}": 0.9 / (k + 2) for k, f in enumerate(more.get("findings", ()))}
            | dict.fromkeys(more.get("recalibrated", ()), 0.05),
        ),
        "units": {"theta_m": "rad (assumed)", "q3": "mm"},
        "work": Work(STEP_S, 24000, 6000, 2, {c: n for c, n in NOISE.items() if c in rigs[0].sensors}, 67, 8),
    } | more  # fmt: skip
    shown = replace(shown, floors={"theta_m": ModelErrors(290.0, 220.0, 1.01), "q3": ModelErrors(12.0, 9.0, 1.02)})
    return Diagnosis(verdict, summary, fit=fit, nominal=rigs[0], extended=rigs[1], shown=shown, **given)


def found(place: str, effect: str, sentence: str, values: dict, also: tuple = (), when: str = "") -> Finding:
    """A finding; values : name -> (value, unit, low, high)."""
    parameters = {n: ParameterEstimate(v, unit, (low, high)) for n, (v, unit, low, high) in values.items()}
    mark: Confidence = "partial" if also else "sure"
    return Finding(place, effect, parameters, tuple(Alternative(*a) for a in also), when, None, sentence, mark)


def candidates(chosen: list[tuple[str, str]]) -> tuple[Candidate, ...]:
    """A long list: the chosen ones, and what was ruled out."""
    ruled_out = [
        Candidate(place, effect, score, None, f"fitted; the best model with it is behind by {by} in -2 log likelihood")
        for place, effect, score, by in (
            ("amplifier", "dead_zone", 402.0, 120), ("motor_bearing", "stribeck_friction", 91.2, 31),
            ("link_1", "stiffness_drift", 77.0, 120), ("motor_bearing", "cogging", 31.0, 120),
        )
    ]  # fmt: skip
    ruled_out += [
        Candidate(place, effect, 9.1 - i, None, "low score")
        for i, (place, effect) in enumerate(
            [(f"link_{k}", e) for k in (1, 2) for e in ("cubic_stiffness", "hysteresis", "dry_friction", "bumper")]
        )
    ]
    rows = [Candidate(place, effect, 1840.0 - 300 * i, None, "added") for i, (place, effect) in enumerate(chosen)]
    return (*ruled_out[:1], *rows, *ruled_out[1:])


def friction_law(effect: str = "coulomb_friction", torque: float = 0.02) -> LawShown:
    """A torque against speed: the law, and points; without an effect the points of something else, alone."""
    random = np.random.default_rng(3)
    speed = np.linspace(-8.0, 8.0, 25)
    recovered = -torque * np.sign(speed) + 0.02 * torque * random.standard_normal(25)
    error = np.full(25, 0.02 * torque)
    labels = ("motor_bearing", effect, "speed of motor bearing", "missing torque", "rad/s", "N m")
    if not effect:
        recovered = recovered + 1.5 * torque * np.sin(speed)
        return LawShown(*labels, state=speed, recovered=recovered, error=error)
    drawing = drawing_of(find("rotor", effect, ""))
    return LawShown(*labels, *law_curve(drawing, {"torque": torque}, {}, (-8.0, 8.0)), speed, recovered, error)


@functools.cache
def missing() -> Diagnosis:
    """Coulomb friction and backlash on the lead-screw rig."""
    nominal = nominal_rig("lead_screw")
    truth = nominal.with_effect("motor_bearing", "coulomb_friction", {"torque": 0.02})
    truth = truth.with_effect("gear", "backlash", {"half_gap": 0.349})
    u = command(30.0, 3.0)
    coulomb = found(
        "motor_bearing", "coulomb_friction", "Dry (Coulomb) friction of 0.02 N m acts at the motor bearing.",
        {"torque": (0.02, "N m", 0.0195, 0.0205)}, (("amplifier", "dead_zone"),),
        "84 % of the mismatch lies within 50 ms of a velocity reversal",
    )  # fmt: skip
    backlash = found(
        "gear", "backlash", "The gear has backlash of 0.349 rad to each side.",
        {"half_gap": (0.349, "rad", 0.3481, 0.3499)},
    )  # fmt: skip
    shown = PlotData({"motor_bearing": 0.627, "gear": 0.373}, curves(truth, nominal, truth, u), (friction_law(),))
    return made(
        "missing_physics",
        "The motor bearing sticks and the gear has play. With both in the model, the error on held-out data "
        "falls from 12 % to the sensors' noise. A dead zone of the amplifier would look like the friction.",
        (0.12, 0.091, 0.00042), (nominal, truth.with_parameters({"k": 9020.0})), shown,
        findings=(coulomb, backlash),
        recalibrated={
            "k": Recalibrated(10000.0, 9020.0, "N/m", (9001.0, 9039.0)),
            "J": Recalibrated(5e-6, 5.1e-6, "kg m^2", (5.02e-6, 5.18e-6)),
        },
        candidates=candidates([("motor_bearing", "coulomb_friction"), ("gear", "backlash")]),
        next_experiment="Record the motor current i_m: it tells Coulomb friction from a dead zone (correlation 0.31 "
        "instead of 0.99).",
        notes=("12 missing samples were interpolated.",), source="bench_07.csv",
    )  # fmt: skip


@functools.cache
def drifting() -> Diagnosis:
    """EMPS without friction: the nominal model leaves the picture; three findings at one element."""
    nominal = nominal_rig("emps")
    truth = nominal.with_effect("carriage", "coulomb_friction", {"force": 20.3})
    truth = truth.with_effect("carriage", "viscous_friction", {"coefficient": 203.5})
    truth = truth.with_effect("carriage", "constant_force", {"force": -3.16})
    t = np.arange(0, 25.0, STEP_S)
    u = 1.2 * np.sign(np.sin(2 * np.pi * t / 4)) * (1 + 0.3 * np.sin(2 * np.pi * t / 1.3))
    findings = tuple(
        found("carriage", effect, sentence, {name: (value, unit, low, high)})
        for effect, name, value, unit, low, high, sentence in (
            ("coulomb_friction", "force", 20.3, "N", 19.8, 21.4, "Dry friction of 20.3 N acts at the carriage."),
            ("viscous_friction", "coefficient", 203.5, "N s/m", 198.0, 209.0,
             "Viscous friction of 203.5 N s/m acts at the carriage."),
            ("constant_force", "force", -3.16, "N", -3.3, -3.02, "A constant force of -3.16 N acts at the carriage."),
        )
    )  # fmt: skip
    speed = np.linspace(-0.1, 0.1, 20)
    law = LawShown("carriage", "coulomb_friction", "speed of carriage", "missing force", "m/s", "N", speed,
                   -20.4 * np.sign(speed), speed,
                   -20.3 * np.sign(speed) + np.random.default_rng(5).standard_normal(20), np.ones(20))  # fmt: skip
    return made(
        "missing_physics", "The carriage has dry and viscous friction and is pushed by a constant force.",
        (11.3, 9.4, 0.0031), (nominal, truth), PlotData({"carriage": 1.0}, curves(truth, nominal, truth, u), (law,)),
        findings=findings, candidates=candidates([("carriage", f.effect) for f in findings]), source="emps",
    )  # fmt: skip


@functools.cache
def parameters() -> Diagnosis:
    """A stiffness that is 10 % off."""
    nominal = nominal_rig("lead_screw")
    truth = nominal.with_parameters({"k": 9020.0})
    return made(
        "parameters", "The links are 10 % softer than stated. Nothing else is needed to explain the recording.",
        (0.0113, 0.00041, 0.00041), (nominal, truth), PlotData({}, curves(truth, nominal, truth, command(12.0, 3.0))),
        recalibrated={"k": Recalibrated(10000.0, 9020.0, "N/m", (9018.7, 9021.2))},
        candidates=candidates([])[:3], source="soft.csv",
    )  # fmt: skip


@functools.cache
def consistent() -> Diagnosis:
    """Nothing but noise."""
    nominal = nominal_rig("lead_screw")
    return made(
        "consistent", "What the nominal model leaves unexplained is the sensors' noise.", (0.00041, None, None),
        (nominal, nominal), PlotData({}, curves(nominal, nominal, nominal, command(12.0, 3.0))),
        candidates=candidates([])[5:], source="good.csv",
    )  # fmt: skip


@functools.cache
def unexplained() -> Diagnosis:
    """A mismatch at the bearing that no law of the catalogue fits."""
    nominal = nominal_rig("lead_screw")
    truth = nominal.with_effect("motor_bearing", "cogging", {"torque": 0.01, "periods": 3.0, "phase": 0.0})
    law = friction_law("")
    points = tuple(zip(law.state.tolist(), law.recovered.tolist(), law.error.tolist(), strict=True))
    return made(
        "unexplained", "The mismatch is real, 40 times the noise, and sits at the motor bearing. No effect of the "
        "catalogue was found that explains it.", (0.043, 0.041, 0.041), (nominal, nominal),
        PlotData({"motor_bearing": 1.0}, curves(truth, nominal, nominal, command(12.0, 3.0)), (law,)),
        located=Located("motor", "motor_bearing", 0.93, RemainingLaw("speed", "rad/s", "N m", 0.4, points)),
        candidates=candidates([]), next_experiment="Turn the motor slowly and evenly in both directions.",
        source="odd.csv",
    )  # fmt: skip


@functools.cache
def with_parts() -> Diagnosis:
    """The same with all that a page can have: many parameters and their correlations, formulas, recordings, limits."""
    base = unexplained()
    names = ["K_t", "R", "J", "k_theta", "motor_bearing.stribeck_friction.velocity", "m_1", "m_2", "m_3", "k", "c"]
    rows = {n: Recalibrated(1.0e-5, 1.1234e-5, "N m s/rad", (1.1e-5, 1.2e-5)) for n in names}
    correlation = {a: {b: 1.0 if a == b else 0.9 for b in names} for a in names}
    formula = Formula("a power of the distance", "(a + b*abs(q)**n)*v", dict.fromkeys("abn", (1e-3, 0.9e-3, 1.1e-3)),
                      {"a": "N m s/rad"}, 1.003, True, True)  # fmt: skip
    points = tuple((float(x), 1e-3 * x, 1e-4) for x in range(12))
    modelled = Modelled("motor_bearing", "found_1", "speed", "rad/s", "", "N m", points, (), (formula,) * 3,
                        "An effort over the speed.", base.extended)  # fmt: skip
    used = tuple(
        RecordingUsed(f"a_rather_long_name_of_a_recording_{k}.csv", 9000, 1e-3, 7000, 2000, ModelErrors(0.5, 0.4, 0.01))
        for k in range(5)
    )
    return replace(
        base, calibration=Calibration(rows, correlation, ()), modelled=modelled, recordings=used,
        fit=replace(base.fit, channels=tuple(NOISE)),
    )  # fmt: skip


EACH = {
    "missing": missing, "drifting": drifting, "parameters": parameters, "consistent": consistent,
    "unexplained": unexplained,
}  # fmt: skip
