"""What to record next: the sensor or the amplitude that would separate what this recording cannot."""

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import Key
from dtbacklash.diagnose.judge.free_form import Recovered
from dtbacklash.diagnose.judge.stands import Rival
from dtbacklash.diagnose.search.model import Model
from dtbacklash.diagnose.words import all_in_words, place_in_words
from dtbacklash.physics.effects.declare import name_in_words
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

#: an experiment that makes two models differ by less is not advised (share of the signal)
TOLD_APART_SHARE = 0.01


def next_experiment(model: Model, rest: Recovered | None, rivals: dict[Key, list[Rival]]) -> str:
    """A sentence, from simulations of a finding and its rival: in which sensor, or at which amplitude, they differ.

    rest : what nothing explains, if anything is left. rivals : per finding, that were fitted in its place.
    """
    evidence = model.evidence
    if rest is not None:
        if not rest.shown:
            return f"What is missing shows itself at no place: {_more_to_record(evidence)}."
        place = place_in_words(rest.place)
        if rest.state == "time":
            return f"What is missing at {place} has a time course of its own: record the same motion again, and rest."
        return (f"What is missing depends most on the {rest.state} of {place}: record it slowly from end to end of its "
                "range, in both directions, and at another speed.")  # fmt: skip
    if model.could_be is not None:
        name = model.could_be.name
        return f"To tell what was found from a wrong value of `{name}`, measure `{name}` by itself."
    if (wrong := model.wrong_value) is not None and wrong.instead_of:
        return f"To tell `{wrong.name}` from {all_in_words(wrong.instead_of)}, measure it by itself."
    pairs = [(key, t.key, t.fitted, t.reason) for key in model.keys for t in model.about(key).alike]
    pairs += [(key, r.key, r.fitted, "") for key in model.keys for r in rivals[key] if not r.behind.clear]
    if not pairs:
        return "Nothing is ambiguous in this recording; a second recording would confirm it."
    # what any recording can tell comes first
    key, other, beside, reason = min(pairs, key=lambda pair: bool(pair[3]))
    first, second = model.fitted.rig, beside.rig
    what = f"{name_in_words(key[1])} ({key[0]}) from {name_in_words(other[1])} ({other[0]})"
    if reason:
        return f"No recording tells {what}: {reason}."
    recorded = _recorded(evidence)
    here = _differences(evidence, first, second, 1.0)
    hidden = {n: d for n, d in here.items() if n not in recorded}
    if hidden:
        best = max(hidden, key=lambda n: hidden[n])
        if hidden[best] > TOLD_APART_SHARE:
            return (f"To tell {what}, record {best} as well: there the two differ by {100 * hidden[best]:.0f} % of the "
                    "signal.")  # fmt: skip
    ranked = {}
    for factor in (0.25, 4.0):
        differences = _differences(evidence, first, second, factor)
        ranked[factor] = max((d for n, d in differences.items() if n in recorded), default=0.0)
    factor = max(ranked, key=lambda f: ranked[f])
    if ranked[factor] > TOLD_APART_SHARE:
        return (f"To tell {what}, record once more with the command {factor:g} times as large: the two then differ by "
                f"{100 * ranked[factor]:.0f} % of the signal.")  # fmt: skip
    return f"Neither another sensor of this rig nor another amplitude tells {what}."


def _recorded(evidence: Evidence) -> set[str]:
    return {c for b in evidence.blocks for c in b.channels}


def _more_to_record(evidence: Evidence) -> str:
    """What may show where something is missing: the sensors that were not recorded, else another motion."""
    others = [name for name in evidence.nominal.sensors if name not in _recorded(evidence)]
    if others:
        return f"record {' and '.join(others)} as well"
    return "every sensor of this rig is recorded; record another motion, slow and fast, small and large"


def _differences(evidence: Evidence, first: Rig, second: Rig, factor: float) -> dict[str, float]:
    """Per sensor, the rms difference of two rigs' answers to the scaled command, relative to the signal."""
    record = evidence.records[0]
    n = min(record.samples, 20000)
    u = factor * record.u[: n - 1]
    a = simulate(first, u, record.sample_time_s, substeps=2, event_levels=4).sensors
    b = simulate(second, u, record.sample_time_s, substeps=2, event_levels=4).sensors
    return {name: _relative(a[name], b[name]) for name in a}


def _relative(a: Floats, b: Floats) -> float:
    size = float(np.std(a))
    value = float(np.std(a - b)) / size if size > 0.0 else 0.0
    return value if np.isfinite(value) else 0.0
