"""What differs between recordings, and what each of them says of each cause, in sentences and rows."""

from collections.abc import Sequence

from dtbacklash.diagnosis.conclusion import MISSED, Conclusion
from dtbacklash.diagnosis.engine.change_detection import Change
from dtbacklash.diagnosis.engine.intervals import NORMAL95
from dtbacklash.diagnosis.engine.parameters import Key, unit_of
from dtbacklash.diagnosis.engine.per_recording import RecordingValue, difference
from dtbacklash.diagnosis.explain.sentences import quantity
from dtbacklash.diagnosis.findings import Cause, Changed, Confidence, Finding, ParameterEstimate

SEEN, NOT_SEEN, CANNOT = "seen", "not seen", "cannot be seen here"


def differences_said(c: Conclusion) -> str:
    """Each value that was found to differ between recordings, with its sizes; empty where what changed was asked."""
    if c.changes is not None:
        return ""
    return " ".join(_said(c, title, c.in_each[title]) for title in c.search.differences if title in c.in_each)


def changed(c: Conclusion) -> list[tuple[Change, float, float]]:
    """What changed, by how much, and the standard error of that; a value that may be the same in both did not."""
    both = [one for one in c.changes or () if len(c.in_each.get(one.title, ())) > 1]
    found = [(one, *difference(c.model, c.values, one.title)) for one in both]
    return [row for row in found if abs(row[1]) > NORMAL95 * row[2]]


def changes(c: Conclusion) -> tuple[Changed, ...] | None:
    """What changed from the first recording to the second; None where that was not asked."""
    return None if c.changes is None else tuple(_changed(c, *row) for row in changed(c))


def _changed(c: Conclusion, change: Change, more: float, error: float) -> Changed:
    """more, error : its difference."""
    before, after = c.in_each[change.title]
    unit, min_t = _unit(c, change.title), c.search.rules.min_t
    others = tuple(title for title, (t, _) in change.rivals.items() if not t > min_t)
    clear = abs(more) > min_t * error and c.left < c.search.rules.max_unexplained
    alike = all(t > -min_t for t, _ in change.rivals.values())
    mark: Confidence = "partial" if not clear or (others and not alike) else "one_of" if others else "sure"
    first, second = (
        ParameterEstimate(e.value, unit, (e.value - NORMAL95 * e.error, e.value + NORMAL95 * e.error))
        for e in (before, after)
    )
    instead = f" It may be {' or '.join(f'`{title}`' for title in others)} instead." if others else ""
    none = before.there or after.there  # what is seen in one alone is nothing in the other
    was, now = (f"{_seen(e, change.title, unit, none)} in {c.named(e.recording)}" for e in (before, after))
    by = f"by {quantity(more, unit)} +/- {quantity(NORMAL95 * error, unit)}"
    by += ", which is open" if mark == "partial" and not others else ""
    said = f"`{change.title}` changed from {was} to {now}, {by}."
    return Changed(change.title, unit, first, second, mark, others, said + instead)


def _seen(one: RecordingValue, title: str, unit: str, none: bool) -> str:
    """A value in one recording. none : whether an effect that is not seen there is nothing."""
    return "nothing" if none and not one.there and "." in title else quantity(one.value, unit)


def changes_said(c: Conclusion, named: Sequence[Finding]) -> str:
    """The same in words, also where nothing is seen to have changed, and what both have. named : the findings."""
    found = changes(c) or ()
    beside = "Beside what the rig lacks in both" if c.left > MISSED * c.search.rules.unexplained_attention else ""
    nothing = f"{beside or 'From one recording to the other'}, nothing is seen to have changed."
    titles = [one.title for one in found]
    both = [one.sentence for one in named if c.sizes[one.location, one.effect] not in titles]
    said = [one.sentence for one in found] or [nothing]
    return " ".join([*said, *(["In both:", *both] if both else [])])


def apart_said(c: Conclusion, key: Key) -> str:
    """Why a name does not stand in each recording; empty where it does."""
    title = c.sizes[key]
    if c.stands_in_each(title):
        worse = [c.named(k) for k in c.not_predicted(key)]
        return f" Fitted to the others, it predicts {' and '.join(worse)} no better." if worse else ""
    missing = [c.named(one.recording) for one in c.in_each[title] if one.visible and not one.there]
    if missing:
        return f" It is not seen in {' and '.join(missing)}, which would show it."
    return f" The recordings do not agree on its size: {_sizes(c, title, c.in_each[title])}."


def only_said(c: Conclusion, key: Key) -> str:
    """In which recordings alone a name is seen, where its size is each one's own."""
    each = [one for one in c.in_each.get(c.sizes[key], ()) if one.own]
    seen = [c.named(one.recording) for one in each if one.there]
    return f" It is seen in {' and '.join(seen)} only." if 0 < len(seen) < len(each) else ""


def causes_in(c: Conclusion, recording: int) -> dict[str, Cause]:
    """Title of a cause -> what one recording says of it."""
    found = {}
    for title, each in c.in_each.items():
        for one in each:
            if one.recording == recording:
                interval = one.value - NORMAL95 * one.error, one.value + NORMAL95 * one.error
                said = SEEN if one.there else NOT_SEEN if one.visible else CANNOT
                found[title] = Cause(said, one.value, _unit(c, title), interval)
    return found


def _said(c: Conclusion, title: str, each: tuple[RecordingValue, ...]) -> str:
    return f"`{title}` is {_sizes(c, title, each)}: it depends on what differs between them."


def _sizes(c: Conclusion, title: str, each: tuple[RecordingValue, ...]) -> str:
    unit = _unit(c, title)
    return ", ".join(f"{quantity(one.value, unit)} in {c.named(one.recording)}" for one in each)


def _unit(c: Conclusion, title: str) -> str:
    return unit_of(c.model.rig, next(f for f in c.values.free if f.shared_title == title))
