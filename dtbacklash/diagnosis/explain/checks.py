"""Checks of a result, a row each: statistic, threshold, pass or fail, what it means, and where it comes from."""

import math

import numpy as np
from scipy.special import chdtri

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.conclusion import Conclusion
from dtbacklash.diagnosis.engine.intervals import NORMAL95
from dtbacklash.diagnosis.explain.errors import ErrorTables
from dtbacklash.diagnosis.labels import named_in_words, place_in_words
from dtbacklash.diagnosis.plot_data import FreeRunning
from dtbacklash.diagnosis.result import Check
from dtbacklash.physics.catalogue import find

#: of the test for whiteness, Ljung and Box's usual number of lags, and so many samples a lag
LAGS, SAMPLES_PER_LAG = 20, 10
#: a held-out mean square may be so much larger than noise, or than the fitted part's, by chance (ratio)
BY_CHANCE = 1.2
#: tolerances from nominal that are usual
USUAL = 3.0

INNOVATIONS = "innovations of a true model have this size: Ljung, System Identification (1999), section 16.6"
LJUNG_BOX = "Ljung and Box, Biometrika 65 (1978) 297"
DIFFUSION = "Kristensen, Madsen and Jorgensen, Automatica 40 (2004) 225"
HELD_OUT = "Stone, J. R. Stat. Soc. B 36 (1974) 111"
WALD = "Wald, Trans. Am. Math. Soc. 54 (1943) 426; errors: White, Econometrica 50 (1982) 1"
PRIOR = "tolerances of the rig's parameters"
FREE = "Ljung, System Identification (1999), chapter 16"


def all_checks(c: Conclusion, tables: ErrorTables, free: FreeRunning) -> tuple[Check, ...]:
    """All rows."""
    rows = [*_unknown(c), *_noise(c, tables), *_whiteness(c, tables), _generalises(c, tables)]
    rows += [_away_from_nothing(c, key) for key in c.model.keys if not _is_table(c, key)]
    away = c.beyond()
    if away:
        name = max(away, key=lambda n: away[n])
        rows.append(_below(
            "the rig's parameters stay within what is given", away[name], USUAL,
            f"distance of `{name}`, the furthest, from nominal, in tolerances; more: the rig's value is wrong, or its "
            "tolerance, or it stands in for missing physics", PRIOR,
        ))  # fmt: skip
    before, after = free.held_out.recalibrated, free.held_out.extended
    if before is not None and after is not None:
        rows.append(_below(
            "simulated freely, the extended rig errs no more", after / max(before, 1e-300), BY_CHANCE,
            "ratio of the errors of free simulations of what judges, extended to recalibrated; more: what was found "
            "helps only where the measurement does", FREE,
        ))  # fmt: skip
    return tuple(rows)


def _is_table(c: Conclusion, key: tuple[str, str]) -> bool:
    return find(c.model.rig.kind_at(key[0]), key[1], key[0]).is_table


def _below(check: str, statistic: float, threshold: float, comment: str, source: str) -> Check:
    known = math.isfinite(statistic)
    passed = known and bool(statistic < threshold)
    return Check(check, float(statistic) if known else None, "<", threshold, passed, comment, source)


def _unknown(c: Conclusion) -> list[Check]:
    return [
        _below(
            f"no force is unknown at {place_in_words(body)}", share, c.search.rules.max_unexplained,
            "unknown force that the recording still needs there, as a share of the rms force that moves the body",
            DIFFUSION,
        )
        for body, share in c.unknown(c.last).items()
    ]  # fmt: skip


def _noise(c: Conclusion, tables: ErrorTables) -> list[Check]:
    squares = c.seen.mean_squares(tables.compared[-1], "held")
    return [
        _below(
            f"residual of {channel} is noise", value / tables.floor[channel] ** 2, BY_CHANCE,
            "mean square of the prediction's error on what judges, over what a true model would leave", INNOVATIONS,
        )
        for channel, value in squares.items()
    ]  # fmt: skip


def _whiteness(c: Conclusion, tables: ErrorTables) -> list[Check]:
    errors = tables.compared[-1]
    if errors is None:
        return []
    rows = []
    for channel in c.seen.channels:
        parts = [
            e[s.held, s.predictor.readings.channels.index(channel)]
            for s, e in zip(c.seen.stretches, errors, strict=True) if channel in s.predictor.readings.channels
        ]  # fmt: skip
        left = np.concatenate(parts)
        left = left[np.isfinite(left)]
        if len(left) < SAMPLES_PER_LAG * LAGS:
            continue
        rows.append(_below(
            f"residual of {channel} is white", ljung_box(left, LAGS), float(chdtri(LAGS, 0.05)),
            f"Ljung-Box Q over {LAGS} lags of what judges; more shows structure, as encoder counts and a rate that was "
            "averaged do, too", LJUNG_BOX,
        ))  # fmt: skip
    return rows


def ljung_box(values: Floats, lags: int) -> float:
    """Ljung and Box's Q: n (n + 2) times the sum over the lags k of r_k^2/(n - k), r the autocorrelation.

    White noise has a chi-square with as many degrees of freedom as lags. It grows with the number of samples: of a
    long record it finds colours that matter to nobody.
    """
    n = len(values)
    e = values - np.mean(values)
    power = float(e @ e)
    if power == 0.0:
        return 0.0
    return n * (n + 2) * sum((float(e[k:] @ e[:-k]) / power) ** 2 / (n - k) for k in range(1, lags + 1))


def _generalises(c: Conclusion, tables: ErrorTables) -> Check:
    train, held = (c.seen.mean_squares(tables.compared[-1], part) for part in ("train", "held"))
    ratios = {channel: held[channel] / train[channel] for channel in held if train.get(channel, 0.0) > 0.0}
    worst = max(ratios, key=lambda channel: ratios[channel], default="")
    return _below(
        "held-out data fit as well as those fitted to", ratios.get(worst, math.nan), BY_CHANCE,
        f"ratio of the mean squares in the worst channel ({worst}); more is fitted by chance, changes with time, or "
        "moves more there", HELD_OUT,
    )  # fmt: skip


def _away_from_nothing(c: Conclusion, key: tuple[str, str]) -> Check:
    place, name = key
    entry = find(c.model.rig.kind_at(place), name, place)
    values = c.model.rig.effects[place][name]
    away = {}
    for p in entry.amplitudes:
        if p.neutral is not None and values[p.name] != p.neutral:
            error = max(c.values.errors.get((place, name, p.name), math.nan), 1e-300)
            # what does nothing where it is never reached is compared with the largest command instead of infinity
            away[p.name] = (abs(values[p.name] - p.neutral) if math.isfinite(p.neutral) else values[p.name]) / error
    named = max(away, key=lambda n: np.nan_to_num(away[n], nan=-1.0), default=entry.size.name)
    statistic = away.get(named, math.nan)
    known = math.isfinite(statistic)
    return Check(
        f"{named_in_words(name, place)} is not zero", float(statistic) if known else None, ">", NORMAL95,
        known and bool(statistic > NORMAL95),
        f"distance of `{named}` from where it does nothing, in standard errors; less could be nothing at all", WALD,
    )  # fmt: skip
