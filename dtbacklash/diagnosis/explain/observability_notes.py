"""What a recording of a rig cannot tell, whatever is in it: said before a diagnosis, not after."""

from collections.abc import Container

from dtbacklash.physics.rig import Rig

#: quantities that show an effort
EFFORTS = ("force", "torque", "current")


def beforehand(rig: Rig, channels: Container[str] | None = None) -> tuple[str, ...]:
    """Sentences on what the recorded channels cannot tell apart; none where nothing has to be said.

    channels : that are recorded; None: all sensors of the rig.
    """
    shown = [s for s in rig.sensors.values() if channels is None or s.name in channels]
    quantities = [s.quantity for s in shown]
    return _accelerations_alone(quantities) + _servo_alone(rig, quantities) + _forceless(rig)


def _accelerations_alone(shown: list[str]) -> tuple[str, ...]:
    if "acceleration" not in shown or {"position", "velocity"} & set(shown):
        return ()
    return (
        "Accelerations alone do not show where the machine stands, and hardly what is constant or slow: a constant "
        "load is not told from none, and laws over a position count from where the recording begins, at rest.",
    )


def _servo_alone(rig: Rig, shown: list[str]) -> tuple[str, ...]:
    servo = rig.servo
    if servo is None or any(quantity in EFFORTS for quantity in shown):
        return ()
    gains = " and ".join(servo.values)
    return (
        f"Command and position show the gains of {servo.name} ({gains}), inertias, friction and loads in proportion "
        "only: all of them can grow alike. Viscous friction of what it drives is the same as more speed_gain, a "
        "constant load the same as an offset of the command. How large each is comes from the tolerances, or from a "
        "recorded force.",
    )


def _forceless(rig: Rig) -> tuple[str, ...]:
    if not rig.forceless:
        return ()
    places = " and ".join(name for name in rig.forceless if name in rig.config.joints)
    return (
        f"The FMU has no input that pushes {places}: friction, cogging and loads are not looked for there. Give it a "
        "force input, and name that in `joints`.",
    )
