"""What a search believes, which never changes in place, and its log of what it has tried, which only grows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import held_loss
from dtbacklash.diagnose.fit.free import Key, penalty_of, tolerances_away, with_tolerance
from dtbacklash.diagnose.fit.problem import Fit, weights_for
from dtbacklash.diagnose.propose.locate import Score


@dataclass(frozen=True)
class Trial:
    """One candidate that was fitted.

    held_out : what the fit leaves of the held-out part, in floors. beside : the number of effects that were named then.
    reason : why no recording can tell a rival from what is named, in words; empty where another recording may.
    """

    key: Key
    score: Score
    fitted: Fit
    held_out: float
    beside: int = 0
    reason: str = ""


@dataclass(frozen=True)
class Asked:
    """A bank's scores, the residual that they were scored on, (rows,), and what that was of."""

    evidence: Evidence
    scores: list[Score]
    residual: Floats


@dataclass(frozen=True)
class WrongValue:
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


@dataclass(frozen=True)
class Named:
    """An effect that the model has.

    tried : what was fitted in its place. alike : what no recording can tell from it.
    """

    key: Key
    tried: tuple[Trial, ...] = ()
    alike: tuple[Trial, ...] = ()


@dataclass(frozen=True)
class Model:
    """What is believed: the evidence, the nominal rig's own fit, and the fit with the effects that are named.

    wrong_value : the parameter that is beyond its tolerance, instead of effects; ``could_be`` : one that would explain
    as much as they do. formulations : per block, (channels,) what other formulations of the named laws explain more,
    mean square in units of the floor's.
    """

    evidence: Evidence
    nominal: Fit
    fitted: Fit
    named: tuple[Named, ...] = ()
    wrong_value: WrongValue | None = None
    could_be: WrongValue | None = None
    formulations: dict[str, Floats] = field(default_factory=dict)

    @property
    def keys(self) -> tuple[Key, ...]:
        """The named effects, in the order in which they were added."""
        return tuple(n.key for n in self.named)

    def about(self, key: Key) -> Named:
        """What is known of a named effect.

        Raises
        ------
        KeyError : it is not named.
        """
        for named in self.named:
            if named.key == key:
                return named
        raise KeyError(key)

    def plus(self, fitted: Fit, named: Named) -> Model:
        """With one more effect."""
        return replace(self, fitted=fitted, named=(*self.named, named))

    def minus(self, fitted: Fit, *keys: Key) -> Model:
        """Without some effects."""
        return replace(self, fitted=fitted, named=tuple(n for n in self.named if n.key not in keys))

    def instead(self, fitted: Fit, key: Key, named: Named) -> Model:
        """With another effect, or other knowledge of it, in the place of ``key``."""
        return replace(self, fitted=fitted, named=tuple(named if n.key == key else n for n in self.named))

    def seen_by(self, evidence: Evidence) -> Model:
        """The same about evidence whose floor is another one: all fits, and what they leave, in its units."""
        before = self.evidence

        def seen(trial: Trial) -> Trial:
            return rescaled(trial, before, evidence)

        return replace(
            self,
            evidence=evidence,
            nominal=_rescaled(self.nominal, before, evidence),
            fitted=_rescaled(self.fitted, before, evidence),
            named=tuple(
                replace(n, tried=tuple(map(seen, n.tried)), alike=tuple(map(seen, n.alike))) for n in self.named
            ),
        )


def seen_by(evidence: Evidence, fitted: Fit) -> Fit:
    """A fit as other evidence of the same recordings, with another pull, sees it."""
    residuals = evidence.residuals(fitted.rig)
    penalty = penalty_of(fitted.rig, evidence.nominal)
    return replace(fitted, residuals=residuals, penalty=penalty, weights=weights_for(evidence, residuals))


def _rescaled(fitted: Fit, before: Evidence, after: Evidence) -> Fit:
    residuals = after.rescaled(fitted.residuals, before)
    return replace(fitted, residuals=residuals, weights=weights_for(after, residuals))


def rescaled(trial: Trial, before: Evidence, after: Evidence) -> Trial:
    """A trial that was fitted to ``before``, in units of the floor of ``after``."""
    fitted = _rescaled(trial.fitted, before, after)
    return replace(trial, fitted=fitted, held_out=held_loss(after, fitted))


@dataclass
class Log:
    """What a search has tried. Entries are added and never changed.

    banks : each bank that was asked, in order. trials : each with the evidence that it was fitted to, and what was said
    of trials. wrong_values : parameters that were let go beyond their tolerances. refused : what fits and is not
    believed, and why; the last word on an effect counts.
    """

    banks: list[Asked] = field(default_factory=list)
    trials: list[tuple[Trial, Evidence]] = field(default_factory=list)
    verdicts: list[tuple[Trial, str]] = field(default_factory=list)
    wrong_values: list[WrongValue] = field(default_factory=list)
    refused: dict[Key, str] = field(default_factory=dict)
    _left_out: list[tuple[Fit, Key, Fit]] = field(default_factory=list)
    _in_place: list[tuple[Fit, Trial]] = field(default_factory=list)

    @property
    def scores(self) -> list[Score]:
        """Of the first bank that had any, about the recalibrated rig."""
        return next((asked.scores for asked in self.banks if asked.scores), [])

    def tried(self, evidence: Evidence, trials: list[Trial]) -> None:
        """Note trials that were fitted to ``evidence``."""
        self.trials += [(trial, evidence) for trial in trials]

    def verdict(self, trial: Trial) -> str:
        """What was said last of a trial; empty if nothing was."""
        return next((said for of, said in reversed(self.verdicts) if of is trial), "")

    def refuse(self, key: Key, why: str, trial: Trial | None = None) -> None:
        """Note that an effect is not believed; it is not tried again."""
        self.refused = {**self.refused, key: why}
        if trial is not None:
            self.verdicts.append((trial, why))

    def left_out(self, fitted: Fit, key: Key, make: Callable[[], Fit]) -> Fit:
        """The fit without an effect of ``fitted``: as it was made before, or made now."""
        for of, gone, made in self._left_out:
            if of is fitted and gone == key:
                return made
        self._left_out.append((fitted, key, make()))
        return self._left_out[-1][2]

    def in_place(self, without: Fit) -> dict[Key, Trial]:
        """The rivals that were fitted beside the effects of ``without``."""
        return {trial.key: trial for beside, trial in self._in_place if beside is without}

    def note_in_place(self, without: Fit, trials: list[Trial]) -> None:
        """Note rivals that were fitted beside the effects of ``without``."""
        self._in_place += [(without, trial) for trial in trials]
