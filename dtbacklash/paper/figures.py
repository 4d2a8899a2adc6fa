"""The paper's figures from the experiments."""

from pathlib import Path

from dtbacklash.experiment.metrics import StepMetrics
from dtbacklash.paper.experiments import PLAY_GAP_DEG, Experiments
from dtbacklash.report.kit import style
from dtbacklash.report.paper import figures


def draw_figures(experiments: Experiments, folder: Path) -> dict[str, Path]:
    """Draw Figures 4, 6, 7, 8, 10, 13 and 14 into ``folder``; name -> file."""
    runs = experiments.runs
    drawn = {}
    for number in (4, 6):
        trace = runs[f"fig{number}"].trace
        part = trace[trace["t_s"] <= (6.0 if number == 4 else 2.0)]
        move = experiments.moves[f"fig{number}"].iloc[0]
        found = StepMetrics(*(float(move[name]) for name in StepMetrics._fields))
        drawn[number] = figures.response_and_voltage(part["t_s"], part["q3_mm"], part["u_v"], found)
    play = experiments.play
    drawn[7] = figures.play_figure(play.t_s, play.theta_m_deg, play.theta_d_deg, PLAY_GAP_DEG)
    for number in (8, 10, 13):
        run = runs[f"fig{number}"]
        drawn[number] = figures.gap_scenario(run.trace, run.estimates)
    run = runs["fig14"]
    drawn[14] = figures.novelty_scenario(run.trace, run.estimates, run.config.twin.novelty_threshold_mm)
    paths = {}
    for number in sorted(drawn):
        paths[f"figure_{number:02d}"] = folder / f"figure_{number:02d}.png"
        style.save(drawn[number], paths[f"figure_{number:02d}"])
    return paths
