"""From the settings of a planned experiment to its simulated recording, and what it would show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dtbacklash.config.experiments import IsolabilityConfig
from dtbacklash.config.run import ProfileConfig, ReferenceConfig, RunConfig

if TYPE_CHECKING:
    from dtbacklash.diagnose.experiments.isolability import Isolability
    from dtbacklash.recording import Recording

#: a bar goes on after each step
Tell = Callable[[float, str], None]


def isolable(config: IsolabilityConfig, jobs: int = 1, tell: Tell | None = None) -> Isolability:
    """What a planned experiment would show. jobs : threads that share the work.

    Raises
    ------
    UserError : a plan that cannot be read or simulated, moves nothing, or leaves a part unseen.
    """
    from threadpoolctl import threadpool_limits

    from dtbacklash.diagnose.experiments.isolability import isolability
    from dtbacklash.diagnose.spread import on_cores
    from dtbacklash.physics.rig import build_rig

    say = tell or (lambda share, text: None)
    say(0.0, "simulating the plan")
    run = _run_of(config)
    whole = _recorded(run)
    taken = _only(whole, config)

    def turned() -> Recording:
        say(0.4, "the same turned around")
        return _only(_turned(run, whole), config)

    def complete() -> Recording:
        say(0.7, "the same with all sensors")
        return whole

    with on_cores(jobs), threadpool_limits(1, "blas"):
        say(0.1, "what each effect would do")
        alone = config.controller.structure == "open_loop"
        return isolability(
            build_rig(config.rig), taken, config.unknown, turned if alone else None,
            complete if config.record and taken is not whole else None,
        )  # fmt: skip


def _run_of(config: IsolabilityConfig) -> RunConfig:
    """The run that simulates the plan: nothing wears, no twin is asked."""
    reference, duration_s, step_s = config.reference, config.duration_s, config.sample_time_s
    if config.command is not None:
        from dtbacklash.experiment.signals import span_of

        duration_s, step_s = span_of("command", config.command, step_s)
        reference = ReferenceConfig(kind="csv", path=config.command)
    return RunConfig(
        rig=config.rig, controller=replace(config.controller, reconfigure="never"), reference=reference,
        profile=ProfileConfig(kind="constant", start_deg=0.0, end_deg=0.0), sensors=config.sensors,
        duration_s=duration_s, sample_time_s=step_s, seed=config.seed,
    )  # fmt: skip


def _recorded(run: RunConfig) -> Recording:
    from dtbacklash.closing import recording_of
    from dtbacklash.experiment.run import run_scenario

    return recording_of(run_scenario(run))


def _turned(run: RunConfig, whole: Recording) -> Recording:
    """The recording of the command, and then of the same with the other sign."""
    import tempfile
    from pathlib import Path

    import pandas as pd

    u = np.concatenate([whole.channels["u"][:-1], -whole.channels["u"]])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "turned.csv"
        pd.DataFrame({"t": run.sample_time_s * np.arange(len(u)), "u": u}).to_csv(path, index=False)
        again = replace(run, reference=ReferenceConfig(kind="csv", path=str(path)), duration_s=2.0 * run.duration_s)
        return _recorded(again)


def _only(recording: Recording, config: IsolabilityConfig) -> Recording:
    """The recording with the sensors that are to be recorded."""
    left_out = [name for name in config.rig.sensors if config.record and name not in config.record]
    if not left_out:
        return recording
    kept = {name: values for name, values in recording.channels.items() if name not in left_out}
    return replace(recording, channels=kept)
