"""What a case hides, and a machine's true answer to the test's command; goes to JSON and back. Standard library."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any

SPLITS = ("development", "scored", "real")
#: what a case asks for: what its model lacks, or what changed from the first recording to the second
TASKS = ("missing", "change")
KINDS = ("nothing", "parameters", "single", "several", "unlisted", "change", "real")


@dataclass(frozen=True)
class Hidden:
    """One thing to find: words of the vocabulary, and how large it is (None: it has no size, or none is published)."""

    place: str
    effect: str
    size: float | None = None
    unit: str = ""


@dataclass(frozen=True)
class Truth:
    """The answer of one case.

    case : its number. machine, kind, split, lifelike : to sort figures by. hidden : what is to be found.
    allowed : (place, effect) that are no false names, though nobody has to find them: small things of a lifelike
    machine, slightly wrong parameters.
    visibility : ``place.effect`` -> rms change of the signal that shows it most, in units of its noise.
    test : channel -> what its sensor read at the test's command. oracle : channel -> rms error of the true machine.
    """

    case: str
    machine: str
    kind: str
    split: str
    lifelike: bool
    hidden: list[Hidden] = field(default_factory=list)
    allowed: list[tuple[str, str]] = field(default_factory=list)
    visibility: dict[str, float] = field(default_factory=dict)
    test: dict[str, list[float]] = field(default_factory=dict)
    oracle: dict[str, float] = field(default_factory=dict)

    def to_json(self) -> str:
        """The answer as JSON, keys in a fixed order."""
        return json.dumps(asdict(self), sort_keys=True, allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Truth:
        """Read what :meth:`to_json` wrote.

        Raises ValueError, TypeError, KeyError: it is something else.
        """
        data: dict[str, Any] = json.loads(text)
        hidden = [Hidden(**one) for one in data.pop("hidden")]
        allowed = [(str(place), str(effect)) for place, effect in data.pop("allowed")]
        return cls(hidden=hidden, allowed=allowed, **data)
