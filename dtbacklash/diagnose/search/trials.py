"""What a search has tried and found: plain records, which the steps after the search read."""

from dataclasses import dataclass, field

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import Key, tolerances_away, with_tolerance
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.propose.locate import Score
from dtbacklash.diagnose.settings import settings


@dataclass
class Trial:
    """One candidate that was fitted: the fit, what it leaves of the held-out part, beside how many found effects.

    reason : why no recording can tell a rival, in words; empty where another one may.
    """

    key: Key
    score: Score
    fitted: Fit
    held_out: float
    verdict: str = ""
    beside: int = 0
    reason: str = ""


@dataclass(frozen=True)
class Asked:
    """A bank's scores, the residual that they were scored on, (rows,), and what that was of."""

    evidence: Evidence
    scores: list[Score]
    residual: Floats


@dataclass(frozen=True)
class Beyond:
    """A fit with one parameter that may be beyond its tolerance, and no physics missing.

    name, tolerance : of the parameter, as given. evidence : about the rig in which its tolerance is wide.
    instead_of : the effects that would explain no less, and that it takes the place of.
    """

    name: str
    tolerance: float
    evidence: Evidence
    fitted: Fit
    instead_of: tuple[Key, ...] = ()

    @property
    def tolerances(self) -> float:
        """How many of its tolerances, as given, the parameter is off."""
        given = with_tolerance(self.evidence.nominal, self.name, self.tolerance)
        return tolerances_away(given, self.fitted.rig)[self.name]


@dataclass
class Search:
    """What the search did: the nominal rig's fit, the last fit, every trial, and per effect what would fit as well."""

    evidence: Evidence
    nominal: Fit
    fitted: Fit
    order: list[Key]
    trials: list[Trial] = field(default_factory=list)
    #: so many effects are looked for at most
    most: int = field(default_factory=lambda: settings().effects_max)
    rivals: dict[Key, list[Trial]] = field(default_factory=dict)
    #: per effect what was fitted beside it when it was added
    tried: dict[Key, list[Trial]] = field(default_factory=dict)
    scores: list[Score] = field(default_factory=list)
    #: the bank that was asked last
    last: Asked | None = None
    #: per effect the simplest at its place that would be named if it were not there, but explains less
    instead: dict[Key, Trial] = field(default_factory=dict)
    #: what fitted and was not believed: why
    refused: dict[Key, str] = field(default_factory=dict)
    #: per effect the fit without it, and the fit that all of these are of
    left_out: dict[Key, Fit] = field(default_factory=dict)
    left_out_of: Fit | None = None
    #: rivals that were fitted in the place of an effect, each with the fit that it was fitted beside
    against: list[tuple[Fit, Trial]] = field(default_factory=list)
    #: per block what other formulations of laws that were found explain more, mean square in units of the floor's
    formulations: dict[str, Floats] = field(default_factory=dict)
    #: the parameter that is beyond its tolerance, instead of all findings; and one that would explain as much
    beyond: Beyond | None = None
    as_well: Beyond | None = None
