"""Checks of a result, a row each: statistic, threshold, pass or fail, what it means, and where it comes from.

The verdict depends on the rows on whiteness; the others inform a reader. Residuals are in units of the noise floor.
"""

import math

import numpy as np
from scipy.stats import chi2

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.compare import Block, residual
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.data.floor import synthetic
from dtbacklash.diagnose.fit.comparison import EARNS, lead
from dtbacklash.diagnose.fit.free import Errors, Key, nominal_free, standing, stands_at_limit, tolerances_away
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.judge.free_form import Recovered
from dtbacklash.diagnose.result import Check
from dtbacklash.diagnose.search.model import Model
from dtbacklash.diagnose.search.objections import distance, distances
from dtbacklash.diagnose.search.wrong_value import believed
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.diagnose.shown import FreeRunning
from dtbacklash.diagnose.words import place_in_words
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.declare import Effect, Parameter, Role, name_in_words
from dtbacklash.physics.rig import Rig

#: a residual that exceeds the threshold of the test for whiteness so many times has a structure (ratio)
COLOURED_RATIO = 5.0
#: a residual may be so much more coloured than a true model's, of which one simulation tells roughly (ratio)
WHITE_RATIO = 3.0
#: the held-out mean square may be so much larger than the fitted part's by chance (ratio)
OVERFITTED_RATIO = 1.2

FLOOR = "noise floor from the recording itself and a simulated one"
LJUNG_BOX = (
    "Ljung and Box, Biometrika 65 (1978) 297; threshold by simulation: Besag and Diggle, Applied Statistics 26 (1977) "
    "327"
)
HELD_OUT = "Stone, J. R. Stat. Soc. B 36 (1974) 111"
PAIRED = "Diebold and Mariano, J. Bus. Econ. Stat. 13 (1995) 253"
WALD = "Wald, Trans. Am. Math. Soc. 54 (1943) 426; errors: White, Econometrica 50 (1982) 1"
PRIOR = "tolerances of the rig's parameters"
BOUNDS = "bounds of the catalogue"
#: the test for whiteness wants so many samples a lag
SAMPLES_PER_LAG = 10
FREE = "Ljung, System Identification (1999), chapter 16"


def all_checks(
    model: Model, errors: Errors, free: FreeRunning, form: Recovered | None,
    white: dict[str, Check] | None = None,
) -> tuple[Check, ...]:  # fmt: skip
    """All rows.

    errors : standard errors of the last fit's parameters. free : errors of the free simulations. form : the effort of
    free form that beats nothing most significantly. white : see :func:`whiteness`, if that is known already.
    """
    white = whiteness(model.evidence, model.fitted) if white is None else white
    rows = [*_noise(model), *white.values(), *_stateless(form), _generalises(model)]
    rows.append(_recalibration(model))
    if model.keys:
        rows.append(_earned(model))
        rows += [_away_from_nothing(model, key, errors) for key in model.keys]
        rows.append(_inside_bounds(model))
    tolerance = _inside_tolerances(believed(model.evidence.nominal, model.wrong_value), model.fitted.rig)
    return (*rows, *([tolerance] if tolerance else []), _free(free))


def _below(check: str, statistic: float, threshold: float, comment: str, source: str) -> Check:
    known = math.isfinite(statistic)
    return Check(check, statistic if known else None, "<", threshold, known and statistic < threshold, comment, source)


def _above(check: str, statistic: float, threshold: float, comment: str, source: str) -> Check:
    known = math.isfinite(statistic)
    return Check(check, statistic if known else None, ">", threshold, known and statistic > threshold, comment, source)


def _noise(model: Model) -> list[Check]:
    evidence = model.evidence
    squares, least = evidence.mean_square(model.fitted.residuals, "held"), evidence.least()
    floors = SETTINGS.noise_floors
    return [
        _below(
            f"residual of {channel} is noise", float(squares[b.name][j]), floors * float(least[b.name][j]),
            "mean square residual of the held-out part over that of the noise floor; a larger value is unexplained",
            FLOOR,
        )
        for b in evidence.blocks for j, channel in enumerate(b.channels)
    ]  # fmt: skip


def whiteness(evidence: Evidence, fitted: Fit) -> dict[str, Check]:
    """Channel -> whether what is left of its held-out part is white; none of a sensor that is exact."""
    rows: dict[str, Check] = {}
    colour = WHITE_RATIO
    for block in evidence.blocks:
        here = evidence.rows(fitted.residuals, block.name, "held")
        # a short recording is asked for fewer
        lags = min(SETTINGS.white_lags, max(1, here.shape[1] // SAMPLES_PER_LAG))
        truth = _of_a_truth(evidence, fitted.rig, block)
        for j, channel in enumerate(block.channels):
            if evidence.least()[block.name][j] > 1.0:  # an exact sensor: what is left is the method's own error
                continue
            usual = float(chi2.ppf(0.95, lags))
            threshold = max(usual, colour * ljung_box(truth[j], lags)) if truth is not None else usual
            rows[channel] = _below(
                f"residual of {channel} is white", ljung_box(here[j], lags), threshold,
                f"Ljung-Box Q over {lags} lags of the held-out part, against {colour:g} times that of a simulated "
                "recording of the extended rig (encoder counts colour noise, too); a larger value shows structure",
                LJUNG_BOX,
            )  # fmt: skip
    return rows


def coloured(white: dict[str, Check]) -> set[str]:
    """The channels of which far more structure is left than of a simulated truth."""
    ratio = COLOURED_RATIO
    return {c for c, row in white.items() if row.statistic is not None and row.statistic > ratio * row.threshold}


def ljung_box(values: Floats, lags: int) -> float:
    """Ljung and Box's Q: n (n + 2) times the sum over the lags k of r_k^2/(n - k), r the autocorrelation.

    White noise has a chi-square with as many degrees of freedom as lags. It grows with the number of samples: of a
    long record it finds colours that matter to nobody. NaN for fewer than ten samples a lag.
    """
    n = len(values)
    if n < SAMPLES_PER_LAG * lags:
        return math.nan
    e = values - np.mean(values)
    power = float(e @ e)
    if power == 0.0:
        return 0.0
    return n * (n + 2) * sum((float(e[k:] @ e[:-k]) / power) ** 2 / (n - k) for k in range(1, lags + 1))


def _of_a_truth(evidence: Evidence, rig: Rig, block: Block) -> Floats | None:
    """(channels, samples) held-out residuals of a simulated recording of ``rig``; None if it does not stay finite."""
    rng = np.random.default_rng(0)
    left = []
    for record in evidence.records:
        with np.errstate(over="ignore", invalid="ignore"):
            made = synthetic(rig, record, evidence.noise, rng)
            if not all(np.isfinite(v).all() for v in made.y.values()):
                return None
            left.append(residual(rig, block, made)[record.held])
    joined: Floats = np.concatenate(left).T
    return joined


def _stateless(form: Recovered | None) -> list[Check]:
    if form is None:
        return []
    t = form.t if form.fall > SETTINGS.depends_floors else min(form.t, 0.0)
    return [_below(
        "what is left depends on no state", t, SETTINGS.depends_errors,
        f"fall of the held-out loss by an effort of free form over the {form.state} of {place_in_words(form.place)}, "
        "the best of the states, in standard errors over stretches; more: the law is another one, or one is missing",
        PAIRED,
    )]  # fmt: skip


def _generalises(model: Model) -> Check:
    train, held = (model.evidence.mean_square(model.fitted.residuals, part) for part in ("train", "held"))
    ratios = {
        c: float(held[b.name][j] / train[b.name][j]) for b in model.evidence.blocks for j, c in enumerate(b.channels)
    }
    worst = max(ratios, key=lambda c: ratios[c])
    return _below(
        "held-out data fit as well as those fitted to", ratios[worst], OVERFITTED_RATIO,
        f"ratio of the mean squares in the worst channel ({worst}); more is fitted by chance or changes with time",
        HELD_OUT,
    )  # fmt: skip


def _recalibration(model: Model) -> Check:
    evidence = model.evidence
    nominal = evidence.rms(evidence.residuals(evidence.nominal))
    recalibrated, most = evidence.rms(model.nominal.residuals), math.sqrt(SETTINGS.needed_ratio)
    return _below(
        "recalibrated no worse than nominal", recalibrated / max(nominal, 1e-300), most,
        "ratio of the held-out rms errors, both without new physics; more is fitted by chance", HELD_OUT,
    )  # fmt: skip


def _earned(model: Model) -> Check:
    t = lead(model.evidence, model.nominal, model.fitted).t
    return _above(
        "the findings lower the held-out error", t, EARNS.errors,
        "fall of the loss between recalibrated and extended, in standard errors over stretches of the held-out part",
        PAIRED,
    )  # fmt: skip


def _named(key: Key) -> str:
    return f"{name_in_words(key[1])} at {place_in_words(key[0])}"


def _entry(evidence: Evidence, key: Key) -> Effect:
    return find(evidence.nominal.kind_at(key[0]), key[1], key[0])


def _away_from_nothing(model: Model, key: Key, errors: Errors) -> Check:
    evidence = model.evidence
    size, away = _entry(evidence, key).size, distances(evidence, model.fitted.rig, key, errors)
    named = max(away, key=lambda name: np.nan_to_num(away[name], nan=-1.0), default=size.name)
    meaning = "does nothing" if math.isfinite(size.neutral or 0.0) else "is never reached"
    return _above(
        f"{_named(key)} is not zero", distance(evidence, model.fitted.rig, key, errors), SETTINGS.away_errors,
        f"distance of `{named}` from where it {meaning}, in standard errors; less could be nothing at all", WALD,
    )  # fmt: skip


def at_bounds(model: Model) -> list[str]:
    """The parameters of the findings that stand at an end of their range, each with its effect and place in words."""
    return [
        f"`{p.name}` of {_named(key)}"
        for key in model.keys for p in _entry(model.evidence, key).parameters
        if p.role is not Role.ANGLE
        and _at_bound(p, (model.fitted.rig.effect(*key) or {})[p.name], model.evidence.bounds(key).get(p.name))
    ]  # fmt: skip


def at_tolerances(nominal: Rig, rig: Rig) -> list[str]:
    """The parameters of the rig that went as far from nominal as a fit may go."""
    return [f"`{f.title}`" for f in nominal_free(nominal, rig=rig) if stands_at_limit(f, standing(f, rig))]


def _inside_bounds(model: Model) -> Check:
    there = at_bounds(model)
    which = f" ({', '.join(there)})" if there else ""
    return _below(
        "the findings' parameters are inside their bounds", float(len(there)), 1.0,
        f"number of those at an end of their range{which}; there the data did not choose them", BOUNDS,
    )  # fmt: skip


def _at_bound(p: Parameter, value: float, shown: tuple[float, float] | None) -> bool:
    """Whether a value is at an end of its range; ``shown`` : by the recording.

    Zero is an end of a shape. Whether a size is away from it is a matter of its error, see :func:`_away_from_nothing`:
    machines differ by many decades.
    """
    least, most = shown or (p.low, p.high)
    least, most = max(least, p.low), min(most, p.high)
    if least == 0.0:
        low = p.role is not Role.SIZE and value <= 1e-6 * p.typical
    else:
        low = value <= least + SETTINGS.bound_share * abs(least)
    return low or value >= most - SETTINGS.bound_share * abs(most)


def _inside_tolerances(nominal: Rig, rig: Rig) -> Check | None:
    away, most = tolerances_away(nominal, rig), SETTINGS.tolerances_max
    if not away:
        return None
    worst = max(away, key=lambda n: away[n])
    return _below(
        "the rig's parameters are inside their tolerances", away[worst], (1.0 - SETTINGS.bound_share) * most,
        f"the furthest from nominal (`{worst}`), in tolerances; {most:g} is as far as a fit may go, and "
        "there it stands in for missing physics", PRIOR,
    )  # fmt: skip


def _free(free: FreeRunning) -> Check:
    nominal, extended = free.held_out.nominal, free.held_out.extended
    ratio = math.nan if extended is None else 0.0 if nominal is None else extended / nominal if nominal else 1.0
    return _below(
        "on its own it simulates no worse than nominal", ratio, SETTINGS.needed_ratio,
        "held-out error of the extended rig over that of the nominal one, both simulated by the commands alone; more "
        "would be a model that only follows the measurement", FREE,
    )  # fmt: skip
