"""A stand-in for the simulation, so that the tests of the command line are quick; the real command; a network."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import network
import numpy as np
import pandas as pd
import pytest
from hydra.core.global_hydra import GlobalHydra
from network import Broker, Puppet, Served
from told import without_progress

from dtbacklash import cli
from dtbacklash.experiment import signals
from dtbacklash.experiment.metrics import move_table
from dtbacklash.experiment.result import RunResult

FOLDER = os.environ.get("DTB_RECORDINGS", "")
#: beside the repository, where a shared folder of recordings may lie
NEIGHBOUR = Path(__file__).resolve().parents[3] / "shared" / "recordings"

SENSORS = ("theta_m", "q3")
SIGNALS = [
    {"signal": "u", "column": "u_v", "unit": "V", "of": "", "quantity": "command",
     "lowest": -1.0, "highest": 1.0, "rms": 0.5},
]  # fmt: skip


def pretend(config, progress=None):
    """Return a result of the right form, without simulating."""
    t_s = np.arange(config.samples + 1) * config.sample_time_s
    r_mm = signals.reference(config.reference, t_s, config.seed)
    gap = signals.gap_profile(config.profile, t_s)
    names = [
        "t_s", "r_mm", "q3_mm", "u_v", "theta_m_rad", "theta_d_rad", "gap_deg", "gap_hat_deg", "eps_mm", "novelty_mm",
    ]  # fmt: skip
    columns = [t_s, r_mm, r_mm, r_mm, r_mm, r_mm, gap, gap, 0 * gap, 0 * gap]
    heads = [
        "t_event_s", "t_applied_s", "gap_deg", "true_gap_deg", "accepted", "reason", "cost", "evaluations", "wall_s",
    ]  # fmt: skip
    summary = {
        "controller": config.controller.name, "n_moves": 1, "n_estimations": 0, "n_attempts": 0,
        "n_accepted": 0, "settles": True, "advice": [], "tracking_rms_mm": 0.0, "signals": SIGNALS,
        "overshoot_pct_max": np.float64(config.twin.delay_s), "settling_time_s_max": float("nan"),
        "peak_voltage_v": 4.5, "moves": [], "estimates": [], "seconds_simulated": config.duration_s,
        "wall_s": {"simulate": 0.0, "estimate": 0.0, "total": 0.0},
    }  # fmt: skip
    trace = pd.DataFrame(dict(zip(names, columns, strict=True)))
    sensors = {name: SimpleNamespace(name=name, unit="m", per_si=1.0) for name in SENSORS}
    rig = SimpleNamespace(
        config=config.rig, sensors=sensors, reference_per_si=lambda: 1.0, command_unit="V", only=sensors.get
    )
    seen = dict.fromkeys(("r", "u", *SENSORS), 1e-3 * r_mm)
    own = {name: name for name in ("u_v", "theta_m_rad", "q3_mm")}
    return RunResult(config, rig, trace, seen, move_table(trace), pd.DataFrame(columns=heads), summary, own=own)


@pytest.fixture
def public(monkeypatch):
    """Use the folder of public recordings, or skip."""
    folder = Path(FOLDER) if FOLDER else NEIGHBOUR
    if not (folder / "emps").is_dir():
        pytest.skip("the public recordings are not at hand: set DTB_RECORDINGS to their folder")
    monkeypatch.setenv("DTB_RECORDINGS", str(folder))
    return folder


@pytest.fixture
def scenario(monkeypatch):
    """The module that the command calls; a test may replace its ``run_scenario``."""
    module = SimpleNamespace(run_scenario=pretend)
    monkeypatch.setitem(sys.modules, "dtbacklash.experiment.run", module)
    monkeypatch.setattr("dtbacklash.experiment.run", module, raising=False)
    return module


@pytest.fixture
def typed(tmp_path, monkeypatch, capsys):
    """Run ``dtb`` here, in an empty folder: words -> (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)

    def call(*words):
        GlobalHydra.instance().clear()
        code = cli.main([str(word) for word in words])
        out, err = capsys.readouterr()
        return code, out, without_progress(err)

    yield call
    GlobalHydra.instance().clear()


@pytest.fixture
def dtb(typed, scenario):
    """The same with the stand-in."""
    return typed


@pytest.fixture
def process(tmp_path):
    """Run ``dtb`` as a process with the real simulation: words -> CompletedProcess."""

    def call(*words, timeout=300, **extra):
        command = [sys.executable, "-m", "dtbacklash.cli", *map(str, words)]
        options = {"cwd": tmp_path, "capture_output": True, "text": True, "timeout": timeout, "env": os.environ | extra}
        done = subprocess.run(command, check=False, **options)
        done.stderr = without_progress(done.stderr)
        return done

    return call


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Ctrl-C reaches the commands that a test starts, also where the suite runs in the background and ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def files():
    """List the files below a folder, hidden ones too."""
    return lambda folder: sorted(str(path.relative_to(folder)) for path in Path(folder).rglob("*") if path.is_file())


@pytest.fixture(scope="module")
def broker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Broker]:
    """A real broker, of a file's own: no twin of another file is heard."""
    one = Broker(tmp_path_factory.mktemp("broker")).start()
    yield one
    one.stop()


@pytest.fixture(scope="module")
def served(broker: Broker, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A real ``dtb twin serve`` at the broker."""
    one = Served(broker, folder=tmp_path_factory.mktemp("serve")).ready()
    yield one
    one.end()


@pytest.fixture
def puppet(broker: Broker) -> Iterator[Callable[..., Puppet]]:
    """Start twins that do as they are told."""
    there: list[Puppet] = []

    def start(play: network.Play | None = None, at: Broker | None = None, address: str = "") -> Puppet:
        there.append(Puppet(at or broker, play, address))
        return there[-1]

    yield start
    for one in there:
        one.close()


@pytest.fixture(scope="session")
def plain() -> RunResult:
    """The network's scenario with a twin in the same process: three estimates, all accepted."""
    result = network.local()
    assert list(result.estimates["accepted"]) == [True] * 3
    return result
