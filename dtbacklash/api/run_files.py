"""One experiment from its configuration to its files; ``dtb run`` and ``dtbacklash.run`` do the same."""

from __future__ import annotations

import importlib.metadata
import platform
import shlex
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from threadpoolctl import threadpool_limits

from dtbacklash.config.load import fingerprint, plain
from dtbacklash.config.run import RunConfig
from dtbacklash.errors import UserError
from dtbacklash.files import run_folder, write_json, write_parquet, written
from dtbacklash.version import __version__

if TYPE_CHECKING:
    from dtbacklash.closed_loop_check import Closed, Tell
    from dtbacklash.experiment.run import RunResult

LIBRARIES = ("numpy", "scipy", "control", "pandas", "hydra-core", "matplotlib")


def simulate(config: RunConfig, command: str | None, progress: Callable[[float], None] | None = None) -> RunResult:
    """Run ``config``.

    Parameters
    ----------
    command : the command line that repeats the run; None if there is none. progress : called with the share simulated.

    Raises
    ------
    UserError : the combination makes no sense; the loop diverged (:class:`Diverged`).
    """
    from dtbacklash.experiment import run as scenario

    # all matrices are tiny: threads of the linear algebra cost more than they bring
    with threadpool_limits(1, "blas"):
        if config.twin.where == "remote" and config.controller.reconfigure != "never":
            result = _with_remote_twin(config, progress)
        else:
            result = scenario.run_scenario(config, progress)
        if config.uncertainty is not None:
            from dtbacklash.experiment.uncertainty import with_band

            with_band(result, config.uncertainty, progress)
    result.summary["command"] = command
    return result


def _with_remote_twin(config: RunConfig, progress: Callable[[float], None] | None) -> RunResult:
    """Run ``config`` with a twin at the other end of a network; the summary says how it went there."""
    from dtbacklash.control.belief import Belief, Beliefs, design_for, settled
    from dtbacklash.experiment import run as scenario
    from dtbacklash.remote.belief import described
    from dtbacklash.remote.client import RemoteTwin

    def design(belief: Belief) -> None:
        design_for(settled(config, Beliefs(belief, belief)), belief)

    with RemoteTwin(config.twin, described(config), config.pace != "real", design) as service:
        result = scenario.run_scenario(config, progress, service=service)
        result.summary["remote"] = service.summary()
    return result


def save(result: RunResult, folder: Path) -> Path:
    """Write the folder of a run, complete or not at all; returns it.

    Raises
    ------
    UserError : the folder holds something else, or cannot be written.
    """
    with run_folder(folder, key="folder") as scratch:
        write(result, scratch)
    return folder


def simulate_and_write(
    config: RunConfig, folder: Path, command: str, progress: Callable[[float], None] | None = None
) -> RunResult:
    """Run ``config`` and put its results into ``folder``, complete or not at all.

    Parameters
    ----------
    command : the command line that repeats the run. progress : called with the share simulated, 0 to 1.

    Raises
    ------
    UserError : the folder or the recording cannot be written, or the latter is there; the loop diverged.
    """
    # libraries first: Ctrl-C while one is loading may end the process before anything is cleared away
    from dtbacklash.experiment import run as _scenario  # noqa: F401
    from dtbacklash.report.run import page as _page  # noqa: F401

    check_recording(config)
    with run_folder(folder) as scratch:  # before the work: a folder that holds something else is told at once
        result = simulate(config, command, progress)
        write(result, scratch)
        save_recording(result)
    return result


def close_and_write(config: RunConfig, folder: Path, command: str, tell: Tell | None = None) -> Closed:
    """Record, diagnose, run with each belief, and put it all into ``folder``, complete or not at all.

    Parameters
    ----------
    command : the command line that repeats it. tell : called with what is being done and the share done, 0 to 1.

    Raises
    ------
    UserError : see :func:`dtbacklash.closed_loop_check.close_the_loop`; the folder cannot be written.
    """
    from dtbacklash.closed_loop_check import close_the_loop, seen_by_the_loop
    from dtbacklash.report.closing import page
    from dtbacklash.report.diagnosis import page as diagnosis_page

    with run_folder(folder) as scratch, threadpool_limits(1, "blas"):
        closed = close_the_loop(config, tell)
        found = scratch / "found"
        found.mkdir()
        diagnosis_page.write(closed.diagnosis, found)
        seen = ["t", *seen_by_the_loop(closed.recorded).channels]
        write_parquet(scratch / "recording.parquet", recording_columns(closed.recorded)[seen])
        closed.table.to_csv(scratch / "close_the_loop.csv", index=False)
        page.write(closed, config, scratch, command)
        write_json(scratch / "summary.json", closed_summary(config, closed, command))
    return closed


def closed_summary(config: RunConfig, closed: Closed, command: str) -> dict[str, Any]:
    """Return the content of ``summary.json``: the figures of the loop that believes in the found rig, and the table."""
    both = closed.runs["both"]
    keys = ("controller", "overshoot_pct_max", "settling_time_s_max", "peak_voltage_v", "n_estimations", "n_accepted")
    figures = {key: both.summary[key] for key in keys} if both is not None else {"controller": config.controller.name}
    return {
        **figures, "verdict": closed.diagnosis.verdict, "beliefs": closed.table.to_dict("records"), "command": command,
        **provenance(config),
    }  # fmt: skip


def write(result: RunResult, folder: Path) -> None:
    """Write the files of a run into an existing folder."""
    from dtbacklash.report.run import page as run_report

    result.summary |= provenance(result.config)
    write_json(folder / "summary.json", result.summary)
    result.moves.to_csv(folder / "metrics.csv", index=False)
    result.estimates.to_csv(folder / "estimates.csv", index=False)
    write_parquet(folder / "trace.parquet", result.channels)
    run_report.write(result, result.moves, folder)


def recording_columns(result: RunResult) -> pd.DataFrame:
    """Return the measured signals in the plain columns of a file: ``t`` s, ``r``, ``u`` V, the sensors.

    Each is in the unit that the rig declares for its recordings, ``r`` in that of the output's sensor (in open loop V).
    """
    factors = {name: sensor.per_si for name, sensor in result.rig.sensors.items()}
    if result.units["r"] == "m":
        factors["r"] = result.rig.reference_per_si()
    columns = {name: values * factors.get(name, 1.0) for name, values in result.seen.items()}
    return pd.DataFrame({"t": result.t_s, **columns})


def check_recording(config: RunConfig) -> None:
    """Refuse to write over a recording: it may be a bench's, which nobody can make again; raises UserError."""
    wanted = config.recording.save
    if wanted is not None and Path(wanted).exists():
        raise UserError("recording.save", wanted, "is there already; give another name, or remove it first")


def save_recording(result: RunResult) -> None:
    """Write the measured signals to ``recording.save``, through a hidden file beside it."""
    wanted = result.config.recording.save
    if wanted is None:
        return
    target = Path(wanted).absolute()
    with written(target, "recording.save", wanted, parents=False) as scratch:
        if target.suffix.lower() == ".csv":
            recording_columns(result).to_csv(scratch, index=False)
        else:
            write_parquet(scratch, recording_columns(result))


def command_of(overrides: Sequence[str], rig: object = None, model: object = None) -> str | None:
    """Return the command line that repeats a run, quoted for a shell; None if a rig is neither a name nor a file."""
    given = {group: one for group, one in (("rig", rig), ("model", model)) if one is not None}
    if any(not isinstance(one, (str, Path)) for one in given.values()):
        return None
    chosen = [f"{group}={one}" for group, one in given.items()]
    return shlex.join(["dtb", "run", *chosen, *(word.lstrip("+") for word in overrides)])


def provenance(config: RunConfig) -> dict[str, Any]:
    """Return what it takes to repeat a run: the resolved configuration, versions, seed."""
    versions = {"python": platform.python_version(), "dtbacklash": __version__}
    versions |= {name: importlib.metadata.version(name) for name in LIBRARIES}
    return {
        "seed": config.seed,
        "config": plain(config),
        "config_hash": fingerprint(config),
        "versions": versions,
        "code": describe_code(),
    }


def describe_code() -> str | None:
    """Return ``git describe`` of the code if it runs from its repository, else None."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return None  # installed; a repository further up would be somebody else's
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--tags"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip() or None
