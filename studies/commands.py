"""What whole commands cost, from Enter to the page, in processor time: the table that the docs quote."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from studies.measure import Row, verdict

#: README's recording: soft springs, and friction in the motor's bearing
README = (
    "run", "controller=open_loop", "reference=multisine", "reference.rms_v=2", "reference.f_max_hz=10",
    "profile=constant", "profile.start_deg=0", "duration_s=30", "sensors=encoder", "rig.parameters.k.value=8000",
    "rig.effects.motor_bearing.coulomb_friction.torque=0.02", "recording.save=bench.csv",
)  # fmt: skip
#: what is diagnosed -> how it is concealed, and the processor time that it may take, s
CONCEALED = {
    "nothing missing, oscillator": (("rig=oscillator", "kind=nothing", "seed=3002"), 5.0),
    "clean friction, pendulum": (("rig=pendulum", "effect=disk.coulomb_friction", "seed=3009"), 10.0),
    "clean friction, rotary drive": (("rig=rotary_drive", "effect=load.coulomb_friction", "seed=3022"), 10.0),
    "friction beside small things, pendulum": (
        ("rig=pendulum", "effect=disk.coulomb_friction", "machine=lifelike", "seed=3029"), 25.0),
    "a lifelike stage": (
        ("rig=two_mass_stage", "effect=carriage.coulomb_friction", "machine=lifelike", "seed=3031"), 60.0),
}  # fmt: skip
#: commands that do little -> the processor time that they may take, s
SMALL = {
    ("run", "controller=nimc_twin"): 1.2,
    ("run", "--help"): 0.3,
    ("run", "controler=nimc_twin"): 0.4,
}


def command_rows() -> list[Row]:
    """Processor time of commands, each a process of its own: of all its threads, with what it imports."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        rows = [_row(f"dtb {' '.join(words)}", most, *_timed(folder, *words)) for words, most in SMALL.items()]
        _timed(folder, *README)
        rows.append(_diagnosed("README's example", folder, "bench.csv", "lead_screw", 15.0))
        for what, (words, most) in CONCEALED.items():
            hidden = folder / what.replace(" ", "_")
            _timed(folder, "conceal", *words, f"out={hidden}")
            (recording,) = hidden.glob("*/recording.csv.gz")
            rows.append(_diagnosed(what, folder, str(recording), words[0].removeprefix("rig="), most))
    return rows


def _diagnosed(what: str, folder: Path, recording: str, rig: str, most: float) -> Row:
    words = "diagnose", f"recording={recording}", f"rig={rig}", "jobs=1", "out=found"
    row = _row(f"dtb diagnose, {what}", most, *_timed(folder, *words))
    found = json.loads((folder / "found" / "diagnosis.json").read_text(encoding="utf-8"))
    names = [f"{f['location']}.{f['effect']} ({f['confidence']})" for f in found["findings"]]
    return {**row, "said": ", ".join([found["verdict"], *names])}


def _row(what: str, most: float, processor_s: float, memory_mb: float) -> Row:
    return {
        "what": what, "processor_s": processor_s, "memory_mb": memory_mb, "limit": most,
        "pass": verdict(processor_s, most),
    }  # fmt: skip


def _timed(folder: Path, *words: str) -> tuple[float, float]:
    """(processor time, s; memory at its highest of all commands so far, MB) of one command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-m", "dtbacklash.cli", *words], cwd=folder, check=False, capture_output=True,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return spent, after.ru_maxrss / 1024.0
