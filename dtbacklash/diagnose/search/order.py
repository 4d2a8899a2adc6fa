"""Which candidates are worth a fit, and the order in which fits are asked whether they earn their place."""

from dtbacklash.diagnose.data.compare import places_of
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import TOLD, alike, merit
from dtbacklash.diagnose.fit.free import Key
from dtbacklash.diagnose.propose.locate import Score
from dtbacklash.diagnose.search.model import Model, Trial
from dtbacklash.diagnose.search.simpler_law import has_become
from dtbacklash.diagnose.settings import SETTINGS

#: a signature has to promise as much a sample: less is chance (floors, mean square)
GAIN_FLOOR_SHARE = 0.0075


def promising(evidence: Evidence, scores: list[Score]) -> list[Score]:
    """The scores that promise as much as an effect has to earn."""
    samples = sum(int(r.train.sum()) for r in evidence.records)
    floors = GAIN_FLOOR_SHARE * samples
    return [s for s in scores if s.gain > max(SETTINGS.gain_min, floors * s.lightest)]


def is_named_already(model: Model, trial: Trial) -> bool:
    """Whether a trial's law has reached the limit that is a law named at its place, or the other way round.

    The same law twice explains nothing more, and two laws that each stick chatter, which takes seconds to simulate.
    """
    evidence, (place, name) = model.evidence, trial.key
    there = {effect for at, effect in model.keys if at == place}
    became = {has_become(evidence, model.fitted, (place, effect)) for effect in there}
    return has_become(evidence, trial.fitted, trial.key) in there or name in became


def apart(evidence: Evidence, trials: list[Trial]) -> list[list[Trial]]:
    """All trials; then, for the case that none of them earns its place, those that share no block with the best.

    The best trial in one block may earn nothing there and still hide what is missing in another block.
    """
    if not trials:
        return []
    best = min(trials, key=lambda t: merit(evidence, t.fitted))
    return [trials, [t for t in trials if not meet(evidence, best.key, t.key)]]


def simplest_first(evidence: Evidence, trials: list[Trial]) -> list[Trial]:
    """The trials that fit as well as the best, those with the fewest parameters first."""
    ranked = sorted(trials, key=lambda t: merit(evidence, t.fitted))
    if not ranked:
        return []
    best = ranked[0]
    equal = [t for t in ranked if t is best or alike(evidence, best.fitted, t.fitted, TOLD)]
    return sorted(equal, key=lambda t: (len(t.score.candidate.effect.parameters), merit(evidence, t.fitted)))


def meet(evidence: Evidence, first: Key, second: Key) -> bool:
    """Whether two effects act in the same block."""
    return any({first[0], second[0]} <= places_of(evidence.nominal, b) for b in evidence.blocks)
