"""Recover: the effort that is missing at a place, against the state that it depends on, with no law assumed.

The effort is a sum of hat functions of a state. Each reaches the output through the block's linear dynamics, so that
one regression on what a model leaves gives their heights; its parameters stay at their fitted values. Where no effect
explains a mismatch, the place and the state that explain most of it on held-out data say where it sits.
"""

from collections.abc import Container, Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.candidates import positions
from dtbacklash.diagnose.data.compare import Block, Record, part_of, places_of, true_angle
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.data.responses import Response, transfers
from dtbacklash.diagnose.fit.comparison import in_errors
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.assembly import state_names
from dtbacklash.physics.catalogue import effects_of
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.table import SHAPES
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kinds import AXES
from dtbacklash.physics.rig import Rig

#: an effort that explains less of what is left does not show where it acts (share of what is left)
LOCATED_SHARE = 0.05
#: hats over a state: enough for friction's corner, few enough for their noise (hats)
RECOVERED_KNOTS = 25
#: outermost values, beyond the outermost hats, that a spike would have moved (share)
RECOVERED_TAIL_SHARE = 0.002


@dataclass(frozen=True)
class Recovered:
    """The missing effort at a place against a state.

    Attributes
    ----------
    place, state : where, and of what (``speed``, ``position``, ``stretch``, ``stretch rate``, ``command``, ``time``).
    state_unit, effort_unit : SI.
    knots, effort, error : (K,) state, effort and its standard error.
    share : of the mismatch's mean square on the held-out part that it explains. fall : by which the held-out mean
    square of the channel that shows it best falls, in units of the floor's. t : the fall, in standard errors over
    stretches. times : a second state that multiplies it, or empty. proven : whether a table
    over it was refitted and clearly leaves less.
    """

    place: str
    state: str
    state_unit: str
    effort_unit: str
    knots: Floats
    effort: Floats
    error: Floats
    share: float
    fall: float = 0.0
    t: float = 0.0
    times: str = ""
    proven: bool = False

    @property
    def shown(self) -> bool:
        """Whether it shows where the missing effort acts: it explains a part of what is left, and significantly."""
        return self.proven or (self.share >= LOCATED_SHARE and self.t > SETTINGS.depends_errors)


def free_forms(
    evidence: Evidence, fitted: Fit, places: Iterable[str] | None = None, blocks: Container[str] | None = None,
    tables: bool = False,
) -> list[Recovered]:  # fmt: skip
    """What a fit leaves, as an effort against every state at every place, each on its own.

    places, blocks : where to look, by name; None: everywhere. tables : over what a table may be over instead, which
    may be a state times another one.
    """
    lens = _Lens(evidence, fitted, tables)
    listed = fitted.rig.elements if places is None else [p for p in fitted.rig.elements if p in places]
    seen = [block for block in evidence.blocks if blocks is None or block.name in blocks]
    return [r for place in listed for block in seen for r in lens.at(block, place)]


class _Lens:
    """Regressions on what one model leaves."""

    def __init__(self, evidence: Evidence, base: Fit, tables: bool = False) -> None:
        self.evidence, self.base, self.rig, self.tables = evidence, base, base.rig, tables
        self.positions = [positions(base.rig, evidence.blocks, r) for r in evidence.records]

    def at(self, block: Block, place: str) -> list[Recovered]:
        """What is missing at a place as one block sees it, against each of the place's states."""
        part = part_of(self.rig, block)
        path = path_of(part, block, place) if place in places_of(self.rig, block) else None
        if path is None:
            return []
        unit, columns = path
        records = self.evidence.records
        states = [states_of(self.rig, place, block, r, p) for r, p in zip(records, self.positions, strict=True)]
        responses = transfers(part, block, records, columns)
        found = []
        for over, times in self._shapes(place, states[0]):
            values = [s[over][0] for s in states]
            factors = [s[times][0] if times else np.ones(len(s[over][0])) for s in states]
            knots = knots_over(np.concatenate(values))
            if knots is not None:
                names = over, states[0][over][1], unit
                found.append(
                    replace(self._regress(block, place, names, values, factors, knots, responses), times=times)
                )
        return found

    def _shapes(self, place: str, states: Iterable[str]) -> list[tuple[str, str]]:
        """(state, state that multiplies or "") over which an effort is looked for at a place."""
        if not self.tables:
            return [(name, "") for name in states]
        here = [SHAPES[name] for name, effect in effects_of(self.rig.kind_at(place)).items() if effect.is_table]
        return [(shape.over, shape.times) for shape in here]

    def _regress(
        self, block: Block, place: str, names: tuple[str, str, str], values: list[Floats],
        factors: list[Floats], knots: Floats, responses: list[Response],
    ) -> Recovered:  # fmt: skip
        scale = self.evidence.floor[block.name]
        hats = np.eye(len(knots))
        waves: Residuals = {block.name: []}
        for v, factor, (numerators, denominator) in zip(values, factors, responses, strict=True):
            # (samples, channels, knots) in units of the floor; one knot after the other, for the memory that it takes
            reached = np.empty((len(v), len(scale), len(knots)))
            for k, hat in enumerate(hats):
                shape = factor * np.interp(v, knots, hat)
                for c, row in enumerate(numerators):
                    reached[:, c, k] = lfilter(row, denominator, shape) / scale[c]
            waves[block.name].append(reached)
        waves[block.name] = self.evidence.without_zeros(block, waves[block.name])
        root = np.sqrt(self.base.weights[block.name])

        def rows(of: list[Floats], part: str) -> Floats:
            kept = [e[getattr(r, part)] * _wide(root, e) for e, r in zip(of, self.evidence.records, strict=True)]
            joined = kept[0] if len(kept) == 1 else np.concatenate(kept)
            return joined.reshape(joined.shape[0] * joined.shape[1], *joined.shape[2:])

        left, x = self.base.residuals[block.name], rows(waves[block.name], "train")
        power = np.mean(np.sum(x**2, axis=0))
        bend = np.diff(np.eye(len(knots)), 2, axis=0) * np.sqrt(SETTINGS.recovered_smoothing * power)
        gram = np.linalg.pinv(x.T @ x + bend.T @ bend + 1e-12 * np.mean(np.sum(x**2, axis=0)) * np.eye(len(knots)))
        y = rows(left, "train")
        heights = gram @ (x.T @ y)
        target = rows(left, "held")
        rest = target - rows(waves[block.name], "held") @ heights
        error = np.sqrt(np.maximum(np.diag(gram) * np.mean((y - x @ heights) ** 2), 0.0))
        share = 1.0 - float(rest @ rest) / max(self._total(root, block.name, target), 1e-300)
        fall, t = self._fall(block, waves[block.name], heights)
        return Recovered(place, *names, knots, heights, error, share, fall, t)

    def _fall(self, block: Block, waves: list[Floats], heights: Floats) -> tuple[float, float]:
        """(fall, t) of the held-out mean square in the channel where an effort is most significant."""
        before = self.base.residuals
        after = {block.name: [e - w @ heights for e, w in zip(before[block.name], waves, strict=True)]}
        falls = self.evidence.stretches(before, block.name) - self.evidence.stretches(after, block.name)
        t = in_errors(falls)
        best = int(np.argmax(t))
        return float(falls[best].mean()), float(t[best])

    def _total(self, root: Floats, name: str, target: Floats) -> float:
        """Held-out mismatch of all blocks, so that shares of different blocks can be compared."""
        total = float(target @ target)
        for block in self.evidence.blocks:
            if block.name != name:
                e = self.evidence.rows(self.base.residuals, block.name, "held")
                total += float(np.sum(e**2 * self.base.weights[block.name][:, None]))
        return total


def _wide(root: Floats, e: Floats) -> Floats:
    return root[None, :, None] if e.ndim == 3 else root[None, :]


def path_of(part: Rig, block: Block, place: str) -> tuple[str, dict[int, float]] | None:
    """(unit of the effort, {input channel: sign}) through which an effort at a place acts."""
    element = part.elements.get(place)
    bodies = state_names(part, block.imposed is not None)
    if element is None:
        return None
    trait = element.trait.trait
    if trait == slots.AMPLIFIER:
        return "V", {pl.CH_V: 1.0}
    if trait == slots.BODY:
        unit = AXES[element.trait.axis][2]
        return (unit, {pl.CH_F + bodies.index(place): 1.0}) if place in bodies else None
    if trait == slots.SPRING:
        a, b = element.neighbours["between"]
        ends = {pl.CH_F + bodies.index(e): sign for e, sign in ((a, element.lever), (b, -1.0)) if e in bodies}
        return (AXES[element.trait.axis][2], ends) if ends else None
    if trait in (slots.GEAR, slots.SCREW) and block.imposed:
        return "m", {pl.CH_D: 1.0}
    return None


def states_of(
    rig: Rig, place: str, block: Block, record: Record, at: dict[str, Floats]
) -> dict[str, tuple[Floats, str]]:
    """What an effort at the place may depend on: name -> ((N,) values, unit)."""
    step, kind = record.sample_time_s, rig.elements[place].trait
    clock = record.from_s + np.arange(record.samples, dtype=np.float64) * step
    time = {"time": (clock, "s")}
    if kind.trait == slots.AMPLIFIER:
        return {"command": (record.u, "V"), **time}
    if kind.trait in (slots.GEAR, slots.SCREW):
        angle = true_angle(rig, block, record)
        return {"angle": (angle, "rad"), "speed": (_rate(angle, step), "rad/s"), **time}
    position, velocity, _ = AXES.get(kind.axis, ("", "", ""))
    if kind.trait == slots.SPRING:
        a, b = rig.elements[place].neighbours["between"]
        zero = np.zeros(record.samples)
        stretch = at.get(b, zero) - rig.elements[place].lever * at.get(a, zero)
        return {"stretch": (stretch, position), "stretch rate": (_rate(stretch, step), velocity), **time}
    q = at.get(place, np.zeros(record.samples))
    return {"speed": (_rate(q, step), velocity), "position": (q, position), **time}


def _rate(q: Floats, step: float) -> Floats:
    """Derivative of a position that may be counted: smoothed over a few samples."""
    width = 9
    window = np.hanning(width + 2)
    rate: Floats = np.convolve(np.gradient(q, step), window[1:-1] / window.sum(), "same")
    return rate


def knots_over(values: Floats) -> Floats | None:
    """Places of the hats: half of them even over the range, half of them where the state mostly is."""
    tails, half = RECOVERED_TAIL_SHARE, RECOVERED_KNOTS // 2 + 1
    low, high = np.quantile(values, (tails, 1.0 - tails))
    if not high > low:
        return None
    even = np.linspace(low, high, half)
    often = np.quantile(values, np.linspace(tails, 1.0 - tails, half))
    knots = np.unique(np.concatenate([even, often]))
    kept = [knots[0]]
    for k in knots[1:]:
        if k - kept[-1] > 1e-3 * (high - low):
            kept.append(k)
    return np.array(kept) if len(kept) > 4 else None
