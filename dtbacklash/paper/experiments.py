"""The experiments behind the paper's figures, run once and handed to the figures and the claims."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from dtbacklash.arrays import Floats
from dtbacklash.config.compose import compose
from dtbacklash.control.belief import beliefs_of, design_for
from dtbacklash.control.design import ControllerDesign, MotorParameters, StructureParameters
from dtbacklash.experiment.run import RunResult, run_scenario
from dtbacklash.physics.effects.play import play

#: figure or experiment -> the words of `dtb run` that make it
SCENARIOS: dict[str, tuple[str, ...]] = {
    "fig4": ("experiment=fig4",),
    "fig6": ("experiment=fig6",),
    "fig8": ("experiment=fig8",),
    "fig10": ("experiment=fig10",),
    "fig13": ("experiment=fig13",),
    "fig14": ("experiment=fig14",),
    "exact": ("experiment=fig10", "profile=constant", "profile.start_deg=100", "controller.gap_hat_deg=100",
              "duration_s=60"),
}  # fmt: skip

PLAY_GAP_DEG = 20.0


@dataclass(frozen=True)
class Play:
    """Figure 7: the play operator under a growing sine; degrees."""

    t_s: Floats
    theta_m_deg: Floats
    theta_d_deg: Floats


@dataclass(frozen=True)
class Experiments:
    """All that the claims are about."""

    runs: dict[str, RunResult]
    moves: dict[str, pd.DataFrame]
    play: Play
    design: ControllerDesign
    motor: MotorParameters
    structure: StructureParameters


def run_experiments(progress: Callable[[float], None] | None = None) -> Experiments:
    """Run them all; ``progress`` gets the share done, 0 to 1."""
    runs = {}
    if progress:
        progress(0.0)
    for j, (name, words) in enumerate(SCENARIOS.items()):
        runs[name] = run_scenario(compose(*words))
        if progress:
            progress((j + 1) / len(SCENARIOS))
    config = runs["fig13"].config
    belief = beliefs_of(config).design
    design, linear = design_for(config, belief), belief.linear()
    assert design is not None
    moves = {name: run.moves for name, run in runs.items()}
    return Experiments(runs, moves, play_under_growing_sine(), design, linear.motor, linear.structure)


def play_under_growing_sine(duration_s: float = 10.0, step_s: float = 1e-3) -> Play:
    """theta_m = (1 + t/10) sin(2 pi t) rad through a play of 20 degrees (section 3.1)."""
    t_s = np.arange(0.0, duration_s + step_s / 2, step_s)
    theta_m = (1.0 + t_s / 10.0) * np.sin(2.0 * np.pi * t_s)
    theta_d = np.zeros_like(theta_m)
    for k in range(1, t_s.size):
        theta_d[k] = play(theta_d[k - 1], theta_m[k], np.radians(PLAY_GAP_DEG))
    return Play(t_s, np.degrees(theta_m), np.degrees(theta_d))
