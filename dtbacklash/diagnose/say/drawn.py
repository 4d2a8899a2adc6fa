"""What the figures of a diagnosis show: the signals, the laws, and where the evidence lies."""

import numpy as np

from dtbacklash.diagnose.data.compare import predict
from dtbacklash.diagnose.data.evidence import Evidence, Residuals, by_recording
from dtbacklash.diagnose.fit.errors import in_floors
from dtbacklash.diagnose.fit.free import Key
from dtbacklash.diagnose.judge.free_form import Recovered
from dtbacklash.diagnose.judge.law_points import EFFORTS
from dtbacklash.diagnose.named import Modelled
from dtbacklash.diagnose.search.model import Model
from dtbacklash.diagnose.shown import Curve, LawShown, Shown
from dtbacklash.diagnose.words import place_in_words
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.drawing import POINTS, effort_over


def shown(
    model: Model, left_out: dict[Key, Residuals], laws: list[LawShown], rest: Recovered | None,
    modelled: Modelled | None = None,
) -> Shown:  # fmt: skip
    """Everything that is drawn.

    Parameters
    ----------
    left_out : per finding, what remains without it. laws : of the findings.
    rest : the effort that explains most of what no law explains. modelled : that effort as the rig has it.
    """
    laws = [*laws]
    if modelled is not None:
        laws.append(_as_modelled(modelled))
    # where a block is driven by what is imposed on it, an effort may show nowhere: there is nothing to draw then
    elif rest is not None and rest.shown and np.any(rest.effort):
        laws.append(_unexplained(rest))
    evidence_at = shares(model, left_out, rest)
    return Shown(
        evidence_at, tuple(_curves(model)), tuple(laws), in_floors(model.evidence, model.nominal, model.fitted)
    )


def _as_modelled(modelled: Modelled) -> LawShown:
    """The table or formula of what no name explains, with the table's values as points."""
    rig, place = modelled.rig, modelled.location
    entry, values = find(rig.kind_at(place), modelled.effect, place), rig.effects[place][modelled.effect]
    state, effort, error = (np.array(column) for column in zip(*modelled.points, strict=True))
    missing = EFFORTS.get(modelled.unit, "missing effort")
    grid = np.linspace(state[0], state[-1], POINTS)
    curve = effort_over(entry, values, modelled.state, modelled.times, grid)
    if modelled.state == "command":  # drawn as output over input
        curve, effort = curve + grid, effort + state
    return LawShown(
        place, modelled.effect, f"{modelled.state} of {place_in_words(place)}",
        f"missing effort by {modelled.times}" if modelled.times else missing, modelled.state_unit, modelled.unit,
        grid, curve, state, effort, error,
    )  # fmt: skip


def _unexplained(rest: Recovered) -> LawShown:
    label = "time" if rest.state == "time" else f"{rest.state} of {place_in_words(rest.place)}"
    return LawShown(
        rest.place, "", label, EFFORTS.get(rest.effort_unit, "missing effort"), rest.state_unit, rest.effort_unit,
        state=rest.knots, recovered=rest.effort, error=rest.error,
    )  # fmt: skip


def shares(model: Model, left_out: dict[Key, Residuals], rest: Recovered | None) -> dict[str, float]:
    """Place -> its share of the evidence against the recalibrated rig; they add up to 1, or there are none.

    An effect weighs what the held-out log-likelihood of a sample falls by when it alone is taken out again, and
    what nothing explains what separates it from the noise floor: noise alone weighs nothing, and so does what shows
    itself at no place.
    """
    weights: dict[str, float] = {}
    last = _log_excess(model.evidence, model.fitted.residuals)
    for (place, _), residuals in left_out.items():
        weights[place] = weights.get(place, 0.0) + max(_log_excess(model.evidence, residuals) - last, 0.0)
    if rest is not None and rest.shown:
        weights[rest.place] = weights.get(rest.place, 0.0) + last
    total = sum(weights.values())
    return {place: weight / total for place, weight in weights.items()} if total > 0.0 else {}


def _log_excess(evidence: Evidence, residuals: Residuals) -> float:
    """Sum over the channels of the logarithm of the held-out mean square above the floor."""
    squares, least = evidence.mean_square(residuals, "held"), evidence.least()
    return sum(float(np.sum(np.log(np.maximum(squares[n] / least[n], 1.0)))) for n in squares)


def _curves(model: Model) -> list[Curve]:
    """Measured, nominal and extended, a channel and a recording each, at the scale of the comparison."""
    evidence = model.evidence
    curves = []
    for number, stretches in enumerate(by_recording(evidence.records)):
        clocks = [r.from_s + np.arange(r.samples, dtype=np.float64) * r.sample_time_s for r in stretches]
        t_s = np.concatenate(clocks)
        held = np.flatnonzero(np.concatenate([r.held for r in stretches]))
        for block in evidence.blocks:
            nominal = np.concatenate([predict(evidence.nominal, block, r) for r in stretches])
            extended = np.concatenate([predict(model.fitted.rig, block, r) for r in stretches])
            for j, channel in enumerate(block.channels):
                curves.append(
                    Curve(
                        name=channel if number == 0 else f"{channel} (recording {number + 1})",
                        unit=evidence.nominal.sensors[channel].unit,
                        t_s=t_s,
                        measured=np.concatenate([r.y[channel] for r in stretches]),
                        nominal=nominal[:, j],
                        extended=extended[:, j],
                        held_out_from_s=float(t_s[held[0]]) if held.size else None,
                        noise_floor=float(evidence.floor[block.name][j]),
                    )
                )
    return curves
