"""Effects of a position-commanded drive: how fast, and how strongly, its loop may move what it drives."""

from dtbacklash.physics.effects.declare import CORNER_ERROR, INF, Effect, Parameter, Place, Role, Values
from dtbacklash.physics.effects.slots import EffortLimit, SpeedLimit

#: where a search starts: shares of the fastest motion, and of the largest effort of the loop without a limit
SHARES = 0.4, 0.7, 0.95
#: of a motion, its usual peak over its rms: a limit above it clips nothing (ratio)
CREST = 2.0


def _speeds(place: Place) -> list[Values]:
    return [{"size": share * place.speed} for share in SHARES] if place.speed > 0.0 else []


def _efforts(place: Place) -> list[Values]:
    return [{"size": share * place.force} for share in (0.1, *SHARES)] if place.force > 0.0 else []


def _limits(kind: str, speed: str, effort: str) -> list[Effect]:
    """The limits of one kind of servo. speed, effort : their units."""
    return [
        Effect(
            "speed_limit", kind, (Parameter("speed", speed, 1e-9, INF, 6.0, INF, role=Role.SIZE),),
            "the speed that the position loop asks for, position_gain/speed_gain (u - q), clipped to [-speed, speed]",
            SpeedLimit("speed"), "position loop over a speed loop, as in industrial drives",
            "The {location} asks for {speed} at most.",
            conceal=lambda place, sign: (0.8, 0.2), starts=_speeds,
            strength=lambda place, strength: CREST * place.speed * (1.0 - strength), formulation_error=CORNER_ERROR,
        ),
        Effect(
            "effort_limit", kind, (Parameter("effort", effort, 1e-9, INF, 1.0, INF, role=Role.SIZE),),
            "the effort of the loop, clipped to [-effort, effort]", EffortLimit("effort"), "ideal limiter",
            "The {location} makes {effort} at most.",
            conceal=lambda place, sign: (0.8, 0.2), starts=_efforts,
            strength=lambda place, strength: CREST * place.force * (1.0 - strength), formulation_error=CORNER_ERROR,
        ),
    ]  # fmt: skip


EFFECTS = [*_limits("servo", "rad/s", "N m"), *_limits("linear_servo", "m/s", "N")]
