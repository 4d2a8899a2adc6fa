"""The twin over a network, with a real broker and a real ``dtb twin serve``: same answers, status, metrics, an end."""

import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import network
import pytest
from network import Broker, Served, wait_for

from dtbacklash.config.compose import compose
from dtbacklash.errors import UserError
from dtbacklash.experiment.run import run_scenario
from dtbacklash.remote.belief import described

pytestmark = pytest.mark.check


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("controller=nimc_novelty", "twin.delay_s=0.5"),
        pytest.param(("optimizer=differential_evolution", "seed=7", "sensors=encoder"), marks=pytest.mark.nightly),
        ("twin.guard=false",),
        ("model=lead_screw", "model.effects.link_1.cubic_stiffness.k3=2e9", "sensors=encoder"),
    ],
    ids=["plain", "novelty", "lots", "unguarded", "simulated"],
)
def test_local_and_remote_are_the_same_to_the_last_bit(broker: Broker, served: Served, words: tuple[str, ...]) -> None:
    remote = network.run(broker.config(*words))
    plain = network.local(*words)
    network.same(plain, remote)
    said = remote.summary["remote"]
    assert said["requests"] == said["answered"] == plain.summary["n_estimations"] > 0
    assert said["dropped"] == said["unanswered"] == {}
    assert remote.summary["n_attempts"] == plain.summary["n_attempts"]


def test_the_status_says_what_has_happened(broker: Broker, served: Served, capsys: object) -> None:
    """After a run: its machine with three estimates; nothing waits."""
    before = network.status(broker).get("twin", {}).get("machines", {}).get("lathe", {}).get("answered", 0)
    network.run(broker.config(machine="lathe"))
    status = network.settled_status(broker, lambda s: s["machines"].get("lathe", {}).get("answered", 0) == before + 3)
    assert status["online"]
    assert (status["busy"], status["queue"], status["workers"]) == (0, 0, 1)
    lathe = status["machines"]["lathe"]
    assert lathe["requests"] == lathe["answered"] == lathe["accepted"]
    assert lathe["last"]["gap_deg"] == pytest.approx(40.0, abs=0.2)
    command = [sys.executable, "-m", "dtbacklash.cli", "twin", "status", f"broker={broker.address}",
               f"credentials={broker.of('monitor')}", "wait_s=0.3"]  # fmt: skip
    table = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout
    assert "twin: online" in table
    assert next(line for line in table.splitlines() if line.startswith("lathe")).split("|")[2].strip() == str(
        before + 3
    )


def test_sigterm_ends_the_twin_and_it_says_that_it_is_gone(broker: Broker, tmp_path: Path) -> None:
    one = Served(broker, "name=second", folder=tmp_path).ready()
    wait_for(lambda: network.status(broker).get("second", {}).get("online"))
    assert one.end() == 0  # within 20 s
    assert "twin second: ended" in one.text()
    assert not network.status(broker)["second"]["online"]


def test_a_config_for_a_remote_twin_is_refused_where_none_can_be(broker: Broker) -> None:
    with pytest.raises(UserError, match=r"twin\.where=remote: a twin elsewhere is for dtb run"):
        run_scenario(broker.config())
    with pytest.raises(UserError, match=r"twin\.where=remote: closing the loop"):
        compose("experiment=close_the_loop", "twin=remote")
    with pytest.raises(UserError, match=r"no key in it nor in \$DTB_TWIN_KEY"):
        config = broker.config()
        config.twin.credentials = None
        network.run(config)
    config = broker.config()
    config.twin.machine = "lathe"
    with pytest.raises(UserError, match="is that of press; needed is that of lathe"):
        config.twin.credentials = broker.of("press")
        network.run(config)
    config = broker.config("duration_s=400", "twin.buffer=300000")
    with pytest.raises(UserError, match=r"twin\.buffer=300000: must be at most \d+ samples with a remote twin"):
        network.run(config)


def test_a_process_of_the_twin_that_ends_is_replaced(broker: Broker, served: Served) -> None:
    for pid in network.children(served.process.pid, "spawn_main"):
        os.kill(pid, signal.SIGKILL)
    result = network.run(broker.config())
    assert result.summary["remote"]["answered"] == 3
    assert network.children(served.process.pid, "spawn_main")


def test_another_model_comes_over_the_network_too(broker: Broker, served: Served) -> None:
    """The bank: what has changed, and the model that is believed from then on; the same run as in its own process."""
    words = (
        "experiment=aging", "profile=constant", "profile.start_deg=20", "profile.end_deg=20", "figures=false",
        "controller.gap_hat_deg=20", "reference.period_s=32", "changes=[{at_s:10,parameters:{k:7000}}]",
        "duration_s=24", "twin.indexes=[frequency,structure]",
    )  # fmt: skip
    plain, config = network.run(compose(*words)), compose(*words)
    there = broker.config().twin
    config.twin = replace(
        config.twin, where="remote", broker=there.broker, machine=there.machine, credentials=there.credentials,
        timeout_s=60.0,
    )  # fmt: skip
    assert plain.estimates["found"].iloc[0] == "k: k -30 %"
    network.same(plain, network.run(config))


def test_the_client_of_the_docs_in_another_language(broker: Broker, served: Served, tmp_path: Path) -> None:
    """The JavaScript of ``docs/remote.md`` gets the gap that a run would put in force, and tells a refusal."""
    node = shutil.which("node")
    folders = os.environ.get("NODE_PATH", "") + ":/usr/share/nodejs:/usr/lib/nodejs"
    if node is None or not any(Path(folder, "mqtt").is_dir() for folder in folders.split(":") if folder):
        pytest.skip("Node.js with its package mqtt is not installed (apt install node-mqtt)")
    page = (Path(__file__).parents[2] / "docs" / "remote.md").read_text(encoding="utf-8")
    program = page.split("```js\n")[1].split("```")[0]
    assert len(program.splitlines()) <= 32
    (tmp_path / "gateway.js").write_text(program)
    result = network.local()
    buffer = result.trace.iloc[10_000:11_000]
    columns = {"theta_m_rad": buffer["theta_m_rad"].tolist(), "q3_m": result.seen["q3"][10_000:11_000].tolist()}
    belief = described(compose(*network.scenario()))
    (tmp_path / "buffer.json").write_text(json.dumps(columns))

    def ask(belief: dict[str, Any]) -> str:
        (tmp_path / "belief.json").write_text(json.dumps(belief))
        command = [node, "gateway.js", broker.address, broker.of("press"), "press", "belief.json", "buffer.json"]
        done = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=30,
            env=os.environ | {"NODE_PATH": folders},
        )  # fmt: skip
        return done.stdout.strip()

    assert float(ask(belief)) == pytest.approx(result.estimates["applied_deg"].iloc[0], rel=1e-12)
    belief["twin"]["settle"] = 5000
    assert ask(belief) == "twin.settle=5000: must be below twin.buffer=1000 samples"


def test_in_real_time_the_loop_does_not_wait_for_the_network(broker: Broker, served: Served) -> None:
    """``pace=real``: the answer comes into force when it is there, some samples after the buffer was full."""
    result = network.run(broker.config("pace=real", "duration_s=4", "reference.period_s=4", "twin.delay_s=0"))
    first = result.estimates.iloc[0]
    assert first["accepted"]
    assert 3.0 < first["t_applied_s"] < 4.0
    assert result.trace.query("gap_hat_deg > 0")["t_s"].min() == pytest.approx(first["t_applied_s"])
    pace = result.summary["pace"]
    assert pace["deadlines"] == 4001
    assert pace["median_ms"] < 1.0
