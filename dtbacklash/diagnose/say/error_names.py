"""Errors about a recording carry its name: what is deep inside knows channels only."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

from dtbacklash.errors import UserError
from dtbacklash.recording.model import Recording

Rest = ParamSpec("Rest")
Result = TypeVar("Result")


def names_the_recording(
    function: Callable[Concatenate[Recording, Rest], Result],
) -> Callable[Concatenate[Recording, Rest], Result]:
    """A function of a recording whose errors with the key ``recording`` say which recording it is."""

    @wraps(function)
    def named(recording: Recording, /, *arguments: Rest.args, **options: Rest.kwargs) -> Result:
        try:
            return function(recording, *arguments, **options)
        except UserError as error:
            if error.key != "recording":
                raise
            raise UserError("recording", recording.name, f"{error.value}: {error.allowed}") from error

    return named
