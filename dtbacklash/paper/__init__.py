"""``dtb paper``: the paper's figures, and every statement of it that can be checked."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from dtbacklash.files import write_json
from dtbacklash.paper.claims import all_claims
from dtbacklash.paper.experiments import Experiments, run_experiments
from dtbacklash.paper.figures import draw_figures

__all__ = ["Experiments", "all_claims", "run_experiments", "run_paper"]


def run_paper(folder: Path, progress: Callable[[float], None] | None = None) -> bool:
    """Run every experiment of the paper, draw its figures and check its claims.

    Writes ``figures/*.png``, ``claims.csv``, ``report.html`` and ``summary.json`` into ``folder`` and prints the table.

    Returns
    -------
    Whether every claim holds.
    """
    from dtbacklash.report.kit import tables
    from dtbacklash.report.paper import page as paper_page

    experiments = run_experiments(progress)
    claims = pd.DataFrame([claim.row() for claim in all_claims(experiments)])
    (folder / "figures").mkdir()
    figures = draw_figures(experiments, folder / "figures")
    claims.to_csv(folder / "claims.csv", index=False)
    paper_page.write(claims, figures, folder)
    failed = claims.loc[~claims["pass"], "claim"].tolist()
    summary = {"claims": len(claims), "passed": int(claims["pass"].sum()), "failed": failed}
    write_json(folder / "summary.json", summary)
    tables.show(tables.claims(claims))
    return not failed
