"""The sentences of a diagnosis."""

from typing import Any

import numpy as np

from dtbacklash.diagnose.evidence import Evidence
from dtbacklash.diagnose.name import Key, Search
from dtbacklash.physics.catalogue import name_in_words

#: a mismatch that lies within one of these times of an event is said to lie there, s
NEAR_S = (0.05, 0.1, 0.2, 0.3)
#: a second best that leaves more than this many times the error explains nothing
WORTH_SAYING = 10.0
#: slower than this share of the highest speed is taken as rest
TREMOR = 0.02


def quantity(value: float, unit: str) -> str:
    """A number with its unit, three digits; lengths in millimetres."""
    if unit == "m":
        value, unit = 1e3 * value, "mm"
    return f"{value:.3g}" + ("" if unit in ("", "1") else f" {unit}")


def less(instead: dict[str, Any] | None) -> str:
    """What the second best would be, where there is one that explains a part."""
    if instead is None or not 1.0 <= instead["times_the_error"] <= WORTH_SAYING:
        return ""
    what = f"{name_in_words(instead['effect'])} ({quantity(instead['value'], instead['unit'])})"
    worse = instead["times_the_error"]
    times = f"{worse:.2g}" if worse < 10.0 else f"{worse:.0f}"
    place = instead["location"].replace("_", " ")
    return (f" If the catalogue did not hold that, {what} at the {place} would be named, "
            f"with {times} times the error; it is not needed beside it.")  # fmt: skip


def when(evidence: Evidence, found: Search, key: Key) -> str:
    """When the effect matters: where the square of what it changes in the prediction lies."""
    place, name = key
    without = evidence.residuals(found.fitted.rig.with_effect(place, name, None), found.fitted.residuals, {place})
    record = evidence.records[0]
    change = np.zeros(record.samples)
    for block in evidence.blocks:
        difference = without[block.name][0] - found.fitted.residuals[block.name][0]
        change += np.sum(difference**2, axis=1)
    if change.sum() <= 0.0:
        return "the effect does not change the prediction of this recording"
    # a positioner's command is the motion itself
    imposed = evidence.nominal.only("positioner") is not None
    signal = record.u if imposed else record.y[evidence.blocks[0].channels[0]]
    smooth = np.convolve(np.gradient(signal), np.ones(11) / 11, "same")
    moving = np.flatnonzero(np.abs(smooth) > TREMOR * np.abs(smooth).max())
    turns = moving[1:][np.diff(np.sign(smooth[moving])) != 0]
    before = max(1, round(NEAR_S[0] / record.sample_time_s))
    for near_s in NEAR_S:
        near = max(1, round(near_s / record.sample_time_s))
        mask = np.zeros(record.samples, dtype=bool)
        for k in turns:
            mask[max(0, k - before) : k + near] = True
        share = float(change[mask].sum() / change.sum())
        if share > 0.5 and mask.mean() < 0.6 * share:
            return f"{100 * share:.0f} % of the mismatch lies within {1e3 * near_s:.0f} ms of a velocity reversal"
    fast = np.abs(smooth) > np.quantile(np.abs(smooth), 0.75)
    share = float(change[fast].sum() / change.sum())
    if share > 0.5:
        return f"{100 * share:.0f} % of the mismatch lies in the quarter of the time in which it moves fastest"
    order = np.sort(change)[::-1]
    busy = float(np.searchsorted(np.cumsum(order), 0.8 * change.sum()) / record.samples)
    if busy > 0.4:
        return "the mismatch is spread over the whole recording"
    return f"80 % of the mismatch lies in {100 * busy:.0f} % of the time"


def summary(
    verdict: str, findings: list[dict[str, Any]], recalibrated: dict[str, Any], located: dict[str, Any] | None
) -> str:
    """Two or three sentences."""
    parts = []
    if verdict == "consistent":
        return "The recording agrees with the rig: what is left is the sensors' noise."
    if verdict == "parameters":
        names = ", ".join(f"{n} = {quantity(p['value'], p['unit'])}" for n, p in recalibrated.items())
        return f"No physics is missing: recalibrated parameters explain the recording ({names})."
    parts += [f["sentence"] for f in findings]
    for finding in findings:
        if finding["also_fits"]:
            others = " or ".join(f"{name_in_words(o['effect'])} at the {o['location'].replace('_', ' ')}"
                                 for o in finding["also_fits"])  # fmt: skip
            parts.append(f"This recording cannot tell {name_in_words(finding['effect'])} from {others}.")
    if verdict == "unexplained" and located:
        said = "What remains" if findings else "The mismatch"
        parts.append(f"{said} is real and lies at or near {located['location'].replace('_', ' ')}, "
                     "but nothing in the catalogue explains it.")  # fmt: skip
    return " ".join(parts)
