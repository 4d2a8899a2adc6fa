"""A rig on its test bench: its excitation, its sensors' errors, and how much two of its runs differ."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import Generator

from dtbacklash.arrays import Floats
from dtbacklash.physics.rig import Rig
from dtbacklash.prove import excitation, tuning
from dtbacklash.prove.secret import Secret
from dtbacklash.prove.simulator.given import Loop, Unlisted
from dtbacklash.prove.simulator.rig import Trial, roles, simulate_other

#: bandwidth of the weak loop that keeps two open-loop runs together when they are compared, rad/s
WEAK_RAD_S = 15.0
#: noise of a sensor of position, and of any other, as a share of its signal's rms
NOISE_POSITION, NOISE_OTHER = (1e-5, 3e-4), (5e-4, 5e-3)
#: the largest share of a PID's command that its sensor's noise may make up
NOISE_OF_COMMAND = 0.1
#: the rig no longer works where a hidden effect makes its signals or its command so many times as large
WILD_SIGNAL, WILD_COMMAND = 8.0, 4.0


@dataclass(frozen=True)
class Bench:
    """The rig with its true parameters but without what is hidden, and what is drawn for its recording.

    plain : its run without noise and counts, once it is made.
    """

    rig: Rig
    secret: Secret
    plain: Trial | None = None

    def loop(self, *unknown: Unlisted) -> Loop:
        """The signals of the excitation, with a course in time for each law that the catalogue lacks."""
        move, duration_s, step_s = self.secret.excitation, self.secret.duration_s, self.secret.sample_time_s
        t_s = excitation.times(duration_s, step_s)
        courses = [excitation.course_of(one.name, one.seed or move["seed"], t_s) for one in unknown]
        force = np.column_stack(courses) if courses else np.zeros(len(t_s))
        made = excitation.loop_of_motion if "pid" in move else excitation.loop_of
        return made(move, t_s, force)

    def quiet(self, rig: Rig, *unknown: Unlisted) -> Trial:
        """A run without noise and counts; in open loop a weak loop holds it to the motion of the plain run.

        A lifelike rig is held so in any case: at the same command, as a diagnosis compares it.
        """
        loop = self.loop(*unknown)
        if self.plain is not None and (self.secret.machine == "lifelike" or not loop.closed):
            loop = self._held(loop, rig, self.plain)
        return simulate_other(rig, loop, self.secret.sample_time_s, None, *unknown)

    def real(self, rig: Rig, *unknown: Unlisted) -> Trial:
        """A run without noise and counts, moved as in the recording."""
        return replace(self, plain=None).quiet(rig, *unknown)

    def _held(self, loop: Loop, rig: Rig, plain: Trial) -> Loop:
        """The loop that holds a rig to a run: by what the sensor showed, where the run may hide an error of it."""
        lifelike = self.secret.machine == "lifelike"
        if tuning.in_cascade(rig):
            screw, circuit = rig.only("screw"), rig.only("motor_circuit")
            assert screw is not None
            assert circuit is not None
            shown = list(rig.sensors)[roles(rig)[0]]
            course = (plain.truth[shown] if lifelike else plain.states[:, 2]) * screw.values["lead"]
            weak: dict[str, Any] = {"gain": WEAK_RAD_S * circuit.values["emf_constant"]}
        else:
            plant = tuning.plant_of(rig)
            if plant.grounded or not plant.sensor:
                # it holds its place, or nothing can hold it
                return replace(loop, closed=False, reference=plain.u, dither=np.zeros(len(plain.u)))
            at = 2 + plain.bodies.index(plant.driven)
            course = plain.truth[plant.sensor] if lifelike else plain.states[:, at]
            slower = tuning.MODE_SHARE * 2.0 * math.pi * float(plant.modes_hz.min(initial=math.inf))
            weak = {**tuning.pid(plant, min(WEAK_RAD_S, slower)), "integral": 0.0, "pid": plant.sensor}
        return replace(
            loop, **{"closed": True, "integral": 0.0, "reference": course, "dither": plain.u, "filter_rad_s": math.inf,
                     "limit": math.inf, **weak}
        )  # fmt: skip

    def seen(self, changed: Trial, plain: Trial) -> float:
        """How much two runs differ in the channel that shows it most, in units of its noise."""
        if changed.diverged or plain.diverged:
            return math.inf
        noise, counts = self.secret.noise, self.secret.resolution
        return max(
            float(np.sqrt(np.mean((changed.truth[c] - plain.truth[c]) ** 2)))
            / math.hypot(noise[c], counts[c] / math.sqrt(12.0))
            for c in self.secret.channels
        )

    def wild(self, rig: Rig, run: Trial, *unknown: Unlisted) -> bool:
        """Whether a rig with what is hidden no longer works: it runs away in open loop, or its loop oscillates."""
        assert self.plain is not None
        if tuning.in_cascade(rig):
            return False  # it turns slowly and holds its place
        if not self.loop().closed or self.secret.machine == "lifelike":
            run = self.real(rig, *unknown)
        if run.diverged or rms(run.u) > WILD_COMMAND * rms(self.plain.u):
            return True
        return any(float(np.ptp(run.truth[c])) > WILD_SIGNAL * float(np.ptp(self.plain.truth[c])) for c in run.truth)


def rms(values: Floats) -> float:
    """Root mean square; never 0, so that it can divide."""
    return float(np.sqrt(np.mean(values**2))) + 1e-300


def errors_in_cascade(rng: Generator, rig: Rig) -> tuple[dict[str, float], dict[str, float]]:
    """Noise and counts of each sensor: about a 4096-count encoder and 1 um, in proportion to the rig's lead."""
    turn, circuit = excitation.turn_m(rig) / excitation.PAPER_TURN_M, rig.only("motor_circuit")
    assert circuit is not None
    ampere = 1.0 / circuit.values["resistance"]
    noise, resolution = {}, {}
    for name, sensor in rig.sensors.items():
        spread = float(np.exp(rng.uniform(math.log(0.3), math.log(3.0))))
        counts = float(rng.choice([2048.0, 4096.0, 8192.0]))
        part = float(rng.choice([0.1, 0.2, 0.5]))
        if sensor.unit == "rad":
            resolution[name] = 2.0 * math.pi / counts
            noise[name] = 0.1 * spread * resolution[name]
            continue
        unit = {"m": 1e-6 * turn, "A": 8e-3 * ampere, "m/s": 2e-5 * turn, "rad/s": 0.05}[sensor.unit]
        noise[name], resolution[name] = unit * spread, unit * part
    return noise, resolution


def errors_of(
    rng: Generator, rig: Rig, move: dict[str, Any], plain: Trial
) -> tuple[dict[str, float], dict[str, float]]:
    """Noise and counts of each sensor, relative to its signal; a PID's sensor is quiet enough for its command.

    A position sensor is an encoder, whose counts are larger than its noise, or has fine counts and more noise.
    """
    noise, resolution = {}, {}
    for name, sensor in rig.sensors.items():
        position = sensor.quantity == "position"
        share = math.exp(float(rng.uniform(*np.log(NOISE_POSITION if position else NOISE_OTHER))))
        counted, part = bool(rng.random() < 0.5), float(rng.choice([0.1, 0.2, 0.5]))
        size = share * rms(plain.truth[name] - plain.truth[name].mean())
        if name == move["pid"]:
            size = min(size, NOISE_OF_COMMAND * move["rms_v"] / (move["gain"] + move["rate"]))
        counted = counted and position
        noise[name] = 0.3 * size if counted else size
        resolution[name] = math.sqrt(12.0) * 0.95 * size if counted else part * size
    return noise, resolution
