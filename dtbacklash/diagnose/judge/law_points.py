"""The law of a finding beside what the recording says of it: points of the missing effort, each from the data alone.

The effort is the law's plus a sum of hat functions of its state, whose heights one regression gives: each hat reaches
the output through the block's linear dynamics and is fitted to what the extended rig leaves. Were the law another one,
the points would leave it. The state is that of the extended rig's motion, so that law and points share their axes.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.candidates import positions
from dtbacklash.diagnose.data.compare import Block, part_of, places_of
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.data.responses import Response, transfers
from dtbacklash.diagnose.fit.free import Key
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.judge.free_form import knots_over, path_of, states_of
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.diagnose.shown import LawShown
from dtbacklash.diagnose.words import place_in_words
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.drawing import Drawing, drawing_of, law_curve

#: hats over a wave, and over the travel after a reversal
OVER_WAVE, OVER_TRAVEL = 25, 13
#: a movement back by this share of a loop's width is a reversal
REVERSAL = 0.1
#: the loop of a recording's own stroke: this quantile of the state about its middle
STROKE = 0.98
#: points whose standard error is above this share of the law's size, or of their own, say nothing
USELESS = 0.5

EFFORTS = {"N m": "missing torque", "N": "missing force", "V": "missing voltage", "m": "missing displacement"}


@dataclass(frozen=True)
class _Sight:
    """One block's view of an effort: (N,) coordinate of the hats, (N,) factor, response of each record, and knots."""

    block: Block
    along: list[Floats]
    factor: list[Floats]
    knots: Floats
    responses: list[Response]


def law_shown(evidence: Evidence, fitted: Fit, key: Key, left_out: Residuals) -> LawShown | None:
    """The law of one effect with its points; None where it is no law of one state, or its place does not move.

    Parameters
    ----------
    left_out : what remains without the effect: it says in which block it can be seen best.
    """
    place, name = key
    rig = fitted.rig
    drawing, values = drawing_of(find(rig.kind_at(place), name, place)), rig.effect(place, name)
    if drawing is None or values is None:
        return None
    blocks = [b for b in evidence.blocks if place in places_of(rig, b) and path_of(part_of(rig, b), b, place)]
    if not blocks:
        return None
    block = max(blocks, key=lambda b: _seen(evidence, fitted, left_out, b.name))
    path = path_of(part_of(rig, block), block, place)
    assert path is not None
    unit, columns = path
    at = [positions(rig, evidence.blocks, r) for r in evidence.records]
    states = [states_of(rig, place, block, r, p) for r, p in zip(evidence.records, at, strict=True)]
    state_unit = states[0][drawing.state][1]
    reach = _reach([s[drawing.state][0] for s in states], drawing, values)
    sight = _sight(evidence, fitted, block, drawing, values, [{n: v for n, (v, _) in s.items()} for s in states],
                   columns, reach)  # fmt: skip
    if sight is None:
        return None
    if drawing.shape == "curve":
        reach = float(sight.knots[0]), float(sight.knots[-1])
    element = rig.elements[place].values
    law = law_curve(drawing, values, element, reach)
    deviation, error = _deviation(evidence, fitted, sight)
    if drawing.effort_unit == "rad" and unit == "m":  # a displacement of the screw, drawn as the angle that makes it
        screw = rig.only("screw")
        assert screw is not None
        deviation, error = deviation / screw.values["lead"], error / screw.values["lead"]
    points = _points(drawing, law, reach, sight.knots, deviation, error)
    usual = 2.0 * float(np.quantile(np.abs(points[1]), 0.8))
    size = max(float(np.ptp(law[1])) or float(np.abs(law[1]).max()), usual)
    useful = points[2] < USELESS * size
    label = "time" if drawing.state == "time" else f"{drawing.state} of {place_in_words(place)}"
    state, effort, errors = (p[useful] for p in points)
    return LawShown(
        place, name, label, drawing.effort_label or EFFORTS.get(unit, "missing effort"), state_unit,
        drawing.effort_unit or unit, *law, state, effort, errors, _share(points, deviation, error),
    )  # fmt: skip


def _share(points: tuple[Floats, Floats, Floats], deviation: Floats, error: Floats) -> float:
    """Share of the effort of free form that the law explains; deviations as large as their errors do not count.

    NaN where no effort of free form reaches what was recorded.
    """
    if not np.any(error > 0.0):
        return math.nan
    weights = 1.0 / np.maximum(error, 1e-9 * float(np.max(error, initial=1e-300))) ** 2
    efforts = points[1][: len(deviation)]  # of a loop, on the way up
    beside = max(float(weights @ deviation**2) - len(deviation), 0.0)
    return 1.0 - beside / max(float(weights @ efforts**2), 1e-300)


def _seen(evidence: Evidence, fitted: Fit, left_out: Residuals, name: str) -> float:
    """How many times what is left of a block's held-out part grows without the effect."""
    before = evidence.mean_square(fitted.residuals, "held")[name]
    return float(np.max(evidence.mean_square(left_out, "held")[name] / before))


def _reach(states: list[Floats], drawing: Drawing, values: dict[str, float]) -> tuple[float, float]:
    """Lowest and highest state over which a wave or a loop is drawn."""
    if drawing.shape == "wave":
        return 0.0, 2.0 * np.pi / (values[drawing.wave] if drawing.wave else 1.0)
    if drawing.shape == "loop":
        assert drawing.width is not None
        joined = np.concatenate(states)
        half = drawing.stroke * drawing.width(values) if drawing.stroke else float(
            np.quantile(np.abs(joined - np.median(joined)), STROKE)
        )  # fmt: skip
        return -half, half
    return 0.0, 0.0


def _sight(
    evidence: Evidence, fitted: Fit, block: Block, drawing: Drawing, values: dict[str, float],
    states: list[dict[str, Floats]], columns: dict[int, float], reach: tuple[float, float],
) -> _Sight | None:  # fmt: skip
    """Where the hats stand and how each of them reaches the block's channels; None where the state does not move."""
    main = [s[drawing.state] for s in states]
    factor = [s[drawing.times] if drawing.times else np.ones(len(v)) for s, v in zip(states, main, strict=True)]
    low, high = reach
    knots: Floats | None
    if drawing.shape == "wave":
        along, knots = [np.mod(v, high) for v in main], np.linspace(0.0, high, OVER_WAVE)
    elif drawing.shape == "loop":
        assert drawing.width is not None
        least = REVERSAL * drawing.width(values)
        pairs = [travel(v, least) for v in main]
        along, factor = [t for t, _ in pairs], [d for _, d in pairs]
        knots = np.linspace(0.0, high - low, OVER_TRAVEL)
    else:
        fitted_to = [v[r.train] for v, r in zip(main, evidence.records, strict=True)]
        along, knots = main, knots_over(np.concatenate(fitted_to))
    if knots is None:
        return None
    part = part_of(fitted.rig, block)
    return _Sight(block, along, factor, knots, transfers(part, block, evidence.records, columns))


def travel(values: Floats, least: float) -> tuple[Floats, Floats]:
    """(N,) how far a state has gone since its last reversal, and (N,) in which direction: 1 or -1.

    Moving back by less than ``least`` is no reversal.
    """
    way, direction = np.zeros(len(values)), np.ones(len(values))
    turn = most = float(values[0])
    sign = 1.0 if values[-1] >= values[0] else -1.0
    for k, value in enumerate(values.tolist()):
        if sign * (value - most) > 0.0:
            most = value
        elif sign * (most - value) > least:
            turn, most, sign = most, value, -sign
        way[k], direction[k] = max(sign * (value - turn), 0.0), sign
    return way, direction


def _deviation(evidence: Evidence, fitted: Fit, sight: _Sight) -> tuple[Floats, Floats]:
    """(K,) heights of the hats beside the law, and their standard errors."""
    name = sight.block.name
    scale, root = evidence.floor[name], np.sqrt(fitted.weights[name])
    hats = np.eye(len(sight.knots))
    columns, left = [], []
    for record, along, factor, residual, (numerators, denominator) in zip(
        evidence.records, sight.along, sight.factor, fitted.residuals[name], sight.responses, strict=True
    ):
        shapes = np.array([factor * np.interp(along, sight.knots, h) for h in hats])
        reached = np.array(
            [lfilter(row, denominator, shapes, axis=1) for row in numerators]
        )  # channels, knots, samples
        weighted = reached[:, :, record.train] * (root / scale)[:, None, None]
        columns.append(np.moveaxis(weighted, 1, 2).reshape(-1, len(hats)))
        left.append((residual[record.train] * root).T.ravel())
    x, y = np.concatenate(columns), np.concatenate(left)
    power = float(np.mean(np.sum(x**2, axis=0)))
    bend = np.diff(hats, 2, axis=0) * np.sqrt(SETTINGS.recovered_smoothing * power)
    gram = np.linalg.pinv(x.T @ x + bend.T @ bend + 1e-12 * power * hats)
    heights: Floats = gram @ (x.T @ y)
    # the weights count a residual that is not noise as fewer samples than were taken: its scatter is in them
    error: Floats = np.sqrt(np.maximum(np.diag(gram), 0.0))
    return heights, error


def _points(
    drawing: Drawing, law: tuple[Floats, Floats], reach: tuple[float, float], knots: Floats, deviation: Floats,
    error: Floats,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """State, effort and its standard error of every point: the law there and what deviates from it."""
    state, effort = law
    if drawing.shape != "loop":
        return knots, np.interp(knots, state, effort) + deviation, error
    half = len(state) // 2
    up, down = reach[0] + knots, reach[1] - knots
    rising = np.interp(up, state[:half], effort[:half]) + deviation
    falling = np.interp(down, state[: half - 1 : -1], effort[: half - 1 : -1]) - deviation
    return np.concatenate([up, down]), np.concatenate([rising, falling]), np.concatenate([error, error])
