"""Made-up answers and diagnoses of concealed recordings; no simulation."""

from dataclasses import replace
from typing import Any

import numpy as np

from dtbacklash.prove import rules

COULOMB = ("motor_bearing", "coulomb_friction")
DEAD_ZONE = ("amplifier", "dead_zone")
BACKLASH = ("gear", "backlash")
CUBIC = ("link_1", "cubic_stiffness")
COGGING = ("motor_bearing", "cogging")
VALUES: dict[tuple[str, str], dict[str, float]] = {
    COULOMB: {"torque": 0.02}, DEAD_ZONE: {"half_width": 0.2}, BACKLASH: {"half_gap": 0.35}, CUBIC: {"k3": 1e10},
    COGGING: {"torque": 0.01, "periods": 24.0, "phase": 3.1}, ("link_2", "cubic_stiffness"): {"k3": 1e10},
    ("sensor_q3", "delay"): {"time": 1e-3},
    ("mass_2", "absorber"): {"mass": 0.3, "frequency": 12.0, "damping_ratio": 0.05},
}  # fmt: skip


def secret(kind: str, *keys: tuple[str, str], seed: int = 10_000, size: float = 30.0, **more: Any) -> dict[str, Any]:
    """What was hidden: the effects ``keys``, each of the same visibility."""
    unknown = None
    visibility = {".".join(key): size for key in keys}
    if kind == "unknown":
        unknown = {"location": "link_1", "name": "rate_damping", "description": "made up", "size": 1.0}
        visibility["link_1.rate_damping"] = size
    return {
        "seed": seed, "rig": "lead_screw", "kind": kind, "unknown": unknown, "visibility": visibility,
        "effects": [{"location": p, "effect": e, "parameters": dict(VALUES[p, e])} for p, e in keys],
        "parameters": {"k": 9300.0} if kind == "parameters" else {}, "excitation": {}, "controller": "cascade",
        "instruments": "minimal", "channels": ["theta_m", "q3"], "noise": {}, "resolution": {}, "duration_s": 30.0,
        "sample_time_s": 1e-3, **more,
    }  # fmt: skip


def finding(key: tuple[str, str], *rivals: tuple[str, str], off: float = 0.0, width: float = 0.05) -> dict[str, Any]:
    """A finding with intervals of +/- ``width`` about values that are ``off`` by this share."""
    parameters = {
        name: {"value": v * (1 + off), "unit": "1", "ci95": [v * (1 + off - width), v * (1 + off + width)]}
        for name, v in VALUES[key].items()
    }
    also = [{"location": p, "effect": e} for p, e in rivals]
    return {"location": key[0], "effect": key[1], "parameters": parameters, "also_fits": also, "sentence": "",
            "confidence": "sure"}  # fmt: skip


def diagnosis(*findings: dict[str, Any], verdict: str = "", located: str = "", **recalibrated: Any) -> dict[str, Any]:
    """A diagnosis; ``recalibrated`` : name -> (value, low, high)."""
    verdict = verdict or ("missing_physics" if findings else "parameters" if recalibrated else "consistent")
    return {
        "verdict": verdict, "findings": list(findings), "located": {"location": located} if located else None,
        "recalibrated": {
            name: {"nominal": 1e4, "value": value, "unit": "N/m", "ci95": [low, high]}
            for name, (value, low, high) in recalibrated.items()
        },
    }  # fmt: skip


def oracle(*keys: tuple[str, str], clear: bool = True, extended: float | None = 1.0) -> dict[str, Any]:
    """An oracle that sees all of the effects, or none."""
    return {
        "clear": {".".join(key): clear for key in keys}, "clear_parameters": {}, "unlisted_clear": clear,
        "held_out": {"nominal": 40.0, "recalibrated": 20.0, "extended": extended, "oracle": 1.0},
    }  # fmt: skip


def perfect(kind: str, *keys: tuple[str, str], seed: int = 10_000, size: float = 30.0) -> rules.Case:
    """A case that was diagnosed without a fault."""
    seen = oracle(*keys)
    if kind == "parameters":
        found = diagnosis(k=(9310.0, 9290.0, 9330.0))
        seen["clear_parameters"] = {"k": True}
    elif kind == "unknown":
        found = diagnosis(verdict="unexplained")
    else:
        found = diagnosis(*(finding(key) for key in keys))
    return case(f"case{seed}", secret(kind, *keys, seed=seed, size=size), found, seen, 10.0)


def lifelike(one: rules.Case, *findings: dict[str, Any], **more: Any) -> rules.Case:
    """The case beside a small cogging, with another diagnosis."""
    small = [{"location": COGGING[0], "effect": COGGING[1], "parameters": {}, "visibility": 4.0}]
    told = one.secret | {"machine": "lifelike", "beside": small, "beside_visibility": 4.0}
    return replace(one, secret=told, diagnosis=diagnosis(*findings, **more))


#: kind of each element of the rig of these cases
KINDS = {
    "amplifier": "amplifier", "motor_circuit": "motor_circuit", "motor_bearing": "rotor", "gear": "gear",
    "screw": "screw", **{f"mass_{j}": "mass" for j in (1, 2, 3)}, **{f"link_{j}": "link" for j in (1, 2)},
}  # fmt: skip


def case(*arguments: Any, **named: Any) -> rules.Case:
    """A case of the rig ``lead_screw``."""
    return rules.Case(*arguments, **{"kinds": KINDS} | named)


def campaign(n: int = 200, seed: int = 0) -> list[rules.Case]:
    """Cases in which a made-up tool sees what is large, errs now and then, and fails once."""
    rng = np.random.default_rng(seed)
    kinds, keys = ("nothing", "parameters", "single", "single", "single", "several", "unknown"), list(VALUES)
    cases = []
    for j in range(n):
        kind, size = str(rng.choice(kinds)), float(10 ** rng.uniform(-1, 3.5))
        count = {"single": 1, "several": 2}.get(kind, 0)
        hidden = [keys[k] for k in rng.choice(len(keys), count, replace=False)]
        one = perfect(kind, *hidden, seed=10_000 + j, size=size)
        one.oracle["clear"] = dict.fromkeys(one.oracle["clear"], size > 2)
        one.oracle["held_out"]["oracle"] = float(rng.uniform(1.0, 1.1))
        one.oracle["held_out"]["extended"] = float(rng.uniform(1.0, 1.4))
        if hidden and rng.random() > size / (size + 3):
            wrong = [] if rng.random() < 0.5 else [finding(keys[int(rng.integers(len(keys)))], hidden[0])]
            one = case(one.id, one.secret, diagnosis(*wrong), one.oracle, 12.0)
        cases.append(one)
    broken = next(c for c in cases if c.kind == "single")
    lost = {**broken.oracle, "held_out": {**broken.oracle["held_out"], "extended": None}}
    cases[cases.index(broken)] = case(broken.id, broken.secret, None, lost, None, "its worker died")
    return cases
