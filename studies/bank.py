"""The twin's bank on random machines: one change of each kind in a closed loop that believes in the nominal rig.

A case is a square wave with an old estimate of the gap, through an encoder and a noisy sensor of the output, and its
second move with the rest before it is what the bank sees: 1.5 s. Each kind of the bank is drawn in turn, of random size
and place, and beside it physics that the bank does not have: there `unknown` or `ambiguous` is right, any name wrong.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.random import Generator

from dtbacklash.config.compose import compose
from dtbacklash.control.belief import Belief, Beliefs
from dtbacklash.errors import Diverged
from dtbacklash.experiment.run import run_scenario
from dtbacklash.files import write_text
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.prove.draw import name_hash
from dtbacklash.report.kit.markdown import between, table
from dtbacklash.twin.bank.bank import Buffer, Diagnosis, diagnose_buffer
from studies.measure import Row

PAGE = "bank.md"
BEGIN, END = "<!-- bank: begin, made by python -m studies bank -->", "<!-- bank: end -->"
PERIOD_S, BUFFER, REST = 16.0, 1500, 100
MOTOR, DRIVE = "motor_bearing", "motor_circuit"


@dataclass
class Case:
    """What one machine conceals: overrides of the true rig's effects and parameters, and what should be said."""

    kind: str
    place: str = ""
    effects: dict[str, dict[str, dict[str, float]]] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    fields: dict[tuple[str, str], float] = field(default_factory=dict)
    size: str = ""

    def rig(self, known: Rig) -> Rig:
        """The true machine, from what is known of it; a field of a single element gets a parameter of its own."""
        config = known.config
        effects = {place: dict(there) for place, there in config.effects.items()}
        for place, there in self.effects.items():
            effects[place] = {**effects.get(place, {}), **there}
        parameters, elements = dict(config.parameters), {n: dict(spec) for n, spec in config.elements.items()}
        for name, ratio in self.parameters.items():
            parameters[name] = replace(parameters[name], value=parameters[name].value * ratio)
        for (element, what), ratio in self.fields.items():
            name = elements[element][what]
            parameters[f"{name}_{element}"] = replace(parameters[name], value=parameters[name].value * ratio)
            elements[element][what] = f"{name}_{element}"
        return build_rig(replace(config, parameters=parameters, elements=elements, effects=effects))


def _ratio(rng: Generator, least: float, most: float) -> float:
    """1 plus or minus something between."""
    return 1.0 + float(rng.choice([-1.0, 1.0]) * rng.uniform(least, most))


def _log(rng: Generator, least: float, most: float) -> float:
    return float(np.exp(rng.uniform(math.log(least), math.log(most))))


def _of_links(rng: Generator, what: str, parameter: str, ratio: float) -> Case:
    place = str(rng.choice(["all links", "link_1", "link_2"]))
    if place == "all links":
        return Case(what, place, parameters={parameter: ratio}, size=f"{ratio - 1:+.0%}")
    return Case(what, place, fields={(place, what): ratio}, size=f"{ratio - 1:+.0%}")


def _effect(kind: str, place: str, name: str, **values: float) -> Case:
    return Case(kind, place, {place: {name: values}}, size=", ".join(f"{v:.3g}" for v in values.values()))


def _side(rng: Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _any(rng: Generator, *names: str) -> str:
    return str(rng.choice(names))


INSIDE: dict[str, Callable[[Generator], Case]] = {
    "gap alone": lambda g: Case("gap alone"),
    "stiffness": lambda g: _of_links(g, "stiffness", "k", _ratio(g, 0.08, 0.3)),
    "damping": lambda g: _of_links(
        g, "damping", "c", 1.0 / _log(g, 1.3, 2.0) if g.random() < 0.5 else _log(g, 1.3, 2.0)
    ),
    "compliance": lambda g: _effect("compliance", "screw", "compliance", compliance=_log(g, 2e-6, 2e-5)),
    "ground friction": lambda g: _effect(
        "ground friction", _any(g, "mass_2", "mass_3"), "ground_friction", force=_log(g, 0.03, 0.4)
    ),
    "hysteresis": lambda g: _effect(
        "hysteresis",
        _any(g, "link_1", "link_2"),
        "hysteresis",
        force=_log(g, 0.05, 0.5),
        displacement=_log(g, 5e-6, 5e-5),
    ),
    "Coulomb friction": lambda g: _effect("Coulomb friction", MOTOR, "coulomb_friction", torque=_log(g, 0.005, 0.05)),
    "viscous friction": lambda g: _effect(
        "viscous friction", MOTOR, "viscous_friction", coefficient=_log(g, 2e-4, 2e-3)
    ),
    "constant load": lambda g: _effect("constant load", MOTOR, "constant_load", torque=_side(g) * _log(g, 0.005, 0.05)),
    "cogging": lambda g: _effect(
        "cogging",
        MOTOR,
        "cogging",
        torque=_log(g, 0.005, 0.05),
        periods=float(g.integers(3, 25)),
        phase=float(g.uniform(-3.1, 3.1)),
    ),
    "gain": lambda g: _effect("gain", "amplifier", "gain_error", relative=_ratio(g, 0.05, 0.25) - 1.0),
    "delay": lambda g: _effect("delay", "amplifier", "delay", time=_log(g, 2e-4, 4e-3)),
    "torque constant": lambda g: Case(
        "torque constant", DRIVE, parameters={"k_T": (r := _ratio(g, 0.1, 0.3))}, size=f"{r - 1:+.0%}"
    ),
}

OUTSIDE: dict[str, Callable[[Generator], Case]] = {
    "cubic stiffness": lambda g: _effect(
        "cubic stiffness", _any(g, "link_1", "link_2"), "cubic_stiffness", k3=_side(g) * _log(g, 5e11, 4e12)
    ),
    "quadratic damping": lambda g: _effect(
        "quadratic damping", _any(g, "link_1", "link_2"), "quadratic_damping", c2=_log(g, 2e4, 2e5)
    ),
    "bumper": lambda g: _effect(
        "bumper",
        _any(g, "link_1", "link_2"),
        "bumper",
        stiffness=_log(g, 3e3, 3e4),
        clearance=float(g.uniform(2e-6, 1e-5)),
    ),
    "absorber": lambda g: _effect(
        "absorber",
        _any(g, "mass_2", "mass_3"),
        "absorber",
        mass=_log(g, 0.2, 1.0),
        frequency=float(g.uniform(3.0, 12.0)),
        damping_ratio=float(g.uniform(0.01, 0.1)),
    ),
    "pitch error": lambda g: _effect(
        "pitch error",
        "screw",
        "pitch_error",
        amplitude=_log(g, 5e-6, 3e-5),
        periods=float(g.choice([1.0, 2.0, 3.0])),
        phase=float(g.uniform(-3.1, 3.1)),
    ),
    "backlash of a link": lambda g: _effect(
        "backlash of a link", _any(g, "link_1", "link_2"), "backlash", lost_motion=_log(g, 3e-6, 3e-5)
    ),
    "mass": lambda g: Case("mass", "", parameters={"m": (r := _ratio(g, 0.05, 0.25))}, size=f"{r - 1:+.0%}"),
    "pitch": lambda g: Case("pitch", "", parameters={"p": (r := _ratio(g, 0.01, 0.04))}, size=f"{r - 1:+.1%}"),
    "late output sensor": lambda g: _effect(
        "late output sensor", "sensor_q3", "delay", time=float(g.uniform(1e-3, 6e-3))
    ),
    "output sensor's gain": lambda g: _effect(
        "output sensor's gain", "sensor_q3", "gain_error", relative=_side(g) * float(g.uniform(0.01, 0.04))
    ),
    "asymmetric friction": lambda g: _effect(
        "asymmetric friction", MOTOR, "asymmetric_friction", viscous_difference=_side(g) * _log(g, 2e-4, 2e-3)
    ),
    "Stribeck friction": lambda g: _effect(
        "Stribeck friction", MOTOR, "stribeck_friction", torque=_log(g, 0.01, 0.04), speed=_log(g, 1.0, 5.0)
    ),
    "warming winding": lambda g: _effect(
        "warming winding", DRIVE, "resistance_heating", gain=_log(g, 5.0, 50.0), time_constant=1.0
    ),
    "reaction on the motor": lambda g: _effect(
        "reaction on the motor", "screw", "load_reaction", share=float(g.uniform(0.3, 1.0))
    ),
    "two of the structure": lambda g: Case(
        "two of the structure",
        "",
        {"mass_3": {"ground_friction": {"force": _log(g, 0.05, 0.3)}}},
        parameters={"k": (r := _ratio(g, 0.1, 0.3))},
        size=f"k {r - 1:+.0%}, ground friction",
    ),
    "two of the motor": lambda g: Case(
        "two of the motor",
        "",
        {
            MOTOR: {
                "coulomb_friction": {"torque": _log(g, 0.01, 0.04)},
                "cogging": {"torque": _log(g, 0.01, 0.04), "periods": float(g.integers(3, 25)), "phase": 0.5},
            }
        },
        size="Coulomb friction, cogging",
    ),
}


#: what is known of a machine beside its nominal parameters, in KNOWN_SHARE of the cases; never the kind that changes
KNOWN_SHARE = 0.4
KNOWN: dict[str, Callable[[Rig], Rig]] = {
    "stiffness": lambda rig: rig.with_parameters({"k": 8500.0}),
    "compliance": lambda rig: rig.with_effect("screw", "compliance", {"compliance": 8e-6}),
    "ground friction": lambda rig: rig.with_effect("mass_3", "ground_friction", {"force": 0.1}),
    "Coulomb friction": lambda rig: rig.with_effect(MOTOR, "coulomb_friction", {"torque": 0.02}),
}


def _known(rng: Generator, name: str) -> tuple[str, Rig]:
    """What is believed of the machine before something changes."""
    nominal = build_rig(compose().rig)
    known = str(rng.choice([one for one in KNOWN if one != name and not name.startswith("two")] or ["nominal"]))
    if rng.random() >= KNOWN_SHARE or known == "nominal":
        return "nominal", nominal
    return known, KNOWN[known](nominal)


def run_case(seed: int, number: int, name: str) -> dict[str, Any]:
    """One row: what was concealed, what was said, the gap's error over its standard error, the time it took."""
    rng = np.random.default_rng([seed, number, name_hash(name)])
    known, rig = _known(rng, name)
    belief = Belief(rig)
    for _ in range(20):
        case = {**INSIDE, **OUTSIDE}[name](rng)
        gap_deg = float(rng.uniform(0.0, 100.0))
        old_deg = gap_deg * float(rng.uniform(0.3, 1.0))
        buffer = recorded(case.rig(rig), belief, gap_deg, old_deg, rng)
        if buffer is not None:
            break
    assert buffer is not None
    began = time.process_time()
    said = diagnose_buffer(belief, buffer, math.radians(old_deg))
    cpu_s = time.process_time() - began
    error = math.degrees(said.gap_rad) - gap_deg
    change = said.changes[0] if said.changes else None
    return {
        "number": number, "name": name, "known": known, "place": case.place, "size": case.size, "gap_deg": gap_deg,
        "old_deg": old_deg, "verdict": said.verdict, "found": said.found, "score": score(case, said),
        "gap_error_deg": error, "gap_std_deg": math.degrees(said.gap_std_rad), "wall_s": said.wall_s, "cpu_s": cpu_s,
        "value": change.values[0].value if change else math.nan, "excess_structure": said.halves[0].excess,
        "excess_motor": said.halves[1].excess, "structure": said.halves[0].verdict, "motor": said.halves[1].verdict,
    }  # fmt: skip


def recorded(rig: Rig, belief: Belief, gap_deg: float, old_deg: float, rng: Generator) -> Buffer | None:
    """1.5 s from a loop that believes in an old gap: rest and the second move; None: it diverged."""
    amplitude = float(rng.choice([0.5, 0.75, 1.0]))
    lines = int(rng.choice([4096, 8192, 20000]))
    noise, counts = float(rng.uniform(0.2, 1.0)), float(rng.choice([0.0, 0.1, 0.5]))
    config = compose(
        "controller=nimc_fixed", "controller.internal_model=inner_loop", f"controller.gap_hat_deg={old_deg}",
        "profile=constant", f"profile.start_deg={gap_deg}", "figures=false", f"reference.period_s={PERIOD_S}",
        f"reference.amplitude_mm={amplitude}", f"duration_s={PERIOD_S / 2 + 2}", f"seed={rng.integers(1, 2**31)}",
    )  # fmt: skip
    config.rig = rig.config
    config.sensors.noise = {"q3_mm": noise * 1e-3}
    config.sensors.resolution = {"theta_m_rad": 2.0 * math.pi / lines, "q3_mm": counts * 1e-3}
    try:
        seen = run_scenario(config, beliefs=Beliefs(belief, belief)).seen
    except Diverged:
        return None
    first = round(PERIOD_S / 2 / config.sample_time_s) - REST
    u, theta_m, q3 = (np.array(seen[name][first : first + BUFFER]) for name in ("u", "theta_m", "q3"))
    return Buffer(u, theta_m, q3, config.sample_time_s)


def score(case: Case, said: Diagnosis) -> str:
    """`right`, `wrong`, `unknown` or `ambiguous`; a gap or nothing where there was more is wrong as well.

    A twin that the finding itself names beside what it says is `ambiguous`.
    """
    if said.verdict in ("unknown", "ambiguous"):
        return said.verdict
    if any(case.kind in twin for change in said.changes for twin in change.twins):
        return "ambiguous"
    if case.kind in OUTSIDE or len(said.changes) > 1:
        return "wrong"
    if case.kind == "gap alone":
        return "right" if not said.changes else "wrong"
    right = [c for c in said.changes if (c.kind, c.place) == (case.kind, case.place)]
    if right and case.kind == "cogging":
        periods = case.effects[case.place]["cogging"]["periods"]
        right = [c for c in right if c.values[1].value == periods]
    return "right" if right else "wrong"


def run_bank(n: int, seed: int) -> pd.DataFrame:
    """n machines of each kind, inside the bank and outside; a row a machine."""
    return pd.DataFrame([run_case(seed, i, name) for name in (*INSIDE, *OUTSIDE) for i in range(n)])


def bank_rows(cases: pd.DataFrame) -> list[Row]:
    """A row a kind, and one for all inside the bank and outside; errors of the gap over their standard errors."""
    rows: list[Row] = []
    inside = cases["name"].isin(list(INSIDE))
    groups = [*cases.groupby("name", sort=False), ("all inside", cases[inside]), ("all outside", cases[~inside])]
    for name, some in groups:
        apart = (some["gap_error_deg"] / some["gap_std_deg"]).abs()
        rows.append({
            "what": str(name), "machines": len(some),
            **{said: int((some["score"] == said).sum()) for said in ("right", "wrong", "unknown", "ambiguous")},
            "gap_error_median_deg": _or_none(some["gap_error_deg"].abs().median()),
            "gap_error_max_deg": _or_none(some["gap_error_deg"].abs().max()),
            "error_over_std_max": _or_none(apart.max()),
            "seconds_median": float(some["cpu_s"].median()), "seconds_max": float(some["cpu_s"].max()),
        })  # fmt: skip
    return rows


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def bank_words(cases: pd.DataFrame, seed: int) -> list[str]:
    """Sentences below the table."""
    wrong = [f"{r['name']} {r['place']} {r['size']} as {r['found']}" for r in cases.to_dict("records")
             if r["score"] == "wrong"]  # fmt: skip
    gaps = (cases["gap_error_deg"] / cases["gap_std_deg"]).abs().dropna()
    return [
        f"seed {seed}; seconds: of processor time, for one buffer; wrong: {'; '.join(wrong) or 'none'}.",
        f"the gap is given {len(gaps)} times, {(gaps <= 2.0).mean():.0%} of them within two of its standard errors.",
    ]


def _cell(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def write_docs(rows: list[Row], words: list[str], folder: Path) -> None:
    """Bring the table into the page, between its marks."""
    text = (folder / PAGE).read_text(encoding="utf-8")
    heads = ["concealed", "machines", "right", "wrong", "unknown", "ambiguous", "gap error, median [deg]",
             "largest [deg]", "largest over its standard error", "time, median [s]", "largest [s]"]  # fmt: skip
    shown = [
        ["-" if v is None else f"{v:.3g}" if isinstance(v, float) else str(v) for v in row.values()] for row in rows
    ]
    said = "\n".join(f"{line[0].upper()}{line[1:]}" for line in words)
    write_text(folder / PAGE, between(text, BEGIN, END, table(heads, shown) + "\n\n" + said))
