"""``dtb run --help``: what can be chosen. Reads the folders of ``conf`` itself, so that it needs no Hydra."""

from __future__ import annotations

import textwrap
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

GROUPS = {
    "experiment": "a whole scenario, e.g. a figure of the paper",
    "rig": "the machine; also the path of a YAML file",
    "controller": "the controller",
    "profile": "the gap over time",
    "reference": "the reference over time",
    "twin": "the digital twin and its link",
    "optimizer": "the twin's search for the gap",
    "sensors": "noise and quantisation",
    "solver": "accuracy of the simulation",
    "hydra/launcher": "who runs the jobs of a sweep",
}
LAUNCHERS = "joblib, basic, submitit_local, submitit_slurm (submitit: an extra)"

KEYS = """\
  duration_s=200               length of the run [s]
  sample_time_s=0.001          sample time of the controller [s]
  seed=0                       of noise, random references and optimizers that draw lots
  figures=true                 false: numbers only
  profile.start_deg=0          gap at the start [deg]; profile.end_deg=100 at the end
  profile.t_start_s=50         growth from here [s]; profile.t_end_s=150 to here
  profile.path=FILE            with profile=csv: columns t_s,gap_deg
  reference.amplitude_mm=1     size [mm]; reference.period_s=40 period [s]
  reference.path=FILE          with reference=csv: columns t_s,r_mm
  controller.gap_hat_deg=0     first estimate of the gap [deg]
  controller.k_theta_v_per_rad=15   gain of the inner loop [V/rad]
  controller.internal_model=bare    what drives the internal model: bare, measured, inner_loop, exact
  twin.delay_s=4               from a full buffer to the new gap in force [s]
  twin.buffer=1000             samples of one estimation; twin.settle=400 of them dropped
  twin.guard=true              false: trust whatever the optimizer returns
  optimizer.max_evaluations=200, optimizer.tolerance=1e-6
  sensors.noise.q3_mm=0.001    standard deviation; sensors.resolution.q3_mm=0.0005 one count
  rig.effects.ELEMENT.EFFECT.PARAMETER=VALUE   a physical effect, SI units
  recording.save=FILE          also write what the sensors saw (.csv or .parquet)
  hydra.run.dir=FOLDER         where the results go (default outputs/<date>/<time>_run_<controller>)
  hydra.sweep.dir=FOLDER       the same for a sweep (default outputs/sweeps/<keys>_<hash>)
  hydra.launcher.n_jobs=-1     jobs of a sweep at a time (-1: one a core)"""

EXAMPLES = """\
  dtb run controller=nimc_twin
  dtb run experiment=fig13
  dtb run controller=imc profile=constant profile.start_deg=60 duration_s=40
  dtb run rig.effects.motor_bearing.coulomb_friction.torque=0.02 controller.internal_model=measured
  dtb run -m controller=imc,nimc_fixed profile=s_curve,step twin.delay_s=0,4"""


def text() -> str:
    """Return the help text, with the options of the packaged ``conf`` and of a ``conf`` folder here."""
    parts = ["usage: dtb run [-m] [group=option ...] [key=value ...]", ""]
    parts += ["Simulates a controller on a rig while its backlash grows; writes tables, figures and report.html."]
    parts += ["-m sweeps: every combination of the comma-separated choices, one table and one figure at the end;"]
    parts += ["started again, it does only what is missing. --cfg job shows the configuration and runs nothing."]
    parts += ["", "choices (group=option):"]
    for group, summary in GROUPS.items():
        chosen = LAUNCHERS if group == "hydra/launcher" else ", ".join(options(group))
        wrapped = textwrap.wrap(chosen, 72)
        parts.append(f"  {group:<15} {summary}")
        parts += [f"  {'':<17} {line}" for line in wrapped]
    parts += ["", "settings (key=default) [unit]:", KEYS, "", "examples:", EXAMPLES]
    parts += [
        "",
        "A folder `conf` in the current directory extends the choices: conf/rig/mine.yaml is rig=mine.",
    ]
    return "\n".join(parts)


def options(group: str) -> list[str]:
    """Return the options of a folder of ``conf``, packaged and the user's, sorted."""
    places: list[Traversable] = [resources.files("dtbacklash.conf") / group]
    mine = Path("conf") / group
    if mine.is_dir():
        places.append(mine)
    names = {entry.name.removesuffix(".yaml") for place in places for entry in place.iterdir()}
    return sorted((name for name in names if not name.startswith(("_", "."))), key=_numbers_last)


def _numbers_last(name: str) -> tuple[str, int]:
    """Sort fig4 before fig10."""
    stem = name.rstrip("0123456789")
    return stem, int(name[len(stem) :] or 0)
