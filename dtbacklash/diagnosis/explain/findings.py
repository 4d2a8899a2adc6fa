"""Findings: from the names of the last model to what is said of them, with intervals, rivals and limits."""

import math
from dataclasses import replace

from dtbacklash.diagnosis.conclusion import Conclusion, is_there
from dtbacklash.diagnosis.engine.candidates import CandidateSensitivities
from dtbacklash.diagnosis.engine.confidence import Rival, confidence_set
from dtbacklash.diagnosis.engine.intervals import NORMAL95
from dtbacklash.diagnosis.engine.parameters import Key, held, in_recording, unit_at, unit_of
from dtbacklash.diagnosis.explain.differences import apart_said, only_said
from dtbacklash.diagnosis.explain.sentences import certainty_said, less, quantity, when
from dtbacklash.diagnosis.findings import (
    Alternative,
    Evidence,
    Finding,
    Ground,
    Instead,
    Interval,
    ParameterEstimate,
    Recalibrated,
)
from dtbacklash.diagnosis.labels import all_in_words, place_in_words
from dtbacklash.diagnosis.result import UNEXPLAINED, Candidate, Limit, Located, RemainingLaw, Verdict
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.declare import Role
from dtbacklash.physics.effects.table import KNOTS, SHAPES

#: of a law that the recording needs and that it bounds to one side only, as a friction that always holds
UNSIZED = " The recording does not say how large it is."


def findings(c: Conclusion) -> tuple[Finding, ...]:
    """A finding for each name of the extended rig; tables are none."""
    named = [k for k in c.model.keys if not find(c.model.rig.kind_at(k[0]), k[1], k[0]).is_table]
    return tuple(_finding(c, key) for key in named)


def _finding(c: Conclusion, key: Key) -> Finding:
    place, name = key
    nominal, rig = c.search.segments.nominal, c.model.rig
    entry, values = find(nominal.kind_at(place), name, place), rig.effects[place][name]
    parameters: dict[str, ParameterEstimate] = {}
    each: dict[str, ParameterEstimate] = {}
    largest: dict[str, ParameterEstimate] = {}
    idle = entry.idle(values)
    for p in entry.parameters:
        if p.name in idle:
            continue  # nothing asked for it
        for f, x in zip(c.values.free, c.values.x, strict=True):
            if f.key == key and f.name == p.name and f.recording is not None:
                low, high = around(f.value(x), c.values.errors[*key, f.label])
                there = max(low, p.low), min(high, p.high)
                own = ParameterEstimate(f.value(x), unit_at(nominal, place, p.unit), there)
                each[c.label(f.name, f.recording)] = own
                largest[p.name] = max(largest.get(p.name, own), own, key=lambda one: abs(one.value))
        last = held(rig, ".".join((*key, p.name)), c.search.segments.recordings)[-1]
        label = p.name if last is None else in_recording(p.name, last)
        value = values[p.name] if last is None else rig.own[last][".".join((*key, p.name))]
        error = c.values.errors.get((place, name, label), math.nan)
        others = _elsewhere(c, key, p.name) if p.role is not Role.ANGLE else []
        low, high = (
            around(end, error)[side] for side, end in enumerate((min([value, *others]), max([value, *others])))
        )
        low, high = max(low, p.low), min(high, p.high)
        parameters[p.name] = ParameterEstimate(value, unit_at(nominal, place, p.unit), (low, high))
    grounds = evidence(c, key)
    instead = _instead(c, key)
    shown = {n: quantity(p.value, p.unit) for n, p in (parameters | largest).items()}
    parameters |= each
    silent = idle | _unseen(c, key)
    said = entry.said(silent).format(location=place_in_words(place), **shown)
    mark, alike = c.certainty.get(key, "partial"), also_fits(c, key)
    said += entry.remark(values)
    if c.full:
        said = said.removesuffix(".") + certainty_said(mark, grounds, key, alike, c.explains) + "."
    else:
        said = f"Likeliest, not tried against rivals: {said}"
    said += apart_said(c, key) + only_said(c, key) + ("" if is_there(c.model, c.values, key) else UNSIZED)
    sentence = said[:1].upper() + said[1:] + less(instead)
    return Finding(place, name, parameters, alike, when(c, key), instead, sentence, mark, grounds)


def _elsewhere(c: Conclusion, key: Key, parameter: str) -> list[float]:
    """The values that a parameter of a name has in other models: those that the rig's other names do not beat.

    Which of these is true is open, unless the recording is so much likelier with the name as one has to be that joins.
    A table takes up any part of a law over its state: beside one the name's value is none.
    """
    place, name = key
    most = c.search.rules.min_gain * c.search.segments.count
    rivals = [r for other, those in c.judged.rivals.items() if other != key for r in those]
    models = [r.model for r in rivals if not r.beaten and r.lead < most and not r.model.smooth]
    return [there[parameter] for m in models if (there := m.rig.effect(place, name)) is not None]


def _unseen(c: Conclusion, key: Key) -> set[str]:
    """The amplitudes of an effect whose intervals hold what does nothing."""
    entry, values = find(c.model.rig.kind_at(key[0]), key[1], key[0]), c.model.rig.effects[key[0]][key[1]]
    found = set()
    for p in entry.amplitudes:
        error = c.values.errors.get((*key, p.name), math.nan)
        if p is not entry.size and p.neutral is not None and not abs(values[p.name] - p.neutral) > NORMAL95 * error:
            found.add(p.name)
    return found


def also_fits(c: Conclusion, key: Key) -> tuple[Alternative, ...]:
    """The rivals that it does not lead, a pair as its parts; a table that adds much; the law that does the same."""
    judged, found = c.judged, dict[Key, Alternative]()
    for rival in confidence_set(judged.rivals.get(key, ())):
        for place, name in rival.keys:
            if (place, name) not in c.model.keys:
                others = [(at, effect) for at, effect in rival.keys if (at, effect) != (place, name)]
                beside = f"with {all_in_words(others)}" if others else ""
                found.setdefault((place, name), Alternative(place, name, beside))
    here = [p.keys[0] for p in judged.rest if p.keys[0][0] == key[0]]
    more = here[:1] if judged.adds.get(key, 0.0) >= c.search.rules.tie_ratio else []
    for place, name in [*more, *([(key[0], judged.simpler[key])] if judged.simpler.get(key) else [])]:
        found.setdefault((place, name), Alternative(place, name))
    return tuple(found.values())


def evidence(c: Conclusion, key: Key) -> Evidence:
    """What a name rests on: rivals elsewhere, rivals and tables at its place, and the rig without it."""
    rivals = c.judged.rivals.get(key, ())
    left = confidence_set(rivals)
    elsewhere = [r for r in rivals if r.keys and any(k[0] != key[0] for k in r.keys)]
    here = [r for r in rivals if r.keys and all(k[0] == key[0] for k in r.keys)]
    without = [r for r in rivals if not r.keys]
    law = _ground(here, left)
    share = c.judged.adds.get(key)
    enough = share is None or share < c.search.rules.tie_ratio
    law = Ground(
        law.stands and enough,
        law.ratio,
        law.t,
        law.agree,
        law.against,
        None if share is None else 1.0 - min(share, 1.0),
    )
    size = _ground(without, left)
    size = replace(size, recordings=tuple(c.predicted.get(key, ())))
    return Evidence(_ground(elsewhere, left), law, size)


def _ground(rivals: list[Rival], left: list[Rival]) -> Ground:
    """A lead over the closest of some rivals. left : those that are not beaten."""
    if not rivals:
        return Ground(True)
    close = min(rivals, key=lambda r: r.least)
    against = Alternative(*close.keys[0]) if close.keys else None
    ratio = close.ratio if math.isfinite(close.ratio) else None
    return Ground(not any(r is other for r in rivals for other in left), ratio, close.least, close.agree, against)


def _instead(c: Conclusion, key: Key) -> Instead | None:
    """What would be named if an effect were not in the catalogue: the closest of the laws there that are beaten."""
    kind = c.model.rig.kind_at(key[0])
    here = [
        r for r in c.judged.rivals.get(key, ())
        if r.beaten and len(r.keys) == 1 and r.keys[0][0] == key[0] and not find(kind, r.keys[0][1], key[0]).is_table
    ]  # fmt: skip
    if not here:
        return None
    close = min(here, key=lambda r: r.lead)
    place, name = close.keys[0]
    size = find(kind, name, place).size
    values = close.model.rig.effect(place, name) or {}
    return Instead(place, name, values.get(size.name, size.neutral or 0.0), size.unit, close.ratio)


def recalibrated(c: Conclusion) -> dict[str, Recalibrated]:
    """The known parameters that had to move."""
    known = {c.label(f.shared_title, f.recording): f for f in c.values.free}
    return {
        name: Recalibrated(
            known[name].centre, value, unit_of(c.search.segments.nominal, known[name]), around(value, error)
        )
        for name, (value, error) in c.moved.items()
    }


def around(value: float, error: float) -> Interval:
    """The 95 % interval of a value with a standard error."""
    return value - NORMAL95 * error, value + NORMAL95 * error


def located(c: Conclusion, verdict: Verdict) -> Located | None:
    """Where what nothing explains sits: the body with the largest unknown force, and the table that explains most."""
    if verdict != UNEXPLAINED:
        return None
    unknown = c.unknown(c.model)
    body = max(unknown, key=lambda b: unknown[b])
    share = min(c.left / max(c.before, 1e-300), 1.0)
    best = next(
        (p for p in c.judged.rest if p.gain > c.search.rules.min_gain_if_clearing * c.search.segments.count), None
    )
    if c.modelled is not None:
        m = c.modelled
        rest = RemainingLaw(m.state, m.state_unit, m.unit, 1.0, m.points)
        return Located(body, m.location, share, rest)
    if best is None or best.errors is None:
        return Located(body, body, share)
    ((h, heights),) = best.parts
    assert heights is not None
    shape, entry = SHAPES[h.effect.name], h.effect
    knots = [h.values[f"x{k + 1}"] for k in range(KNOTS)]
    points = tuple(zip(knots, heights.tolist(), best.errors.tolist(), strict=True))
    explained = min(best.gain / max(c.search.nothing.loss - c.model.loss + best.gain, 1e-300), 1.0)
    rest = RemainingLaw(shape.over, entry.parameters[KNOTS].unit, entry.size.unit, explained, points)
    return Located(body, h.place, share, rest)


def candidates(c: Conclusion) -> tuple[Candidate, ...]:
    """The columns about the recalibrated rig, best first, and what became of each name."""
    rows = []
    best = min(c.search.tried.values(), default=0.0)
    for key, gain in sorted(c.search.gains.items(), key=lambda row: -row[1]):
        scores = [score for keys, score in c.search.tried.items() if key in keys]
        if key in c.model.keys:
            said = "added"
        elif scores:
            said = f"fitted; the best model with it is behind by {min(scores) - best:.0f} in -2 log likelihood"
        else:
            said = "low score"
        rows.append(Candidate(*key, gain, None, said))
    return tuple(rows)


def limits(c: Conclusion) -> tuple[Limit, ...]:
    """For each effect that was not found, how large it could still be, from its column beside the last model."""
    columns = CandidateSensitivities(c.search.segments, c.last, c.last.noise_levels, bounded=True)
    found: dict[Key, Limit] = {}
    for h, bound in columns.bounds(NORMAL95):
        place, name = h.key
        size = h.effect.size
        unit = unit_at(c.search.segments.nominal, place, size.unit)
        at = {n: v for n, v in h.values.items() if n != size.name}
        if size.neutral == 0.0:
            widest = max(abs(size.low), abs(size.high))
            most = bound if bound is not None and bound < widest else None
            if h.key not in found or (most is not None and (found[h.key].upper95 or math.inf) > most):
                found[h.key] = Limit(place, name, size.name, unit, at, upper95=most)
        else:
            value = h.values[size.name] if bound is not None else None
            known = found[h.key].lower95 if h.key in found else None
            least = max((v for v in (value, known) if v is not None), default=None)
            found[h.key] = Limit(place, name, size.name, unit, at, lower95=least)
    return tuple(found[key] for key in sorted(found))
