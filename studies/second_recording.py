"""Whether a designed second recording names what one recording confuses: concealed pairs on a rotary drive.

A truth is drawn of two effects that stand for one another on a motion that does not reverse. The first recording is of
such a motion, and both models are fitted to it; where it tells them apart anyway, the case does not count. The second
recording, of the same length, is the one that ``dtb design`` looks for within the limits of the first, a multisine as
it is drawn within the same limits, or another draw of the first kind of motion. Both models are fitted to the two
recordings together. The machine is made by steps finer than those of the fit, with its parameters off by a third of
their tolerances. A pair is named rightly if the truth leads by what a diagnosis asks of any name.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.compose import compose
from dtbacklash.diagnosis.engine.fit import FitProblem, FittedModel
from dtbacklash.diagnosis.engine.motion import motion_of
from dtbacklash.diagnosis.engine.parameters import Key, with_priors
from dtbacklash.diagnosis.engine.resampling import rate_of
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.diagnosis.engine.selection import LEAST
from dtbacklash.diagnosis.experiments.design import Limits, designed
from dtbacklash.diagnosis.experiments.rivalry import Rival, Rivalry
from dtbacklash.diagnosis.planning import Observed
from dtbacklash.diagnosis.predictions import segments_of
from dtbacklash.diagnosis.records import Record
from dtbacklash.diagnosis.settings import SETTINGS
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.simulate import simulate
from studies.measure import Row

STEP_S, LENGTH_S, LEAD_IN_S, TRIES = 1e-3, 4.0, 1.5, 24
NOISE = {"theta_m": 1e-3, "theta_l": 1e-3}
#: (place, effect), its size, its other parameters: two that one kind of motion confuses
Law = tuple[str, str, dict[str, float]]


def _pair(place: str, first: str, second: str, a: dict[str, float], b: dict[str, float]) -> tuple[Law, Law]:
    return (place, first, a), (place, second, b)


RUBS, LOADS, DRAGS = {"torque": 0.015}, {"torque": -0.015}, {"coefficient": 3e-4}
PAIRS: tuple[tuple[Law, Law], ...] = (
    *(_pair(place, "coulomb_friction", "constant_load", RUBS, LOADS) for place in ("load", "motor_rotor")),
    *(
        _pair(place, "viscous_friction", "asymmetric_friction", DRAGS, {"viscous_difference": 3e-4})
        for place in ("load", "motor_rotor")
    ),
    *(
        _pair(place, "coulomb_friction", "asymmetric_friction", RUBS, {"coulomb_difference": 0.015})
        for place in ("load", "motor_rotor")
    ),
    _pair("load", "coulomb_friction", "stribeck_friction", RUBS, {"torque": 0.015, "speed": 2.0}),
    (("load", "coulomb_friction", RUBS), ("motor_rotor", "coulomb_friction", RUBS)),
    (("load", "coulomb_friction", RUBS), ("amplifier", "dead_zone", {"half_width": 0.3})),
    (("load", "viscous_friction", DRAGS), ("motor_rotor", "viscous_friction", DRAGS)),
)
#: what the second recording is of
SECOND = "designed", "multisine", "again"


@dataclass(frozen=True)
class Case:
    """A drawn pair: the truth first."""

    truth: Law
    other: Law
    machine: Rig


def rows(n: int, seed: int) -> list[Row]:
    """A row a pair: what the first recording says, and what each second one does."""
    nominal = with_priors(build_rig(compose("rig=rotary_drive", "controller=open_loop").rig))
    return [_case(nominal, seed + j, *PAIRS[j % len(PAIRS)]) for j in range(n)]


def _case(nominal: Rig, seed: int, a: Law, b: Law) -> Row:
    rng = np.random.default_rng(seed)
    truth, other = (a, b) if rng.random() < 0.5 else (b, a)
    size = rng.uniform(0.6, 1.6)
    case = Case(truth, other, _machine(nominal, truth, size, rng))
    first = _recorded(case.machine, _one_way(rng), rng, 0)
    alone = _leads(nominal, [first], case)
    row: Row = {"what": f"{truth[0]}.{truth[1]} or {other[0]}.{other[1]}", "alone": float(alone[0])}
    if abs(alone[0]) > _asked(nominal, [first]):
        return row | {"confused": "no"}
    found, rival = (alone[1], alone[2]) if alone[0] > 0.0 else (alone[2], alone[1])
    again = _one_way(rng)
    for how, u in zip(SECOND, (*_designed(found, rival, first), again), strict=True):
        both = [first, _recorded(case.machine, u, rng, 1, LEAD_IN_S if u is again else 0.0)]
        lead, asked = _leads(nominal, both, case)[0], _asked(nominal, both)
        row |= {how: float(lead), f"named {how}": "right" if lead > asked else "wrong" if lead < -asked else "open"}
    return row | {"confused": "yes"}


def _machine(nominal: Rig, law: Law, size: float, rng: np.random.Generator) -> Rig:
    """The true machine: the law, and parameters off by a third of their tolerances."""
    parameters = {
        name: replace(p, value=p.value * (1.0 + p.tolerance / 3.0 * rng.standard_normal()))
        for name, p in nominal.config.parameters.items()
    }
    first = next(iter(law[2]))
    values = {name: value * (size if name == first else 1.0) for name, value in law[2].items()}
    return build_rig(replace(nominal.config, parameters=parameters)).with_effect(law[0], law[1], values)


def _one_way(rng: np.random.Generator) -> Floats:
    """A command that never reverses the motion, after a time in which it begins."""
    t = STEP_S * np.arange(round((LENGTH_S + LEAD_IN_S) / STEP_S))
    waves = [rng.uniform(0.1, 0.5) * np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 6.0)) for f in (0.5, 1.1, 2.7, 5.3)]
    return np.asarray(rng.uniform(3.0, 4.0) + np.sum(waves, axis=0))


def _recorded(rig: Rig, u: Floats, rng: np.random.Generator, number: int, lead_in_s: float = LEAD_IN_S) -> Record:
    shown, cut = simulate(rig, u, STEP_S, substeps=16).sensors, round(lead_in_s / STEP_S)
    y = {c: shown[c][cut : len(u)] + size * rng.standard_normal(len(u) - cut) for c, size in NOISE.items()}
    whole = np.ones(len(u) - cut, dtype=bool)
    return Record(STEP_S, u[cut:], y, whole, ~whole, recording=number)


def _segments(nominal: Rig, records: list[Record]) -> Segments:
    return segments_of(nominal, records, [rate_of(nominal, r.y, r.sample_time_s) for r in records])


def _asked(nominal: Rig, records: list[Record]) -> float:
    """What a diagnosis asks of any name."""
    return max(SETTINGS.min_gain_if_clearing * sum(r.samples * len(r.y) for r in records), LEAST)


def _leads(
    nominal: Rig, records: list[Record], case: Case
) -> tuple[float, tuple[FittedModel, Key], tuple[FittedModel, Key]]:
    """By how much the truth is likelier than the other, and both models."""
    segments = _segments(nominal, records)
    truth, other = ((_fitted(segments, nominal, law), law[:2]) for law in (case.truth, case.other))
    return other[0].score - truth[0].score, truth, other


def _fitted(segments: Segments, nominal: Rig, law: Law) -> FittedModel:
    rig = nominal.with_effect(*law)
    sizes, _ = segments.tuned(nominal)
    motion = motion_of(segments, nominal, segments.gains(nominal, sizes))
    model = FitProblem(segments, rig, [law[:2]], motion, 1.0).homotopy_fit(sizes)
    assert model is not None
    return model


def _designed(found: tuple[FittedModel, Key], rival: tuple[FittedModel, Key], first: Record) -> tuple[Floats, Floats]:
    """The command that tells both apart best, within the limits of the first recording, and a multisine as drawn."""
    model, key = found
    place = key[0]
    leaves = {name: {"value": v, "tolerance": 0.05} for name, v in model.rig.effects[place][key[1]].items()}
    seen = Observed(STEP_S, LENGTH_S, float(np.abs(first.u).max()), *_limits(first), dict(NOISE), {})
    rivalry = Rivalry(model.rig.with_effect(*key, leaves), [Rival("other", rival[0].rig, (rival[1],))], seen)
    made = designed(rivalry, Limits(seen.command, seen.travel, seen.speed), LENGTH_S, TRIES)
    return made.best.u, (made.beside or made.best).u


def _limits(first: Record) -> tuple[dict[str, float], dict[str, float]]:
    """How far, and how fast, the first recording went."""
    travel, speed = {}, {}
    for body, channel in (("motor_rotor", "theta_m"), ("load", "theta_l")):
        y = first.y[channel]
        travel[body] = float(np.abs(y - y[0]).max())
        speed[body] = float(np.abs(np.diff(y[::100])).max() / (100 * STEP_S))
    return travel, speed


def said(found: list[Row]) -> list[str]:
    """The figures of the docs."""
    confused = [row for row in found if row["confused"] == "yes"]
    counts = {
        how: [sum(row[f"named {how}"] == name for row in confused) for name in ("right", "open", "wrong")]
        for how in SECOND
    }
    told = "; ".join(f"{how}: {r} right, {o} open, {w} wrong" for how, (r, o, w) in counts.items())
    return [f"{len(confused)} of {len(found)} pairs are confused by one recording. With a second one, {told}."]
