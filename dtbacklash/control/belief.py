"""What controller and twin believe about the rig: one object for the design, the internal model and the twin.

A belief is a rig with effects. The design needs its linear part: the motor, and the chain behind the screw with all
linear effects (a compliant screw, masses on springs to the ground, viscous friction). Effects that depend on the
motor's angle or speed alone can be compensated by a feed-forward (:class:`FeedForward`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from dtbacklash import units
from dtbacklash.config.rig import RigConfig, of_the_model
from dtbacklash.config.run import RunConfig, SensorsConfig
from dtbacklash.control.chain import (
    MotorParameters,
    StructureParameters,
    dominant_frequency,
    driven_chain,
    motor_parameters,
    structure_parameters,
)
from dtbacklash.control.design import ControllerDesign, design_controller
from dtbacklash.control.linear_law import LinearLaw
from dtbacklash.control.margins import DesignedLoop
from dtbacklash.control.own_law import read_law
from dtbacklash.control.predictive import mpc_law
from dtbacklash.control.rivals import lqg_law, pid_law, robust_law
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects import slots
from dtbacklash.physics.element_kinds import SENSOR
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig, Sensor, build_rig
from dtbacklash.physics.simulate import rig_half_gap
from dtbacklash.result_cache import kept

#: where the reference is held: for how long the gap in force goes on growing, s, and by how many of its standard errors
#: an estimate is put in force too small (``python -m studies crossing``)
HELD_GROWTH_S, HELD_SHADING = 20.0, 0.5


@dataclass(frozen=True)
class Linear:
    """The linear part of a belief: the motor, and the structure that its screw moves."""

    motor: MotorParameters
    structure: StructureParameters

    @property
    def static_gain_m_per_rad(self) -> float:
        """Position of the last mass per angle of the screw, at rest."""
        return self.structure.static_gain_m_per_rad


@dataclass(frozen=True)
class FeedForward:
    """Voltages against known torques on the motor: ``u = -(amplitude sin(periods theta + phase) + load - viscous w)``.

    amplitude_v, load_v : V. viscous_v_s_per_rad : V s/rad. periods : as ``cogging`` has it, phase : rad.
    Statically, through R / k_T: the winding's lag (L / R, 0.08 ms on the paper's motor) is left out.
    """

    amplitude_v: float = 0.0
    periods: float = 0.0
    phase: float = 0.0
    viscous_v_s_per_rad: float = 0.0
    load_v: float = 0.0


@dataclass(frozen=True)
class Belief:
    """What is believed of the machine; ``rig`` has the effects that are believed in."""

    rig: Rig

    @property
    def half_gap_rad(self) -> float:
        """The believed half-gap before anything was measured."""
        return rig_half_gap(self.rig)

    def linear(self, compensated: tuple[str, ...] = ()) -> Linear:
        """The linear part; viscous friction that is fed forward is not in it.

        Raises
        ------
        UserError : the rig is no screw-driven chain of masses (:func:`.chain.driven_chain`).
        """
        structure = structure_parameters(self.rig)
        motor = motor_parameters(self.rig)
        if "viscous_friction" in compensated:
            motor = replace(motor, viscous_n_m_s=0.0)
        return Linear(motor, structure)

    def feed_forward(self, compensated: tuple[str, ...]) -> FeedForward:
        """The voltage that compensates those of the named effects that the believed motor has."""
        rotor, circuit = self.rig.motor_rotor(), self.rig.only("motor_circuit")
        if rotor is None or circuit is None:
            return FeedForward()
        there = {n: v for n, v in self.rig.effects.get(rotor.name, {}).items() if n in compensated}
        per_torque = circuit.values["resistance"] / circuit.values["torque_constant"] / motor_parameters(self.rig).gain
        cogging, viscous = there.get("cogging", {}), there.get("viscous_friction", {})
        return FeedForward(
            amplitude_v=per_torque * cogging.get("torque", 0.0),
            periods=cogging.get("periods", 0.0),
            phase=cogging.get("phase", 0.0),
            viscous_v_s_per_rad=per_torque * viscous.get("coefficient", 0.0),
            load_v=per_torque * there.get("constant_load", {}).get("torque", 0.0),
        )

    def delays_s(self) -> tuple[float, float, float]:
        """The believed delays of the command, of the motor's sensor and of the output's, s."""
        amplifier = self.rig.only("amplifier")
        places = [amplifier.name if amplifier else "", *(SENSOR_PREFIX + s.name if s else "" for s in self._shows())]
        command, angle, output = (
            self.rig.effects.get(place, {}).get("delay", {}).get("time", 0.0) for place in places
        )  # fmt: skip
        return command, angle, output

    def noise(self, sensors: SensorsConfig) -> tuple[float, float]:
        """What the sensors of the motor's angle, rad, and of the output, m, show of noise and counts, rms."""
        found = []
        for sensor in self._shows():
            unit, factor = units.shown(sensor.unit) if sensor else ("", 1.0)
            column = f"{sensor.name}_{units.suffix(unit)}" if sensor else ""
            counts = sensors.resolution.get(column, 0.0) / math.sqrt(12.0)
            found.append(math.hypot(sensors.noise.get(column, 0.0), counts) / factor)
        return found[0], found[1]

    def varied(self, compensated: tuple[str, ...]) -> tuple[tuple[Linear, Linear], ...]:
        """The linear part with one parameter of the rig one tolerance below and above, for each of them."""
        nominal, found = self.linear(compensated), []
        for name, parameter in self.rig.config.parameters.items():
            shares = (1.0 - min(parameter.tolerance, 0.5), 1.0 + parameter.tolerance)
            low, high = (
                Belief(self.rig.with_parameters({name: parameter.value * x})).linear(compensated) for x in shares
            )
            if low != nominal or high != nominal:
                found.append((low, high))
        return tuple(found)

    def _shows(self) -> list[Sensor | None]:
        """The sensors of the motor's angle and of the output."""
        bodies = self.rig.motor_rotor(), driven_chain(self.rig)[0][-1]
        sensors = self.rig.sensors.values()
        return [next((s for s in sensors if one and s.of == one.name), None) for one in bodies]

    def limit_v(self) -> float | None:
        """The believed limit of the amplifier's voltage; None if there is none."""
        amplifier = self.rig.only("amplifier")
        there = self.rig.effects.get(amplifier.name, {}) if amplifier else {}
        return there["saturation"]["limit"] if "saturation" in there else None

    def bends(self) -> bool:
        """Whether it has effects behind the gear that the linear part leaves out."""
        return bool(bending(self.rig))


def bending(rig: Rig) -> list[tuple[str, str]]:
    """(place, effect) of the effects behind the gear that :meth:`Belief.linear` leaves out."""
    # the reaction acts on the motor, whose angle is measured
    linear = (slots.Yielding, slots.BodyDamping, slots.Reaction)
    found = []
    for place, there in rig.effects.items():
        kind = rig.kind_at(place)
        if kind not in ("amplifier", "motor_circuit", "rotor", "gear", SENSOR.name):
            found += [(place, name) for name in there if not isinstance(find(kind, name, place).slot, linear)]
    return found


def on_the_motor(rig: Rig, delays: bool = False) -> list[tuple[str, str]]:
    """(effect, place) of the effects between voltage and angle; delays, which only limit the gain, if asked for."""
    rotor = rig.motor_rotor()
    sensors = [SENSOR_PREFIX + s.name for s in rig.sensors.values() if rotor is not None and s.of == rotor.name]
    found = []
    for place, there in rig.effects.items():
        driving = rig.kind_at(place) in ("amplifier", "motor_circuit", "rotor") or place in sensors[:1]
        found += [
            (name, place) for name in there if (driving and (delays or name != "delay")) or name == "load_reaction"
        ]
    return found


def nominal(config: RigConfig) -> RigConfig:
    """A rig without effects, as its maker states it."""
    return replace(config, effects={})


@dataclass(frozen=True)
class Beliefs:
    """What the controller was designed for, and what the twin believes."""

    design: Belief
    twin: Belief


def beliefs_of(config: RunConfig) -> Beliefs:
    """The beliefs of a configuration, from ``model``, ``controller.design_from`` and ``twin.estimate_from``.

    Raises
    ------
    UserError : in the name of ``model``, where that is no rig.
    """
    stated = Belief(build_rig(nominal(config.rig)))
    if config.model is None:
        return Beliefs(stated, stated)
    try:
        found = Belief(build_rig(config.model))
    except UserError as mistake:
        raise of_the_model(mistake) from mistake
    return Beliefs(
        found if config.controller.design_from == "model" else stated,
        found if config.twin.estimate_from == "model" else stated,
    )


def settled(config: RunConfig, beliefs: Beliefs) -> RunConfig:
    """The configuration with what it leaves open (``auto``, null) decided, and the design's half-gap as the first one.

    An integrating model of the motor drifts where something acts on the motor that it does not have, and a machine
    always has something: a complete model of the inner loop is the default. Among those only ``inverse`` can hold the
    reference and settles with a fixed estimate that is too large; without either a twin meets a growing gap from below,
    where ``inner_loop`` overshoots less. A linear twin is blind to effects behind the gear.
    """
    controller, twin = config.controller, config.twin
    nimc, fixed = controller.structure == "nimc", controller.reconfigure == "never"
    if controller.internal_model == "auto":
        form = "inverse" if nimc and (fixed or controller.crossing == "hold") else "inner_loop"
        controller = replace(controller, internal_model=form)
    held = nimc and controller.internal_model == "inverse" and controller.crossing == "hold"
    if twin.growth_s is None:
        twin = replace(twin, growth_s=HELD_GROWTH_S if held else 0.0)
    if twin.shading is None:
        twin = replace(twin, shading=HELD_SHADING if held else 1.0)
    if controller.gap_hat_deg is None:
        controller = replace(controller, gap_hat_deg=math.degrees(beliefs.design.half_gap_rad))
    if controller.limit_v is None:
        controller = replace(controller, limit_v=beliefs.design.limit_v())
    if twin.method == "auto":
        twin = replace(twin, method="simulate" if beliefs.twin.bends() else "linear")
    return replace(config, controller=controller, twin=twin)


def design_for(config: RunConfig, belief: Belief) -> ControllerDesign | None:
    """The controller's design for what is believed of the rig; None in open loop.

    Raises
    ------
    UserError : the rig is none that this controller is made for, or the sampling is too slow for it.
    """
    c, rig = config.controller, belief.rig
    if c.structure == "open_loop":
        return None
    if c.structure == "nimc" and rig.only("gear") is None:
        raise UserError(
            "controller", c.name, f"needs a rig with a gear; {rig.config.name} has none: give controller=open_loop"
        )
    linear = belief.linear(tuple(c.compensate))
    frequency = kept(dominant_frequency, linear.structure)
    if frequency * config.sample_time_s >= math.pi:
        allowed = f"sampling above twice the dominant mode's {frequency / (2 * math.pi):.3g} Hz"
        raise UserError("sample_time_s", config.sample_time_s, allowed)
    design = kept(
        design_controller,
        linear.motor, linear.structure, c.k_theta_v_per_rad, c.prefilter, c.tau_r_s, config.sample_time_s,
    )  # fmt: skip
    design = replace(design, delays_s=belief.delays_s())
    return replace(design, law=_law(config, belief, linear, design))


def _law(config: RunConfig, belief: Belief, linear: Linear, design: ControllerDesign) -> LinearLaw | None:
    """The law of a controller that is none of the paper's, else None."""
    c, step, noise = config.controller, config.sample_time_s, belief.noise(config.sensors)
    if c.structure == "state_space":
        return read_law(c.file)
    if c.structure == "pid":
        return kept(pid_law, design, linear.motor, linear.structure)
    if c.structure == "offset":
        loop = DesignedLoop.of(config, design, belief)
        return kept(robust_law, loop, linear.motor, linear.structure, c.prefilter, noise, c.robust)
    if c.structure in ("lqg", "mpc"):
        make = lqg_law if c.structure == "lqg" else mpc_law
        return kept(make, linear.motor, linear.structure, c.tau_r_s, step, noise)
    return None
