"""Compile what the tests need, once: the oracle of the core, and a concealed recording. ``python warm.py``."""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np


def warm() -> None:
    """Run this file as a process of its own; what is compiled is kept on disk."""
    subprocess.run([sys.executable, str(Path(__file__).resolve())], capture_output=True, check=True, timeout=900)


def main() -> None:
    from oracle import passes

    from dtbacklash import load_rig
    from dtbacklash.physics.assembly import compile_plant
    from dtbacklash.physics.kernel.plant import new_state
    from dtbacklash.prove.conceal import conceal

    plant = compile_plant(load_rig("lead_screw"), 1e-3, 0, 16)
    state, rows = new_state(plant), np.zeros(3)
    y = np.zeros((3, len(plant.sensor)))
    passes.run(plant, state, np.zeros(2), rows, rows, y, np.zeros((3, state.x.size)), rows.copy())
    with tempfile.TemporaryDirectory() as folder:
        conceal(1, "oscillator", Path(folder, "cases"))


if __name__ == "__main__":
    main()
