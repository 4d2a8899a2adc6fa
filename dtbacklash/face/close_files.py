"""The folder of a loop that was closed over a diagnosis: what ``experiment=close_the_loop`` writes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from dtbacklash.config.run import RunConfig
from dtbacklash.face.run_files import provenance, recording_columns
from dtbacklash.files import run_folder, write_json

if TYPE_CHECKING:
    from dtbacklash.closing import Closed, Tell


def close_and_write(config: RunConfig, folder: Path, command: str, tell: Tell | None = None) -> Closed:
    """Record, diagnose, run with each belief, and put it all into ``folder``, complete or not at all.

    Parameters
    ----------
    command : the command line that repeats it. tell : called with what is being done and the share done, 0 to 1.

    Raises
    ------
    UserError : see :func:`dtbacklash.closing.close_the_loop`; the folder cannot be written.
    """
    from dtbacklash.closing import close_the_loop, seen_by_the_loop
    from dtbacklash.report.closing import page
    from dtbacklash.report.diagnosis import page as diagnosis_page

    with run_folder(folder) as scratch, threadpool_limits(1, "blas"):
        closed = close_the_loop(config, tell)
        found = scratch / "found"
        found.mkdir()
        diagnosis_page.write(closed.diagnosis, found)
        seen = ["t", *seen_by_the_loop(closed.recorded).channels]
        recording_columns(closed.recorded)[seen].to_parquet(scratch / "recording.parquet", index=False)
        closed.table.to_csv(scratch / "close_the_loop.csv", index=False)
        page.write(closed, config, scratch, command)
        write_json(scratch / "summary.json", summary(config, closed, command))
    return closed


def summary(config: RunConfig, closed: Closed, command: str) -> dict[str, Any]:
    """What ``summary.json`` holds: the figures of the loop that believes in what was found, and the table."""
    both = closed.runs["both"]
    keys = ("controller", "overshoot_pct_max", "settling_time_s_max", "peak_voltage_v", "n_estimations", "n_accepted")
    figures = {key: both.summary[key] for key in keys} if both is not None else {"controller": config.controller.name}
    return {
        **figures, "verdict": closed.diagnosis.verdict, "beliefs": closed.table.to_dict("records"), "command": command,
        **provenance(config),
    }  # fmt: skip
