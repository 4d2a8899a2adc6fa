"""What to record next: the sensor or the amplitude that would separate what this recording cannot."""

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.conclusion import Conclusion
from dtbacklash.diagnosis.engine.confidence import Rival
from dtbacklash.diagnosis.engine.parameters import Key
from dtbacklash.diagnosis.explain.differences import changes
from dtbacklash.diagnosis.labels import place_in_words
from dtbacklash.diagnosis.result import UNEXPLAINED, Located, Verdict
from dtbacklash.physics.effects.declare import name_in_words
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate_roughly

#: an experiment that makes two models differ by less is not advised (share of the signal)
TOLD_APART_SHARE = 0.01
DESIGN = "dtb design FOLDER, with the folder of this diagnosis, looks for the experiment that tells what is open apart."
NOTHING = "Nothing is ambiguous in this recording; a second recording would confirm it."
LOG_IT = "Log the command whenever it changes, or as often as the sensors: what is left then shows what it is."
FAULT = (
    "The rig errs by more than the signals move, although each reading corrects it: look for a fault of the recording "
    "(values far off, units, which column is which) before anything else."
)
NOTHING_IN_ALL = "Nothing is ambiguous in these recordings, taken together."
#: of the longest command, what is simulated (samples)
SAMPLES = 20_000


def next_experiment(c: Conclusion, verdict: Verdict, where: Located | None) -> str:
    """What tells a finding from its rival, simulated: a sensor, an amplitude; and the command that designs the rest."""
    pairs = [
        (key, rival) for key in c.model.keys for rival in c.judged.rivals.get(key, ())
        if rival.keys and not rival.beaten
    ]  # fmt: skip
    changed = [(one.title, *one.also_fits) for one in changes(c) or () if one.also_fits]
    said = LOG_IT if c.seen.unlogged(c.model.rig) else ""
    if not said and not c.follows:
        return _fault(c)
    if not said and verdict == UNEXPLAINED and where is not None:
        said = _where(c, where)
    if not said and changed:
        said = f"What changed is open: {' or '.join(f'`{title}`' for title in changed[0])}."
    if not said:
        alone = len({s.record.recording for s in c.seen.stretches}) == 1
        said = _told_apart(c, *pairs[0]) if pairs else NOTHING if alone else NOTHING_IN_ALL
    return f"{said} {DESIGN}" if (pairs or changed) and not c.model.rig.config.model else said


def _fault(c: Conclusion) -> str:
    """What to look for in a recording that the rig, corrected by each reading, does not follow at all."""
    at = c.seen.furthest_off(c.model.rig)
    where = (
        f" It errs most in {at[1]}, {at[2]:.6g} s after the beginning{f' of {at[0]}' if at[0] else ''}." if at else ""
    )
    return f"{FAULT}{where}"


def _where(c: Conclusion, where: Located) -> str:
    """What shows more of what nothing explains; empty where a name is open instead."""
    place = place_in_words(where.location)
    if where.rest is not None:
        return (f"What is missing depends most on the {where.rest.state} of {place}: record it slowly from end to end "
                "of its range, in both directions, and at another speed.")  # fmt: skip
    if c.model.keys:
        return ""
    recorded = set(c.seen.channels)
    others = [name for name in c.search.segments.nominal.sensors if name not in recorded]
    more = (
        f"record {' and '.join(others)} as well" if others else "record another motion, slow and fast, small and large"
    )
    return f"What is missing acts at or near {place}, and depends on no state alone: {more}."


def _told_apart(c: Conclusion, key: Key, rival: Rival) -> str:
    """In which sensor, or at which amplitude, a finding and its rival differ."""
    recorded = set(c.seen.channels)
    other = rival.keys[0]
    what = f"{name_in_words(key[1])} ({key[0]}) from {name_in_words(other[1])} ({other[0]})"
    first, second = c.model.rig, rival.model.rig
    if first.config.model:
        return f"What tells {what} has to be looked for with the model's own simulator."
    here = _differences(c, first, second, 1.0)
    hidden = {n: d for n, d in here.items() if n not in recorded}
    if hidden and max(hidden.values()) > TOLD_APART_SHARE:
        best = max(hidden, key=lambda n: hidden[n])
        return (f"To tell {what}, record {best} as well: there the two differ by {100 * hidden[best]:.0f} % of the "
                "signal.")  # fmt: skip
    ranked = {
        factor: max((d for n, d in _differences(c, first, second, factor).items() if n in recorded), default=0.0)
        for factor in (0.25, 4.0)
    }  # fmt: skip
    factor = max(ranked, key=lambda f: ranked[f])
    if ranked[factor] > TOLD_APART_SHARE:
        return (f"To tell {what}, record once more with the command {factor:g} times as large: the two then differ by "
                f"{100 * ranked[factor]:.0f} % of the signal.")  # fmt: skip
    return f"Neither another sensor of this rig nor another amplitude tells {what}."


def _differences(c: Conclusion, first: Rig, second: Rig, factor: float) -> dict[str, float]:
    """Per sensor, the rms difference of two rigs' answers to the scaled command, relative to the signal."""
    record = c.seen.stretches[0].record
    u = factor * record.u[: min(record.samples, SAMPLES) - 1]
    with np.errstate(over="ignore", invalid="ignore"):
        a = simulate_roughly(first, u, record.sample_time_s).sensors
        b = simulate_roughly(second, u, record.sample_time_s).sensors
        return {name: _relative(a[name], b[name]) for name in a}


def _relative(a: Floats, b: Floats) -> float:
    size = float(np.std(a))
    value = float(np.std(a - b)) / size if size > 0.0 else 0.0
    return value if np.isfinite(value) else 0.0
