"""One closed-loop experiment: the rig wears, the controller works, the twin answers when it is asked."""

import math
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np

from dtbacklash.arrays import Floats, Ints
from dtbacklash.config.rig import of_the_model
from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import Belief, Beliefs, beliefs_of, design_for, settled
from dtbacklash.control.design import ControllerDesign
from dtbacklash.control.handover import Rest, handed_over
from dtbacklash.control.laws import Controller, ControllerState, build_controller, new_controller_state
from dtbacklash.control.margins import DesignedLoop
from dtbacklash.errors import Diverged, UserError
from dtbacklash.experiment import loop, signals
from dtbacklash.experiment.advice import causes
from dtbacklash.experiment.aging import aged_rigs, aged_state
from dtbacklash.experiment.estimation import Estimation, answering
from dtbacklash.experiment.novelty_monitor import Watcher
from dtbacklash.experiment.realtime import RealTime, undisturbed
from dtbacklash.experiment.result import RunResult, Walls, collect
from dtbacklash.experiment.sensors import roles, sensor_errors
from dtbacklash.experiment.settling import AT_REST
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.kernel.plant import Plant, State, new_state, place_at
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.simulate import rig_half_gap
from dtbacklash.result_cache import kept
from dtbacklash.twin.gap.novelty import NoveltyDesign, novelty_design, novelty_index
from dtbacklash.twin.link.background import BackgroundTwin
from dtbacklash.twin.link.service import Answer, TwinService

__all__ = ["RunResult", "run_scenario", "true_half_gap"]

#: samples between two calls of the progress callback (and two chances for Ctrl-C)
CHUNK = 5000
#: for how long a new detector of novelty sees the present error before it counts, s
SETTLED_S = 3.0
#: a carriage in open loop may run away; beyond so many times ``solver.divergence_mm`` it is a mistake
OPEN_LOOP_RATIO = 1e3
#: no sensor shows more (SI)
SANE = 1e9
RUNS_AWAY = "the machine runs away: look at its parameters and at the size of the reference"


@dataclass
class _Machine:
    """What a segment advances: the plant, the controller and the detector of novelty, each with its memory.

    aged : what becomes of the plant, and from which sample on.
    """

    plant: Plant
    state: State
    controller: Controller
    control_state: ControllerState
    detector: NoveltyDesign
    detector_state: Floats
    watcher: Watcher | None = None
    clock: RealTime | None = None
    aged: list[tuple[int, Rig, Plant]] = field(default_factory=list)

    def take_up(self, asked: RunConfig, answer: Answer, gaps_rad: tuple[float, float], traces: loop.Traces,
                inputs: loop.Signals, which: tuple[int, int], k: int) -> ControllerDesign | None:  # fmt: skip
        """Controller, detector and indexes of another model, at rest as they are; gap and design change in one step.

        asked : the configuration before anything in it was settled. gaps_rad : before and after. k : the sample that
        comes next.
        """
        belief = answer.belief
        assert belief is not None
        config = settled(asked, Beliefs(belief, belief))
        design = design_for(config, belief)
        assert design is not None
        controller, detector = _controlling(config, design, belief)
        # the motor may creep in its gap: its angle is that of the last moment, beyond an encoder's counts
        first, last = max(k - AT_REST, 0), max(k - AT_REST // 10, 0)
        theta_m, q3 = (float(np.mean(traces.seen[at:k, role])) for at, role in zip((last, first), which, strict=True))
        # the reference may be about to change: the rest is that of the one in force until now
        here = Rest(inputs.reference[k - 1], theta_m, q3, float(np.mean(traces.u[first:k])), *gaps_rad)
        self.control_state = handed_over(self.controller, self.control_state, controller, here)
        self.controller, self.detector, self.detector_state = controller, detector, detector.initial_state()
        error = here.q3 - float(controller.sc @ self.control_state.s)
        errors = np.full(round(SETTLED_S / config.sample_time_s), error)
        novelty_index(errors, detector.sos, detector.cos_step, detector.sin_step, self.detector_state)
        if self.watcher is not None:
            before = self.watcher
            self.watcher = Watcher.prepare(config, belief, before.values.shape[0])
            assert self.watcher is not None
            self.watcher.values, self.watcher.alarms = before.values, before.alarms
        return design

    def run(
        self, inputs: loop.Signals, traces: loop.Traces, which: tuple[int, int], first: int, stop: int,
        in_force: loop.GapInForce, limits: tuple[float, float], before: float,
    ) -> tuple[int, int]:  # fmt: skip
        """Run the samples ``first <= k < stop``: see :func:`.loop.run_segment`; in real time each at its instant."""

        def advance(begin: int, end: int, level: float) -> tuple[int, int]:
            return self._advance(inputs, traces, which, begin, end, in_force, limits, level)

        if self.clock is None:
            return advance(first, stop, before)
        return self.clock.run(advance, traces.novelty, first, stop, before)

    def _advance(
        self, inputs: loop.Signals, traces: loop.Traces, which: tuple[int, int], first: int, stop: int,
        in_force: loop.GapInForce, limits: tuple[float, float], before: float,
    ) -> tuple[int, int]:  # fmt: skip
        oscillator = (self.detector.sos, self.detector.cos_step, self.detector.sin_step)
        return loop.run_segment(
            self.plant, self.state, self.controller, self.control_state, self.detector_state, oscillator, inputs,
            traces, which, first, stop, in_force, limits, before, self.watcher and self.watcher.struct(),
        )  # fmt: skip


def run_scenario(
    config: RunConfig,
    progress: Callable[[float], None] | None = None,
    beliefs: Beliefs | None = None,
    service: TwinService | None = None,
) -> RunResult:
    """Simulate one experiment.

    config : the checked configuration. progress : called with the share simulated, 0 to 1.
    beliefs : what controller and twin believe of the rig; None: what the configuration says.
    service : who estimates for the twin; None: a twin in this process.

    Raises UserError: the rig or the combination makes no sense. Diverged: the loop is unstable.
    """
    started = time.perf_counter()
    with ExitStack() as until_done:
        rig = build_rig(config.rig)
        beliefs = beliefs_of(config) if beliefs is None else beliefs
        asked, config = config, settled(config, beliefs)
        if config.pace == "real" and config.controller.reconfigure != "never" and service is None:
            service = until_done.enter_context(BackgroundTwin(answering(config, beliefs.twin)))
        design = _designed(config, beliefs.design)
        machine = _build(config, rig, design, beliefs.design)
        machine.aged = aged_rigs(config, machine.plant)
        inputs, changes = _inputs(config, rig)
        n, sensors = config.samples + 1, len(rig.sensors)
        traces = loop.Traces(*(np.zeros(n) for _ in range(5)), *(np.zeros((n, sensors)) for _ in range(2)))
        which = roles(rig, design is not None)
        twin = Estimation.prepare(config, beliefs.twin, changes, traces.seen, which, inputs.gap, service)
        if design is not None:
            machine.watcher = twin.watcher = Watcher.prepare(config, beliefs.twin, inputs.gap.size)
        if machine.plant.imposed:
            place_at(machine.plant, machine.state, inputs.reference[0])
        if progress:
            progress(0.0)  # all checks are done
        twin.u = traces.u
        twin.warm_up()
        if config.pace == "real":
            machine.clock = RealTime.of(config.samples, config.sample_time_s)
            until_done.enter_context(undisturbed())
        ready = time.perf_counter()
        _segments((asked, config), rig, design, machine, inputs, traces, which, twin, progress)
    end = time.perf_counter()
    walls = Walls(end - ready - twin.wall_s, twin.wall_s, end - started)
    designed = DesignedLoop.of(config, design, beliefs.design) if design is not None else None
    result = collect(config, rig, designed, inputs, traces, which, twin.table(), walls, machine.watcher)
    if machine.clock is not None:
        result.summary["pace"] = machine.clock.summary() | {"late_answers": twin.late}
    return result


def _designed(config: RunConfig, belief: Belief) -> ControllerDesign | None:
    """The design; a model that it cannot be made for is refused in its own name."""
    try:
        return design_for(config, belief)
    except UserError as mistake:
        believed = config.model is not None and config.controller.design_from == "model"
        raise of_the_model(mistake) if believed and mistake.key.startswith("rig") else mistake from mistake


def _build(config: RunConfig, rig: Rig, design: ControllerDesign | None, belief: Belief) -> _Machine:
    """Everything at rest."""
    solver = config.solver
    plant = compile_plant(rig, config.sample_time_s, solver.substeps, solver.event_levels)
    controller, detector = _controlling(config, design, belief)
    return _Machine(
        plant, new_state(plant), controller, new_controller_state(controller), detector, detector.initial_state()
    )


def _controlling(
    config: RunConfig, design: ControllerDesign | None, belief: Belief
) -> tuple[Controller, NoveltyDesign]:  # fmt: skip
    """The controller and the detector of novelty for a design."""
    forward = belief.feed_forward(tuple(config.controller.compensate)) if design else None
    frequency = design.dominant_frequency_rad_s if design else 1.0
    return (
        build_controller(config.controller, design, forward),
        kept(novelty_design, config.twin.novelty_filter, frequency, config.sample_time_s),
    )


def _inputs(config: RunConfig, rig: Rig) -> tuple[loop.Signals, Ints]:
    """The signals that go in, (N+1,) each, and the samples at which the reference changes."""
    t_s = np.arange(config.samples + 1, dtype=np.float64) * config.sample_time_s
    closed = config.controller.structure != "open_loop"
    r = signals.reference(config.reference, t_s, config.seed, command=not closed) * (1e-3 if closed else 1.0)
    gap = true_half_gap(config, rig, t_s)
    noise, resolution = sensor_errors(config, list(rig.sensors.values()), t_s.size)
    changes = (np.flatnonzero(np.diff(r)) + 1).astype(np.int64)
    moving = np.zeros(0)
    if config.reference.kind == "trajectory":  # known ahead, and a change from one rest to the next
        changes, moving = changes[np.diff(changes, prepend=-2) > 1], np.sign(np.diff(r, append=r[-1]))
    return loop.Signals(np.ascontiguousarray(r), gap, noise, resolution, moving), changes


def true_half_gap(config: RunConfig, rig: Rig, t_s: Floats) -> Floats:
    """(N+1,) the half-gap of the true rig at the times ``t_s``, rad: that of its gear and what the profile adds."""
    if rig.only("gear") is None:
        return np.zeros(t_s.size)
    return np.radians(signals.gap_profile(config.profile, t_s)) + rig_half_gap(rig)


def _segments(
    configs: tuple[RunConfig, RunConfig],
    rig: Rig,
    design: ControllerDesign | None,
    machine: _Machine,
    inputs: loop.Signals,
    traces: loop.Traces,
    which: tuple[int, int],
    twin: Estimation,
    progress: Callable[[float], None] | None,
) -> None:
    """Run from one sample at which Python has something to do to the next, to the end.

    configs : as asked for, and with what is ``auto`` in it settled.

    Raises Diverged: |q3| passes ``solver.divergence_mm`` in a closed loop.
    """
    asked, config = configs
    aged = list(machine.aged)
    limit_m = config.solver.divergence_mm * 1e-3 * (1.0 if design else OPEN_LOOP_RATIO)
    threshold_m = config.twin.novelty_threshold_mm * 1e-3
    chunk = CHUNK if machine.clock is None else machine.clock.chunk
    k, n = 0, inputs.gap.size
    while k < n:
        while aged and aged[0][0] <= k:
            _, rig, after = aged.pop(0)
            machine.plant, machine.state = after, aged_state(machine.plant, machine.state, after)
        twin.before(k)
        old_gap = twin.in_force.at(k)
        if (answer := twin.taken_up(k)) is not None:
            design = machine.take_up(asked, answer, (old_gap, twin.in_force.at(k)), traces, inputs, which, k)
            twin.watcher = machine.watcher
        stop = min([k + chunk, n, *twin.stops(k), *(one[0] for one in aged[:1])])
        listening = twin.listening
        limits = (limit_m, threshold_m if listening else math.inf)
        before = traces.novelty[k - 1] if k > 0 and not twin.rejected else 0.0
        before_k = k
        k, why = machine.run(inputs, traces, which, k, stop, twin.in_force.segment, limits, before)
        if listening and k > before_k + 1:
            twin.rejected = False  # the index has been low meanwhile
        if why == loop.DIVERGED:
            far = f"{OPEN_LOOP_RATIO:g} times " if design is None else ""
            what = f"|q3| above {far}solver.divergence_mm={config.solver.divergence_mm:g} mm"
            said = " ".join(causes(config, rig, design)) if design else RUNS_AWAY
            raise Diverged("controller", config.controller.name, k * config.sample_time_s, what, said)
        if why == loop.NOVELTY:
            twin.alarm(k)
        elif why >= loop.ALARM and machine.watcher is not None:
            twin.alarmed(k, machine.watcher.raised(k - 1, why))
        if listening:
            twin.rejected = False
        if not np.all(np.abs(traces.truth[before_k:k]) < SANE):
            what = f"a sensor above {SANE:g} (SI)"
            raise Diverged("controller", config.controller.name, k * config.sample_time_s, what, RUNS_AWAY)
        if progress:
            progress(k / n)
