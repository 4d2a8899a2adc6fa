"""From a recording to a controller that works again: record in closed loop, diagnose, and use what was found.

The machine is recorded in the loop of a controller that believes in the nominal rig. Then the twin alone, the design
alone, and both use what the diagnosis has found; a loop that knows the truth is run for comparison.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import pandas as pd

from dtbacklash.config.run import ProfileConfig, ReferenceConfig, RunConfig
from dtbacklash.control.belief import Belief, Beliefs, nominal
from dtbacklash.errors import Diverged
from dtbacklash.experiment.run import RunResult, run_scenario
from dtbacklash.experiment.sensors import roles
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.simulate import rig_half_gap
from dtbacklash.recording import Recording

if TYPE_CHECKING:
    from dtbacklash.diagnosis import Diagnosis

#: what the loops believe: name -> (design, twin), each ``nominal``, ``found`` or ``true``
VARIANTS = {
    "nominal": ("nominal", "nominal"),
    "twin only": ("nominal", "found"),
    "design only": ("found", "nominal"),
    "both": ("found", "found"),
    "truth": ("true", "true"),
}
#: how a machine is recorded: a multisine over its first modes, from the loop as it is, with the gap as it is at first
RECORDED_S, RMS_MM, LOWEST_HZ, HIGHEST_HZ = 30.0, 1.0, 0.1, 4.0
COLUMNS = ["belief", "overshoot_pct", "settling_time_s", "estimations", "accepted", "largest_gap_error_deg"]

Tell = Callable[[str, float], None]


@dataclass(frozen=True)
class Closed:
    """The outcome.

    recorded : the run that the machine was recorded in. diagnosis : of the recording. runs :
    variant -> its run, None where the loop diverged. table : a row a variant, columns ``COLUMNS``.
    """

    recorded: RunResult
    diagnosis: Diagnosis
    runs: dict[str, RunResult | None]
    table: pd.DataFrame


def close_the_loop(config: RunConfig, tell: Tell | None = None) -> Closed:
    """Record the machine ``config.rig``, diagnose it against ``config.model``, and run the loop with what was found.

    Parameters
    ----------
    config : of the loop; ``model`` is what is believed before (None: the rig's own parameters without effects).
    tell : called with what is being done and the share done, 0 to 1.

    Raises
    ------
    UserError : the rig is none that a controller is made for; the recording says nothing.
    """
    from dtbacklash.diagnosis import diagnose

    say = tell or (lambda text, share: None)
    stated = build_rig(config.model or nominal(config.rig))
    say("recording the machine", 0.0)
    recorded = record(config, stated)
    found = diagnose(
        seen_by_the_loop(recorded), stated, progress=lambda text, share: say(text, 0.05 + 0.75 * share), jobs=2
    )
    runs = compare(config, stated, found.rig, lambda name, share: say(f"running: {name}", 0.8 + 0.2 * share))
    return Closed(recorded, found, runs, table(runs))


def record(config: RunConfig, believed: Rig) -> RunResult:
    """The loop that believes in ``believed``, following a multisine, before anything of ``changes`` happens."""
    belief = Belief(believed)
    controller = replace(config.controller, structure="nimc", reconfigure="never", internal_model="inner_loop")
    start_deg = config.profile.start_deg
    asked = replace(
        config, controller=controller, duration_s=RECORDED_S, task="run", changes=[],
        profile=ProfileConfig("constant", start_deg=start_deg, end_deg=start_deg),
        reference=ReferenceConfig(
            "multisine", rms_mm=RMS_MM, f_min_hz=LOWEST_HZ, f_max_hz=HIGHEST_HZ, period_s=1.0 / LOWEST_HZ
        ),
    )  # fmt: skip
    return run_scenario(asked, beliefs=Beliefs(belief, belief))


def seen_by_the_loop(result: RunResult) -> Recording:
    """What the loop itself has: the reference, the command, and the sensors of motor and output."""
    recording, names = recording_of(result), list(result.rig.sensors)
    kept = {"r", "u", *(names[role] for role in roles(result.rig, True))}
    return replace(recording, channels={n: v for n, v in recording.channels.items() if n in kept},
                   units={n: v for n, v in recording.units.items() if n in kept})  # fmt: skip


def recording_of(result: RunResult) -> Recording:
    """What the sensors of a run saw, as a recording in SI; nothing is copied."""
    name, step_s = f"{result.config.controller.name} on {result.rig.config.name}", result.config.sample_time_s
    return Recording(name, None, step_s, result.t_s, dict(result.seen), result.units)


def compare(
    config: RunConfig, stated: Rig, found: Rig, tell: Tell | None = None
) -> dict[str, RunResult | None]:  # fmt: skip
    """The loop of ``config`` on its rig with each belief of ``VARIANTS``; None where it diverged.

    stated : the rig as it is believed before. found : as the diagnosis leaves it.
    """
    true = build_rig(config.rig)
    gear, gap = true.only("gear"), rig_half_gap(true) + math.radians(config.profile.start_deg)
    if gear is not None and gap > 0.0:  # the truth knows of the gap that there is at first, too
        true = true.with_effect(gear.name, "backlash", {"half_gap": gap})
    known = {"nominal": Belief(stated), "found": Belief(found), "true": Belief(true)}
    runs: dict[str, RunResult | None] = {}
    for j, (name, (design, twin)) in enumerate(VARIANTS.items()):
        if tell:
            tell(name, j / len(VARIANTS))
        try:
            runs[name] = run_scenario(config, beliefs=Beliefs(known[design], known[twin]))
        except Diverged:
            runs[name] = None
    return runs


def table(runs: dict[str, RunResult | None]) -> pd.DataFrame:
    """A row a belief, columns ``COLUMNS``; infinite overshoot where the loop diverged."""
    return pd.DataFrame([_row(name, run) for name, run in runs.items()], columns=COLUMNS)


def _row(name: str, run: RunResult | None) -> list[object]:
    if run is None:
        return [name, math.inf, math.nan, 0, 0, math.nan]
    accepted = run.estimates[run.estimates["accepted"].astype(bool)]
    error = (accepted["applied_deg"] - accepted["true_gap_deg"]).abs()
    told = run.summary
    return [
        name, told["overshoot_pct_max"], told["settling_time_s_max"], told["n_estimations"], told["n_accepted"],
        float(error.max()) if len(error) else math.nan,
    ]  # fmt: skip
