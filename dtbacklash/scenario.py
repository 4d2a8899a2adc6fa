"""One closed-loop experiment: the rig wears, the controller works, the twin answers when it is asked."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from dtbacklash import closed_loop as loop
from dtbacklash import metrics, signals
from dtbacklash.config.run import RunConfig
from dtbacklash.control.controllers import build_controller, new_controller_state
from dtbacklash.control.design import (
    ControllerDesign,
    MotorParameters,
    StructureParameters,
    design_controller,
    dominant_frequency,
)
from dtbacklash.errors import Diverged, UserError
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.plant import Floats, Ints, new_state, place_at
from dtbacklash.physics.rig import Element, Rig, Sensor, build_rig
from dtbacklash.physics.simulate import rig_half_gap
from dtbacklash.twin.estimate import Problem, default_start, estimate_gap
from dtbacklash.twin.guard import Attempt, GuardSettings, Verdict, guarded_estimates, outcome, warm_up
from dtbacklash.twin.link import FullBuffer, TwinLink
from dtbacklash.twin.novelty import novelty_design
from dtbacklash.twin.observer import TwinModel, twin_model

#: samples between two calls of the progress callback (and two chances for Ctrl-C)
CHUNK = 5000
#: a sensor's unit in SI -> the unit, its factor and its suffix in traces
TRACE_UNITS = {
    "m": ("mm", 1e3),
    "rad": ("rad", 1.0),
    "A": ("a", 1.0),
    "m/s": ("mm_s", 1e3),
    "rad/s": ("rad_s", 1.0),
    "N": ("n", 1.0),
}

#: names that a sensor may not have: the columns of traces and recordings
RESERVED = ("t", "r", "u", "theta_d", "gap", "gap_hat", "eps", "novelty")

ESTIMATE_COLUMNS = [
    "t_event_s", "t_applied_s", "gap_deg", "true_gap_deg", "accepted", "reason", "cost", "evaluations", "wall_s",
]  # fmt: skip


@dataclass
class RunResult:
    """What a run gives; the columns are those that ``dtb run`` writes.

    trace : a row a sample. recording : what the sensors saw (t s, r mm, u V, then the sensors). moves : a row a
    move, see :func:`dtbacklash.metrics.move_table`. estimates : a row an estimation. summary : JSON-able figures of
    the run.
    """

    config: RunConfig
    trace: pd.DataFrame
    recording: pd.DataFrame
    moves: pd.DataFrame
    estimates: pd.DataFrame
    summary: dict[str, Any]


@dataclass
class _Run:
    """Everything that one run carries from segment to segment."""

    config: RunConfig
    rig: Rig
    signals: loop.Signals
    traces: loop.Traces
    roles: tuple[int, int]
    changes: Ints
    link: TwinLink[float]
    model: TwinModel | None
    gap_hat: float
    rows: list[dict[str, Any]] = field(default_factory=list)
    estimate_s: float = 0.0
    rejected: bool = False  # the last estimate was: ask again as long as the novelty index is high


def driven_chain(rig: Rig) -> tuple[list[Element], list[Element]]:
    """Masses and links behind the mass that the screw carries, in order.

    Raises
    ------
    UserError : the rig is not a screw-driven chain of masses, for which the paper's controllers are made.
    """
    screw = rig.only("screw")
    base = screw.neighbours.get("carries") if screw else None
    allowed = (
        "a rig with a motor, a screw that carries a mass, and a chain of links from there, or controller=open_loop"
    )
    if base is None or rig.only("motor_circuit") is None or rig.only("rotor") is None:
        raise UserError("rig", rig.config.name, f"this controller needs {allowed}")
    links, masses, here = [], [], base
    remaining = {e.name: e for e in rig.of_kind("link")}
    while step := [e for e in remaining.values() if here in e.neighbours["between"]]:
        link = step[0]
        here = next(end for end in link.neighbours["between"] if end != here)
        if len(step) > 1 or here not in rig.elements:
            break
        del remaining[link.name]
        links.append(link)
        masses.append(rig.elements[here])
    if remaining or not links:
        raise UserError("rig", rig.config.name, f"this controller needs {allowed}")
    return masses, links


def structure_parameters(rig: Rig) -> StructureParameters:
    """The chain that the screw drives, as the design wants it; raises as :func:`driven_chain`."""
    masses, links = driven_chain(rig)
    screw = rig.only("screw")
    assert screw is not None
    return StructureParameters(
        tuple(e.values["mass"] for e in masses),
        tuple(e.values["stiffness"] for e in links),
        tuple(e.values.get("damping", 0.0) for e in links),
        screw.values["lead"],
    )


def motor_parameters(rig: Rig) -> MotorParameters:
    """The motor of a rig as the design wants it; the rig has one (:func:`driven_chain` checks it)."""
    circuit, rotor = rig.only("motor_circuit"), rig.only("rotor")
    assert circuit is not None
    assert rotor is not None
    v = circuit.values
    return MotorParameters(
        rotor.values["inertia"], v["inductance"], v["resistance"], v["torque_constant"], v["emf_constant"]
    )


def design_for(config: RunConfig, rig: Rig) -> ControllerDesign | None:
    """The controller's design for a rig, from its nominal parameters alone (effects are what it does not know)."""
    c = config.controller
    if c.structure == "open_loop":
        return None
    structure = structure_parameters(rig)
    frequency = dominant_frequency(structure)
    if frequency * config.sample_time_s >= math.pi:
        allowed = f"sampling above twice the dominant mode's {frequency / (2 * math.pi):.3g} Hz"
        raise UserError("sample_time_s", config.sample_time_s, allowed)
    return design_controller(
        motor_parameters(rig), structure, c.k_theta_v_per_rad, c.prefilter, c.tau_r_s, config.sample_time_s
    )


def run_scenario(config: RunConfig, progress: Callable[[float], None] | None = None) -> RunResult:
    """Simulate one experiment.

    Parameters
    ----------
    config : the checked configuration. progress : called with the share simulated, 0 to 1.

    Raises
    ------
    UserError : the rig or the combination makes no sense. Diverged : the loop is unstable.
    """
    started = time.perf_counter()
    rig = build_rig(config.rig)
    design = design_for(config, rig)
    plant = compile_plant(rig, config.sample_time_s, config.solver.substeps, config.solver.event_levels)
    controller = build_controller(config.controller, design)
    state, control_state = new_state(plant), new_controller_state(controller)
    frequency = design.dominant_frequency_rad_s if design else 1.0
    detector = novelty_design(config.twin.novelty_filter, frequency, config.sample_time_s)
    detector_state = detector.initial_state()
    oscillator = (detector.sos, detector.cos_step, detector.sin_step)
    run = _prepare(config, rig)
    if plant.imposed:
        place_at(plant, state, run.signals.reference[0])
    # in open loop there is nothing that could be unstable by choice: a carriage may well run away
    if progress:
        progress(0.0)  # all checks are done: from here on compiled code runs
    if run.model is not None:
        warm_up(run.model, config.optimizer)
    limits_m = config.solver.divergence_mm * 1e-3 if design else math.inf
    threshold_m = config.twin.novelty_threshold_mm * 1e-3
    k, n = 0, config.samples + 1
    while k < n:
        _twin_due(run, k)
        stop = min(_next_stop(run, k, n), n)
        listening = config.controller.reconfigure == "novelty" and not _busy(run)
        limits = (limits_m, threshold_m if listening else math.inf)
        before = run.traces.novelty[k - 1] if k > 0 and not run.rejected else 0.0
        k, why = loop.run_segment(
            plant, state, controller, control_state, detector_state, oscillator, run.signals, run.traces, run.roles,
            k, stop, run.gap_hat, limits, before,
        )  # fmt: skip
        if why == loop.DIVERGED:
            _report_divergence(config, k * config.sample_time_s)
        if why == loop.NOVELTY:
            run.link.open(k, None if run.rejected else _last_change(run, k))
        if listening:
            run.rejected = False
        if progress:
            progress(k / n)
    return _collect(run, time.perf_counter() - started)


def _prepare(config: RunConfig, rig: Rig) -> _Run:
    """Signals in, room for the traces, the twin and its link."""
    n, sensors = config.samples + 1, list(rig.sensors.values())
    t_s = np.arange(n, dtype=np.float64) * config.sample_time_s
    r = signals.reference(config.reference, t_s, config.seed)
    closed = config.controller.structure != "open_loop"
    gap = np.radians(signals.gap_profile(config.profile, t_s)) + rig_half_gap(rig)
    if rig.only("gear") is None:
        gap = np.zeros(n)
    noise, resolution = _sensor_errors(config, sensors, n)
    into = loop.Signals(np.ascontiguousarray(r * (1e-3 if closed else 1.0)), gap, noise, resolution)
    traces = loop.Traces(*(np.zeros(n) for _ in range(5)), *(np.zeros((n, len(sensors))) for _ in range(2)))
    roles = _roles(rig, closed)
    changes = (np.flatnonzero(np.diff(r)) + 1).astype(np.int64)
    link: TwinLink[float] = TwinLink(config.twin.buffer, config.twin.delay_s, config.sample_time_s)
    run = _Run(config, rig, into, traces, roles, changes, link, None, math.radians(config.controller.gap_hat_deg))
    if config.controller.reconfigure != "never":
        run.model = twin_model(
            structure_parameters(rig),
            config.twin.observer_pole_rad_s,
            config.sample_time_s,
            config.twin.settle,
        )
    return run


def _sensor_errors(config: RunConfig, sensors: list[Sensor], n: int) -> tuple[Floats, Floats]:
    """Noise (n, sensors) or (0, sensors), and resolutions (sensors,), in SI."""
    noise, resolution = np.zeros((0, len(sensors))), np.zeros(len(sensors))
    columns = {_column(sensor): (j, TRACE_UNITS[sensor.unit][1]) for j, sensor in enumerate(sensors)}
    for kind, sizes in (("noise", config.sensors.noise), ("resolution", config.sensors.resolution)):
        for name, size in sizes.items():
            if name not in columns:
                raise UserError(f"sensors.{kind}.{name}", size, f"no such column; known: {', '.join(columns)}")
            j, factor = columns[name]
            if kind == "resolution":
                resolution[j] = size / factor
            elif size > 0.0:
                if not len(noise):
                    noise = np.zeros((n, len(sensors)))
                # a stream of its own for each sensor: adding one does not change the others
                rng = np.random.default_rng([config.seed, j])
                noise[:, j] = rng.normal(0.0, size / factor, n)
    return noise, resolution


def _column(sensor: Sensor) -> str:
    return f"{sensor.name}_{TRACE_UNITS[sensor.unit][0]}"


def _roles(rig: Rig, closed: bool) -> tuple[int, int]:
    """Which sensors show the motor's angle and the position of the last mass (-1: none)."""
    bodies = [e.name for e in rig.elements.values() if e.kind in ("mass", "carriage")]
    end = driven_chain(rig)[0][-1].name if closed else (bodies or [""])[-1]
    motor, output = -1, -1
    for j, sensor in enumerate(rig.sensors.values()):
        if sensor.quantity == "position" and rig.elements[sensor.of].kind == "rotor":
            motor = j
        elif sensor.quantity == "position" and sensor.of == end:
            output = j
    if closed and (motor < 0 or output < 0):
        allowed = f"a closed loop needs position sensors on the motor and on {end}"
        raise UserError("rig.sensors", ", ".join(rig.sensors), allowed)
    for j, name in enumerate(rig.sensors):
        if name in RESERVED or (name == "q3" and j != output) or (name == "theta_m" and j != motor):
            allowed = f"another name; kept for the traces: {', '.join(RESERVED)}, q3 ({end}) and theta_m (the motor)"
            raise UserError(f"rig.sensors.{name}", name, allowed)
    return motor, output


def _last_change(run: _Run, k: int) -> int:
    """The last change of the reference before sample k: memory still holds the motion that raised the alarm.

    A new attempt after a rejected one begins at its own event instead, since the same samples would say the same.
    """
    before = run.changes[run.changes < k]
    return int(before[-1]) if before.size else 0


def _busy(run: _Run) -> bool:
    """Whether a buffer fills or an answer is on its way; meanwhile the novelty index raises no further alarm."""
    return run.link.next_sample() is not None


def _next_stop(run: _Run, k: int, n: int) -> int:
    """The next sample at which Python has something to do."""
    stops = [k + CHUNK, n]
    if run.config.controller.reconfigure == "reference_change":
        later = run.changes[np.searchsorted(run.changes, k, side="right") :]
        stops += [int(later[0])] if later.size else []
    due = run.link.next_sample()
    return min([*stops, max(due, k + 1)] if due is not None else stops)


def _twin_due(run: _Run, k: int) -> None:
    """What is due before sample k: buffers to open or to send, answers to put in force."""
    if (full := run.link.full_buffer(k)) is not None:
        _estimate(run, full, k)
    for gap in run.link.arrived(k):
        run.gap_hat = gap
    if run.config.controller.reconfigure == "reference_change":
        at = np.searchsorted(run.changes, k)
        if at < run.changes.size and run.changes[at] == k:
            run.link.open(k)


def _estimate(run: _Run, full: FullBuffer, k: int) -> None:
    """The twin at work on a full buffer; what passes the guard is sent back."""
    began = time.perf_counter()
    window = slice(full.first, full.stop)
    assert run.model is not None
    gap_max = math.radians(run.config.twin.gap_max_deg)
    theta_m, q3 = (run.traces.seen[window, role] for role in run.roles)
    problem = Problem(theta_m, q3, run.model, gap_max)
    rng = np.random.default_rng([run.config.seed, full.event])
    if run.config.twin.guard:
        settings = GuardSettings(gap_max_deg=run.config.twin.gap_max_deg)
        attempts = guarded_estimates(problem, run.config.optimizer, run.gap_hat, settings, rng=rng)
    else:
        estimate = estimate_gap(problem, run.config.optimizer, default_start(problem, run.gap_hat), rng)
        attempts = [Attempt(estimate, Verdict(True, "not guarded"))]
    chosen = outcome(attempts)
    run.rejected = not chosen.verdict.accepted
    applied = math.nan
    if chosen.verdict.accepted:
        gap = chosen.estimate.gap_rad if run.config.twin.guard else chosen.estimate.fit_gap_rad
        applied = run.link.send(k, gap) * run.config.sample_time_s
    middle = min((full.first + full.stop) // 2, run.signals.gap.size - 1)
    for attempt in attempts:
        e = attempt.estimate
        run.rows.append({
            "t_event_s": full.event * run.config.sample_time_s,
            "t_applied_s": applied if attempt is chosen else math.nan,
            "gap_deg": math.degrees(e.gap_rad if run.config.twin.guard else e.fit_gap_rad),
            "true_gap_deg": math.degrees(run.signals.gap[middle]),
            "accepted": attempt.verdict.accepted,
            "reason": attempt.verdict.reason,
            "cost": e.cost_m2 * 1e6,
            "evaluations": e.evaluations,
            "wall_s": e.wall_s,
        })  # fmt: skip
    run.estimate_s += time.perf_counter() - began


def _report_divergence(config: RunConfig, t_s: float) -> None:
    c = config.controller
    what = f"|q3| above solver.divergence_mm={config.solver.divergence_mm:g} mm"
    raise Diverged("controller", c.name, t_s, what)


def _collect(run: _Run, total_s: float) -> RunResult:
    """Tables and summary of a finished run."""
    t, s = run.traces, run.signals
    time_s = np.arange(s.gap.size) * run.config.sample_time_s
    closed = run.config.controller.structure != "open_loop"
    r_mm = s.reference * (1e3 if closed else 1.0)
    sensors = list(run.rig.sensors.values())
    truth, seen = {}, {}
    for j, sensor in enumerate(sensors):
        factor = TRACE_UNITS[sensor.unit][1]
        truth[_column(sensor)] = t.truth[:, j] * factor
        seen[sensor.name] = t.seen[:, j] * factor
    q3 = truth.pop(_column(sensors[run.roles[1]])) if run.roles[1] >= 0 else np.full_like(time_s, math.nan)
    theta_m = truth.pop(_column(sensors[run.roles[0]])) if run.roles[0] >= 0 else np.full_like(time_s, math.nan)
    trace = pd.DataFrame({
        "t_s": time_s, "r_mm": r_mm, "q3_mm": q3, "u_v": t.u, "theta_m_rad": theta_m, "theta_d_rad": t.theta_d,
        "gap_deg": np.degrees(s.gap), "gap_hat_deg": np.degrees(t.gap_hat), "eps_mm": t.eps * 1e3,
        "novelty_mm": t.novelty * 1e3, **truth,
    })  # fmt: skip
    recording = pd.DataFrame({"t": time_s, "r": r_mm, "u": t.u, **seen})
    estimates = pd.DataFrame(run.rows, columns=ESTIMATE_COLUMNS)
    moves = metrics.move_table(trace if closed else trace.iloc[:0])  # in open loop r is no target of q3
    summary = _summary(run, trace, moves, estimates, total_s)
    return RunResult(run.config, trace, recording, moves, estimates, summary)


def _summary(
    run: _Run, trace: pd.DataFrame, moves: pd.DataFrame, estimates: pd.DataFrame, total_s: float
) -> dict[str, Any]:
    closed = run.config.controller.structure != "open_loop"
    return {
        "controller": run.config.controller.name,
        "n_moves": len(moves),
        "n_estimations": int(estimates["t_event_s"].nunique()),
        "n_attempts": len(estimates),
        "n_accepted": int(estimates["accepted"].sum()) if len(estimates) else 0,
        "overshoot_pct_max": float(moves["overshoot_pct"].max()) if len(moves) else None,
        # a move that does not settle has no settling time, and then the worst one has none either
        "settling_time_s_max": float(moves["settling_time_s"].max(skipna=False)) if len(moves) else None,
        "peak_voltage_v": float(trace["u_v"].abs().max()),
        "tracking_rms_mm": metrics.tracking_rms_mm(trace) if closed else None,
        "seconds_simulated": float(trace["t_s"].iloc[-1]),
        "moves": moves.to_dict("records"),
        "estimates": estimates.to_dict("records"),
        "wall_s": {"simulate": total_s - run.estimate_s, "estimate": run.estimate_s, "total": total_s},
    }
