"""The experiments behind the paper's figures, run once and handed to the figures and the claims."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.compose import compose
from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import beliefs_of, design_for
from dtbacklash.control.chain import MotorParameters, StructureParameters
from dtbacklash.control.design import ControllerDesign
from dtbacklash.experiment.run import RunResult, run_scenario
from dtbacklash.physics.effects.spring import play

#: half-gap throughout, and first estimate of it: three moves
_GAP_100 = ("profile=constant", "profile.start_deg=100", "duration_s=60")

#: standard deviation of the white noise on q3, mm, with which the two amplitudes of section 4.2 are compared: half the
#: novelty threshold, so that the raw amplitude passes it now and then
NOISE_MM = 0.05

#: the disturbances of section 1: N on mass_3, at the output, and N m on the motor, at the input
FORCE_N, TORQUE_N_M = 1.0, 0.02

#: the experiments in which the structure loads the motor by its masses alone: nothing holds mass 1 to the ground
INERTIAL = ("load", "load_inner_loop")

#: figure or experiment -> the words of `dtb run` that make it
SCENARIOS: dict[str, tuple[str, ...]] = {
    "fig4": ("experiment=fig4",),
    "fig6": ("experiment=fig6",),
    "fig8": ("experiment=fig8",),
    "fig10": ("experiment=fig10",),
    "fig13": ("experiment=fig13",),
    "fig14": ("experiment=fig14",),
    # section 1 and 2.1: a disturbance, and the structure's load on the motor
    "force": ("experiment=fig6", f"rig.effects.mass_3.constant_force.force={FORCE_N}", "duration_s=20"),
    "torque": ("experiment=fig6", f"rig.effects.motor_bearing.constant_load.torque={TORQUE_N_M}", "duration_s=20"),
    "load": ("experiment=fig6", "rig.effects.screw.load_reaction.share=1"),
    "load_inner_loop": ("experiment=fig6", "rig.effects.screw.load_reaction.share=1",
                        "controller.internal_model=inner_loop"),
    # abstract: NIMC with the exact gap, with a wrong one, and linear IMC with it
    "no_gap": ("experiment=fig8", "profile=constant", "profile.start_deg=0", "duration_s=60"),
    "linear": ("experiment=fig8", *_GAP_100),
    "exact": ("experiment=fig10", *_GAP_100, "controller.gap_hat_deg=100"),
    "below": ("experiment=fig10", *_GAP_100, "controller.gap_hat_deg=80"),
    "above": ("experiment=fig10", *_GAP_100, "controller.gap_hat_deg=120"),
    # section 4.1: other optimizers, no delay, and the plain minimum of (18) without this project's guard and correction
    "lbfgsb": ("experiment=fig13", "optimizer=lbfgsb"),
    "nelder_mead": ("experiment=fig13", "optimizer=nelder_mead"),
    "differential_evolution": ("experiment=fig13", "optimizer=differential_evolution"),
    "dual_annealing": ("experiment=fig13", "optimizer=dual_annealing"),
    "no_delay": ("experiment=fig13", "twin.delay_s=0"),
    "unguarded": ("experiment=fig13", "twin=unguarded"),
    # section 4.2: noise while there is next to no gap, and springs that have become softer
    "noise": ("experiment=fig14", f"sensors.noise.q3_mm={NOISE_MM}", "duration_s=60"),
    "soft": ("experiment=fig8", "rig.parameters.k.value=8000"),
}  # fmt: skip

#: of them, those with another optimizer than the paper's
OPTIMIZERS = ("lbfgsb", "nelder_mead", "differential_evolution", "dual_annealing")

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
    play: Play
    design: ControllerDesign
    motor: MotorParameters
    structure: StructureParameters

    def q3_mm(self, run: str) -> Floats:
        """q3 of a run, shape (n,)."""
        return self.runs[run].trace["q3_mm"].to_numpy()


def run_experiments(progress: Callable[[float], None] | None = None) -> Experiments:
    """Run them all; ``progress`` gets the share done, 0 to 1."""
    runs = {}
    tell = progress or (lambda share: None)
    tell(0.0)
    for name, words in SCENARIOS.items():
        runs[name] = run_scenario(configured(name, words))
        tell(len(runs) / len(SCENARIOS))
    config = runs["fig13"].config
    belief = beliefs_of(config).design
    design, linear = design_for(config, belief), belief.linear()
    assert design is not None
    return Experiments(runs, play_under_growing_sine(), design, linear.motor, linear.structure)


def configured(name: str, words: tuple[str, ...]) -> RunConfig:
    """The configuration of an experiment."""
    config = compose(*words)
    if name not in INERTIAL:
        return config
    base = {key: value for key, value in config.rig.elements["mass_1"].items() if not key.startswith("ground_")}
    return replace(config, rig=replace(config.rig, elements={**config.rig.elements, "mass_1": base}))


def play_under_growing_sine(duration_s: float = 10.0, step_s: float = 1e-3) -> Play:
    """theta_m = (1 + t/10) sin(2 pi t) rad through a play of 20 degrees (section 3.1)."""
    t_s = np.arange(0.0, duration_s + step_s / 2, step_s)
    theta_m = (1.0 + t_s / 10.0) * np.sin(2.0 * np.pi * t_s)
    theta_d = np.zeros_like(theta_m)
    for k in range(1, t_s.size):
        theta_d[k] = play(theta_d[k - 1], theta_m[k], np.radians(PLAY_GAP_DEG))
    return Play(t_s, np.degrees(theta_m), np.degrees(theta_d))
