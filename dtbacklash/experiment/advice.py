"""Why a run does not settle, and which setting helps: from what is configured, and from where it fails.

Each cause is checked by itself; a sentence names the cause and the setting, as the command line takes it. Where no
cause is found, only the first sentence stands.
"""

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd
import scipy

from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import on_the_motor
from dtbacklash.control.design import ControllerDesign, largest_gain
from dtbacklash.control.linear_law import LinearLaw
from dtbacklash.control.margins import DesignedLoop
from dtbacklash.experiment.sensors import column, roles, trace_factor
from dtbacklash.physics.effects.declare import name_in_words
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig

#: a pole is outside the unit circle from here on: an integrator that is sampled twice lies on it to rounding
UNSTABLE = 1e-5
#: a gain above this share of the one from which the inner loop is unstable is too large: a gain margin of 2
GAIN_SHARE = 0.5
#: the prefilter's time constants that a move needs to come within 1 %, and a little more for the structure
MOVE_TIME_CONSTANTS = 5.0
#: a gap that differs from the believed one by less, deg, rings nothing
SMALL_GAP_DEG = 0.5
#: from this share of the true gap and 0.01 deg on, an estimate that is too large may keep the loop oscillating in it
SURPLUS_SHARE = 0.2
#: settling band, share of a move, and how far the structure rings where a move meets an unknown gap
BAND, RINGING = 0.01, 0.1
#: effects on the motor that the design has in its linear part
IN_THE_DESIGN = ("viscous_friction", "gain_error")


def settles(moves: pd.DataFrame) -> bool | None:
    """Whether every move settles; None where there is no move. moves : see :func:`.metrics.move_table`."""
    return bool(moves["settling_time_s"].notna().all()) if len(moves) else None


def advice(
    config: RunConfig, rig: Rig, designed: DesignedLoop | None, trace: pd.DataFrame, moves: pd.DataFrame
) -> list[str]:
    """Sentences for a run that does not settle, the first of which says so; where it does, of its delay alone.

    designed : the controller, None in open loop. trace, moves : of the run, as in :class:`.result.RunResult`.
    """
    if designed is None:
        return []
    late, design = list(_late(rig, designed)), designed.design
    if settles(moves) is not False:
        return late
    restless = moves[moves["settling_time_s"].isna()]
    said = [f"{len(restless)} of {len(moves)} moves never settle within {100 * BAND:g} %."]
    at = trace.iloc[np.searchsorted(trace["t_s"], restless["t_s"] - 1e-9)]
    holds = _holds(trace, moves)[restless.index]
    return [
        *said, *late, *causes(config, rig, design), *_too_short(config, design, at, holds),
        *_too_fine(config, rig, restless), *_false_output(rig), *_surplus(config, at),
    ]  # fmt: skip


def rig_delay_s(rig: Rig) -> float:
    """The delays between the command and the measured angle, s."""
    places = [place for name, place in on_the_motor(rig, delays=True) if name == "delay"]
    return sum(rig.effects[place]["delay"]["time"] for place in places)


def _late(rig: Rig, designed: DesignedLoop) -> Iterator[str]:
    found, delay_s = designed.margins(), rig_delay_s(rig)
    known_s = sum(designed.design.delays_s[:2])
    if found.delay_s is not None and found.delay_s + known_s < 2.0 * delay_s:
        beyond = f" beyond the {1e3 * known_s:.3g} ms that it knows" if known_s else ""
        # a PID, an LQG and an MPC have no such gain
        more = ": a smaller controller.k_theta_v_per_rad leaves more" if designed.design.law is None else ""
        yield (
            f"The design's delay margin of {1e3 * found.delay_s:.3g} ms{beyond} is below twice the rig's delay of "
            f"{1e3 * delay_s:.3g} ms{more}."
        )


def causes(config: RunConfig, rig: Rig, design: ControllerDesign) -> list[str]:
    """The causes that the configuration alone shows; also for a loop that diverged."""
    if design.law is not None:  # it has neither an internal model nor a prefilter
        return list(_unstable(config, design, design.law))
    told = [*_gain(config, rig, design), *_unmodelled(config, rig)]
    if config.controller.prefilter == "none":
        told.append(
            "Without a prefilter every move rings the structure: controller.prefilter=reduced cancels its mode."
        )
    return told


def _unstable(config: RunConfig, design: ControllerDesign, law: LinearLaw) -> Iterator[str]:
    """A linear law whose loop around the believed rig is unstable, without a gap and a limit."""
    motor, plant = design.motor_position, design.plant
    seen = np.zeros((3, motor.order + plant.order))
    seen[1, : motor.order], seen[2, motor.order :] = motor.C[0], plant.C[0]
    driven = np.concatenate([motor.B, plant.B])
    loop = np.block([
        [scipy.linalg.block_diag(motor.A, plant.A) + driven @ (law.D @ seen)[None], driven @ law.C[None]],
        [(law.B + np.outer(law.E, law.D)) @ seen, law.A + np.outer(law.E, law.C)],
    ])  # fmt: skip
    radius = float(np.abs(np.linalg.eigvals(loop)).max())
    if radius > 1.0 + UNSTABLE:
        which = f"controller.file={config.controller.file}" if config.controller.file else "this controller"
        yield (
            f"Around the believed rig {which} is unstable: a pole at a distance of {radius:.4g} from 0, its matrices "
            f"taken for samples of {1e3 * config.sample_time_s:g} ms and y = (reference m, angle rad, output m)."
        )


def _gain(config: RunConfig, rig: Rig, design: ControllerDesign) -> Iterator[str]:
    """The inner loop's gain beside the largest one that the sampled motor bears, with the delays on the way."""
    late_s = sum(
        there["delay"]["time"]
        for place, there in rig.effects.items()
        if "delay" in there
        and (rig.kind_at(place) == "amplifier" or place == SENSOR_PREFIX + list(rig.sensors)[roles(rig, True)[0]])
    )
    limit = largest_gain(design.motor_position, round(late_s / config.sample_time_s))
    gain = config.controller.k_theta_v_per_rad
    if gain > GAIN_SHARE * limit:
        delays = f" and delays of {1e3 * late_s:g} ms" if late_s else ""
        yield (
            f"The inner loop has little or no margin: with samples of {1e3 * config.sample_time_s:g} ms{delays} it is "
            f"unstable from {limit:.3g} V/rad on, and its gain is {gain:g}; controller.k_theta_v_per_rad="
            f"{0.8 * GAIN_SHARE * limit:.2g} leaves a margin."
        )


def _unmodelled(config: RunConfig, rig: Rig) -> Iterator[str]:
    """Effects between the voltage and the measured angle, which the internal model does not know."""
    believed = config.model.effects if config.model and config.controller.design_from == "model" else {}
    known = {*config.controller.compensate, *IN_THE_DESIGN}
    found = [
        f"{name_in_words(name)} at {place}" for name, place in on_the_motor(rig)
        if not (name in known and name in believed.get(place, {}))
    ]  # fmt: skip
    model = config.controller.internal_model
    if not found or model in ("inner_loop", "inverse"):
        return
    better = "inverse" if config.controller.structure == "nimc" else "inner_loop"
    how = {
        "measured": "cannot see the voltage that it needs, so an error stays",
        "bare": "integrates the voltage without it, and drifts",
        "exact": "integrates the voltage without it, and drifts",
    }[model]
    yield (
        f"The controller does not know of {' and '.join(found)}: its internal model ({model}) {how}; "
        f"controller.internal_model={better} takes it out."
    )


def _holds(trace: pd.DataFrame, moves: pd.DataFrame) -> pd.Series:
    """How long each move is held, s; the last to the end of the run."""
    return pd.Series(np.diff([*moves["t_s"], trace["t_s"].iloc[-1]]), index=moves.index)


def _too_short(config: RunConfig, design: ControllerDesign, at: pd.DataFrame, holds: pd.Series) -> Iterator[str]:
    """The reference goes on before a move can have arrived. at : the trace where these moves begin."""
    if config.controller.prefilter != "reduced" or design.law is not None:
        return
    tau_s = config.controller.tau_r_s
    needed = np.full(len(at), MOVE_TIME_CONSTANTS * tau_s)
    # a gap that the controller does not have in its model rings the structure, which has to die away by itself
    believed = at["gap_hat_deg"] if config.controller.structure == "nimc" else 0.0 * at["gap_deg"]
    wrong = (at["gap_deg"] - believed).abs().to_numpy() > SMALL_GAP_DEG
    needed[wrong] += math.log(RINGING / BAND) / _decay_per_s(design)
    short = holds.to_numpy() < needed
    if not short.any():
        return
    needed_s, held_s = float(needed[short].max()), float(np.median(holds.to_numpy()[short]))
    longer = {
        "square": f"reference.period_s={2.4 * needed_s:.3g}",
        "staircase": f"reference.dwell_s={1.2 * needed_s:.3g}",
    }.get(config.reference.kind, "hold it longer")
    if short.sum() == 1 and short[-1] and at["t_s"].iloc[-1] + needed_s > config.duration_s:
        longer = f"duration_s={math.ceil(at['t_s'].iloc[-1] + 1.2 * needed_s)}"
    ringing = f" and a gap that the controller's model does not have ({at['gap_deg'][wrong].max():.3g} deg)"
    why = f"controller.tau_r_s={tau_s:.3g} s" + (ringing if wrong.any() else "")
    yield f"A move takes about {needed_s:.2g} s ({why}), and the reference holds for {held_s:.2g} s: {longer}."


def _decay_per_s(design: ControllerDesign) -> float:
    """How fast the structure's slowest mode dies away, 1/s."""
    slowest = float(np.abs(np.linalg.eigvals(design.structure.A)).max())
    return -math.log(min(slowest, 1.0 - 1e-12)) / design.sample_time_s


def _too_fine(config: RunConfig, rig: Rig, restless: pd.DataFrame) -> Iterator[str]:
    """A settling band that is narrower than what the sensors resolve."""
    band_mm = BAND * float((restless["to_mm"] - restless["from_mm"]).abs().min())
    screw = rig.only("screw")
    lead_mm = 1e3 * screw.values["lead"] if screw else 0.0
    for j, role in enumerate(roles(rig, True)):
        sensor = list(rig.sensors.values())[role]
        name, per_mm = column(sensor), lead_mm / trace_factor(sensor) if j == 0 else 1.0
        for what, sizes in (("resolution", config.sensors.resolution), ("noise", config.sensors.noise)):
            size_mm = sizes.get(name, 0.0) * per_mm
            if size_mm > band_mm:
                yield (
                    f"The settling band of the smallest such move, {band_mm:.2g} mm, is narrower than the {what} of "
                    f"{name} ({size_mm:.2g} mm at the output): larger moves, or sensors.{what}.{name}=0."
                )


def _false_output(rig: Rig) -> Iterator[str]:
    """The sensor at the output shows something else than the output: no controller can know."""
    place = SENSOR_PREFIX + list(rig.sensors)[roles(rig, True)[1]]
    wrong = [name_in_words(name) for name in rig.effects.get(place, {}) if name != "delay"]
    if wrong:
        yield f"{place} has {' and '.join(wrong)}: the loop brings its reading to the target; no setting can know."


def _surplus(config: RunConfig, at: pd.DataFrame) -> Iterator[str]:
    """NIMC whose model has a larger gap than there is. at : the trace where moves begin that do not settle."""
    c = config.controller
    true, believed = at["gap_deg"].to_numpy(dtype=float), at["gap_hat_deg"].to_numpy(dtype=float)
    if c.structure != "nimc" or c.internal_model not in ("measured", "inner_loop"):
        return
    if np.any(believed > (1.0 + SURPLUS_SHARE) * true + 0.01):
        yield (
            f"NIMC with internal_model={c.internal_model} can oscillate for ever inside a gap that it believes larger "
            f"({believed.max():.3g} deg) than it is ({true.min():.3g} deg): controller.internal_model=inverse, or "
            f"controller.gap_hat_deg={float(np.round(true.min(), 3)):g}."
        )
