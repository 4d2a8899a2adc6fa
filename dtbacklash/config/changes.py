"""What may stand in ``changes``: when, and which parameters and effects; that the rig has them, the run checks."""

from __future__ import annotations

import sys
from typing import Any

from dtbacklash.config.rig import RigConfig
from dtbacklash.errors import UserError

KEYS = ("at_s", "parameters", "effects")
PARAMETERS = "a mapping name -> finite number, SI"
EFFECTS = "a mapping element -> {effect: {parameter: value}}"


def check_changes(changes: list[Any], duration_s: float, sample_time_s: float) -> None:
    """Refuse a change without its time, one beyond the end of the run, and one that changes nothing.

    duration_s, sample_time_s : of the run.

    Raises
    ------
    UserError : names ``changes[i]`` and the way to the mistake in it.
    """
    for i, change in enumerate(changes):
        key = f"changes[{i}]"
        form = isinstance(change, dict) and set(change) <= set(KEYS)
        if not form or "at_s" not in change or len(change) == 1:
            raise UserError(key, change, "a mapping with at_s, and parameters or effects")
        _check_time(f"{key}.at_s", change["at_s"], duration_s, sample_time_s)
        if "parameters" in change:
            _check_parameters(f"{key}.parameters", change["parameters"])
        if "effects" in change:
            _check_effects(f"{key}.effects", change["effects"])


def of_the_change(mistake: UserError, i: int) -> UserError:
    """The same mistake of a rig's description, where ``changes[i]`` is what made it."""
    key = mistake.key
    if key.startswith("rig.parameters."):
        key = key.removesuffix(".value")
    return UserError(f"changes[{i}]" + key.removeprefix("rig"), mistake.value, mistake.allowed)


def _check_time(key: str, at_s: object, duration_s: float, sample_time_s: float) -> None:
    if not _is_finite(at_s) or at_s < 0:  # type: ignore[operator]
        raise UserError(key, at_s, "must be a finite number, at least 0 s")
    if round(float(at_s) / sample_time_s) >= round(duration_s / sample_time_s):  # type: ignore[arg-type]
        last_s = duration_s - sample_time_s
        raise UserError(key, at_s, f"must be at most {last_s:.9g} s, as the run ends at duration_s={duration_s:.9g} s")


def _check_parameters(key: str, parameters: object) -> None:
    if not isinstance(parameters, dict) or not parameters:
        raise UserError(key, parameters, PARAMETERS)
    for name, value in parameters.items():
        if not _is_finite(value):
            raise UserError(f"{key}.{name}", value, "a finite number, SI")


def _check_effects(key: str, effects: object) -> None:
    """The form of a rig's own ``effects``; null takes out an effect that the rig has."""
    if not isinstance(effects, dict) or not effects:
        raise UserError(key, effects, EFFECTS)
    for place, there in effects.items():
        if not isinstance(there, dict) or not there:
            raise UserError(f"{key}.{place}", there, "a mapping effect -> {parameter: value}")
        given = {name: values for name, values in there.items() if values is not None}
        try:
            RigConfig(effects={place: given})
        except UserError as mistake:
            raise UserError(key + mistake.key.removeprefix("rig.effects"), mistake.value, mistake.allowed) from mistake


def _is_finite(value: object) -> bool:
    known = isinstance(value, (int, float)) and not isinstance(value, bool)
    return known and abs(value) <= sys.float_info.max  # type: ignore[arg-type]
