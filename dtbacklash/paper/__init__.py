"""``dtb paper``: the paper's figures, and every statement of it that can be checked."""

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from dtbacklash.experiment.metrics import StepMetrics
from dtbacklash.files import write_json
from dtbacklash.paper.claims import all_claims
from dtbacklash.paper.experiments import PLAY_GAP_DEG, Experiments, run_experiments
from dtbacklash.report.components import style, tables
from dtbacklash.report.paper import figures, page

__all__ = ["Experiments", "all_claims", "run_experiments", "run_paper"]


def run_paper(folder: Path, progress: Callable[[float], None] | None = None) -> bool:
    """Run every experiment of the paper, draw its figures and check its claims.

    Writes ``figures/*.png``, ``claims.csv``, ``report.html`` and ``summary.json`` into ``folder`` and prints the table.

    Returns whether every claim holds.
    """
    experiments = run_experiments(progress)
    claims = all_claims(experiments)
    (folder / "figures").mkdir()
    paths = {}
    for number, figure in _figures(experiments).items():
        paths[f"figure_{number:02d}"] = style.save(figure, folder / "figures" / f"figure_{number:02d}.png")
    claims.to_csv(folder / "claims.csv", index=False)
    page.write(claims, paths, folder)
    failed = claims.loc[~claims["pass"], "claim"].tolist()
    write_json(folder / "summary.json", {"claims": len(claims), "passed": len(claims) - len(failed), "failed": failed})
    tables.show(tables.of(page.claims_table(claims, reasons=False)), "", *page.failures(claims))
    return not failed


def _figures(x: Experiments) -> dict[int, Figure]:
    """The paper's figures by their numbers."""
    drawn = {}
    for number, until_s in ((4, 6.0), (6, 2.0)):
        trace, move = x.runs[f"fig{number}"].trace, x.runs[f"fig{number}"].moves.iloc[0]
        part = trace[trace["t_s"] <= until_s]
        measured = StepMetrics(*(float(move[name]) for name in StepMetrics._fields))
        drawn[number] = figures.response_and_voltage(part["t_s"], part["q3_mm"], part["u_v"], measured)
    drawn[7] = figures.play_figure(x.play.t_s, x.play.theta_m_deg, x.play.theta_d_deg, PLAY_GAP_DEG)
    for number in (8, 10, 13):
        drawn[number] = figures.gap_scenario(x.runs[f"fig{number}"].trace, x.runs[f"fig{number}"].estimates)
    run = x.runs["fig14"]
    drawn[14] = figures.novelty_scenario(run.trace, run.estimates, run.config.twin.novelty_threshold_mm)
    return drawn
