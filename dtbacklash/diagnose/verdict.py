"""Verdict: from a finished search to what is said, with intervals, rivals and what to record next."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from dtbacklash.diagnose.candidates import positions
from dtbacklash.diagnose.command import CLEARLY, held_equivalent
from dtbacklash.diagnose.compare import Record
from dtbacklash.diagnose.earn import held_loss
from dtbacklash.diagnose.evidence import Evidence
from dtbacklash.diagnose.intervals import standard_errors
from dtbacklash.diagnose.name import Key, Search, search
from dtbacklash.diagnose.next_experiment import next_experiment
from dtbacklash.diagnose.recover import Recovered, locate_rest, recover
from dtbacklash.diagnose.refit import Fit, fit, nominal_free
from dtbacklash.diagnose.sayings import less, quantity, summary, when
from dtbacklash.diagnose.slow import refit_slowly
from dtbacklash.diagnose.spread import on_cores
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig

Errors = dict[tuple[str, str, str], float]
Moved = dict[str, tuple[float, float]]

CONSISTENT, PARAMETERS, MISSING, UNEXPLAINED = "consistent", "parameters", "missing_physics", "unexplained"

#: a channel's mean square, in units of the floor's, below which it is noise
NOISE = 1.2
#: the same of the part of the recording where it is larger
NOISE_ONCE = 2.0
#: share of the excess over the floor that may remain when physics has been named
REMAINS = 0.1
#: effect -> (parameter, the law that it becomes where the parameter is small): Bouc-Wen is dry friction then
LIMITS = {"hysteresis": ("displacement", "dry_friction")}
#: small is below this share of the link's stretch
SHARP = 0.03
#: a parameter has moved when it did so by this share of its tolerance
MOVED_SHARE = 0.2
#: and by as many standard errors: what only follows another one along a direction that cannot be seen has not
MOVED_ERRORS = 0.7


@dataclass(frozen=True)
class Diagnosis:
    """The result of a diagnosis.

    verdict : one of the four. search : fits, trials and rivals. evidence : recordings, blocks, floor. nominal : the
    rig as it was given. extended : the rig with what was found. recovered : per finding its effect and the effort
    that a model without it lacks; last, with an empty effect, what nothing explains. document : the content of
    ``diagnosis.json``.
    """

    verdict: str
    evidence: Evidence
    search: Search
    nominal: Rig
    extended: Rig
    recovered: list[tuple[str, Recovered]]
    document: dict[str, Any]

    def to_json(self) -> dict[str, Any]:
        """The content of ``diagnosis.json``."""
        return self.document


def diagnose_records(
    rig: Rig, records: list[Record], progress: Callable[[str, float], None] | None = None, jobs: int | None = None
) -> Diagnosis:
    """Diagnose recordings on a rig.

    Parameters
    ----------
    rig : the nominal rig; effects that it has already are kept and fitted anew.
    records : with masks of the samples to fit and to judge on. progress : called with a text and a share, 0 to 1.
    jobs : threads; None leaves what joblib has been told, else one.

    Raises
    ------
    UserError : no channel of the rig was recorded, an integrating part not measured, or nothing was commanded.
    """
    if not any(np.any(r.u[r.train]) for r in records):
        raise UserError("recording", "u", "it is 0 in all that is fitted: record the machine while it is commanded")
    # many short products of long vectors: threads of the linear algebra would cost more than they bring
    with on_cores(jobs), threadpool_limits(1, "blas"):
        evidence, note = _read_command(rig, records)
        found = search(evidence, progress)
        evidence = found.evidence
        slow, fitted = refit_slowly(evidence, found)
        errors = standard_errors(slow, fitted)
        moved = _moved(evidence, found.fitted, errors)
        verdict = _verdict(evidence, found, moved)
        recovered = _recovered(evidence, found, verdict)
        document = _document(evidence, found, verdict, errors, moved, recovered)
    document["notes"] = [note] if note else []
    return Diagnosis(verdict, evidence, found, rig, found.fitted.rig, recovered, document)


def _read_command(rig: Rig, records: list[Record]) -> tuple[Evidence, str]:
    """The evidence with the command held between its samples, or smooth where that fits clearly better."""
    held = Evidence.gather(rig, records)
    if rig.only("actuator") is None:
        return held, ""
    smooth = Evidence.gather(rig, [replace(r, u=held_equivalent(r.u)) for r in records])
    losses = []
    for evidence in (held, smooth):
        fitted = fit(evidence, rig, nominal_free(rig), rounds=1)
        squares = evidence.mean_square(fitted.residuals, "train")
        losses.append(sum(float(np.sum(v * held.floor[n] ** 2)) for n, v in squares.items()))
    if losses[1] < CLEARLY * losses[0]:
        return smooth, "The command is a measured signal: it passes smoothly through its samples instead of being held."
    return held, ""


def _squares(evidence: Evidence, fitted: Fit) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Per block, (channels,) the smaller and the larger mean square of the two parts, in units of the floor's."""
    train, held = evidence.mean_square(fitted.residuals, "train"), evidence.mean_square(fitted.residuals, "held")
    return (
        {name: np.minimum(train[name], held[name]) for name in train},
        {name: np.maximum(train[name], held[name]) for name in train},
    )


def remaining(evidence: Evidence, found: Search) -> dict[str, float]:
    """Per block, the share of the recalibrated model's excess over the floor that the last fit leaves."""
    first, last = _squares(evidence, found.nominal), _squares(evidence, found.fitted)
    least, shares = evidence.least(), {}
    for name in least:
        quiet = last[0][name] < NOISE * least[name]
        # what happens in one part only has not been explained either: then that part counts
        once = quiet & (last[1][name] > NOISE_ONCE * least[name])
        left = np.where(once, last[1][name], last[0][name]) - 1.0
        before = np.where(once, first[1][name], first[0][name]) - 1.0
        shares[name] = float(np.max(np.where(quiet & ~once, 0.0, left) / np.maximum(before, 1e-9)))
    return shares


def _verdict(evidence: Evidence, found: Search, moved: Moved) -> str:
    left = max(remaining(evidence, found).values())
    if left > REMAINS:
        return UNEXPLAINED
    if found.order:
        return MISSING
    return PARAMETERS if moved else CONSISTENT


def _moved(evidence: Evidence, fitted: Fit, errors: Errors) -> Moved:
    """Nominal parameters that had to move: name -> (value, standard error)."""
    if not _needed(evidence, fitted):
        return {}
    moved: Moved = {}
    clearly: dict[str, float] = {}
    for name, p in evidence.nominal.config.parameters.items():
        value, error = fitted.rig.config.parameters[name].value, errors.get(("", "", name))
        if error is None or p.tolerance == 0.0:
            continue
        away = abs(value - p.value)
        if away > MOVED_SHARE * p.tolerance * abs(p.value):
            moved[name] = (value, error)
            clearly[name] = away / max(error, 1e-300)
    least = min(MOVED_ERRORS, max(clearly.values(), default=0.0))
    return {name: found for name, found in moved.items() if clearly[name] >= least}


def _needed(evidence: Evidence, fitted: Fit) -> bool:
    """Whether recalibration improves the held-out part at all."""
    nominal = evidence.mean_square(evidence.residuals(_uncalibrated(evidence, fitted)), "held")
    here = evidence.mean_square(fitted.residuals, "held")
    return any(bool(np.any(nominal[n] > 1.03 * here[n])) for n in here)


def _uncalibrated(evidence: Evidence, fitted: Fit) -> Rig:
    values = {name: p.value for name, p in evidence.nominal.config.parameters.items()}
    return fitted.rig.with_parameters(values)


def _recovered(evidence: Evidence, found: Search, verdict: str) -> list[tuple[str, Recovered]]:
    listed = [(key[1], recover(evidence, found.fitted, *key)) for key in found.order]
    if verdict == UNEXPLAINED:
        listed.append(("", locate_rest(evidence, found.fitted)))
    return [(effect, r) for effect, r in listed if r is not None]


def _document(
    evidence: Evidence, found: Search, verdict: str, errors: Errors, moved: Moved,
    recovered: list[tuple[str, Recovered]],
) -> dict[str, Any]:  # fmt: skip
    located = _located(evidence, found, next((r for effect, r in recovered if not effect), None))
    findings = [_finding(evidence, found, key, errors) for key in found.order]
    units = {name: p.unit for name, p in evidence.nominal.config.parameters.items()}
    recalibrated = {
        name: {"nominal": evidence.nominal.config.parameters[name].value, "value": value, "unit": units[name],
               "ci95": [value - 1.96 * error, value + 1.96 * error]}
        for name, (value, error) in moved.items()
    }  # fmt: skip
    return {
        "verdict": verdict,
        "summary": summary(verdict, findings, recalibrated, located),
        "findings": findings,
        "recalibrated": recalibrated,
        "fit": _fit_table(evidence, found),
        "candidates": _candidates(found),
        "located": located,
        "next_experiment": next_experiment(evidence, found, next((r for e, r in recovered if not e), None)),
    }


def _finding(evidence: Evidence, found: Search, key: Key, errors: Errors) -> dict[str, Any]:
    place, name = key
    entry = find(evidence.nominal.kind_at(place), name, place)
    values = found.fitted.rig.effect(place, name) or {}
    units = {p.name: p.unit for p in entry.parameters}
    if place.startswith("sensor_") and name == "offset":
        units["offset"] = evidence.nominal.sensors[place.removeprefix("sensor_")].unit
    parameters: dict[str, dict[str, Any]] = {}
    for p in entry.parameters:
        error, value = errors.get((place, name, p.name), float("nan")), values[p.name]
        interval = [max(value - 1.96 * error, p.low), min(value + 1.96 * error, p.high)]
        parameters[p.name] = {"value": value, "unit": units[p.name], "ci95": interval}
    instead = _instead(evidence, found, key)
    shown = {n: quantity(p["value"], p["unit"]) for n, p in parameters.items()}
    said = entry.sentence.format(location=place.replace("_", " "), **shown)
    return {
        "location": place,
        "effect": name,
        "parameters": parameters,
        "also_fits": _also_fits(evidence, found, key, values),
        "when": when(evidence, found, key),
        "instead": instead,
        "sentence": said[:1].upper() + said[1:] + less(instead),
    }


def _also_fits(evidence: Evidence, found: Search, key: Key, values: dict[str, float]) -> list[dict[str, str]]:
    """What this recording cannot tell from a finding: fits that are as good, and the law that it is the limit of."""
    listed = [t.key for t in found.rivals.get(key, [])]
    parameter, limit = LIMITS.get(key[1], ("", ""))
    record, (place, _) = evidence.records[0], key
    if limit:
        a, b = evidence.nominal.elements[place].neighbours["between"]
        at = positions(found.fitted.rig, evidence.blocks, record)
        stretch = at.get(b, np.zeros(1)) - at.get(a, np.zeros(1))
        if values[parameter] < SHARP * float(np.quantile(np.abs(stretch - np.mean(stretch)), 0.95)):
            listed.append((place, limit))
    return [{"location": place, "effect": effect} for place, effect in dict.fromkeys(listed)]


def _instead(evidence: Evidence, found: Search, key: Key) -> dict[str, Any] | None:
    """What would be named if an effect were not in the catalogue: place, effect, size, and how much worse it is."""
    trial = found.instead.get(key)
    if trial is None or trial.key in found.order:
        return None
    size = find(evidence.nominal.kind_at(trial.key[0]), trial.key[1], trial.key[0]).size
    values = trial.fitted.rig.effect(*trial.key) or {}
    worse = held_loss(evidence, trial.fitted) / held_loss(evidence, found.fitted)
    return {"location": trial.key[0], "effect": trial.key[1], "value": values.get(size.name, size.neutral),
            "unit": size.unit, "times_the_error": worse}  # fmt: skip


def _located(evidence: Evidence, found: Search, rest: Recovered | None) -> dict[str, Any] | None:
    """Where what is left sits: the block, and the place and state whose effort explains most of it."""
    shares = remaining(evidence, found)
    name = max(shares, key=lambda n: shares[n])
    if shares[name] <= REMAINS:
        return None
    located: dict[str, Any] = {"block": name, "location": name, "share": shares[name]}
    if rest is not None:
        points = zip(rest.knots.tolist(), rest.effort.tolist(), rest.error.tolist(), strict=True)
        located |= {
            "location": rest.place, "state": rest.state, "state_unit": rest.state_unit,
            "effort_unit": rest.effort_unit, "explained": rest.share, "recovered": [list(p) for p in points],
        }  # fmt: skip
    return located


def _fit_table(evidence: Evidence, found: Search) -> dict[str, Any]:
    fits = {
        "nominal": evidence.residuals(evidence.nominal), "recalibrated": found.nominal.residuals,
        "extended": found.fitted.residuals,
    }  # fmt: skip
    scale = {
        b.name: evidence.floor[b.name] / np.array([max(np.std(evidence.records[0].y[c]), 1e-300) for c in b.channels])
        for b in evidence.blocks
    }
    table: dict[str, Any] = {"metric": "nrmse", "channels": [c for b in evidence.blocks for c in b.channels]}
    for part, label in (("train", "train"), ("held", "held_out")):
        table[label] = {}
        for name, residuals in fits.items():
            squares = evidence.mean_square(residuals, part)
            parts = np.concatenate([squares[b] * scale[b] ** 2 for b in squares])
            table[label][name] = float(np.sqrt(np.mean(parts)))
    table["noise_floor"] = float(np.sqrt(np.mean(np.concatenate(list(scale.values())) ** 2)))
    return table


def _candidates(found: Search) -> list[dict[str, Any]]:
    tried = {t.key: t for t in found.trials}
    rows = []
    for score in found.scores:
        key = score.candidate.key
        trial = tried.get(key)
        verdict = "added" if key in found.order else "low score"
        if trial and key not in found.order:
            others = f" beside {trial.beside} found" if trial.beside else ""
            verdict = trial.verdict or f"fitted{others}, does not earn its place"
        rows.append({"location": key[0], "effect": key[1], "score": score.gain,
                     "held_out": trial.held_out if trial else None, "verdict": verdict})  # fmt: skip
    return rows
