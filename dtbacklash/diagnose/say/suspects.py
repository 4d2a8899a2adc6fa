"""A wrong number in the rig: which parameter, times two or ten or a thousand, explains what no name does.

A typo in a rig is the commonest fault of all, and no search finds it: tolerances hold each parameter near its value.
"""

import numpy as np

from dtbacklash.diagnose.conclusion import Conclusion
from dtbacklash.diagnose.engine.free import nominal_free
from dtbacklash.diagnose.say.sentences import quantity
from dtbacklash.errors import UserError

#: a prefix, a slipped point, a radius for a diameter
FACTORS = {1e-3: "a thousandth of", 0.01: "a hundredth of", 0.1: "a tenth of", 0.5: "half", 2.0: "twice",
           10.0: "ten times", 100.0: "a hundred times", 1e3: "a thousand times"}  # fmt: skip


def suspects(c: Conclusion) -> dict[str, float]:
    """Parameter -> the factor at which the nominal rig leaves little of its unknown force; the likeliest first.

    Compared on the beginning of the recording, and with the rules of a name: it has to earn as much and to clear as
    much. Those that are as good as the best stay: only ratios of some parameters show.
    """
    bench, rules, nominal = c.search.quick, c.search.rules, c.search.bench.nominal
    sizes, before = bench.tuned(nominal)
    unknown = bench.most_unknown(sizes)
    found: dict[str, tuple[float, float]] = {}
    for name in (free.name for free in nominal_free(nominal) if not free.effect):
        for factor in FACTORS:
            try:
                rig = nominal.with_parameters({name: factor * nominal.config.parameters[name].value})
                sizes, loss = bench.tuned(rig)
            except (UserError, np.linalg.LinAlgError):
                continue
            clears = bench.most_unknown(sizes) < rules.clears * unknown
            if clears and loss < min(before - rules.worth * bench.count, found.get(name, (np.inf, 0.0))[0]):
                found[name] = loss, factor
    best = min((loss for loss, _ in found.values()), default=0.0)
    near = {n: one for n, one in found.items() if one[0] < best + rules.alike * (before - best)}
    return {name: factor for name, (_, factor) in sorted(near.items(), key=lambda row: row[1][0])}


def suspects_said(c: Conclusion, found: dict[str, float]) -> str:
    """One sentence on what to look at in the rig; empty where nothing is suspected."""
    parameters = c.search.bench.nominal.config.parameters
    said = [
        f"`{name}` fits {FACTORS[factor]} its value ({quantity(factor * p.value, p.unit)} instead of "
        f"{quantity(p.value, p.unit)})"
        for name, factor in found.items()
        for p in (parameters[name],)
    ]
    return f"{', or '.join(said)}: look for a typo in the rig first." if said else ""
