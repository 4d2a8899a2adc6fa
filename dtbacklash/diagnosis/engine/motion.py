"""How the places of a rig move, as a predictor sees it: where effects begin, their bounds, and what tables are over."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.predictor import Gains, corrected
from dtbacklash.diagnosis.engine.resampling import Samples, between
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.diagnosis.engine.simulator import Pass
from dtbacklash.diagnosis.engine.trajectory import Trajectory
from dtbacklash.physics.bodies import natural_frequencies_hz
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Place
from dtbacklash.physics.rig import SENSOR_PREFIX, Element, Rig

#: of the fastest speed, what is no standstill (share)
MOVES = 0.02
#: fine waves are looked for up to so many a turn; so many are taken, the largest, of so many times the median power
FINEST_WAVE, RIPPLES, STANDS_OUT = 400, 4, 30.0


class Motion(Trajectory):
    """Predicted states of all stretches, one after the other: places in motion, and the states that laws are over."""

    def __init__(self, segments: Segments, rig: Rig, passes: list[Pass], kicks: Floats | None = None) -> None:
        linear, readings = segments.linear, [p.readings for p in segments.predictors]
        self._predictors, self._passes, self._readings = segments.predictors, passes, readings
        drives = [e.name for e in rig.elements.values() if e.trait.trait == slots.JOINT_DRIVE]
        inputs = [r.inputs for r in readings if r.inputs is not None]
        super().__init__(
            rig, linear, np.concatenate([p.X[:, : len(linear.states)] for p in passes]),
            np.concatenate([r.u for r in readings]), readings[0].sample_time_s,
            dict(zip(drives, np.concatenate(inputs).T, strict=True)) if inputs else {},
            self._exerted if rig.config.model else None,
        )  # fmt: skip
        step, n, v = self.step_s, len(linear.bodies), linear.speed
        self._kicks = {} if kicks is None else dict(zip(linear.bodies, kicks[:, v : v + n].T, strict=True))
        self._recorded = np.concatenate([r.recorded for r in readings])
        self.recorded_s = step / readings[0].every
        self.shown = self._predicted(readings, passes)
        self.time = np.concatenate([r.sample_time_s * np.arange(len(r.u)) for r in readings])
        self.acceleration = {b: np.gradient(s, step) for b, s in self.speed.items()}
        modes = natural_frequencies_hz(rig)
        screw = rig.only("screw")
        self._anywhere = Place(
            duration_s=sum(len(r.u) * r.sample_time_s for r in readings), sample_time_s=step,
            modes=(float(modes.min()), float(modes.max())) if len(modes) else (0.0, 0.0), command=self._recorded,
            travel=2.0 * np.pi * screw.values["lead"] if screw else 0.0,
        )  # fmt: skip

    @staticmethod
    def _predicted(readings: list[Samples], passes: list[Pass]) -> dict[str, Floats]:
        """Channel -> (N,) what it was predicted to read; 0 in stretches that do not have it."""
        found = {}
        for channel in dict.fromkeys(c for r in readings for c in r.channels):
            parts = []
            for r, p in zip(readings, passes, strict=True):
                j = r.channels.index(channel) if channel in r.channels else -1
                parts.append(np.nan_to_num(r.y[:, j]) - p.D[:, j] if j >= 0 else np.zeros(len(r.u)))
            found[channel] = np.concatenate(parts)
        return found

    def ripples(self, name: str, above: float) -> Floats:
        """Waves a turn of a place that turns, of more than a number, that stand out in what corrects its speed.

        A force that is unknown there has to be corrected so.

        Returns
        -------
        (up to RIPPLES,) whole numbers; none that passes by in less than four samples.
        """
        body = self._moved(self.rig.elements[name]) if name in self.rig.elements else None
        if body not in self._kicks:
            return np.zeros(0)
        fastest = float(np.quantile(np.abs(self.speed[body]), 0.98)) * self.step_s
        most = int(min(FINEST_WAVE, 0.5 * np.pi / fastest)) if fastest > 0.0 else 0
        if most <= above:
            return np.zeros(0)
        bins, power = 8 * FINEST_WAVE, np.zeros(most + 2)
        ends = np.cumsum([0, *(len(r.u) for r in self._readings)])
        for number in {r.recording for r in self._readings}:  # positions begin anywhere in each
            parts = [
                slice(a, b) for r, a, b in zip(self._readings, ends, ends[1:], strict=False) if r.recording == number
            ]
            q, kick = (np.concatenate([x[part] for part in parts]) for x in (self.position[body], self._kicks[body]))
            bin_of = np.floor(bins * (q / (2.0 * np.pi) % 1.0)).astype(int) % bins
            power += np.abs(np.fft.rfft(np.bincount(bin_of, kick - kick.mean(), bins))[: most + 2]) ** 2
        k = np.arange(max(int(above) + 1, 1), most + 1)
        least = STANDS_OUT * np.median(power[k])
        k = k[(power[k] >= power[k - 1]) & (power[k] >= power[k + 1]) & (power[k] > least)]
        return np.sort(k[np.argsort(-power[k])[:RIPPLES]]).astype(float)

    def unknown_means(self, stretches: int) -> dict[str, Floats]:
        """Body -> (stretches,) mean acceleration that the predictor adds there; empty where its states are others."""
        return {
            body: np.array([np.mean(part) for part in np.array_split(kick, stretches)]) / self.step_s
            for body, kick in self._kicks.items()
        }

    def averaged(self, law: Callable[[Floats], Floats], drive: str = "") -> Floats:
        """(N,) a function of the command as recorded, or that of an actuator of several, averaged as the command is."""
        parts = []
        for r in self._readings:
            u = r.recorded if r.inputs is None or not drive else r.inputs[:, list(self.commands).index(drive)]
            parts.append(between(law(np.ascontiguousarray(u)), r.every)[0][: len(r.u)])
        return np.concatenate(parts)

    def _exerted(self) -> Floats:
        """(N, joints) what actuators of a simulator's model exert on each joint, N or N m."""
        each = zip(self._predictors, self._passes, strict=True)
        return np.concatenate([p.simulated.loads(self.rig, np.ascontiguousarray(found.X)) for p, found in each])

    def states(self, name: str) -> dict[str, Floats]:
        """State -> (N,) of a place, as tables are over them."""
        element = self.rig.elements.get(name)
        if element is None:
            return {}
        found: dict[str, Floats] = {"command": self.commands.get(name, self.command)}
        if name in self.position:
            found |= {"position": self.position[name], "speed": self.speed[name]}
        if element.trait.trait == slots.SPRING:
            found |= dict(zip(("stretch", "stretch rate"), self.stretch(element), strict=True))
        return found

    def __call__(self, name: str) -> Place:
        """The motion at a place, for an effect's declaration."""
        element = self.rig.elements.get(name)
        if element is None:
            shown = self.shown.get(name.removeprefix(SENSOR_PREFIX))
            return self._anywhere if shown is None else replace(self._anywhere, way=float(np.ptp(shown)))
        body = self._moved(element)
        if body is None:
            return replace(self._anywhere, values=element.values)
        speeds = np.abs(self.speed[body])
        fastest = float(np.quantile(speeds, 0.98))
        moving = speeds[speeds > MOVES * fastest]
        place = replace(
            self._anywhere, values=element.values, way=float(np.ptp(self.position[body])), speed=fastest,
            speed_slow=float(np.quantile(moving, 0.25)) if len(moving) else 0.0,
        )  # fmt: skip
        if element.trait.trait == slots.SPRING:
            stretch, rate = self.stretch(element)
            return replace(
                place, stretch=stretch, span=float(np.quantile(np.abs(stretch), 0.95)),
                reach=float(np.abs(stretch).max()), stretch_rate=float(np.quantile(np.abs(rate), 0.9)),
            )  # fmt: skip
        if element.trait.trait == slots.BODY and name in self.position:
            force = self.acting[name]
            return replace(place, force=force, force_most=3.0 * force)
        if element.trait.trait == slots.JOINT_DRIVE:
            return replace(place, command=self.commands[name])
        if element.trait.trait == slots.SERVO:
            asked = self.command - self.position[body]
            return replace(place, force=element.values["position_gain"] * float(np.quantile(np.abs(asked), 0.98)))
        return place

    def _moved(self, element: Element) -> str | None:
        """The body whose motion counts at an element: itself, what it drives, or the motor's rotor."""
        rotor = self.rig.motor_rotor()
        for name in (element.name, element.neighbours.get("drives"), rotor.name if rotor else None):
            if name in self.position:
                return str(name)
        return next(iter(self.position), None)


def motion_of(segments: Segments, rig: Rig, gains: list[Gains]) -> Motion:
    """The motion of a rig as predicted at given gains: in the middle of each sample, behind its correction."""
    passes, kicks = [], []
    for p, g in zip(segments.predictors, gains, strict=True):
        found = p.run(rig, g)
        X = found.X
        if X.shape[1] == g.K.shape[2]:
            Z = corrected(X, found.D, g, p.readings.which(g.opening, p.readings.y))
            kicks.append(Z[:, : len(segments.linear.states)] - X[:, : len(segments.linear.states)])
            Z[:-1] = 0.5 * (Z[:-1] + X[1:])
            found = replace(found, X=Z)
        passes.append(found)
    return Motion(segments, rig, passes, np.concatenate(kicks) if len(kicks) == len(passes) else None)
