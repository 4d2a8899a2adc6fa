"""Compile what the tests need, once: a run with a twin, and a diagnosis. ``python warm.py``, in an empty folder."""

import subprocess
import sys
from pathlib import Path

RUN = ["duration_s=2", "twin.buffer=200", "twin.settle=100", "figures=false"]


def warm(folder: Path) -> None:
    """Run this file as a process of its own; what is compiled is kept on disk."""
    subprocess.run(
        [sys.executable, str(Path(__file__).resolve())], cwd=folder, capture_output=True, check=True, timeout=900
    )


def main() -> None:
    import numpy as np

    from dtbacklash import cli
    from dtbacklash.config.compose import compose
    from dtbacklash.diagnosis import Record, diagnose_records
    from dtbacklash.physics.rig import build_rig
    from dtbacklash.physics.simulate import simulate

    for number, more in enumerate(([], ["rig.effects.motor_bearing.coulomb_friction.torque=0.01"])):
        if code := cli.main(["run", *RUN, f"out=warm{number}", *more]):
            raise SystemExit(code)
    rig, rng = build_rig(compose("controller=open_loop", "rig=lead_screw").rig), np.random.default_rng(0)
    u = np.repeat(rng.uniform(-3.0, 3.0, 40), 100)
    seen = {name: values for name, values in simulate(rig, u, 1e-3).sensors.items() if name in ("theta_m", "q3")}
    measured = {name: v + 1e-4 * np.ptp(v) * rng.standard_normal(v.size) for name, v in seen.items()}
    train = np.arange(u.size + 1) < 2800
    diagnose_records(rig, [Record(1e-3, np.append(u, u[-1]), measured, train, ~train)])


if __name__ == "__main__":
    main()
