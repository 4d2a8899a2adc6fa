"""What is measured on the paper's runs: overshoot, settling, decay and distance, each of a run given by its name.

A public function here and in the two modules beside is a statistic, which ``claims.yaml`` calls by its name with the
arguments ``of``. It returns a number in the unit of its name; those for a claim's ``failing`` may return a text or a
table of numbers.
"""

import math

import numpy as np

from dtbacklash.experiment.metrics import move_table
from dtbacklash.paper.experiments import Experiments


def overshoot_pct(x: Experiments, run: str, take: str = "max", **span: float) -> float:
    """The largest (or ``take: min``, the smallest) overshoot of the moves of a run that begin in a span of time."""
    return _of_moves(x, run, "overshoot_pct", take, **span)


def settling_time_s(x: Experiments, run: str, take: str = "max", **span: float) -> float:
    """The same of the settling time; of a move that does not settle it is infinite."""
    return _of_moves(x, run, "settling_time_s", take, **span)


def _of_moves(
    x: Experiments, run: str, column: str, take: str, from_s: float = 0.0, before_s: float = math.inf
) -> float:
    moves = x.runs[run].moves
    chosen = moves.loc[(moves["t_s"] >= from_s) & (moves["t_s"] < before_s), column].fillna(math.inf)
    return chosen.max() if take == "max" else chosen.min()


def overshoot_above_points(x: Experiments, run: str, other: str) -> float:
    """By how much the largest overshoot of a run exceeds that of another, percentage points."""
    return overshoot_pct(x, run) - overshoot_pct(x, other)


def shortest_settling_over_that_of_fig6(x: Experiments, run: str, from_s: float) -> float:
    return settling_time_s(x, run, "min", from_s=from_s) / settling_time_s(x, "fig6")


def settling_of_fig13_within_2_pct_s(x: Experiments) -> float:
    return move_table(x.runs["fig13"].trace, 0.02)["settling_time_s"].max(skipna=False)


def largest_voltage_v(x: Experiments, run: str) -> float:
    return x.runs[run].trace["u_v"].abs().max()


def largest_q3_difference_mm(x: Experiments, run: str, other: str, samples: int | None = None) -> float:
    return float(np.abs(x.q3_mm(run)[:samples] - x.q3_mm(other)[:samples]).max())


def distance_ratio(x: Experiments, run: str, other: str, reference: str) -> float:
    """Rms distance of q3 of a run from that of the reference, over the same of another run."""
    return _rms_distance_mm(x, run, reference) / _rms_distance_mm(x, other, reference)


def distance_with_a_wrong_gap(x: Experiments) -> float:
    """Rms distance of q3 from that without a gap, with an estimate 20 degrees off, over that with the exact one."""
    away = {name: _rms_distance_mm(x, name, "no_gap") for name in ("exact", "below", "above")}
    return min(away["below"], away["above"]) / away["exact"]


def _rms_distance_mm(x: Experiments, run: str, reference: str) -> float:
    return float(np.sqrt(np.mean((x.q3_mm(run) - x.q3_mm(reference)) ** 2)))


def rest_distance_um(x: Experiments, run: str) -> float:
    """Largest distance of q3 from the reference at the end of any move."""
    trace = x.runs[run].trace
    ends = [*x.runs[run].moves["t_s"].to_numpy()[1:], trace["t_s"].iloc[-1] + 1e-9]
    rows = [trace[trace["t_s"] < end - 1e-9].iloc[-1] for end in ends]
    return 1e3 * max(abs(row["q3_mm"] - row["r_mm"]) for row in rows)


def largest_half_oscillation_ratio(x: Experiments, run: str, start_s: float = 180.0) -> float:
    """Largest ratio of a half oscillation to the one a period before, in the 3 s after a move.

    A half oscillation is the largest distance of q3 from r between two crossings of r; they count from the largest on.
    """
    trace = x.runs[run].trace
    part = trace[(trace["t_s"] > start_s + 0.3) & (trace["t_s"] < start_s + 3.0)]
    error = (part["q3_mm"] - part["r_mm"]).to_numpy()
    halves = np.split(error, np.flatnonzero(np.diff(np.sign(error))) + 1)[1:-1]
    sizes = np.array([np.abs(half).max() for half in halves])
    peaks = sizes[int(np.argmax(sizes)) :]
    return float(np.max(peaks[2:] / peaks[:-2])) if peaks.size > 2 else math.nan


def frequency_over_omega_d(x: Experiments, run: str, start_s: float = 180.0) -> float:
    """Frequency of the transient, by the extremes of q3 from 0.5 s to 2 s after a move, over the nominal omega_d."""
    trace = x.runs[run].trace
    part = trace[(trace["t_s"] > start_s + 0.5) & (trace["t_s"] < start_s + 2.0)]
    error = (part["q3_mm"] - part["r_mm"]).to_numpy()
    turns = part["t_s"].to_numpy()[np.flatnonzero(np.diff(np.sign(np.diff(error)))) + 1]
    return float(math.pi * (turns.size - 1) / (turns[-1] - turns[0])) / x.design.dominant_frequency_rad_s


def gap_of_fig10_deg(x: Experiments) -> dict[int, float]:
    """Time, s -> gap there, at the moves that the paper calls almost exact."""
    trace = x.runs["fig10"].trace
    at = {t_s: int(np.searchsorted(trace["t_s"].to_numpy(), t_s - 1e-9)) for t_s in (80, 120)}
    return {t_s: float(trace["gap_deg"].to_numpy()[k]) for t_s, k in at.items()}


def error_of_fig10_deg(x: Experiments) -> dict[int, float]:
    """Time, s -> how far the fixed estimate is off there."""
    return {t_s: abs(gap - 50) for t_s, gap in gap_of_fig10_deg(x).items()}


def late_start(x: Experiments) -> str:
    """Why NIMC settles later than the design, even with the exact gap: the second move with 100 degrees."""
    return _late_start(x, "exact", float(x.runs["exact"].moves["t_s"].iloc[1]))


def late_start_of_fig10(x: Experiments) -> str:
    """The same of the move at 100 s of Fig. 10."""
    return _late_start(x, "fig10", 100.0)


def _late_start(x: Experiments, run: str, start_s: float) -> str:
    """run : with the same reference as `no_gap`, whose moves of 2 mm differ by their sign alone."""
    trace = x.runs[run].trace
    t_s = trace["t_s"].to_numpy()
    part = (t_s > start_s - 1e-9) & (t_s < start_s + 1.0)
    screw, gap_deg = trace["theta_d_rad"].to_numpy()[part], trace["gap_deg"].to_numpy()[part][0]
    begins_s = float(t_s[part][np.abs(screw - screw[0]) > 1e-6][0] - start_s)
    second = (t_s[: x.q3_mm("no_gap").size] > 20.0 - 1e-9) & (t_s[: x.q3_mm("no_gap").size] < 21.0)
    q3, design = x.q3_mm(run)[part], x.q3_mm("no_gap")[second]
    design = design * np.sign(trace["r_mm"].to_numpy()[part][0]) * np.sign(design[-1])
    return (
        f"at a gap of {gap_deg:.0f} deg the screw begins {1e3 * begins_s:.0f} ms late, once the motor has crossed the "
        f"gap, and catches up: with the exact gap too this leaves a vibration of {np.abs(q3 - design).max():.2f} mm "
        "to the mode's own damping"
    )
