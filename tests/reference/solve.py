"""Integration by SciPy's DOP853, stopped and started again at every contact, at every transition between sticking
and slipping, and at every change of the inputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.signal import lsim

from dtbacklash.physics.rig import Rig

from .machines import machine
from .newton import FREE, GROUND, RIGID, SCREW, Contact

Array = NDArray[np.float64]

#: the electrical time constant is 0.1 ms: no step longer than this, so that no event can hide in one
LONGEST_STEP_S = 1e-3
STEP_AFTER_EVENT_S, SHORTEST_STEP_S = 1e-6, 1e-12
#: lengths are integrated in millimetres, so that one absolute tolerance suits angles, currents and lengths
MILLI = 1e-3


@dataclass(frozen=True)
class Solution:
    """Sensors by name (SI), the screw's angle, and how often the gear and the frictions changed their state."""

    t_s: Array
    sensors: dict[str, Array]
    theta_d_rad: Array
    states: Array
    events: int


class _Run:
    def __init__(self, rig: Rig, rtol: float, atol: float) -> None:
        self.rig, self.machine = rig, machine(rig)
        self.rtol, self.atol = rtol, atol
        it = self.machine
        self.scale = np.ones(it.size)
        for name, body in it.bodies.items():
            if name != it.rotor:
                self.scale[[body.q, body.v]] = MILLI
        self.events = 0

    # --- modes -------------------------------------------------------------------------------------------------

    def margins(self) -> list[Callable[[float, Array], float]]:
        """One function for each way in which the present mode can end: positive while it lasts."""
        it, found = self.machine, []
        if self._gear_watched():
            rotor = it.bodies[it.rotor]
            if it.resting:
                found.append(lambda t, y: it.leaning(t, self.si(y), it.resting)[0])
                found.append(lambda t, y: -it.leaning(t, self.si(y), it.resting)[1])
            elif it.gear == FREE:
                found.append(lambda t, y: it.half_gap(t) - (y[rotor.q] - it.held))
                found.append(lambda t, y: it.half_gap(t) + (y[rotor.q] - it.held))
            else:
                found.append(lambda t, y: it.gear * y[rotor.v] - it.gap[2])
        for j, contact in enumerate(it.contacts):
            if contact.mode:
                found.append(lambda t, y, c=contact: c.mode * it.slip(t, self.si(y), c))
            else:
                found.append(lambda t, y, c=contact, j=j: it.most_held(t, self.si(y), c) - it.holding(t, self.si(y))[j])
                found.append(lambda t, y, c=contact, j=j: it.most_held(t, self.si(y), c) + it.holding(t, self.si(y))[j])
        for function in found:
            function.terminal, function.direction = True, -1.0
        return found

    def _gear_watched(self) -> bool:
        """Whether the gear can change its state; while friction stops the motor at a steady gap, friction decides."""
        it = self.machine
        if not it.screw or not it.rotor or it.gear == RIGID:
            return False
        rubbing = [c for c in it.contacts if c.b == it.rotor]
        sticking = any(c.mode == 0 for c in rubbing)
        if it.gear == FREE:
            return not (sticking and it.gap[2] >= 0.0)
        return not (rubbing and it.gap[2] == 0.0)

    def si(self, y: Array) -> list[float]:
        return (y * self.scale).tolist()

    def cross(self, which: int, t: float, y: Array) -> None:
        """Change the mode whose margin number ``which`` has ended, and everything that follows at once."""
        it = self.machine
        self.events += 1
        gear = 0
        if self._gear_watched():
            gear = 2 if it.gear == FREE else 1
            if which < gear:
                if it.resting:
                    it.gear, it.resting = (FREE if which == 0 else it.resting), 0
                elif it.gear == FREE:
                    self._close(1 if which == 0 else -1, t, y)
                else:
                    self._open(t, y)
                self.settle(t, y)
                return
        which -= gear
        for contact in it.contacts:
            if contact.mode:
                if which == 0:
                    contact.mode = 0
                    self._align(t, y, contact)
                which -= 1
            else:
                if which in (
                    0,
                    1,
                ):  # the force on b cannot rise above (fall below) the level: b slips back (forth)
                    contact.mode = -1 if which == 0 else 1
                which -= 2
        self.settle(t, y)

    def _close(self, side: int, t: float, y: Array) -> None:
        """The teeth meet without rebound: J w + 0 = (J + share lead^2 M) w', seen from the moving tooth."""
        it = self.machine
        it.gear = side
        screw, rotor = it.screw, it.bodies[it.rotor]
        if screw.share and screw.carried not in it.bodies:
            extra = screw.share * screw.lead**2 * screw.carried_mass
            y[rotor.v] = (rotor.inertia * y[rotor.v] + extra * side * it.gap[2]) / (rotor.inertia + extra)
        for contact in it.contacts:  # the screw's end has jumped into motion: what rubs on it slips
            slip = it.slip(t, self.si(y), contact)
            if screw.carried in (contact.a, contact.b) and screw.carried not in it.bodies and slip != 0.0:
                contact.mode = 1 if slip > 0.0 else -1

    def _open(self, t: float, y: Array) -> None:
        """The screw stops where it is; a motor that is only too weak for the load leans on it."""
        it = self.machine
        side, it.held = it.gear, it.screw_angle(t, y)[0]
        it.gear = FREE
        if it.screw.share and it.leaning(t, self.si(y), side)[0] > 0.0:
            assert not any(c.b == it.rotor for c in it.contacts), "no dry friction on a motor that leans on its load"
            it.resting = side
            y[it.bodies[it.rotor].v] = side * it.gap[2]

    def _align(self, t: float, y: Array, contact: Contact) -> None:
        """Take the last rounding error out of the slip of a contact that has come to rest."""
        it = self.machine
        slip = it.slip(t, self.si(y), contact)
        moving, sign = (contact.b, -1.0) if contact.b in it.bodies else (contact.a, 1.0)
        v = it.bodies[moving].v
        y[v] += sign * slip / self.scale[v]
        if contact.a == GROUND:
            y[v] = 0.0

    def settle(self, t: float, y: Array) -> None:
        """Make the modes agree with the inputs: break loose what cannot be held, open a gear that is pulled."""
        it = self.machine
        for _ in range(2 * len(it.contacts) + 2):
            forces, changed = it.holding(t, self.si(y)), False
            for contact, force in zip(it.contacts, forces, strict=True):
                if contact.mode == 0 and abs(force) > it.most_held(t, self.si(y), contact) * (1.0 + 1e-9):
                    contact.mode, changed = (-1 if force > 0.0 else 1), True
            if not changed:
                break
        if it.resting:
            free, loaded = it.leaning(t, self.si(y), it.resting)
            if free < 0.0 or loaded > 0.0:
                it.gear, it.resting = (FREE if free < 0.0 else it.resting), 0
        if it.gear in (1, -1):
            rotor = it.bodies[it.rotor]
            turns = y[rotor.v]
            for contact in it.contacts:
                if contact.b == it.rotor and abs(turns) < 1e-12:  # it is just breaking loose, or sticks
                    turns = contact.mode * 1e-300
            if it.gear * turns < it.gap[2] - 1e-9 or (it.gap[2] == 0.0 and it.gear * turns < 0.0):
                self._open(t, y)

    # --- time --------------------------------------------------------------------------------------------------

    def piece(self, t0: float, t1: float, y: Array, wanted: Array, keep: Callable[[Array, Array], None]) -> Array:
        """Integrate while the inputs stay as they are; ``keep`` gets states at the ``wanted`` times."""
        it, t = self.machine, t0
        step = None
        self.settle(t, y)
        while t < t1:
            at = wanted[(wanted > t) & (wanted <= t1)]
            out = solve_ivp(
                lambda s, z: np.array(it.rates(s, self.si(z))) / self.scale, (t, t1), y, method="DOP853",
                t_eval=np.append(at, t1) if at.size == 0 or at[-1] < t1 else at,
                events=self.margins() or None, rtol=self.rtol, atol=self.atol,
                max_step=LONGEST_STEP_S, first_step=step and min(step, t1 - t),
            )  # fmt: skip
            assert out.success, out.message
            ended = out.status == 1
            reached = len(at) if not ended else int(np.searchsorted(at, out.t[-1], side="right")) if len(out.t) else 0
            if reached:
                keep(out.t[:reached], out.y[:, :reached].T)
            if not ended:
                return out.y[:, -1]
            which = next(j for j, times in enumerate(out.t_events) if len(times))
            # a contact that has just broken loose comes to rest again so soon that the first step misses the slip
            no_progress = out.t_events[which][0] == t and step is not None and step > SHORTEST_STEP_S
            step = step / 100.0 if no_progress else STEP_AFTER_EVENT_S
            t, y = float(out.t_events[which][0]), out.y_events[which][0].copy()
            if not no_progress:
                self.cross(which, t, y)
        return y


def solve(
    rig: Rig,
    u: Array,
    sample_time_s: float,
    gap_rad: Array | None = None,
    start: dict[str, float] | None = None,
    rtol: float = 1e-10,
    atol: float = 1e-11,
) -> Solution:
    """Solve a rig from rest for commands held over each sample.

    Parameters
    ----------
    u : (N,) V. gap_rad : (N+1,) half-gap added to the rig's own, rad, straight between samples.
    start : positions of bodies at the start, m or rad. atol : in A, rad, mm and their rates.
    """
    run = _Run(rig, rtol, atol)
    it, n = run.machine, len(u)
    gap = _own_gap(rig) + (np.zeros(n + 1) if gap_rad is None else gap_rad)
    t_s = sample_time_s * np.arange(n + 1)
    lags = _lags(rig)
    wanted = np.unique(np.concatenate([t_s - lag for lag in {0.0, *lags.values()}]))
    wanted = wanted[wanted > 0.0]
    y = np.zeros(it.size)
    for name, value in (start or {}).items():
        y[it.bodies[name].q] = value / run.scale[it.bodies[name].q]
    times, states, angles, travels = [np.zeros(1)], [(y * run.scale)[None]], [0.0], [(0.0, 0.0)]

    def keep(t: Array, ys: Array) -> None:
        times.append(t)
        states.append(ys * run.scale)
        for time, x in zip(t, ys * run.scale, strict=True):
            angles.append(it.screw_angle(time, x)[0] if it.screw else 0.0)
            travels.append(it.ends(time, x)[SCREW] if it.screw else (0.0, 0.0))

    late = it.amplifier.get("delay", {}).get("time", 0.0)
    for t0, t1, drive, at in _pieces(np.asarray(u, float), gap, t_s, late):
        k = min(int(at), n - 1)
        it.drive = it.amplify(drive)
        it.gap = t_s[k], gap[k], (gap[k + 1] - gap[k]) / sample_time_s
        _mode_for_gap(run, t0, y)
        y = run.piece(t0, t1, y, wanted[(wanted > t0) & (wanted <= t1)], keep)
    return _solution(rig, run, t_s, np.concatenate(times), np.concatenate(states), angles, travels, lags)


def _mode_for_gap(run: _Run, t: float, y: Array) -> None:
    it = run.machine
    if it.rotor and it.screw:
        none = it.gap[1] == 0.0 and it.gap[2] == 0.0
        if none:
            it.gear = RIGID
        elif it.gear == RIGID:
            it.held, it.gear = float(y[it.bodies[it.rotor].q]), FREE


def _pieces(u: Array, gap: Array, t_s: Array, late: float) -> list[tuple[float, float, float, float]]:
    """(start, end, command, sample in which it starts) wherever a command or the slope of the gap changes."""
    n, slopes = len(u), np.diff(gap)
    cuts: dict[float, None] = {0.0: None, float(t_s[-1]): None}
    before = np.concatenate([[0.0], u[:-1]])
    for k in np.nonzero(u != before)[0]:
        if t_s[k] + late < t_s[-1]:
            cuts[float(t_s[k] + late)] = None
    for k in np.nonzero(np.abs(np.diff(slopes)) > 1e-12)[0]:
        cuts[float(t_s[k + 1])] = None
    edges = sorted(cuts)
    step = t_s[1]
    found = []
    for t0, t1 in pairwise(edges):
        middle = 0.5 * (t0 + t1)
        k = int(np.floor((middle - late) / step))
        first = int(np.floor(t0 / step + 1e-6))
        found.append((t0, t1, float(u[min(k, n - 1)]) if k >= 0 else 0.0, first))
    return found


def _own_gap(rig: Rig) -> float:
    gear = rig.only("gear")
    return (rig.effects.get(gear.name, {}).get("backlash", {}).get("half_gap", 0.0)) if gear else 0.0


#: what a filter is given, at equal steps, s
FINE_S = 2e-5


def _lags(rig: Rig) -> dict[str, float]:
    return {s: rig.effects.get(f"sensor_{s}", {}).get("delay", {}).get("time", 0.0) for s in rig.sensors}


def _solution(rig, run, t_s, times, states, angles, travels, lags) -> Solution:
    it, sensors = run.machine, {}
    carried = it.screw.carried if it.screw else None
    for name, sensor in rig.sensors.items():
        index = np.searchsorted(times, t_s - lags[name] - 1e-12)
        if sensor.quantity == "current":
            values = states[:, 0]
        elif sensor.quantity == "force":
            values = np.array([it.force_in(sensor.of, t, x) for t, x in zip(times, states.tolist(), strict=True)])
        elif sensor.of == carried and carried not in it.bodies:
            values = np.array(travels)[:, 0 if sensor.quantity == "position" else 1]
        else:
            body = it.bodies[sensor.of]
            values = states[:, body.q if sensor.quantity == "position" else body.v]
        there = rig.effects.get(f"sensor_{name}", {})
        values = _filtered(there, times, values)
        seen = np.where(t_s - lags[name] > -1e-12, values[np.minimum(index, len(values) - 1)], 0.0)
        seen = _behind_a_play(there.get("lost_motion", {}).get("width", 0.0), seen)
        gain = 1.0 + there.get("gain_error", {}).get("relative", 0.0)
        sensors[name] = gain * seen + there.get("offset", {}).get("offset", 0.0)
    index = np.searchsorted(times, t_s - 1e-12)
    return Solution(t_s, sensors, np.array(angles)[index], states[index], run.events)


def _filtered(there: dict[str, dict[str, float]], times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A signal behind a low-pass, at rest at first."""
    low = there.get("second_order_low_pass") or there.get("low_pass")
    if not low:
        return values
    w, fine = 2.0 * np.pi * low["cutoff"], np.arange(0.0, times[-1] + FINE_S, FINE_S)
    ratio = low.get("damping_ratio")
    system = ([w * w], [1.0, 2.0 * ratio * w, w * w]) if ratio else ([w], [1.0, w])
    once = np.unique(times, return_index=True)[1]
    _, shown, _ = lsim(system, PchipInterpolator(times[once], values[once])(np.minimum(fine, times[-1])), fine)
    return np.asarray(np.interp(times, fine, shown))


def _behind_a_play(width: float, values: np.ndarray) -> np.ndarray:
    """What a gap of this width passes on, sample by sample."""
    shown, at = np.empty(len(values)), 0.0
    for k, value in enumerate(values.tolist()):
        at = shown[k] = min(max(at, value - 0.5 * width), value + 0.5 * width)
    return shown
