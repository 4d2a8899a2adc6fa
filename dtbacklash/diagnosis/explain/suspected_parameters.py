"""A wrong number in the rig: which parameter, times two or ten or a thousand, explains what no name does.

A typo in a rig is the commonest fault of all, and no search finds it: tolerances hold each parameter near its value.
"""

from collections.abc import Sequence

from dtbacklash.diagnosis.conclusion import Conclusion
from dtbacklash.diagnosis.engine.scale_errors import ScaleError, numbers_suspected
from dtbacklash.diagnosis.explain.sentences import quantity

#: a prefix, a slipped point, a radius for a diameter
FACTORS = {1e-3: "a thousandth of", 0.01: "a hundredth of", 0.1: "a tenth of", 0.5: "half", 2.0: "twice",
           10.0: "ten times", 100.0: "a hundred times", 1e3: "a thousand times"}  # fmt: skip


def suspects(c: Conclusion) -> list[ScaleError]:
    """Parameters that are off by a factor, the likeliest first: instead of a gain, or of the names."""
    search = c.search
    begun = search.begin.rig if search.begin else search.segments.nominal
    noise_levels = search.segments.of_first(c.model.noise_levels)
    return list(c.judged.numbers) or numbers_suspected(
        search.quick, noise_levels, c.model, search.motion, search.rules, begun
    )


def suspects_said(c: Conclusion, found: Sequence[ScaleError]) -> str:
    """One sentence on what to look at in the rig; empty where nothing is suspected."""
    parameters = c.search.segments.nominal.config.parameters
    said = [
        f"`{one.key[1]}` fits {FACTORS.get(float(f'{one.factor:.2g}'), f'{one.factor:.3g} times')} its value "
        f"({quantity(one.factor * p.value, p.unit)} instead of {quantity(p.value, p.unit)})"
        for one in found
        for p in (parameters[one.key[1]],)
    ]
    return f"{', or '.join(said)}: look for a typo in the rig first." if said else ""
