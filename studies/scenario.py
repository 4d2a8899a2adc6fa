"""The scenarios that are timed, ready to be simulated by any of the contestants."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.compose import compose
from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import beliefs_of, design_for, settled
from dtbacklash.control.chain import MotorParameters, StructureParameters
from dtbacklash.control.design import ControllerDesign
from dtbacklash.control.laws import Controller, build_controller, new_controller_state
from dtbacklash.experiment import loop
from dtbacklash.experiment.run import RunResult, run_scenario
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.kernel.plant import Plant, new_state
from dtbacklash.physics.rig import build_rig
from dtbacklash.twin.gap.novelty import NoveltyDesign, novelty_design

PAPER = ("controller=nimc_twin",)
#: what slow contestants simulate: two moves with the gear in its gap and out of it, a constant gap of 50 deg
SHORT = (
    "controller=nimc_fixed", "profile=constant", "profile.start_deg=50", "profile.end_deg=50",
    "reference.period_s=4", "duration_s=4",
)  # fmt: skip


@dataclass(frozen=True)
class Scenario:
    """Inputs, design and parameters of one scenario, and the run that says which estimate was in force when.

    reference_m, gap_rad, gap_hat_rad, q3_m: (N+1,), q3_m as ``dtb run`` finds it.
    """

    config: RunConfig
    result: RunResult
    design: ControllerDesign
    motor: MotorParameters
    structure: StructureParameters
    plant: Plant
    controller: Controller
    detector: NoveltyDesign
    reference_m: Floats
    gap_rad: Floats
    gap_hat_rad: Floats
    q3_m: Floats

    @property
    def seconds(self) -> float:
        """Simulated time [s]."""
        return self.config.duration_s


def prepare(*overrides: str) -> Scenario:
    """Compose, design and run a scenario once."""
    config = compose(*overrides)
    rig = build_rig(config.rig)
    config = settled(config, beliefs_of(config))
    belief = beliefs_of(config).design
    design, linear = design_for(config, belief), belief.linear()
    assert design is not None
    result = run_scenario(config)
    columns = (("r_mm", 1e-3), ("gap_deg", np.pi / 180), ("gap_hat_deg", np.pi / 180), ("q3_mm", 1e-3))
    arrays = [result.trace[name].to_numpy() * factor for name, factor in columns]
    solver = config.solver
    plant = compile_plant(rig, config.sample_time_s, solver.substeps, solver.event_levels)
    controller = build_controller(config.controller, design)
    detector = novelty_design(config.twin.novelty_filter, design.dominant_frequency_rad_s, config.sample_time_s)
    return Scenario(config, result, design, linear.motor, linear.structure, plant, controller, detector, *arrays)


def new_traces(n: int, sensors: int) -> loop.Traces:
    """Room for the traces of n samples."""
    u, theta_d, gap_hat, eps, novelty = (np.zeros(n) for _ in range(5))
    return loop.Traces(u, theta_d, gap_hat, eps, novelty, np.zeros((n, sensors)), np.zeros((n, sensors)))


def ours(scenario: Scenario) -> Floats:
    """q3 [m] by our compiled loop, segment by segment between changes of the estimate, as ``dtb run`` does it."""
    n, sensors = scenario.reference_m.size, len(scenario.plant.sensor)
    signals = loop.Signals(scenario.reference_m, scenario.gap_rad, np.zeros((0, sensors)), np.zeros(sensors))
    traces = new_traces(n, sensors)
    state, control_state = new_state(scenario.plant), new_controller_state(scenario.controller)
    detector = scenario.detector
    memory = detector.initial_state()
    edges = [0, *(np.flatnonzero(np.diff(scenario.gap_hat_rad)) + 1), n]
    for first, stop in pairwise(edges):
        loop.run_segment(
            scenario.plant, state, scenario.controller, control_state, memory,
            (detector.sos, detector.cos_step, detector.sin_step), signals, traces, (0, 1), int(first), int(stop),
            loop.GapInForce(float(scenario.gap_hat_rad[first])), (1.0, np.inf), 0.0,
        )  # fmt: skip
    return traces.truth[:, 1]
