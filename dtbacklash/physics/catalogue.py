"""The catalogue: every physical effect that this tool knows, declared once.

Simulation, diagnosis, concealed recordings, the docs' table and the checks of a rig's YAML all read it. To add an
effect: its law in :mod:`.laws`, its entry here, the line in :mod:`.forces` or :mod:`.assembly` that lets it act,
and its case in the tests, which run over the catalogue.
"""

from dataclasses import dataclass, replace

from dtbacklash.errors import UserError

INF = float("inf")

#: relative standard deviation of an effect's parameters between two formulations of its law that engineers would call
#: the same (a bristle for ideal friction, a stiff spring for a stop), and of two integrators
FORMULATION_ERROR = 5e-4


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes
    ----------
    name, unit : as in configs, JSON and reports; SI.
    low, high : physical bounds, inclusive.
    typical : a size that can be seen on a rig of the paper's scale; the default where ``neutral`` is None.
    neutral : the value at which the whole effect does nothing; only the parameter that is the effect's size has one.
    """

    name: str
    unit: str
    low: float
    high: float
    typical: float
    neutral: float | None = None


@dataclass(frozen=True)
class Effect:
    """One effect at one kind of element.

    Attributes
    ----------
    name : its name in the vocabulary, e.g. ``coulomb_friction``.
    kind : the kind of element where it acts, see :mod:`.elements`.
    parameters : the first is its size and has the neutral value.
    law : the formula as text; ``function`` names the compiled form in :mod:`.laws`, if it is not linear.
    sentence : what a report says; ``{location}`` and the parameters' names are filled in.
    formulation_error : see :data:`FORMULATION_ERROR`; intervals count it.
    """

    name: str
    kind: str
    parameters: tuple[Parameter, ...]
    law: str
    function: str
    source: str
    sentence: str
    formulation_error: float = FORMULATION_ERROR

    @property
    def size(self) -> Parameter:
        """The parameter whose neutral value switches the effect off."""
        return self.parameters[0]

    def is_neutral(self, values: dict[str, float]) -> bool:
        """Whether these values make the effect do nothing."""
        return values.get(self.size.name, self.size.neutral) == self.size.neutral

    def complete(self, values: dict[str, float], key: str) -> dict[str, float]:
        """Fill in defaults and check names and bounds; ``key`` is the dotted name for the error."""
        known = {p.name: p for p in self.parameters}
        for name, value in values.items():
            if name not in known:
                raise UserError(f"{key}.{name}", value, f"unknown parameter; known: {', '.join(known)}")
        if self.size.name not in values:
            raise UserError(key, dict(values), f"`{self.size.name}` [{self.size.unit}] must be given")
        filled = {p.name: float(values.get(p.name, p.typical)) for p in self.parameters}
        for name, value in filled.items():
            p = known[name]
            if not p.low <= value <= p.high:
                raise UserError(f"{key}.{name}", value, f"from {p.low:g} to {p.high:g} {p.unit}")
        return filled


def name_in_words(name: str) -> str:
    """A name of the vocabulary as words: ``coulomb_friction`` is ``Coulomb friction``."""
    proper = {"coulomb": "Coulomb", "stribeck": "Stribeck"}
    return " ".join(proper.get(word, word) for word in name.split("_"))


def _amplifier() -> list[Effect]:
    kind = "amplifier"
    return [
        Effect(
            "saturation", kind, (Parameter("limit", "V", 1e-3, INF, 3.0, INF),),
            "v = min(max(u, -limit), limit)", "saturation", "ideal limiter",
            "The {location} clips the voltage at {limit}.",
        ),
        Effect(
            "dead_zone", kind, (Parameter("half_width", "V", 0.0, 1e3, 0.2, 0.0),),
            "v = u - half_width sign(u) where |u| > half_width, else 0", "dead_zone", "ideal dead zone",
            "The {location} passes nothing while the voltage is within {half_width} of zero.",
        ),
        Effect(
            "delay", kind, (Parameter("time", "s", 0.0, 0.05, 1.3e-3, 0.0),),
            "v(t) = u(t - time)", "", "pure delay",
            "The {location} acts {time} late.",
        ),
        Effect(
            "gain_error", kind, (Parameter("relative", "1", -0.9, 9.0, 0.05, 0.0),),
            "v = (1 + relative) u", "", "linear",
            "The {location}'s gain is off by {relative}.",
        ),
    ]  # fmt: skip


def _motor_circuit() -> list[Effect]:
    kind = "motor_circuit"
    return [
        Effect(
            "resistance_heating", kind,
            (Parameter("gain", "1/W", 0.0, 100.0, 0.5, 0.0), Parameter("time_constant", "s", 0.1, 1e4, 5.0)),
            "R(1 + y), time_constant y' = gain R i^2 - y", "heating_rate", "first-order thermal model of the winding",
            "The winding of the {location} heats up: {gain} of relative resistance per watt, within {time_constant}.",
        ),
        Effect(
            "torque_ripple", kind,
            (
                Parameter("relative", "1", 0.0, 1.0, 0.1, 0.0),
                Parameter("periods", "1/rev", 1.0, 200.0, 6.0),
                Parameter("phase", "rad", -3.2, 3.2, 0.0),
            ),
            "T = k_T i (1 + relative sin(periods theta + phase))", "periodic", "torque ripple of a commutated motor",
            "The torque constant of the {location} ripples by {relative}, {periods}.", 2e-3,
        ),
    ]  # fmt: skip


@dataclass(frozen=True)
class _Axis:
    """What differs between a body that turns and one that slides."""

    kind: str
    effort: str
    effort_unit: str
    speed_unit: str
    viscous_unit: str
    wave: Parameter
    load: str
    high: float
    typical: float


_ROTARY = _Axis(
    "rotor", "torque", "N m", "rad/s", "N m s/rad", Parameter("periods", "1/rev", 1.0, 500.0, 24.0), "constant_load",
    10.0, 0.02,
)  # fmt: skip
_LINEAR = _Axis(
    "carriage", "force", "N", "m/s", "N s/m", Parameter("wave_number", "rad/m", 1.0, 1e5, 2513.0), "constant_force",
    1e5, 20.0,
)  # fmt: skip


def _bearing(axis: _Axis) -> list[Effect]:
    kind, effort, unit, top, size = axis.kind, axis.effort, axis.effort_unit, axis.high, axis.typical
    speed = {"rad/s": 1.0, "m/s": 0.02}[axis.speed_unit]
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083"
    return [
        Effect(
            "coulomb_friction", kind, (Parameter(effort, unit, 0.0, top, size, 0.0),),
            f"-{effort} sign(v), |.| <= {effort} at v = 0", "friction_level", source,
            f"Dry (Coulomb) friction of {{{effort}}} acts at the {{location}}.",
        ),
        Effect(
            "stribeck_friction", kind,
            (Parameter(effort, unit, 0.0, top, size / 2, 0.0), Parameter("speed", axis.speed_unit, 1e-6, 1e3, speed)),
            f"-{effort} exp(-(v/speed)^2) sign(v)", "friction_level", source,
            f"Friction at the {{location}} is higher by {{{effort}}} at rest and falls off within {{speed}}.",
            0.05,  # how far it rises before it falls off depends on how a body is held at rest
        ),
        Effect(
            "viscous_friction", kind, (Parameter("coefficient", axis.viscous_unit, 0.0, 1e5, size / 20, 0.0),),
            "-coefficient v", "", "linear",
            "Viscous friction of {coefficient} acts at the {location}.",
        ),
        Effect(
            "asymmetric_friction", kind,
            (Parameter("viscous_difference", axis.viscous_unit, -1e5, 1e5, size / 40, 0.0),),
            "-viscous_difference |v|", "asymmetric_friction", "direction-dependent viscous friction",
            "Viscous friction at the {location} is higher by {viscous_difference} in the positive direction and lower "
            "by as much in the other.",
        ),
        Effect(
            "cogging", kind,
            (Parameter(effort, unit, 0.0, top, size, 0.0), axis.wave, Parameter("phase", "rad", -3.2, 3.2, 0.0)),
            f"{effort} sin({axis.wave.name} q + phase)", "periodic", "position-periodic force of magnets or of a screw",
            f"A ripple of {{{effort}}} that depends on the position ({{{axis.wave.name}}}) acts at the {{location}}.",
        ),
        Effect(
            axis.load, kind, (Parameter(effort, unit, -top, top, size / 2, 0.0),),
            effort, "", "constant",
            f"A constant {effort} of {{{effort}}} acts at the {{location}}.",
        ),
    ]  # fmt: skip


def _backlash(kind: str, size: Parameter, law: str, sentence: str) -> Effect:
    """Lost motion, at a gear that holds its place or in a spring that returns to the middle of the play."""
    return Effect("backlash", kind, (size,), law, "play", "play operator; the paper's Eqs (16)-(17)", sentence)


def _transmission() -> list[Effect]:
    return [
        _backlash(
            "gear", Parameter("half_gap", "rad", 0.0, 6.3, 0.35, 0.0), "theta_d = play(theta_m, half_gap)",
            "The {location} has backlash of {half_gap} to each side.",
        ),
        _backlash(
            "coupling", Parameter("lost_motion", "m", 0.0, 1.0, 1e-3, 0.0),
            "the spring's stretch is what s has beyond lost_motion/2 to either side",
            "The {location} has backlash: a lost motion of {lost_motion} at each reversal.",
        ),
        Effect(
            "compliance", "screw", (Parameter("compliance", "m/N", 0.0, 1e-4, 1e-6, 0.0),),
            "lead theta_d - q1 = compliance * force through the screw", "", "axial spring in series",
            "The {location} gives way by {compliance}.",
        ),
        Effect(
            "pitch_error", "screw",
            (
                Parameter("amplitude", "m", 0.0, 1e-3, 2e-5, 0.0),
                Parameter("periods", "1/rev", 0.05, 50.0, 1.0),
                Parameter("phase", "rad", -3.2, 3.2, 0.0),
            ),
            "d = lead theta_d + amplitude (sin(periods theta_d + phase) - sin(phase))", "periodic",
            "periodic lead error of a screw (ISO 3408)",
            "The lead of the {location} errs periodically by {amplitude} ({periods}).",
        ),
        Effect(
            "load_reaction", "screw", (Parameter("share", "1", 0.0, 1.0, 1.0, 0.0),),
            "torque on the motor = -share * lead * force through the screw, while the gear is in contact", "",
            "power balance of the screw; the paper's first assumption lifted",
            "The structure pushes back on the motor through the {location} ({share} of the full reaction).",
        ),
    ]  # fmt: skip


def _link() -> list[Effect]:
    kind = "link"
    return [
        Effect(
            "cubic_stiffness", kind, (Parameter("k3", "N/m^3", -1e14, 1e14, 1e10, 0.0),),
            "k3 s^3", "cubic_stiffness", "Duffing's spring",
            "The spring of {location} has a cubic part of {k3}.",
        ),
        Effect(
            "quadratic_damping", kind, (Parameter("c2", "N s^2/m^2", 0.0, 1e8, 2e3, 0.0),),
            "c2 |s'| s'", "quadratic_damping", "turbulent damper",
            "The damper of {location} has a quadratic part of {c2}.",
        ),
        Effect(
            "dry_friction", kind, (Parameter("force", "N", 0.0, 1e5, 0.2, 0.0),),
            "force sign(s'), |.| <= force at s' = 0", "friction_level", "Coulomb friction across a link",
            "Dry friction of {force} acts across {location}.",
        ),
        Effect(
            "hysteresis", kind,
            (Parameter("force", "N", 0.0, 1e5, 1.0, 0.0), Parameter("displacement", "m", 1e-8, 1.0, 5e-5)),
            "force z, z' = (s' - |s'| z/2 - s' |z|/2)/displacement", "bouc_wen_rate",
            "Bouc-Wen; Wen, J. Eng. Mech. 102 (1976) 249",
            "{location} yields hysteretically at {force} within {displacement} (Bouc-Wen).", 5e-3,
        ),
        Effect(
            "bumper", kind,
            (Parameter("stiffness", "N/m", 0.0, 1e8, 1e4, 0.0), Parameter("clearance", "m", -1.0, 1.0, 1e-4)),
            "stiffness (s - clearance) where s > clearance", "bumper", "one-sided elastic stop",
            "{location} hits a stop of {stiffness} at a stretch of {clearance}.", 5e-3,
        ),
        Effect(
            "stiffness_drift", kind, (Parameter("rate", "1/s", -1.0, 1.0, 2e-3, 0.0),),
            "k rate t s", "stiffness_drift", "linear drift",
            "The stiffness of {location} drifts by {rate}.",
        ),
    ]  # fmt: skip


def _mass() -> list[Effect]:
    kind = "mass"
    return [
        Effect(
            "ground_friction", kind, (Parameter("force", "N", 0.0, 1e5, 0.2, 0.0),),
            "-force sign(v), |.| <= force at v = 0", "friction_level", "Coulomb friction against the ground",
            "Dry friction of {force} holds {location} against the ground.",
        ),
        Effect(
            "constant_force", kind, (Parameter("force", "N", -1e5, 1e5, 0.5, 0.0),),
            "force", "", "constant",
            "A constant force of {force} acts on {location}.",
        ),
        Effect(
            "absorber", kind,
            (
                Parameter("mass", "kg", 0.0, 1e3, 0.3, 0.0),
                Parameter("frequency", "Hz", 0.01, 1e3, 12.0),
                Parameter("damping_ratio", "1", 0.0, 2.0, 0.05),
            ),
            "a hidden mass on a spring of (2 pi frequency)^2 mass", "", "den Hartog's absorber",
            "A hidden mass of {mass} swings on {location} at {frequency}.",
        ),
    ]  # fmt: skip


def _sensor() -> list[Effect]:
    kind = "sensor"
    return [
        Effect(
            "delay", kind, (Parameter("time", "s", 0.0, 0.05, 1.3e-3, 0.0),),
            "y(t - time)", "", "pure delay", "{location} reports {time} late.",
        ),
        Effect(
            "gain_error", kind, (Parameter("relative", "1", -0.9, 9.0, 0.02, 0.0),),
            "(1 + relative) y", "", "linear", "{location} reads {relative} too much.",
        ),
        Effect(
            "offset", kind, (Parameter("offset", "sensor's unit", -1e3, 1e3, 1e-5, 0.0),),
            "y + offset", "", "constant", "{location} is off by {offset}.",
        ),
    ]  # fmt: skip


def _declare() -> dict[tuple[str, str], Effect]:
    linear = _bearing(_LINEAR)
    # a mass at the end of a link takes the effects of a carriage that make sense there under names of its own
    listed = [*_amplifier(), *_motor_circuit(), *_bearing(_ROTARY), *linear, *_transmission(), *_link(), *_mass(),
              *_sensor()]  # fmt: skip
    listed += [replace(e, kind="carriage") for e in _mass() if e.name == "absorber"]
    of_a_spring = ("cubic_stiffness", "quadratic_damping", "hysteresis")
    listed += [replace(e, kind="coupling") for e in _link() if e.name in of_a_spring]
    # a brake's dry friction is one of its parameters
    listed += [replace(e, kind="brake") for e in linear if e.name not in ("coulomb_friction", "cogging")]
    return {(e.kind, e.name): e for e in listed}


CATALOGUE: dict[tuple[str, str], Effect] = _declare()


def effects_of(kind: str) -> dict[str, Effect]:
    """The effects that an element of this kind takes, by name."""
    return {name: effect for (k, name), effect in CATALOGUE.items() if k == kind}


def find(kind: str, name: str, key: str) -> Effect:
    """The effect ``name`` at an element of ``kind``; ``key`` is the dotted name for the error."""
    effects = effects_of(kind)
    if name not in effects:
        allowed = f"an element of kind `{kind}` takes {', '.join(effects) or 'no effect'}"
        raise UserError(key, name, allowed)
    return effects[name]
