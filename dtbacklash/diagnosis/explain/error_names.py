"""Errors about a recording carry its name: what is deep inside knows channels only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

from dtbacklash.diagnosis.several import names_of
from dtbacklash.errors import UserError
from dtbacklash.recording.model import Recording

Rest = ParamSpec("Rest")
Result = TypeVar("Result")
Given = Recording | Sequence[Recording]


def names_the_recording(
    function: Callable[Concatenate[Given, Rest], Result],
) -> Callable[Concatenate[Given, Rest], Result]:
    """A function of recordings whose errors with the key ``recording`` say which they are."""

    @wraps(function)
    def named(recording: Given, /, *arguments: Rest.args, **options: Rest.kwargs) -> Result:
        try:
            return function(recording, *arguments, **options)
        except UserError as error:
            if error.key != "recording":
                raise
            name = recording.name if isinstance(recording, Recording) else ", ".join(names_of(recording))
            if error.value and str(error.value) in name:  # it says which one already
                raise
            raise UserError("recording", name, ": ".join(filter(None, (str(error.value), error.allowed)))) from error

    return named
