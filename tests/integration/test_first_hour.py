"""What a lab's logs of one machine lead to: a table of kinds, each with its verdict and the words that a user needs.

The machine is a rotor on a torque motor with viscous and Coulomb friction that its rig knows: nothing is missing.
"""

from collections.abc import Callable
from pathlib import Path
from textwrap import dedent

import machines
import numpy as np
import pandas as pd
import pytest

import dtbacklash as dtb

pytestmark = pytest.mark.check

STEP_S, EVERY, COUNT = 5e-3, 5, 2.0 * np.pi / 4096
RIG = """
    name: arm
    parameters: {k_t: {value: 0.3 N m/V, tolerance: 0.02}}
    elements:
      amplifier: {kind: amplifier, drives: motor}
      motor: {kind: actuator, gain: k_t, drives: disk}
      disk: {kind: rotor, inertia: 0.02 kg m^2}
    effects:
      disk: {viscous_friction: {coefficient: 0.05}, coulomb_friction: {torque: {value: 0.03, tolerance: 0.2}}}
    sensors: {theta: {of: disk, quantity: position}}
    """


def made(duration_s: float = 20.0, hold: int = 1, seed: int = 0, late: int = 0) -> pd.DataFrame:
    """The machine under a command of steps and slow sines that is held for ``hold`` samples, read in counts.

    late : by so many ms the angle is read after the command was given.
    """
    t = STEP_S * np.arange(round(duration_s / STEP_S))
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-0.7, 0.7, len(t) // 97 + 1), 97)[: len(t)] + 0.4 * np.sin(3.0 * t)
    u = np.repeat(u[::hold], hold)[: len(t)]
    machine = machines.Machine((0.02,), gain=0.3, coulomb=0.03, viscous=0.05)
    theta = machines.record(machine, np.repeat(u, EVERY))[0][late::EVERY, 0]
    return pd.DataFrame({"t": t, "u": u, "theta": COUNT * np.round(theta / COUNT)})


def on_a_bus(frame: pd.DataFrame, every: int) -> pd.DataFrame:
    """Rows of their own for the command, one of ``every``, and for the sensor."""
    sent = frame[["t", "u"]][::every]
    return pd.concat([sent, frame[["t", "theta"]].assign(t=frame.t + 1e-3)]).sort_values("t")


def short(folder: Path) -> list[Path]:
    text = made(3.0).to_csv(index=False).replace("theta", "theta,comment")
    (folder / "short.csv").write_text(text)
    return [folder / "short.csv"]


def written(change: Callable[[pd.DataFrame], pd.DataFrame], **how: int) -> Callable[[Path], list[Path]]:
    def write(folder: Path) -> list[Path]:
        change(made(**how)).to_csv(folder / "log.csv", index=False)
        return [folder / "log.csv"]

    return write


def twice(folder: Path) -> list[Path]:
    for k in range(2):
        made(10.0, seed=k).to_csv(folder / f"{k}.csv", index=False)
    return [folder / "0.csv", folder / "1.csv"]


#: kind -> how it is written, the verdict, what is said, what is not
KINDS = {
    "short, with a name too many": (short, "consistent", ("3 s are short", "comment"), ()),
    "a sensor that repeats its readings": (
        written(lambda f: f.assign(theta=f.theta[::10].repeat(10).to_numpy())), "consistent",
        ("it is read at one of 10",), ("are short",)),
    "a command of which one value of four is logged": (
        written(lambda f: on_a_bus(f, 4), late=1), "consistent",
        ("what the command may have done between its logged values", "Log the command whenever it changes"), ()),
    "a command that is logged whenever it changes": (
        written(lambda f: on_a_bus(f, 4), hold=4, late=1), "consistent", ("held until the next value",),
        ("between its logged values",)),
    "a command that idles": (
        written(lambda f: f.assign(u=0.0)), "unexplained",
        ("u is 0 from beginning to end", "recording.command=none", "theta moves while the command is constant"), ()),
    "two recordings": (twice, "consistent", ("Nothing is ambiguous in these recordings",), ("a second recording",)),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_has_its_verdict_and_names_nothing(kind, tmp_path):
    write, verdict, words, never = KINDS[kind]
    (tmp_path / "rig.yaml").write_text(dedent(RIG))
    found = dtb.diagnose([str(file) for file in write(tmp_path)], str(tmp_path / "rig.yaml"))
    assert (found.verdict, list(found.findings.effect)) == (verdict, [])
    said = " ".join([*str(found).split(), *found.diagnosis.notes, found.diagnosis.next_experiment])
    assert [word for word in words if word not in said] == []
    assert [word for word in never if word in said] == []
