"""From the settings of a planned experiment to its simulated recording, and what it would show."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dtbacklash.api.progress import ShowProgress, cores_of, shown
from dtbacklash.api.rigs import RigLike, description, load_rig
from dtbacklash.config.commands import DesignConfig, IsolabilityConfig
from dtbacklash.config.compose import compose_for
from dtbacklash.config.grammar import grammar_of
from dtbacklash.config.hydra_app import quoted
from dtbacklash.config.run import ProfileConfig, ReferenceConfig, RunConfig
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.arrays import Floats
    from dtbacklash.diagnosis.experiments.design import Design, Limits
    from dtbacklash.diagnosis.experiments.isolability import Isolability
    from dtbacklash.diagnosis.experiments.rivalry import Rival, Rivalry
    from dtbacklash.diagnosis.planning import Observed
    from dtbacklash.physics.rig import Rig
    from dtbacklash.recording import Recording

#: an experiment is no longer than this where nothing is said, s
DURATION_S = 10.0
#: a bar goes on after each step
Tell = Callable[[float, str], None]


def isolable(config: IsolabilityConfig, jobs: int = 1, tell: Tell | None = None) -> Isolability:
    """Predict what a planned experiment would show. jobs : threads that share the work.

    Raises
    ------
    UserError : a plan that cannot be read or simulated, moves nothing, or leaves a part unseen.
    """
    from threadpoolctl import threadpool_limits

    from dtbacklash.diagnosis.experiments.isolability import isolability
    from dtbacklash.diagnosis.parallel import on_cores
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
    from dtbacklash.closed_loop_check import recording_of
    from dtbacklash.experiment.run import run_scenario

    return recording_of(run_scenario(run))


def _turned(run: RunConfig, whole: Recording) -> Recording:
    """The recording of the command, and then of the same with the other sign."""
    import tempfile

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


def isolability(
    *overrides: str, rig: RigLike | None = None, jobs: int | None = None, progress: ShowProgress = False
) -> Isolability:
    """Predict what a planned experiment would show and confuse: ``dtb isolability`` without files.

    Parameters
    ----------
    overrides : settings as on the command line: ``"command=planned.csv"``, ``"record=[theta_m]"``,
        ``"sensors.noise.theta_m_rad=0.001"``. rig : a rig, a name, the path of a YAML file, or a mapping; default:
        ``lead_screw``. jobs : threads that share the work; None: one for each core. progress : as for ``run``.

    Raises
    ------
    UserError : a setting is wrong; a plan that cannot be simulated, moves nothing, or leaves a part unseen.

    Examples
    --------
    >>> import dtbacklash as dtb
    >>> ahead = dtb.isolability("duration_s=4", "sensors.noise.x_mm=0.01", rig="oscillator")
    >>> ahead.sine(("mass", "ground_friction"), ("mass", "constant_force")) > 0.9
    True
    """
    content = {} if rig is None else {"rig": description(load_rig(rig))}
    config = compose_for(grammar_of(IsolabilityConfig), IsolabilityConfig, *overrides, **content)
    with shown(progress, "looking ahead") as tell:
        return isolable(config, cores_of(jobs), tell)


def design(found: str | Path, *overrides: str, jobs: int | None = None, progress: ShowProgress = False) -> Design:
    """Design the experiment that decides between the models of a diagnosis: ``dtb design FOLDER`` without files.

    Parameters
    ----------
    found : the folder of the diagnosis (:meth:`.Found.save`). overrides : settings as on the command line:
        ``"command_max=5"``, ``"travel={load: 2 rev}"``, ``"duration_s=8"``. jobs, progress : as for
        :func:`isolability`.

    Returns
    -------
    The design. ``best.u`` is the command, (N,) in the rig's unit, one value for each sample; ``best.apart`` is the
    distance of each alternative from the found rig, -2 log likelihood.

    Raises
    ------
    UserError : no folder of a diagnosis; nothing is open in it; limits that allow no motion.

    Examples
    --------
    >>> import dtbacklash as dtb
    >>> dtb.design("nowhere", "duration_s=8")
    Traceback (most recent call last):
        ...
    dtbacklash.errors.UserError: found=nowhere: must be the folder of a diagnosis, with diagnosis.json and rig.yaml
    """
    config = compose_for(grammar_of(DesignConfig), DesignConfig, f"found={quoted(str(found))}", *overrides)
    with shown(progress, "designing") as tell:
        return experiment(config, cores_of(jobs), tell)[0]


def experiment(config: DesignConfig, jobs: int = 1, tell: Tell | None = None) -> tuple[Design, Rivalry]:
    """Design an experiment, and return the models that it decides between. jobs : threads that share the work.

    Raises
    ------
    UserError : no folder of a diagnosis; nothing is open in it; limits that allow no motion; a file of no command.
    """
    from threadpoolctl import threadpool_limits

    from dtbacklash.diagnosis.experiments.design import chosen, designed
    from dtbacklash.diagnosis.experiments.rivalry import Rivalry
    from dtbacklash.diagnosis.parallel import on_cores

    found, seen, rivals = _open_models(config)
    rivalry, limits = Rivalry(found, rivals, seen), _limits(config, found, seen)
    with on_cores(jobs), threadpool_limits(1, "blas"):
        if config.commands:
            commands = {name: _command(name, seen.sample_time_s) for name in config.commands}
            return chosen(rivalry, limits, commands, tell), rivalry
        duration_s = config.duration_s or min(seen.duration_s, DURATION_S)
        return designed(rivalry, limits, duration_s, config.tries, config.seed, tell), rivalry


def _open_models(config: DesignConfig) -> tuple[Rig, Observed, list[Rival]]:
    """The found rig, how it was seen, and the models that are open."""
    from dtbacklash.diagnosis.experiments.rivalry import Rival
    from dtbacklash.diagnosis.labels import all_in_words
    from dtbacklash.diagnosis.planning import Observed
    from dtbacklash.files import read_json
    from dtbacklash.physics.rig_file import rig_of

    folder = Path(str(config.found))
    file = folder / "diagnosis.json"
    if not file.is_file() or not (folder / "rig.yaml").is_file():
        raise UserError("found", config.found, "must be the folder of a diagnosis, with diagnosis.json and rig.yaml")
    try:
        seen = Observed.of(read_json(file)["observed"])
        rigs = [rig_of(one.rig) for one in seen.open]
    except (KeyError, TypeError, ValueError) as error:
        allowed = "was written by another version, or found a fault; run dtb diagnose again"
        raise UserError("found", config.found, allowed) from error
    found = load_rig(str(folder / "rig.yaml"))
    if not rigs:
        raise UserError("found", config.found, "leaves nothing open: no rival is left to be told apart")
    rivals = []
    for one, rig in zip(seen.open, rigs, strict=True):
        place, what = one.instead_of
        without = all_in_words([one.instead_of]) if place else f"`{what}`"
        there = all_in_words(one.effects) if place else f"change of `{one.effects[0][1]}`"
        name = f"{there} instead of {without}" if one.effects else f"no {without}"
        keys = [(place, effect) for place, there in rig.effects.items() for effect in there]
        new = [key for key in keys if key[1] not in rig.tolerances.get(key[0], {})]
        rivals.append(Rival(name, rig, tuple(new)))
    return found, seen, rivals


def _limits(config: DesignConfig, rig: Rig, seen: Observed) -> Limits:
    from dtbacklash.diagnosis.experiments.design import Limits
    from dtbacklash.physics.element_kinds import KINDS

    found: dict[str, dict[str, float]] = {}
    for key, quantity, given, usual in (
        ("travel", "position", config.travel, seen.travel), ("speed", "velocity", config.speed, seen.speed),
    ):  # fmt: skip
        found[key] = dict(usual)
        for body, text in given.items():
            if body not in usual:
                raise UserError(f"{key}.{body}", text, f"no such body; choose of {', '.join(usual)}")
            unit = KINDS[rig.kind_at(body)].quantities[quantity]
            found[key][body] = _sized(f"{key}.{body}", text, unit)
    return Limits(config.command_max or seen.command, found["travel"], found["speed"])


def _sized(key: str, text: str, unit: str) -> float:
    """A positive number, SI or with a unit, in SI."""
    from dtbacklash import units

    number, _, written = str(text).strip().partition(" ")
    known = units.find(written.strip() or unit)
    try:
        size = float(number)
    except ValueError:
        size = math.nan
    if known is None or known.si != unit or not (math.isfinite(size) and size > 0.0):
        raise UserError(key, text, f"a number above 0, in {unit} or with one of {', '.join(units.of_kind(unit))}")
    return size * known.factor


def _command(path: str, step_s: float) -> Floats:
    """The command of a file at a sample time, held between its rows."""
    from dtbacklash.experiment.signals import reference, span_of

    duration_s, _ = span_of("commands", path, step_s)
    t_s = step_s * np.arange(round(duration_s / step_s) + 1, dtype=np.float64)
    return reference(ReferenceConfig(kind="csv", path=path), t_s, command=True)
