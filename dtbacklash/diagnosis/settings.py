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
        0.2, "end of a recording that is not fitted to where no other recording judges", unit="share")
    min_gain: float = setting(
        0.02, "a name has to earn so much for each reading; less is how a law is formulated",
        unit="-2 log-likelihood a reading")
    min_gain_if_clearing: float = setting(
        0.002, "a name that takes the unknown force away has to earn so much", unit="-2 log-likelihood a reading")
    clearing_ratio: float = setting(
        0.3, "a name takes the unknown force away if it leaves less of it; and what was missing is explained",
        unit="share")
    tie_ratio: float = setting(
        0.1, "of two that are nearer than this share of what a name has to earn, or explains, the simpler is taken",
        unit="share")
    min_effect: float = setting(
        0.015, "a law that makes less of what acts at its place is none", unit="share of what acts")
    unexplained_attention: float = setting(
        0.01, "more unknown force is looked at closely: priors stay stiff, and three times as much is missing physics",
        unit="share of what acts")
    max_unexplained: float = setting(
        0.1, "where more unknown force is left, gains are tried at wrong factors, and a finer rate",
        unit="share of what acts")
    min_t: float = setting(
        3.0, "a model leads another by so much; a name is sure if it leads all rivals in all views",
        unit="standard errors")
    min_shift: float = setting(
        0.25, "a parameter of the rig that moved by less is as it was given", unit="tolerances")

    def to_json(self) -> dict[str, dict[str, Any]]:
        """Name -> value, unit and reason."""
        return {
            one.key: {"value": getattr(self, one.key), "unit": one.about.unit, "reason": one.about.meaning}
            for one in declared(DiagnoseSettings)
        }
# fmt: on


SETTINGS = DiagnoseSettings()
