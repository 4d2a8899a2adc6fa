"""What a case hides, and how the names that a tool gives match it: the rule of every score."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence, Set
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

#: (place, effect)
Key = tuple[str, str]
#: a parameter with another value than the model's, and physics that no other word means
WRONG_PARAMETER, UNLISTED = "wrong_parameter", "unlisted"


@dataclass(frozen=True)
class Hidden:
    """One thing to find: words of the vocabulary, and how large it is (None: it has no size, or none is published)."""

    place: str
    effect: str
    size: float | None = None
    unit: str = ""

    @property
    def key(self) -> Key:
        """Place and effect."""
        return self.place, self.effect


@dataclass(frozen=True)
class Truth:
    """The answer of one case, which goes to JSON and back.

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
    allowed: list[Key] = field(default_factory=list)
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


@dataclass(frozen=True)
class Matching:
    """The names that a tool gives, matched with what is hidden.

    hidden : what has to be found. names : what the tool says. allowed : what is no false name, though nobody has to
    find it. also : of each name, what fits as well by the tool's own words (default: nothing).
    one_of : indices of the names that state "this, or one of these".
    """

    hidden: Sequence[Key]
    names: Sequence[Key]
    allowed: Collection[Key] = ()
    also: Sequence[Set[Key]] = ()
    one_of: Collection[int] = ()

    @cached_property
    def pairs(self) -> dict[int, int]:
        """Hidden thing -> name, by index, one to one: most matches by name or by ``also``, then most by name."""
        weight = np.zeros((len(self.hidden), len(self.names)))
        for j, name in enumerate(self.names):
            weight[:, j] = [1.01 if key == name else float(key in self._also(j)) for key in self.hidden]
        rows, columns = linear_sum_assignment(weight, maximize=True)
        return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if weight[i, j] > 0.0}

    @property
    def exact(self) -> set[int]:
        """The hidden things that are named, at their places."""
        return {i for i, key in enumerate(self.hidden) if key in self.names}

    @property
    def placed(self) -> set[int]:
        """The hidden things with any name at their places."""
        places = {place for place, _ in self.names}
        return {i for i, (place, _) in enumerate(self.hidden) if place in places}

    @property
    def right(self) -> set[int]:
        """The names that are hidden; of those that state one of several, each that is paired."""
        paired = set(self.pairs.values()) & set(self.one_of)
        return paired | {j for j, name in enumerate(self.names) if name in self.hidden}

    @property
    def harmless(self) -> set[int]:
        """The names that are allowed; of those that state one of several, each that may mean such a thing."""
        stated = [{name, *(self._also(j) if j in self.one_of else ())} for j, name in enumerate(self.names)]
        return {j for j, keys in enumerate(stated) if not keys.isdisjoint(self.allowed)}

    @property
    def false(self) -> set[int]:
        """All other names, but those that have what is hidden in ``also``, one to one."""
        return set(range(len(self.names))) - self.right - self.harmless - set(self.pairs.values())

    def _also(self, j: int) -> Set[Key]:
        return self.also[j] if self.also else set()
