"""Runs one experiment and writes its files."""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import math
import platform
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash import __version__
from dtbacklash.config.load import fingerprint, plain
from dtbacklash.config.run import RunConfig
from dtbacklash.errors import UserError
from dtbacklash.runfolder import PARTIAL, hidden_sibling, reason, run_folder

if TYPE_CHECKING:
    from dtbacklash.scenario import RunResult

LIBRARIES = ("numpy", "scipy", "numba", "control", "pandas", "hydra-core", "matplotlib")


def simulate_and_write(
    config: RunConfig, folder: Path, command: str, progress: Callable[[float], None] | None = None
) -> RunResult:
    """Run ``config`` and put its results into ``folder``, complete or not at all.

    Parameters
    ----------
    command : the command line that repeats the run.
    progress : called with the fraction simulated, 0 to 1.

    Returns
    -------
    The result.

    Raises
    ------
    UserError : the folder or the recording cannot be written; the loop diverged (:class:`Diverged`).
    """
    from dtbacklash import scenario
    from dtbacklash.report import run_report

    with run_folder(folder) as scratch:
        result = scenario.run_scenario(config, progress)
        result.summary |= {"command": command, **provenance(config)}
        _write_data(result, scratch)
        run_report.write(result, result.moves, scratch)
        _save_recording(config, result)
    return result


def _write_data(result: RunResult, folder: Path) -> None:
    text = json.dumps(json_able(result.summary), indent=2, allow_nan=False)
    (folder / "summary.json").write_text(text + "\n", encoding="utf-8")
    result.moves.to_csv(folder / "metrics.csv", index=False)
    result.estimates.to_csv(folder / "estimates.csv", index=False)
    result.trace.to_parquet(folder / "trace.parquet", index=False)


def _save_recording(config: RunConfig, result: RunResult) -> None:
    """Write what the sensors saw to ``recording.save``, by way of a hidden neighbour."""
    if config.recording.save is None:
        return
    target = Path(config.recording.save).absolute()
    scratch = hidden_sibling(target, PARTIAL)
    try:
        if target.suffix.lower() == ".csv":
            result.recording.to_csv(scratch, index=False)
        else:
            result.recording.to_parquet(scratch, index=False)
        scratch.replace(target)
    except OSError as error:
        raise UserError("recording.save", config.recording.save, f"cannot be written: {reason(error)}") from error
    finally:
        with contextlib.suppress(OSError):  # where it could not be made it cannot be removed either
            scratch.unlink(missing_ok=True)


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


def json_able(value: Any) -> Any:
    """Return ``value`` with numpy scalars as Python's and NaN or infinity as null, which JSON has not."""
    if isinstance(value, dict):
        return {str(key): json_able(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_able(item) for item in value]
    if hasattr(value, "tolist"):  # numpy
        return json_able(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
