"""What a concealed recording hides: a record that goes to JSON and back."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from dtbacklash.config.commands import INSTRUMENTS, KINDS, MACHINES
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig
from dtbacklash.prove.simulator.given import Unlisted
from dtbacklash.scoring.truth import UNLISTED, WRONG_PARAMETER, Key

__all__ = ["INSTRUMENTS", "KINDS", "MACHINES", "Secret"]


@dataclass(frozen=True)
class Secret:
    """Everything that was drawn for one recording; with the nominal rig it repeats the recording to the last bit.

    seed : the seed it was drawn from. rig : name of the rig. kind : one of KINDS.
    effects : each ``{"location", "effect", "parameters": {name: value in SI}}``, names of the catalogue.
    unknown : None, or ``{"location", "name", "description", "size", "scale"}``: physics that the catalogue lacks.
    parameters : true values, SI, of the rig's parameters that differ from their nominal ones.
    excitation : see :mod:`.excitation`. controller : ``cascade``, ``pid`` or ``open_loop``.
    instruments : ``minimal`` or ``rich``. channels : the recorded sensors.
    noise, resolution : sensor -> standard deviation, size of a count, SI.
    visibility : ``location.name`` (and ``parameters``) -> rms change of the recorded signal that shows it most, in
        units of that sensor's noise and counts: two runs without noise are compared (:meth:`.testbench.Bench.quiet`).
    machine : ``clean`` or ``lifelike``. beside : the small things of a lifelike one, as in ``effects`` or ``unknown``,
        each with its ``visibility``, and what the catalogue lacks with ``akin``: [location, effect] that name it, too.
    beside_visibility : of all small things together, beside what is hidden.
    """

    seed: int
    rig: str
    kind: str
    effects: list[dict[str, Any]] = field(default_factory=list)
    unknown: dict[str, Any] | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    excitation: dict[str, Any] = field(default_factory=dict)
    controller: str = "cascade"
    instruments: str = "minimal"
    channels: list[str] = field(default_factory=list)
    noise: dict[str, float] = field(default_factory=dict)
    resolution: dict[str, float] = field(default_factory=dict)
    duration_s: float = 30.0
    sample_time_s: float = 1e-3
    visibility: dict[str, float] = field(default_factory=dict)
    machine: str = MACHINES[0]
    beside: list[dict[str, Any]] = field(default_factory=list)
    beside_visibility: float = 0.0

    def to_json(self) -> str:
        """The record as JSON, keys in a fixed order, floats with all their digits."""
        return json.dumps(asdict(self), sort_keys=True, allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Secret:
        """Read what :meth:`to_json` wrote, or did before it had all of these fields.

        Raises UserError: it is something else.
        """
        try:
            data = json.loads(text)
            known = {f.name for f in fields(cls)}
            if not isinstance(data, dict) or not {"seed", "rig"} <= set(data) <= known or data["kind"] not in KINDS:
                raise ValueError
        except (ValueError, KeyError, RecursionError):
            raise UserError("secret", text[:40], "what `dtb conceal` has sealed") from None
        return cls(**data)

    def true_rig(self, nominal: Rig) -> Rig:
        """The nominal rig with the true parameters and all effects of the catalogue, hidden and small."""
        rig = nominal.with_parameters(self.parameters) if self.parameters else nominal
        return with_effects(rig, [*self.effects, *(thing for thing in self.beside if "effect" in thing)])

    @property
    def laws(self) -> tuple[Unlisted, ...]:
        """What acts that the catalogue lacks: first what is hidden, then the small things."""
        return laws([*([self.unknown] if self.unknown else []), *self.beside])


def with_effects(rig: Rig, effects: list[dict[str, Any]]) -> Rig:
    """The rig with effects of the catalogue, as in :attr:`Secret.effects`."""
    for effect in effects:
        rig = rig.with_effect(effect["location"], effect["effect"], effect["parameters"])
    return rig


def laws(things: Sequence[dict[str, Any]]) -> tuple[Unlisted, ...]:
    """Those of the things that are no effects of the catalogue."""
    known = {f.name for f in fields(Unlisted)}
    return tuple(
        Unlisted(**{k: v for k, v in thing.items() if k in known}) for thing in things if "effect" not in thing
    )


def allowed_in(secret: Mapping[str, Any]) -> list[Key]:
    """What is no false name, of a secret as a dict: wrong parameters, small things, and what names these rightly."""
    found = [(name, WRONG_PARAMETER) for name in secret["parameters"]]
    for thing in secret.get("beside", []):
        found += [(thing["location"], thing.get("effect", UNLISTED)), *map(tuple, thing.get("akin", []))]
    return found
