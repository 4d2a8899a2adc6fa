"""Places and effects as a person would write them."""

from collections.abc import Iterable, Sequence

from dtbacklash.diagnosis.findings import Alternative
from dtbacklash.physics.effects.declare import name_in_words
from dtbacklash.physics.effects.table import SHAPES
from dtbacklash.physics.rig import SENSOR_PREFIX


def place_in_words(location: str) -> str:
    """``sensor_q3`` is ``sensor q3`` (its name stays as it is), ``motor_bearing`` is ``motor bearing``."""
    if location.startswith(SENSOR_PREFIX):
        return "sensor " + location.removeprefix(SENSOR_PREFIX)
    return name_in_words(location)


def effect_in_words(effect: str) -> str:
    """``Coulomb friction``; a table is ``another law over the speed``."""
    shape = SHAPES.get(effect)
    if shape is None:
        return name_in_words(effect)
    return f"another law over the {shape.over}" + (f", times the {shape.times}" if shape.times else "")


def named_in_words(effect: str, location: str) -> str:
    """``Coulomb friction at the motor bearing``; without an effect, something unexplained."""
    return f"{effect_in_words(effect) if effect else 'something unexplained'} at the {place_in_words(location)}"


def all_in_words(keys: Iterable[tuple[str, str]]) -> str:
    """Several effects at their places, as one phrase."""
    return " and ".join(named_in_words(effect, place) for place, effect in keys)


def listed(names: list[str], conjunction: str = "and") -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return f" {conjunction} ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def one_of_in_words(key: tuple[str, str], others: Sequence[Alternative]) -> str:
    """A finding, by its place and effect, and what also fits: ``delay, moving average or low pass``.

    With places where these differ: ``delay at the amplifier or lag at the shaker``.
    """
    if all(other.location == key[0] for other in others):
        return listed([effect_in_words(key[1]), *(effect_in_words(other.effect) for other in others)], "or")
    return listed([named_in_words(key[1], key[0]), *map(other_in_words, others)], "or")


def other_in_words(other: Alternative) -> str:
    """What cannot be told from a finding, and why no recording can where that is known."""
    named = named_in_words(other.effect, other.location)
    return f"{named} ({other.reason})" if other.reason else named
