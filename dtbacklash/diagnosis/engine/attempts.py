"""Proposals are tried here: what one raises costs that proposal, and never the diagnosis."""

import logging
from collections.abc import Callable, Sequence
from typing import ParamSpec, TypeVar

import numpy as np

from dtbacklash.diagnosis.parallel import spread
from dtbacklash.errors import UserError

log = logging.getLogger(__name__)

P = ParamSpec("P")
T = TypeVar("T")
R = TypeVar("R")


def attempt(function: Callable[P, R | None], *args: P.args, **named: P.kwargs) -> R | None:
    """What a function returns; None where it raises.

    A rig that cannot have some values and a fit that breaks down are no news. Any other error is logged as a warning.
    Ctrl-C passes.
    """
    try:
        return function(*args, **named)
    except (UserError, np.linalg.LinAlgError) as error:
        log.debug("a proposal cannot be tried: %s", error)
    except Exception as error:
        log.warning("a proposal could not be tried: %s: %s", type(error).__name__, error)
        log.debug("where it was raised", exc_info=True)
    return None


def attempts(function: Callable[[T], R | None], items: Sequence[T]) -> list[R]:
    """A function's values at some items, in their order, without those that it has none for; see :func:`attempt`."""
    return [found for found in spread(lambda item: attempt(function, item), items) if found is not None]
