"""The guarded twin in the closed loop: random gaps, noises, buffers and starts, with and without the guard.

A case is one life of the paper's rig with a constant gap. The loop runs with an old estimate of the gap until a
buffer is full and the twin's answer is due. From that very state it goes on over further moves in four ways:

- ``exact``: with the true gap, which is the best that a twin could do;
- ``old``: with the old estimate, as if nobody had asked the twin;
- ``plain``: with what the optimiser returned from a random start, as in the paper;
- ``guarded``: with what the guard made of the same start on the same buffer.

The harm that an estimation did is the growth of the rms distance of q3 to the exact loop over that of the old
loop. All four see the same reference and the same noise, so that nothing but the estimate differs.

How finely may harm be judged? Not more finely than the loop repeats itself: with noise or counts, a loop with the
exact gap and other noise of the same size moves q3 by several micrometres, because the noise decides in which sample
the gear's model in the controller takes up contact. Every case measures this scatter for itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dtbacklash.arrays import Floats
from dtbacklash.config.compose import compose
from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import Belief, Beliefs, design_for, settled
from dtbacklash.control.laws import Controller, build_controller, new_controller_state
from dtbacklash.experiment import loop
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.kernel.plant import Plant, new_state
from dtbacklash.physics.rig import build_rig
from dtbacklash.twin.gap.estimate import Problem, estimate_gap
from dtbacklash.twin.gap.guard import guarded_estimates, outcome
from dtbacklash.twin.gap.novelty import NoveltyDesign, novelty_design
from dtbacklash.twin.gap.observer import TwinModel, twin_model
from studies.measure import Row, verdict
from studies.scenario import new_traces

#: An estimation did harm if the loop is farther from the exact one than with the old estimate by more than this
#: share of the moves' rms size, a tenth of the band in which a move counts as settled ...
HARM_SHARE = 1e-3
#: ... and this many times the scatter: a ninth loop may well be farther off than the farthest of eight, but not twice
HARM_SCATTER = 2.0
#: exact loops with other noise, from which the scatter is taken ...
REPEATS = 8
#: ... and the least noise of a sensor that counts, in counts: no real signal stands still between two of them
DITHER = 0.1
#: a buffer is informative if the screw moves this far where the cost looks
INFORMATIVE_DEG = 20.0

WAYS = ("exact", "old", "plain", "guarded")
#: the loop goes on for two moves of this length after the answer
FOLLOWING_S = 5.0


@dataclass(frozen=True)
class Bench:
    """What all cases share: the rig, its controller and the twin's model, designed once."""

    config: RunConfig
    plant: Plant
    controller: Controller
    detector: NoveltyDesign
    model: TwinModel


@dataclass(frozen=True)
class Case:
    """One random case: angles in degrees, times in samples, lengths in mm (noise: standard deviations in SI)."""

    gap_deg: float
    old_deg: float
    moves: tuple[tuple[int, float], ...]
    first: int
    length: int
    settle: int
    delay: int
    following: tuple[tuple[int, float], ...]
    samples: int
    q3_noise_m: float
    theta_m_noise_rad: float
    q3_count_m: float
    theta_m_count_rad: float
    start_deg: tuple[float, float]
    seed: tuple[int, int]

    @property
    def due(self) -> int:
        """The sample from which the answer is in force."""
        return self.first + self.length + self.delay


class _Loop(NamedTuple):
    """Everything in the loop that has a memory."""

    plant: Any
    controller: Any
    detector: Floats

    def copy(self) -> _Loop:
        plant = type(self.plant)(*(a.copy() for a in self.plant))
        return _Loop(plant, type(self.controller)(*(a.copy() for a in self.controller)), self.detector.copy())


def new_bench() -> Bench:
    """The paper's rig, controller and twin."""
    config = compose("controller=nimc_twin", "profile=constant")
    rig = build_rig(config.rig)
    belief = Belief(rig)
    config = settled(config, Beliefs(belief, belief))
    design = design_for(config, belief)
    assert design is not None
    time_s = config.sample_time_s
    return Bench(
        config,
        compile_plant(rig, time_s),
        build_controller(config.controller, design),
        novelty_design(config.twin.novelty_filter, design.dominant_frequency_rad_s, time_s),
        twin_model(belief.linear().structure, config.twin.observer_pole_rad_s, time_s, config.twin.settle),
    )


def random_case(campaign: int, number: int) -> Case:
    """Draw case ``number`` of a campaign; the same two numbers give the same case.

    A tenth of the rigs has no gap at all; an old estimate is anything, near the truth, or the truth; sensors are
    ideal, noisy, or count; most buffers begin at a move, the others anywhere, where there may be nothing to see;
    the search starts anywhere up to 400 degrees, with theta_d anywhere in that gap.
    """
    rng = np.random.default_rng([campaign, number])
    gap = float(rng.choice(np.array([0.0, rng.uniform(0, 120)]), p=[0.1, 0.9]))
    anything, near = float(rng.uniform(0, 120)), float(np.clip(gap + 3 * rng.standard_normal(), 0, 180))
    old = float(rng.choice(np.array([anything, near, gap]), p=[0.6, 0.3, 0.1]))
    times = np.sort(rng.integers(100, 6000, rng.integers(1, 4)))
    size = rng.choice([0.1, 0.5, 2.0])
    moves = tuple((int(t), float(rng.uniform(-size, size))) for t in times)
    length = int(rng.integers(600, 2001))
    settle = int(rng.choice(np.array([400, rng.integers(100, length - 100)])))
    first = int(times[-1]) if rng.random() < 0.6 else int(rng.integers(0, 6000))
    delay = int(rng.choice(np.array([0, rng.integers(0, 4001)])))
    step = round(1000 * FOLLOWING_S)
    now = first + length + delay + int(rng.integers(1, 1000))
    level = float(rng.uniform(-2, 2))
    away = float(rng.choice([-1, 1]) * rng.uniform(0.5, 2))
    noisy, counts = rng.integers(0, 2, 2), rng.integers(0, 2, 2)
    start = float(rng.uniform(0, 400))
    return Case(
        gap, old, moves, first, length, settle, delay, ((now, level), (now + step, level + away)), now + 2 * step,
        float(noisy[0] * rng.uniform(0, 5e-6)), float(noisy[1] * rng.uniform(0, 1e-3)),
        float(counts[0] * rng.uniform(0, 1e-6)), float(counts[1] * 2 * math.pi / rng.choice([1024, 4096, 65536])),
        (start, float(rng.uniform(-1, 1)) * start), (campaign, number),
    )  # fmt: skip


def _signals(bench: Bench, case: Case) -> loop.Signals:
    """Reference, gap, noise and counts of a case; the first two sensors of the rig are theta_m and q3."""
    n, sensors = case.samples + 1, len(bench.plant.sensor)
    reference = np.zeros(n)
    for k, level in (*case.moves, *case.following):
        reference[k:] = level * 1e-3
    resolution = np.zeros(sensors)
    resolution[:2] = case.theta_m_count_rad, case.q3_count_m
    noise = np.zeros((n, sensors))
    sizes = np.array([case.theta_m_noise_rad, case.q3_noise_m])
    noise[:, :2] = sizes * np.random.default_rng([*case.seed, 1, 0]).standard_normal((n, 2))
    return loop.Signals(reference, np.full(n, math.radians(case.gap_deg)), noise, resolution)


def _scatter_um(bench: Bench, case: Case, memory: _Loop, signals: loop.Signals, exact_mm: Floats) -> float:
    """Largest rms distance of exact loops with other noise to the exact loop, micrometres."""
    counts = DITHER * np.array([case.theta_m_count_rad, case.q3_count_m])
    sizes = np.hypot([case.theta_m_noise_rad, case.q3_noise_m], counts)
    if not sizes.any():
        return 0.0
    largest = 0.0
    for repeat in range(1, REPEATS + 1):
        after = np.random.default_rng([*case.seed, 1, repeat]).standard_normal((exact_mm.size, 2))
        noise = signals.noise.copy()
        noise[case.due :, :2] = sizes * after
        y = _continued(bench, case, memory, signals._replace(noise=noise), case.gap_deg)
        largest = max(largest, _rms_um(y, exact_mm))
    return largest


def _run(
    bench: Bench, memory: _Loop, signals: loop.Signals, traces: loop.Traces, first: int, stop: int, gap: float
) -> bool:
    """Run the samples first <= k < stop with one estimate [rad]; False if the loop diverged."""
    detector = bench.detector
    why = loop.run_segment(
        bench.plant, memory.plant, bench.controller, memory.controller, memory.detector,
        (detector.sos, detector.cos_step, detector.sin_step), signals, traces, (0, 1), first, stop,
        loop.GapInForce(gap), (1.0, math.inf), 0.0,
    )[1]  # fmt: skip
    return bool(why == loop.RAN)


def run_case(bench: Bench, case: Case) -> dict[str, Any]:
    """Run one case in the four ways; one row of the table (see :func:`run_campaign`)."""
    signals = _signals(bench, case)
    memory = _Loop(new_state(bench.plant), new_controller_state(bench.controller), bench.detector.initial_state())
    before = new_traces(case.samples + 1, len(bench.plant.sensor))
    old = math.radians(case.old_deg)
    if not _run(bench, memory, signals, before, 0, case.due, old):
        raise RuntimeError(f"case {case.seed}: the loop diverged before the twin was asked")
    row = _estimates(bench, case, before.seen[case.first : case.first + case.length])
    counted = before.theta_d[case.first + case.settle : case.first + case.length]
    row["informative"] = bool(np.sum(np.abs(np.diff(counted))) > math.radians(INFORMATIVE_DEG))
    gaps = {"exact": case.gap_deg, "old": case.old_deg, "plain": row["plain_deg"], "guarded": row["guarded_deg"]}
    q3_mm = {way: _continued(bench, case, memory, signals, gaps[way]) for way in WAYS}
    row["scatter_um"] = _scatter_um(bench, case, memory, signals, q3_mm["exact"])
    return row | _compared(case, 1e3 * signals.reference[case.due :], q3_mm)


def _continued(bench: Bench, case: Case, memory: _Loop, signals: loop.Signals, gap_deg: float) -> Floats:
    """q3 [mm] from the answer on, if the answer is ``gap_deg``; infinite where the loop diverged."""
    traces = new_traces(case.samples + 1, len(bench.plant.sensor))
    fine = _run(bench, memory.copy(), signals, traces, case.due, case.samples + 1, math.radians(gap_deg))
    y = 1e3 * traces.truth[case.due :, 1]
    return y if fine else np.full_like(y, math.inf)


def _rms_um(one_mm: Floats, other_mm: Floats) -> float:
    return 1e3 * float(np.sqrt(np.mean((one_mm - other_mm) ** 2)))


def _estimates(bench: Bench, case: Case, seen: Floats) -> dict[str, Any]:
    """Both twins at work on one buffer from one start."""
    model = replace(bench.model, settle=case.settle)
    optimizer, gap_max = bench.config.optimizer, math.radians(bench.config.twin.gap_max_deg)
    problem = Problem(seen[:, 0], seen[:, 1], model, gap_max)
    start = (math.radians(case.start_deg[0]), problem.theta_m[0] + math.radians(case.start_deg[1]))
    plain = estimate_gap(problem, optimizer, start)
    attempts = guarded_estimates(problem, optimizer, math.radians(case.old_deg), start=start)
    chosen = outcome(attempts)
    accepted = chosen.verdict.accepted
    return {
        "case": case.seed[1],
        "gap_deg": case.gap_deg,
        "old_deg": case.old_deg,
        "plain_deg": math.degrees(plain.fit_gap_rad),
        "guarded_deg": math.degrees(chosen.applied_rad) if accepted else case.old_deg,
        "accepted": accepted,
        "attempts": len(attempts),
        "reason": chosen.verdict.reason,
        "estimate_s": sum(attempt.estimate.wall_s for attempt in attempts),
    }


def _compared(case: Case, r_mm: Floats, q3_mm: dict[str, Floats]) -> dict[str, Any]:
    """Distances to the exact loop, harm and overshoots of the ways (inf where the loop diverged)."""
    row: dict[str, Any] = {"moves_rms_mm": float(np.sqrt(np.mean(np.diff(_levels(case)) ** 2)))}
    for way in WAYS:
        row[f"rms_{way}_um"] = _rms_um(q3_mm[way], q3_mm["exact"])
        row[f"tracking_{way}_um"] = _rms_um(q3_mm[way], r_mm)
        row[f"overshoot_{way}_pct"] = _overshoot(case, q3_mm[way])
    for way in ("plain", "guarded"):
        row[f"harm_{way}"] = 1e-3 * (row[f"rms_{way}_um"] - row["rms_old_um"]) / row["moves_rms_mm"]
    return row


def _levels(case: Case) -> list[float]:
    """The reference before, between and after the following moves, mm."""
    return [case.moves[-1][1], *(level for _, level in case.following)]


def _overshoot(case: Case, y: Floats) -> float:
    """Overshoot of the last move, which is at least 0.5 mm long, percent of its size."""
    _, start, target = _levels(case)
    last = case.following[-1][0] - case.due
    return float(max(100.0 * np.max((y[last:] - target) / (target - start)), 0.0))


def run_campaign(n: int, seed: int, progress: Callable[[int], None] | None = None) -> pd.DataFrame:
    """Run n random cases; a row a case.

    Columns: the case and both estimates (deg), whether and why the guard accepted, whether the screw moved in
    the buffer (``informative``), ``scatter_um`` of the exact loop, ``rms_*_um`` distance of q3 to
    the exact loop after the answer, ``tracking_*_um`` rms of r - q3, ``overshoot_*_pct`` of the last move, and
    ``harm_*``, the growth of that distance over the old loop's, as a share of the rms size of the moves.
    """
    bench = new_bench()
    rows = []
    for number in range(n):
        rows.append(run_case(bench, random_case(seed, number)))
        if progress:
            progress(number + 1)
    return pd.DataFrame(rows)


def harmful(table: pd.DataFrame, way: str) -> pd.Series[bool]:
    """Which cases of a campaign were made worse, ``way`` plain or guarded; see HARM_SHARE, HARM_SCATTER."""
    allowed = HARM_SHARE + HARM_SCATTER * 1e-3 * table["scatter_um"] / table["moves_rms_mm"]
    return ~(table[f"harm_{way}"] <= allowed)


def guard_rows(table: pd.DataFrame) -> list[Row]:
    """One row for the loop with the old estimate, the plain twin, the guarded twin, and the exact gap.

    ``worse``: cases beyond the tolerance; ``worse_by_1_pct``: cases whose distance to the exact loop grew by more than
    1 % of the moves, whatever the scatter; ``worst_harm_pct``: the largest such growth; ``rms_um``: the median
    distance to the exact loop; ``beyond_180_deg``: estimates that no gear can have; ``diverged``: |q3| above 1 m.
    """
    rows: list[Row] = []
    names = {"old": "old estimate kept", "plain": "plain BFGS", "guarded": "guarded twin", "exact": "exact gap"}
    for way, name in names.items():
        overshoot, distance = table[f"overshoot_{way}_pct"], table[f"rms_{way}_um"]
        row: Row = {
            "what": name, "cases": len(table), "worse": None, "worse_by_1_pct": None, "worst_harm_pct": None,
            "rms_median_um": distance.median(), "rms_p99_um": distance.quantile(0.99),
            "overshoot_above_20_pct": int((overshoot > 20.0).sum()), "worst_overshoot_pct": overshoot.max(),
            "beyond_180_deg": int((table[f"{way}_deg"] > 180.0).sum()) if way != "exact" else 0,
        }  # fmt: skip
        if way in ("plain", "guarded"):
            harm = table[f"harm_{way}"]
            row |= {
                "worse": int(harmful(table, way).sum()), "worse_by_1_pct": int((~(harm <= 0.01)).sum()),
                "worst_harm_pct": 100.0 * harm.max(),
            }  # fmt: skip
        if way == "guarded":
            row["pass"] = verdict(row["worse"], 0)
        rows.append(row)
    return rows


def guard_words(table: pd.DataFrame, seed: int) -> list[str]:
    """Sentences below the table."""
    informative = table[table["informative"]]
    lucky = int((table["tracking_exact_um"] > 1.02 * table["tracking_old_um"]).sum())
    reasons = table["reason"][~table["accepted"]].str.replace(r"[\d.]+", "#", regex=True).str.split(":").str[0]
    counted = "; ".join(f"{count} x {reason}" for reason, count in reasons.value_counts().items())
    return [
        f"seed {seed}; worse: farther from the loop with the exact gap than the old estimate by more than "
        f"{100 * HARM_SHARE:g} % of the moves and {HARM_SCATTER:g} times what other noise does to the exact loop.",
        f"accepted: {table['accepted'].mean():.1%} of all buffers, {informative['accepted'].mean():.1%} of the "
        f"{len(informative)} in which the screw moved 20 deg; {table['attempts'].mean():.2f} attempts a buffer.",
        f"rejected: {counted or 'none'}.",
        f"in {lucky} cases the old, wrong estimate tracks the reference better (2 %) than even the exact gap.",
    ]
