"""What the figures of a diagnosis show: the signals, the laws, and where the evidence lies."""

import numpy as np

from dtbacklash.diagnose.data.compare import predict
from dtbacklash.diagnose.data.evidence import Evidence, Residuals, by_recording
from dtbacklash.diagnose.fit.errors import in_floors
from dtbacklash.diagnose.fit.free import Key
from dtbacklash.diagnose.judge.free_form import Recovered
from dtbacklash.diagnose.judge.law_points import EFFORTS
from dtbacklash.diagnose.result import Curve, LawShown, Shown
from dtbacklash.diagnose.search.model import Model
from dtbacklash.diagnose.words import place_in_words


def shown(
    model: Model, left_out: dict[Key, Residuals], laws: list[LawShown], rest: Recovered | None
) -> Shown:  # fmt: skip
    """Everything that is drawn.

    Parameters
    ----------
    left_out : per finding, what remains without it. laws : of the findings.
    rest : the effort that explains most of what no law explains.
    """
    laws = [*laws]
    # where a block is driven by what is imposed on it, an effort may show nowhere: there is nothing to draw then
    if rest is not None and rest.shown and np.any(rest.effort):
        laws.append(_unexplained(rest))
    evidence_at = shares(model, left_out, rest)
    return Shown(
        evidence_at, tuple(_curves(model)), tuple(laws), in_floors(model.evidence, model.nominal, model.fitted)
    )


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
