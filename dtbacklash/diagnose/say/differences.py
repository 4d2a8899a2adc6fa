"""What differs between recordings, and what each of them says of each cause, in sentences and rows."""

from dtbacklash.diagnose.conclusion import Conclusion
from dtbacklash.diagnose.engine.free import Key, unit_of
from dtbacklash.diagnose.engine.in_each import InOne
from dtbacklash.diagnose.engine.values import NORMAL95
from dtbacklash.diagnose.named import Cause
from dtbacklash.diagnose.say.sentences import quantity

SEEN, NOT_SEEN, CANNOT = "seen", "not seen", "cannot be seen here"


def differences_said(c: Conclusion) -> str:
    """Each value that was found to differ between recordings, with its sizes."""
    return " ".join(_said(c, title, c.in_each[title]) for title in c.search.differences if title in c.in_each)


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


def _said(c: Conclusion, title: str, each: tuple[InOne, ...]) -> str:
    return f"`{title}` is {_sizes(c, title, each)}: it depends on what differs between them."


def _sizes(c: Conclusion, title: str, each: tuple[InOne, ...]) -> str:
    unit = _unit(c, title)
    return ", ".join(f"{quantity(one.value, unit)} in {c.named(one.recording)}" for one in each)


def _unit(c: Conclusion, title: str) -> str:
    return unit_of(c.model.rig, next(f for f in c.values.free if f.shared_title == title))
