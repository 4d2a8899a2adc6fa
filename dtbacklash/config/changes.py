"""What may stand in ``changes``: when, and which parameters and effects; that the rig has them, the run checks."""

from __future__ import annotations

from typing import Any

from dtbacklash.config.rig import RigConfig, is_number
from dtbacklash.errors import UserError

KEYS = {"at_s", "parameters", "effects"}
PARAMETERS = "a mapping name -> finite number, SI"
EFFECTS = "a mapping element -> {effect: {parameter: value}}"
PLACE = "a mapping effect -> {parameter: value}"


def check_changes(changes: list[Any], duration_s: float, sample_time_s: float) -> None:
    """Refuse a change without its time, one beyond the end of the run, and one that changes nothing.

    duration_s, sample_time_s : of the run.

    Raises UserError: names ``changes[i]`` and the way to the mistake in it.
    """
    for i, change in enumerate(changes):
        key = f"changes[{i}]"
        if not isinstance(change, dict) or not {"at_s"} < set(change) <= KEYS:
            raise UserError(key, change, "a mapping with at_s, and parameters or effects")
        at_s = change["at_s"]
        if not is_number(at_s, finite=True) or at_s < 0:
            raise UserError(f"{key}.at_s", at_s, "must be a finite number, at least 0 s")
        if round(float(at_s) / sample_time_s) >= round(duration_s / sample_time_s):
            allowed = f"must be at most {duration_s - sample_time_s:.9g} s, as the run ends at"
            raise UserError(f"{key}.at_s", at_s, f"{allowed} duration_s={duration_s:.9g} s")
        if "parameters" in change:
            for name, value in _entries(f"{key}.parameters", change["parameters"], PARAMETERS):
                if not is_number(value, finite=True):
                    raise UserError(f"{key}.parameters.{name}", value, "a finite number, SI")
        if "effects" in change:
            _check_effects(f"{key}.effects", change["effects"])


def of_the_change(mistake: UserError, i: int) -> UserError:
    """The same mistake of a rig's description, where ``changes[i]`` is what made it."""
    key = mistake.key
    if key.startswith("rig.parameters."):
        key = key.removesuffix(".value")
    return UserError(f"changes[{i}]" + key.removeprefix("rig"), mistake.value, mistake.allowed)


def _check_effects(key: str, effects: object) -> None:
    """The form of a rig's own ``effects``; null takes out an effect that the rig has."""
    for place, there in _entries(key, effects, EFFECTS):
        given = {name: values for name, values in _entries(f"{key}.{place}", there, PLACE) if values is not None}
        try:
            RigConfig(effects={place: given})
        except UserError as mistake:
            raise UserError(key + mistake.key.removeprefix("rig.effects"), mistake.value, mistake.allowed) from mistake


def _entries(key: str, mapping: object, allowed: str) -> Any:
    """The entries of a mapping that holds something (raises UserError for anything else)."""
    if not isinstance(mapping, dict) or not mapping:
        raise UserError(key, mapping, allowed)
    return mapping.items()
