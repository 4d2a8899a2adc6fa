"""The result of a run: tables of the trace, the moves and the estimates, what the sensors saw, and a summary."""

import math
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.config.run import RunConfig
from dtbacklash.control.margins import DesignedLoop
from dtbacklash.experiment import loop, metrics
from dtbacklash.experiment.advice import advice, settles
from dtbacklash.experiment.novelty_monitor import Watcher
from dtbacklash.experiment.sensors import column, trace_factor
from dtbacklash.physics.extrapolation import beyond
from dtbacklash.physics.rig import Rig

#: columns of a trace that mean nothing without a gear, and without a loop with a twin
OF_A_TWIN = ["gap_hat_deg", "eps_mm", "novelty_mm"]
OF_A_GEAR = ["theta_d_rad", "gap_deg", *OF_A_TWIN]


@dataclass
class RunResult:
    """What a run gives; the columns are those that ``dtb run`` writes.

    config, rig : what was simulated.
    trace : a row a sample, N+1 of them, with the true values, in the loop's columns: ``theta_m_rad`` is the motor's
        angle and ``q3_mm`` the output, whatever the rig calls them. channels : the same in the rig's own columns.
    own : column of the rig's own -> that of the trace.
    seen : channel -> (N+1,) what controller and sensors saw, in SI: the reference ``r`` (m; V in open loop), the
        command ``u`` (V), and each sensor of the rig with its noise and counts.
    moves : a row a move, see :func:`dtbacklash.experiment.metrics.move_table`.
    estimates : a row an attempt of the twin. summary : JSON-able figures of the run.
    design : the controller with what it was designed for, at the start; None in open loop.
    """

    config: RunConfig
    rig: Rig
    trace: pd.DataFrame
    seen: dict[str, Floats]
    moves: pd.DataFrame
    estimates: pd.DataFrame
    summary: dict[str, Any]
    design: DesignedLoop | None = None
    own: dict[str, str] = field(default_factory=dict)

    @property
    def is_open(self) -> bool:
        """Whether nothing is fed back: the reference is the command."""
        return self.config.controller.structure == "open_loop"

    @property
    def channels(self) -> pd.DataFrame:
        """A row a sample, N+1 of them, with the true values: what this rig and this run have, and nothing else.

        Columns ``t_s``; ``r_mm`` in closed loop; the command; each sensor by its name and unit; of a rig with a gear
        ``theta_d_rad, gap_deg``, in closed loop also ``gap_hat_deg, eps_mm, novelty_mm``; bands and indexes.
        """
        gone = [name for name in ("theta_m_rad", "q3_mm") if name not in self.own.values()]
        gone += OF_A_GEAR if self.rig.only("gear") is None else []
        gone += ["r_mm", *OF_A_TWIN] if self.is_open else []
        names = {inside: own for own, inside in self.own.items()}
        names |= {f"{inside}_{end}": f"{own}_{end}" for own, inside in self.own.items() for end in ("low", "high")}
        table = self.trace.drop(columns=[name for name in dict.fromkeys(gone) if name in self.trace])
        factor = units.shown(self.rig.command_unit)[1]
        return (table if factor == 1.0 else table.assign(u_v=table["u_v"] * factor)).rename(columns=names)

    @property
    def t_s(self) -> Floats:
        """(N+1,) time of each sample, s."""
        return self.trace["t_s"].to_numpy(dtype=np.float64)

    @property
    def units(self) -> dict[str, str]:
        """The SI unit of each channel of ``seen``."""
        unit = self.rig.command_unit
        return {"r": unit if self.is_open else "m", "u": unit, **{s.name: s.unit for s in self.rig.sensors.values()}}


@dataclass(frozen=True)
class Walls:
    """Where the time went, s.

    simulate : the loop. estimate : asking the twin. total : all of it, with designing the controller and loading
    libraries.
    """

    simulate: float
    estimate: float
    total: float


def collect(
    config: RunConfig,
    rig: Rig,
    design: DesignedLoop | None,
    signals: loop.Signals,
    traces: loop.Traces,
    roles: tuple[int, int],
    estimates: pd.DataFrame,
    walls: Walls,
    watcher: Watcher | None = None,
) -> RunResult:
    """Tables and summary of a finished run.

    design : the controller, None in open loop. roles : the sensors (index or -1) that show theta_m and q3.
    """
    closed = config.controller.structure != "open_loop"
    trace = _trace(config, rig, signals, traces, roles)
    seen = {"r": signals.reference, "u": traces.u}
    seen |= {name: np.ascontiguousarray(traces.seen[:, j]) for j, name in enumerate(rig.sensors)}
    if watcher is not None:
        trace = trace.assign(**watcher.columns())
    moves = metrics.move_table(trace if closed else trace.iloc[:0])  # in open loop r is no target of q3
    left = beyond(rig, traces.u, signals.gap, config.sample_time_s)
    summary = {
        "controller": config.controller.name,
        "n_moves": len(moves),
        "n_estimations": int(estimates["t_event_s"].nunique()),
        "n_attempts": int(estimates["wall_s"].notna().sum()),  # a request that nobody answered took none
        "n_accepted": int(estimates["accepted"].sum()) if len(estimates) else 0,
        "settles": settles(moves),
        "overshoot_pct_max": float(moves["overshoot_pct"].max()) if len(moves) else None,
        # a move that does not settle has no settling time, and then the worst one has none either
        "settling_time_s_max": float(moves["settling_time_s"].max(skipna=False)) if len(moves) else None,
        "peak_voltage_v": float(trace["u_v"].abs().max()),
        "tracking_rms_mm": metrics.tracking_rms_mm(trace) if closed else None,
        "signals": _signals(rig, trace, roles),
        "seconds_simulated": float(trace["t_s"].iloc[-1]),
        "advice": [*advice(config, rig, design, trace, moves), *(one.words for one in left)],
        "beyond": [asdict(one) for one in left],
        "margins": None if design is None else design.margins().as_dict(),
        "moves": moves.to_dict("records"),
        "estimates": estimates.to_dict("records"),
        "wall_s": asdict(walls),
    }
    if watcher is not None:
        summary["alarms"] = watcher.alarms
    return RunResult(config, rig, trace, seen, moves, estimates, summary, design, _own_columns(rig, roles))


def _own_columns(rig: Rig, roles: tuple[int, int]) -> dict[str, str]:
    """The columns of command and sensors, by their names and units -> the columns of the loop's trace."""
    motor, output = roles
    inside = [{motor: "theta_m_rad", output: "q3_mm"}.get(j, column(s)) for j, s in enumerate(rig.sensors.values())]
    command = f"u_{units.suffix(units.shown(rig.command_unit)[0])}"
    return {command: "u_v", **dict(zip(map(column, rig.sensors.values()), inside, strict=True))}


def _signals(rig: Rig, trace: pd.DataFrame, roles: tuple[int, int]) -> list[dict[str, Any]]:
    """For the summary: what the command and each sensor are, their own columns, their ranges."""
    (command, _), *sensors = own = list(_own_columns(rig, roles).items())
    unit, factor = units.shown(rig.command_unit)
    found = [{"signal": "u", "column": command, "unit": unit, "of": "", "quantity": "command"}]
    found += [
        {"signal": s.name, "column": name, "unit": units.shown(s.unit)[0], "of": s.of, "quantity": s.quantity}
        for s, (name, _) in zip(rig.sensors.values(), sensors, strict=True)
    ]
    ranges = [metrics.signal_range(trace[inside] * (1.0 if k else factor)) for k, (_, inside) in enumerate(own)]
    return [signal | there for signal, there in zip(found, ranges, strict=True)]


def _trace(config: RunConfig, rig: Rig, s: loop.Signals, t: loop.Traces, roles: tuple[int, int]) -> pd.DataFrame:
    """A row a sample, with the true values; a column for each sensor that is neither theta_m nor q3 at the end."""
    time_s = np.arange(s.gap.size) * config.sample_time_s
    closed = config.controller.structure != "open_loop"
    sensors = list(rig.sensors.values())
    truth = {column(sensor): t.truth[:, j] * trace_factor(sensor) for j, sensor in enumerate(sensors)}
    theta_m, q3 = (truth.pop(column(sensors[role])) if role >= 0 else np.full_like(time_s, math.nan) for role in roles)
    return pd.DataFrame({
        "t_s": time_s, "r_mm": s.reference * (1e3 if closed else 1.0), "q3_mm": q3, "u_v": t.u,
        "theta_m_rad": theta_m, "theta_d_rad": t.theta_d, "gap_deg": np.degrees(s.gap),
        "gap_hat_deg": np.degrees(t.gap_hat), "eps_mm": t.eps * 1e3, "novelty_mm": t.novelty * 1e3, **truth,
    })  # fmt: skip
