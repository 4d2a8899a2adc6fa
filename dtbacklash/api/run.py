"""``dtb run`` in Python: simulate, look, save."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from dtbacklash.api.progress import ShowProgress, shown
from dtbacklash.api.rigs import RigLike, composed
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dtbacklash.config.run import RunConfig
    from dtbacklash.control.margins import DesignedLoop
    from dtbacklash.experiment.run import RunResult
    from dtbacklash.physics.rig import Rig
    from dtbacklash.recording import Recording


@dataclass(frozen=True, repr=False)
class Run:
    """Result of :func:`run`. ``print(result)`` shows the moves, the estimates and a summary.

    Attributes
    ----------
    data : the tables, the arrays and the summary; the properties below are views of it.
    """

    data: RunResult

    @property
    def trace(self) -> pd.DataFrame:
        """True values of the rig's channels: N+1 rows, one for each sample; each column has its unit in its name.

        Columns of the lead screw: ``t_s, r_mm, q3_mm, u_v, theta_m_rad, theta_d_rad, gap_deg, gap_hat_deg, eps_mm,
        novelty_mm``, and one for each further sensor. In open loop there is no reference ``r_mm``, and nothing of a
        twin; without a gear no gap.
        """
        return self.data.channels

    @property
    def moves(self) -> pd.DataFrame:
        """A row for each move: ``move, t_s, from_mm, to_mm, overshoot_pct, settling_time_s, peak_voltage_v``.

        The settling time is NaN if the move never settles. Empty in open loop.
        """
        return self.data.moves

    @property
    def estimates(self) -> pd.DataFrame:
        """A row for each attempt of the twin.

        Columns ``t_event_s, t_applied_s, gap_deg, true_gap_deg, accepted, reason, cost, evaluations, wall_s,
        std_deg, applied_deg``; the cost in mm².
        """
        return self.data.estimates

    @property
    def summary(self) -> dict[str, Any]:
        """Figures of the run as in ``summary.json``: ``overshoot_pct_max``, ``settles``, ``advice``, ``wall_s``, ..."""
        return self.data.summary

    @property
    def config(self) -> RunConfig:
        """Every setting of the run, checked."""
        return self.data.config

    @property
    def rig(self) -> Rig:
        """The rig that was simulated."""
        return self.data.rig

    @property
    def design(self) -> DesignedLoop | None:
        """The controller and its design model, with ``margins()`` and ``curves()``; None in open loop."""
        return self.data.design

    @property
    def recording(self) -> Recording:
        """Measured signals with noise and counts, in SI: N+1 samples of ``r``, ``u`` and each sensor."""
        from dtbacklash.closed_loop_check import recording_of

        return recording_of(self.data)

    def plot(self) -> Figure:
        """Draw reference and output, gap and estimate, and voltage over time, without pyplot."""
        from dtbacklash.report.run.page import overview

        return overview(self.data, self.moves)

    def save(self, folder: str | Path) -> Path:
        """Write the files of ``dtb run``, complete or not at all; an earlier run there is replaced.

        Files: ``summary.json, metrics.csv, estimates.csv, trace.parquet, figures/*.png, report.html``.

        Returns
        -------
        The folder.

        Raises
        ------
        UserError : the folder holds something else, or cannot be written.
        """
        from dtbacklash.api.run_files import save

        return save(self.data, Path(folder).expanduser())

    def __str__(self) -> str:
        from rich.text import Text

        from dtbacklash.report.components import tables
        from dtbacklash.report.run.text import lines

        text = io.StringIO()
        for line in lines(self.summary, self.moves, self.estimates):
            if isinstance(line, Text):
                print(line.plain, file=text)
            else:
                tables.show(line, file=text)
        return text.getvalue().rstrip("\n")

    def _repr_html_(self) -> str:
        """The moves and the overview, for a notebook."""
        from dtbacklash.report.components.blocks import Figure
        from dtbacklash.report.components.page import embedded, fragment
        from dtbacklash.report.components.style import png
        from dtbacklash.report.run.text import moves_table

        table = [moves_table(self.moves)] if len(self.moves) else []
        return fragment(repr(self)[1:-1], *table, Figure(embedded(png(self.plot())), ""))

    def __repr__(self) -> str:
        samples, name = len(self.trace), self.config.controller.name
        return f"<Run: {name} on {self.rig.config.name}, {samples} samples, {len(self.moves)} moves>"


def run(
    *overrides: str, rig: RigLike | None = None, model: RigLike | None = None, progress: ShowProgress = False
) -> Run:
    """Simulate a controller on a rig while its backlash grows: ``dtb run`` without files but ``recording.save=``.

    Parameters
    ----------
    overrides : settings as on the command line: ``"controller=imc"``, ``"twin.delay_s=0"``,
        ``"rig.parameters.k.value=9000"``. All of them: docs/configuration.md.
    rig : a rig, a name, the path of a YAML file, or a mapping; default: ``lead_screw``.
    model : the rig that controller and twin believe in; default: the parameters of ``rig`` without its effects.
    progress : True shows a bar; a function is called with the share done, 0 to 1, and a text.

    Raises
    ------
    UserError : a setting is wrong; the error names key, value and what is allowed. Diverged : the loop is unstable.

    Examples
    --------
    >>> import dtbacklash as dtb
    >>> result = dtb.run("controller=open_loop", "reference=multisine", "duration_s=2", rig="pendulum")
    >>> result.recording.samples, sorted(result.recording.channels)
    (2001, ['omega', 'r', 'theta', 'u'])
    """
    config = composed(list(overrides), rig, model)
    if config.task != "run":
        raise UserError("task", config.task, "is for the command line: dtb run experiment=close_the_loop")
    from dtbacklash.api.run_files import check_recording, command_of, save_recording, simulate

    check_recording(config)
    with shown(progress, "simulating") as tell:
        tick = None if tell is None else lambda share: tell(share, "simulating")
        result = simulate(config, command_of(overrides, rig, model), tick)
    save_recording(result)
    return Run(result)
