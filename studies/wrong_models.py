"""The twin in loops whose model is wrong: random rigs, a controller and a twin that believe the nominal one.

A case is a life of 100 s: a square wave with five moves, a gap that is constant or grows, and four estimations. Wrong
are the structure (k, c, m by up to 25 %) and what the nominal rig has not: dry friction on the motor and at the masses,
a screw that gives way, its pitch error, noise and counts. The same life, with the same noise, is run in four ways:

- ``old``: the first estimate is kept for all of it, as if nobody had asked the twin;
- ``exact``: the twin's answers are the true gaps, in force when the twin's would be: the best that it could do;
- ``former``: through a guard that asks for a clear likelihood ratio alone (:mod:`studies.likelihood`);
- ``guarded``: through the guard of the package.

An estimate is *right* within 2 degrees or 5 % of the true gap. A loop is *worse* if the largest overshoot of the moves
that begin after the first answer is greater than with the old gap kept, by more than ``WORSE_PCT`` of the move and
``SCATTER`` times what other noise does to the old loop. The exact gap too makes some loops worse, where two errors
cancelled each other; those cases are counted apart (``despite``), because no estimate could avoid them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from dtbacklash.arrays import Floats
from dtbacklash.config.compose import compose
from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import Belief, Beliefs, settled
from dtbacklash.errors import Diverged
from dtbacklash.experiment.estimation import answering
from dtbacklash.experiment.run import run_scenario, true_half_gap
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.twin.gap.estimate import Estimate, Problem
from dtbacklash.twin.gap.guard import Attempt, GuardSettings, Verdict, guarded_estimates
from dtbacklash.twin.link.service import Answer, Reply, Request, Twin
from studies.likelihood import likelihood_estimates
from studies.measure import Row

#: moves of a life begin every this many seconds; the first answer is in force before the third move
MOVE_S = 20.0
LIFE_S = 100.0
#: an overshoot this much greater is worse [% of the move] ...
WORSE_PCT = 1.0
#: ... if it is also this many times the largest change that REPEATS other noises make
SCATTER = 2.0
REPEATS = 2
PROCESSES = 2
RIGHT_DEG, RIGHT_SHARE = 2.0, 0.05
#: columns of a life's table of estimates
ESTIMATES = ["t_event_s", "gap_deg", "true_gap_deg", "accepted", "std_deg"]


@dataclass(frozen=True)
class Case:
    """A random life: its configuration (the true rig in it), and its old estimate [deg]."""

    config: RunConfig
    number: int
    drawn: dict[str, float]


def random_case(base: RunConfig, campaign: int, number: int) -> Case:
    """Draw case ``number`` of a campaign; the same two numbers give the same case."""
    rng = np.random.default_rng([campaign, number, 77])
    config = deepcopy(base)
    drawn: dict[str, float] = {}
    for name in ("k", "c", "m"):
        drawn[name] = float(rng.uniform(-0.25, 0.25))
        config.rig.parameters[name].value *= 1.0 + drawn[name]
    effects: dict[str, Any] = {}
    for place, effect, parameter, most, share in (
        ("motor_bearing", "coulomb_friction", "torque", 0.05, 0.4),
        ("mass_2", "ground_friction", "force", 0.3, 0.2),
        ("mass_3", "ground_friction", "force", 0.3, 0.2),
        ("screw", "compliance", "compliance", 1e-5, 0.3),
        ("screw", "pitch_error", "amplitude", 1e-5, 0.3),
    ):
        size, there = float(rng.uniform(0.0, most)), bool(rng.random() < share)
        drawn[f"{place}.{effect}"] = size if there else 0.0
        if there:
            effects.setdefault(place, {})[effect] = {parameter: size}
    phase, periods = float(rng.uniform(-3.1, 3.1)), float(rng.choice(np.array([0.5, 1.0, 2.0])))
    if "pitch_error" in effects.get("screw", {}):
        effects["screw"]["pitch_error"] |= {"phase": phase, "periods": periods}
    config.rig.effects = effects
    noisy, counts = rng.integers(0, 2, 2), rng.integers(0, 2, 2)
    sizes = rng.uniform(0.0, 1.0, 3)
    noise = {"q3_mm": 2e-3 * noisy[0] * sizes[0], "theta_m_rad": 5e-4 * noisy[1] * sizes[1]}
    config.sensors.noise = {name: float(size) for name, size in noise.items()}
    lines = float(rng.choice(np.array([1024, 4096, 65536])))
    config.sensors.resolution = {
        "q3_mm": float(1e-3 * counts[0] * sizes[2]), "theta_m_rad": float(counts[1] * 2 * math.pi / lines)
    }  # fmt: skip
    config.reference.amplitude_mm = float(rng.uniform(0.3, 1.5))
    config.profile.kind = str(rng.choice(np.array(["constant", "s_curve", "step", "ramp"])))
    start, end = (float(g) for g in np.sort(rng.uniform(0.0, 120.0, 2)))
    config.profile.start_deg = start if rng.random() < 0.8 else 0.0
    config.profile.end_deg, config.profile.t_start_s, config.profile.t_end_s = max(start, end), 10.0, 90.0
    anything, near = float(rng.uniform(0, 120)), float(np.clip(start + 3 * rng.standard_normal(), 0, 180))
    old = float(rng.choice(np.array([anything, near, config.profile.start_deg]), p=[0.4, 0.4, 0.2]))
    config.controller.gap_hat_deg = old
    config.controller.internal_model = str(rng.choice(np.array(["bare", "inner_loop"])))
    config.twin.delay_s = float(rng.uniform(0.0, 4.0))
    config.seed = int(rng.integers(1, 2**31))
    return Case(config, number, drawn)


#: who answers: from a request, its problem for the linear twin, the true half-gap in its middle, and the settings
Way = Callable[[Request, Problem, float, RunConfig], list[Attempt]]


@dataclass
class _Answering:
    """The twin of a run, whose attempts a function makes; ``gap`` : (N+1,) the true half-gap, rad.

    rows : of the table of estimates, kept here because a loop that diverges has no result.
    """

    way: Way
    config: RunConfig
    twin: Twin
    gap: Floats
    rows: list[dict[str, Any]] = field(default_factory=list)
    _done: list[Reply] = field(default_factory=list)

    def warm_up(self) -> None:
        self.twin.warm_up()

    def ask(self, request: Request) -> None:
        limit = math.radians(self.config.twin.gap_max_deg)
        problem = Problem(request.theta_m, request.q3, self.twin.model, limit)
        true = float(self.gap[min((request.first + request.stop) // 2, self.gap.size - 1)])
        attempts = self.way(request, problem, true, self.config)
        self._done.append(Reply(request, Answer(tuple(attempts), True, 0.0)))
        for attempt in attempts:
            self.rows.append({
                "t_event_s": request.event * self.config.sample_time_s,
                "gap_deg": math.degrees(attempt.estimate.gap_rad), "true_gap_deg": math.degrees(true),
                "accepted": attempt.verdict.accepted, "std_deg": math.degrees(attempt.estimate.std_rad),
            })  # fmt: skip

    def replies(self) -> list[Reply]:
        done, self._done = self._done, []
        return done


def _exact(_request: Request, _problem: Problem, true_rad: float, _config: RunConfig) -> list[Attempt]:
    estimate = Estimate(true_rad, true_rad, 0.0, 0.0, 0.0, 0.0, math.inf, 0, True, "", 0.0)
    return [Attempt(estimate, Verdict(True, "exact"), true_rad)]


def _former(request: Request, problem: Problem, _true_rad: float, config: RunConfig) -> list[Attempt]:
    return likelihood_estimates(problem, config.optimizer, request.present_rad)


def _guarded(request: Request, problem: Problem, _true_rad: float, config: RunConfig) -> list[Attempt]:
    settings = GuardSettings(gap_max_deg=config.twin.gap_max_deg)
    return guarded_estimates(problem, config.optimizer, request.present_rad, settings)


WAYS: dict[str, Way | None] = {
    "old": None, "exact": _exact, "former": _former, "guarded": _guarded,
}  # fmt: skip


@dataclass(frozen=True)
class Life:
    """What came of one life: largest overshoot after the first answer [% of a move], and the table of estimates."""

    overshoot_pct: float
    estimates: pd.DataFrame


def live(config: RunConfig, believed: Rig, way: Way | None) -> Life:
    """Run one life; the rig of ``config`` is the true one, controller and twin believe the other."""
    belief = Belief(believed)
    beliefs = Beliefs(belief, belief)
    config = settled(config, beliefs)
    service = None
    if way is None:
        config = replace(config, controller=replace(config.controller, reconfigure="never"))
    else:
        t_s = config.sample_time_s * np.arange(config.samples + 1, dtype=np.float64)
        twin = answering(config, belief)
        assert isinstance(twin, Twin)
        service = _Answering(way, config, twin, true_half_gap(config, build_rig(config.rig), t_s))
    try:
        result = run_scenario(config, beliefs=beliefs, service=service)
    except Diverged:
        result = None
    table = pd.DataFrame(service.rows if service else [], columns=ESTIMATES)
    if result is None:
        return Life(math.inf, table)
    after = round(2.0 * MOVE_S / config.sample_time_s)
    r_m, q3_m = (1e-3 * result.trace[name].to_numpy()[after:] for name in ("r_mm", "q3_mm"))
    towards = np.sign(r_m)
    return Life(float(max(100.0 * np.max((q3_m - r_m) * towards) / (2.0 * np.abs(r_m[0])), 0.0)), table)


def run_case(believed: Rig, case: Case) -> dict[str, Any]:
    """One row of the campaign's table; see :func:`run_wrong_models`."""
    config = case.config
    row: dict[str, Any] = {"case": case.number, **case.drawn}
    lives = {way: live(config, believed, answer) for way, answer in WAYS.items()}
    old = lives["old"].overshoot_pct
    suspect = any(life.overshoot_pct > old + WORSE_PCT for life in lives.values())
    others = [replace(config, seed=config.seed + 1 + i) for i in range(REPEATS if suspect and _noisy(config) else 0)]
    changed = [abs(live(other, believed, None).overshoot_pct - old) for other in others]
    scatter = max((c for c in changed if math.isfinite(c)), default=0.0)
    row |= {"scatter_pct": scatter, "old_deg": config.controller.gap_hat_deg}
    for way, life in lives.items():
        row[f"overshoot_{way}_pct"] = life.overshoot_pct
        row[f"worse_{way}"] = life.overshoot_pct > old + WORSE_PCT + SCATTER * scatter
        if way in ("old", "exact"):
            continue
        # an estimation may take several attempts: the accepted one counts, else the last
        table = life.estimates.sort_values("accepted", kind="stable").groupby("t_event_s").tail(1)
        error = (table["gap_deg"] - table["true_gap_deg"]).abs()
        right = error <= np.maximum(RIGHT_DEG, RIGHT_SHARE * table["true_gap_deg"])
        accepted = table["accepted"].astype(bool)
        row |= {
            f"estimations_{way}": len(table), f"accepted_{way}": int(accepted.sum()),
            f"right_{way}": int((accepted & right).sum()),
            f"far_{way}": int((accepted & (error > 3.0 * RIGHT_DEG) & ~right).sum()),
            f"within_2_std_{way}": int((accepted & (error <= 2.0 * table["std_deg"])).sum()),
        }  # fmt: skip
    return row


def _noisy(config: RunConfig) -> bool:
    return any(size > 0.0 for size in config.sensors.noise.values())


def run_wrong_models(n: int, seed: int) -> pd.DataFrame:
    """Run n random lives; a row a life.

    Columns: what is wrong; ``scatter_pct`` (where it matters: one of the loops seems worse); and for each way the
    overshoot, whether the loop is ``worse``, and how many estimates were made, accepted, accepted and right, accepted
    and ``far`` (wrong by more than 6 degrees), accepted and within two of their standard errors.
    """
    base = compose("controller=nimc_twin", "profile=constant", f"duration_s={LIFE_S:g}")
    believed = build_rig(base.rig)
    work = partial(_row, base, believed, seed)
    with ProcessPoolExecutor(PROCESSES) as pool:
        return pd.DataFrame(list(pool.map(work, range(n), chunksize=5)))


def _row(base: RunConfig, believed: Rig, seed: int, number: int) -> dict[str, Any]:
    return run_case(believed, random_case(base, seed, number))


def wrong_model_rows(table: pd.DataFrame) -> list[Row]:
    """One row a way; ``despite``: of the worse loops, those that the exact gap makes worse as well."""
    rows: list[Row] = []
    names = {
        "old": "old estimate kept", "exact": "exact gap", "former": "likelihood ratio alone",
        "guarded": "guarded twin",
    }  # fmt: skip
    right_before = max(int(table["right_former"].sum()), 1)
    for way, name in names.items():
        overshoot, worse = table[f"overshoot_{way}_pct"], table[f"worse_{way}"].astype(bool)
        row: Row = {
            "what": name, "loops": len(table), "worse": int(worse.sum()),
            "despite": int((worse & table["worse_exact"].astype(bool)).sum()),
            "overshoot_median_pct": overshoot.median(), "overshoot_p90_pct": overshoot.quantile(0.9),
        }  # fmt: skip
        if f"right_{way}" in table:
            total = {key: int(table[f"{key}_{way}"].sum()) for key in
                     ("estimations", "accepted", "right", "far", "within_2_std")}  # fmt: skip
            row |= total | {"right_over_former": total["right"] / right_before}
        if way == "guarded":
            met = row["worse"] == row["despite"] and row["right_over_former"] >= 3.0
            row["pass"] = "yes" if met else "no"
        rows.append(row)
    return rows


def wrong_model_words(table: pd.DataFrame, seed: int) -> list[str]:
    """Sentences below the table."""
    bare = table["overshoot_guarded_pct"] - table["overshoot_old_pct"]
    made, right = int(table["estimations_guarded"].sum()), int(table["right_guarded"].sum())
    most = made / max(int(table["right_former"].sum()), 1)
    smooth = table[(table["mass_2.ground_friction"] == 0.0) & (table["mass_3.ground_friction"] == 0.0)]
    shares = [
        smooth[f"right_{way}"].sum() / max(smooth["estimations_guarded"].sum(), 1) for way in ("guarded", "former")
    ]
    return [
        f"seed {seed}; worse: an overshoot greater than with the old gap by more than {WORSE_PCT:g} % of the move and "
        f"{SCATTER:g} times what other noise does; despite: the exact gap makes it worse as well.",
        f"right: within {RIGHT_DEG:g} deg or {100 * RIGHT_SHARE:g} %: {right} of {made} estimations; if all were, "
        f"it would be {most:.2f} times the likelihood ratio's.",
        f"without ground friction ({len(smooth)} loops) {shares[0]:.0%} of all estimates are accepted and right, by "
        f"the likelihood ratio {shares[1]:.0%}.",
        f"the guarded twin changes the overshoot by {bare.min():.3g} to {bare.max():.3g} % of the move, in the median "
        f"by {bare.median():.3g} %.",
    ]
