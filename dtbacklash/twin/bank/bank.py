"""The twin's bank: what has changed, from one buffer of what the controller records.

The machine is cut at the measured motor angle. Behind it, the gap and one of the structure's hypotheses explain the
output (:mod:`.structure_bank`); before it, one of the motor's laws explains the angle (:mod:`.motor_bank`). What each
half says is judged by the same rule (:func:`_judged`): a hypothesis has to leave only noise, and to do so better, by a
margin of the likelihood, than any other kind at any other place; a simpler one, the gap alone or nothing, is preferred
unless it is worse by more than that. Else the answer is `unknown`, or `ambiguous` where several explain the buffer.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.control.belief import Belief
from dtbacklash.control.chain import driven_chain
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig, Sensor
from dtbacklash.twin.bank.hypotheses import Hypothesis, Value, of_the_motor, structural
from dtbacklash.twin.bank.motor import MotorBuffer
from dtbacklash.twin.bank.structure import COMMON, GAP, GROWTH, StructureBuffer
from dtbacklash.twin.bank.whitened import Fit

#: standard deviations of chi-square that a hypothesis may leave beyond the noise
EXCESS = 4.5
#: by how much chi-square has to fall for a change to be believed beside the gap alone, or beside nothing
WORTH = 30.0
#: two hypotheses whose chi-squares differ by less explain a buffer equally well; WORTH, if they are much alike
MARGIN = 14.0
#: share of its size by which a change's standard error may be uncertain for the change to be believed in
UNSURE = 0.3
VERDICTS = ("nothing", "gap", "changed", "ambiguous", "unknown")


@dataclass(frozen=True)
class Buffer:
    """What the controller has recorded, (N,) each: command V, measured motor angle rad, measured output m."""

    u: Floats
    theta_m: Floats
    q3: Floats
    sample_time_s: float


@dataclass(frozen=True)
class Change:
    """One thing that has changed, where, its parameters; twins: what the signals cannot tell from it."""

    kind: str
    place: str
    values: tuple[Value, ...]
    twins: tuple[str, ...] = ()

    @property
    def sure(self) -> bool:
        """Whether its size is known well enough to be believed in: friction that turns round once may not tell it."""
        size = self.values[0]
        return size.std < UNSURE * abs(size.value)

    def __str__(self) -> str:
        return f"{self.kind} {self.place} {', '.join(str(v) for v in self.values)}"


@dataclass(frozen=True)
class Half:
    """What one half of the machine says.

    verdict : as of :class:`Diagnosis`. names : what explains it equally well. rig : the changed one. growth_rad_s : of
    the gap within the buffer, with its standard error.
    """

    verdict: str
    changes: tuple[Change, ...]
    names: tuple[str, ...]
    excess: float
    rig: Rig
    gap_rad: float = math.nan
    gap_std_rad: float = math.inf
    growth_rad_s: float = 0.0
    growth_std_rad_s: float = math.inf


@dataclass(frozen=True)
class Diagnosis:
    """What the bank says of a buffer.

    verdict : `nothing`, `gap`, `changed` (``changes`` says what), `ambiguous` (``names`` explain it equally well) or
    `unknown` (nothing in the bank leaves only noise). gap_rad, gap_std_rad : half-gap in the middle of the buffer with
    its standard error; nan where it is not known. belief : the changed one; without ``changes`` that of before.
    """

    verdict: str
    changes: tuple[Change, ...]
    names: tuple[str, ...]
    gap_rad: float
    gap_std_rad: float
    belief: Belief
    halves: tuple[Half, Half]
    wall_s: float

    @property
    def found(self) -> str:
        """A few words, for a table."""
        if self.verdict == "ambiguous":
            return "ambiguous: " + " or ".join(self.names)
        return "; ".join(str(change) for change in self.changes) or self.verdict


def diagnose_buffer(belief: Belief, buffer: Buffer, gap_rad: float) -> Diagnosis:
    """What has changed.

    Parameters
    ----------
    belief : what is believed of the machine. buffer : begins at rest and holds a move. gap_rad : half-gap in force.

    Raises
    ------
    UserError : the rig is no screw-driven chain of masses with a motor; a buffer that is too short or not finite.
    """
    began = time.perf_counter()
    _check(buffer)
    structure = _structure(belief, buffer, gap_rad)
    motor = _motor(belief, buffer)
    halves = (structure, motor)
    verdicts = [half.verdict for half in halves]
    verdict = next((v for v in ("unknown", "ambiguous", "changed", "gap", "nothing") if v in verdicts), "unknown")
    changes = structure.changes + motor.changes
    rig = belief.rig
    if verdict == "changed":
        rig = structure.rig
        if motor.changes:
            rig = _with_motor(rig, motor.rig)
    return Diagnosis(
        verdict, changes if verdict == "changed" else (), tuple(n for half in halves for n in half.names),
        structure.gap_rad, structure.gap_std_rad, Belief(rig), halves, time.perf_counter() - began,
    )  # fmt: skip


def _check(buffer: Buffer) -> None:
    columns = (buffer.u, buffer.theta_m, buffer.q3)
    if len({c.shape for c in columns}) != 1 or buffer.u.ndim != 1 or buffer.u.size < 500:
        raise UserError("twin.bank_buffer", [c.shape for c in columns], "three equal columns of at least 500 samples")
    if not all(np.all(np.isfinite(c)) for c in columns):
        raise UserError("twin.bank_buffer", "nan", "finite measurements only")


@dataclass(frozen=True)
class Tried:
    """A hypothesis (None: the gap alone, or nothing) with its best fit."""

    hypothesis: Hypothesis | None
    fit: Fit

    @property
    def name(self) -> str:
        h = self.hypothesis
        return "nothing else" if h is None else f"{h.kind} {h.place}"


def _kind(tried: Tried) -> str:
    return "" if tried.hypothesis is None else tried.hypothesis.kind


def _judged(base: Tried, others: list[Tried]) -> tuple[str, list[Tried]]:
    """`base`, `changed`, `ambiguous` or `unknown`, and the hypotheses that this is about."""
    explaining = sorted((t for t in others if t.fit.excess() < EXCESS), key=lambda t: t.fit.chi2)
    simple = base.fit.excess() < EXCESS
    best = explaining[0] if explaining else None
    if best is None or base.fit.chi2 - best.fit.chi2 < WORTH:
        return ("base", [base]) if simple else ("unknown", [])
    assert best.hypothesis is not None
    like = best.hypothesis.like
    rivals = [t for t in explaining if t.fit.chi2 - best.fit.chi2 < (WORTH if _kind(t) in like else MARGIN)]
    # what more parameters explain no better is the simpler one: a spring with a long memory is a stiffer spring
    fewest = min(t.fit.x.size for t in rivals)
    rivals = [t for t in rivals if t.fit.x.size == fewest]
    if len(rivals) > 1:
        return "ambiguous", rivals
    return "changed", [best]


def _structure(belief: Belief, buffer: Buffer, gap_rad: float) -> Half:
    """What the output says of gap and structure."""
    rig = belief.rig
    explained = StructureBuffer(buffer.theta_m, buffer.q3, rig, _output(rig), buffer.sample_time_s)
    fits = [explained.fit(None, gap) for gap in (gap_rad, explained.gap_at_the_end())]
    base = Tried(None, min(fits, key=lambda fit: fit.chi2))
    at = abs(float(base.fit.x[0])) * GAP
    held = base.fit.x[COMMON:]
    others = [Tried(hypothesis, explained.fit(hypothesis, at, held)) for hypothesis in structural(belief)]
    verdict, about = _judged(base, others)
    # the play follows the angle's counts, not the angle
    count = explained.count / math.sqrt(12.0)
    gaps = [(abs(float(t.fit.x[0])) * GAP, math.hypot(float(t.fit.std[0]) * GAP, count)) for t in about]
    gap, std = _common(gaps)
    growth = (float(about[0].fit.x[2]) * GROWTH, float(about[0].fit.std[2]) * GROWTH) if about else (0.0, math.inf)
    if verdict == "base":
        moved = not abs(gap - gap_rad) < max(3.0 * std, math.radians(0.1))
        return Half("gap" if moved else "nothing", (), (), base.fit.excess(), rig, gap, std, *growth)
    if verdict != "changed":
        left = min(t.fit.excess() for t in [base, *others])
        return Half(verdict, (), tuple(t.name for t in about), left, rig, gap, std, *growth)
    change, changed = _change(about[0], rig, COMMON)
    return Half("changed", (change,), (), about[0].fit.excess(), changed, gap, std, *growth)


def _common(gaps: list[tuple[float, float]]) -> tuple[float, float]:
    """A gap and its standard error on which all agree; nan where they do not."""
    if not gaps:
        return math.nan, math.inf
    gap, std = gaps[0]
    far = max(abs(g - gap) for g, _ in gaps)
    return (gap, math.hypot(std, far)) if far < 3.0 * max(s for _, s in gaps) else (math.nan, math.inf)


def _motor(belief: Belief, buffer: Buffer) -> Half:
    """What the angle says of the motor."""
    rig = belief.rig
    explained = MotorBuffer(buffer.u, buffer.theta_m, belief, buffer.sample_time_s)
    base = Tried(None, explained.fit(None))
    if explained.missing:
        verdict = "nothing" if base.fit.excess() < EXCESS else "unknown"
        return Half(verdict, (), (), base.fit.excess(), rig)
    others = [Tried(h, explained.fit(h)) for h in [*of_the_motor(belief), *explained.coggings()]]
    verdict, about = _judged(base, others)
    if verdict == "base":
        return Half("nothing", (), (), base.fit.excess(), rig)
    if verdict != "changed":
        left = min(t.fit.excess() for t in [base, *others])
        return Half(verdict, (), tuple(t.name for t in about), left, rig)
    change, changed = _change(about[0], rig, 0)
    return Half("changed", (change,), (), about[0].fit.excess(), changed)


def _change(tried: Tried, rig: Rig, first: int) -> tuple[Change, Rig]:
    """What a fit says has changed, and the rig with it; ``first`` : place of the hypothesis's own variables."""
    h, fit = tried.hypothesis, tried.fit
    assert h is not None
    x = tuple(fit.x[first : first + len(h.names)])
    values = tuple(
        Value(name, value, h.spread(value, i, float(fit.std[first + i])), unit, was)
        for i, (name, value, unit, was) in enumerate(zip(h.names, h.from_fit(x), h.units, h.believed, strict=True))
    )
    if h.periods:
        values = _of_a_wave(values, h.periods, rig.effect(h.place, "cogging") or {})
    return Change(h.kind, h.place, values, h.twins), h.changed(rig, x)


def _of_a_wave(values: tuple[Value, ...], periods: float, believed: dict[str, float]) -> tuple[Value, ...]:
    """Torque, periods and phase of cogging from its sine and cosine."""
    sine, cosine = values
    torque = math.hypot(sine.value, cosine.value)
    std = math.hypot(sine.std * sine.value, cosine.std * cosine.value) / max(torque, 1e-12)
    same = believed.get("periods") == periods
    return (
        Value("torque", torque, std, sine.unit, believed["torque"] if same else 0.0),
        Value("periods", periods, 0.0, "1/rev"),
        Value("phase", math.atan2(cosine.value, sine.value), std / max(torque, 1e-12), "rad"),
    )


def _with_motor(rig: Rig, motor: Rig) -> Rig:
    """A rig with the motor's half of another: its rotor's and amplifier's effects, and its circuit."""
    rotor, circuit, amplifier = motor.motor_rotor(), motor.only("motor_circuit"), motor.only("amplifier")
    assert rotor is not None
    assert circuit is not None
    from dtbacklash.physics.rig import build_rig

    effects = dict(rig.config.effects)
    for place in [rotor.name, circuit.name] + ([amplifier.name] if amplifier else []):
        effects[place] = motor.config.effects.get(place, {})
    elements = dict(rig.config.elements)
    elements[circuit.name] = motor.config.elements[circuit.name]
    mine = {name: value for name, value in motor.config.parameters.items() if name in elements[circuit.name].values()}
    config = replace(
        rig.config, effects={p: e for p, e in effects.items() if e}, elements=elements,
        parameters={**rig.config.parameters, **mine},
    )  # fmt: skip
    return build_rig(config)


def _output(rig: Rig) -> Sensor:
    """The sensor that shows the last mass."""
    end = driven_chain(rig)[0][-1].name
    shown = [s for s in rig.sensors.values() if s.quantity == "position" and s.of == end]
    if not shown:
        raise UserError("rig.sensors", ", ".join(rig.sensors), f"the bank needs a position sensor on {end}")
    return shown[0]
