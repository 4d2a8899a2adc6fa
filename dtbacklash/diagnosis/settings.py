"""The numbers that decide what a diagnosis says, all of them: each with its value, its unit, and what it is.

docs/method.md says where each is used. None is changed while a program runs; every other number of the diagnosis is
numerical, and stands beside its code.
"""

from dataclasses import dataclass
from typing import Any

from dtbacklash.config.setting import declared, setting


# fmt: off
@dataclass(frozen=True)
class DiagnoseSettings:
    """All of them. "Unknown force" is that of the predictor, a share of the largest force that acts at a body."""

    held_out_share: float = setting(
        0.2, "end of a recording that is held out if no other recording judges", unit="share")
    min_gain: float = setting(
        0.02, "gain of the score that a name needs for each reading", unit="-2 log-likelihood a reading")
    min_gain_if_clearing: float = setting(
        0.002, "the same for a name that takes the unknown force away", unit="-2 log-likelihood a reading")
    clearing_ratio: float = setting(
        0.3, "a name takes the unknown force away, and the mismatch is explained, if less of the force remains",
        unit="share")
    tie_ratio: float = setting(
        0.1, "of two models that differ by less than this share of the gain, the simpler is taken", unit="share")
    min_effect: float = setting(
        0.015, "a law that makes a smaller force at its place is no finding", unit="share of the force that acts")
    unexplained_attention: float = setting(
        0.01, "above it priors stay stiff; three times as much without a finding is missing physics",
        unit="share of the force that acts")
    max_unexplained: float = setting(
        0.1, "above it scale errors and a finer rate are tried", unit="share of the force that acts")
    min_t: float = setting(
        3.0, "lead of one model over another; a sure name leads all alternatives at all horizons",
        unit="standard errors")
    min_shift: float = setting(
        0.25, "a parameter of the rig that moved by less counts as not moved", unit="tolerances")

    def to_json(self) -> dict[str, dict[str, Any]]:
        """Name -> value, unit and reason."""
        return {
            one.key: {"value": getattr(self, one.key), "unit": one.about.unit, "reason": one.about.meaning}
            for one in declared(DiagnoseSettings)
        }
# fmt: on


SETTINGS = DiagnoseSettings()
