"""``dtb twin`` from the command line: the three terminals of the docs, one-line errors, the help."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import network
import pandas as pd
import pytest
from network import wait_for
from told import refusal

from dtbacklash.config.compose import compose
from dtbacklash.config.twin import EXAMPLE


@pytest.mark.usefixtures("interruptible")
@pytest.mark.check
def test_the_three_terminals_of_the_docs_reproduce_figure_13(tmp_path: Path) -> None:
    """``mosquitto``, ``dtb twin serve``, ``dtb run``, as they stand in the docs but for the port."""
    broker = network.Broker(tmp_path, machines=["machine"])
    text = (Path(__file__).parents[2] / "docs" / "remote.md").read_text(encoding="utf-8")
    assert all(line in text for line in EXAMPLE)
    added = [f"broker={broker.address}"], [f"twin.broker={broker.address}", "figures=false", "out=run"]
    head = [sys.executable, "-m", "dtbacklash.cli"]
    serve, run = ([*head, *line.split()[1:], *more] for line, more in zip(EXAMPLE[1:], added, strict=True))
    log = tmp_path / "serve.log"
    broker.start()
    with log.open("w") as out:
        serving = subprocess.Popen(serve, cwd=tmp_path, stdout=out, stderr=subprocess.STDOUT, text=True)
    try:
        wait_for(lambda: "connected to the broker" in log.read_text(), 300)
        subprocess.run(run, cwd=tmp_path, check=True, timeout=300, capture_output=True)
    finally:
        serving.send_signal(signal.SIGINT)
        code = serving.wait(20)
        broker.stop()
    assert code == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["remote"]["answered"] == summary["n_estimations"] == summary["n_accepted"] == 9
    local = network.run(compose("experiment=fig13", "figures=false"))
    trace = pd.read_parquet(tmp_path / "run" / "trace.parquet")
    pd.testing.assert_frame_equal(trace, local.trace, check_exact=True)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["serve", "workers=0"], "workers=0: must be at least 1"),
        (["serve", "worker=2"], "worker=2: no such setting; did you mean workers?"),
        (["serve", "workers=2", "workers=3"], "workers=3: is given twice"),
        (["serve", "workers=two"], "workers=two: must be a whole number"),
        (["serve", "2"], "argument=2: write key=value"),
        (["serve", "credentials="], "credentials=null: no key in it nor in $DTB_TWIN_KEY"),
        (["serve", "credentials=nowhere.yaml"], "credentials=nowhere.yaml: cannot be read: no such file or directory"),
        (["serve", "broker=host:port"], "broker=host:port: host:port, e.g. 127.0.0.1:1883"),
        (["status", "wait_s=-1"], "wait_s=-1.0: must be positive"),
        (["broke"], "twin=broke: choose one of serve, status, describe"),
    ],
)
def test_a_mistake_is_one_line(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    if "broker=host:port" in words:
        monkeypatch.setenv("DTB_TWIN_KEY", 64 * "a")
    assert said in refusal(capsys, "twin", *words)
    assert not list(tmp_path.iterdir())


def test_the_help_says_what_there_is_and_loads_nothing_heavy() -> None:
    code = "from dtbacklash import cli; cli.main(['twin', 'serve', '--help']); cli.main(['twin']); import sys; "
    code += "print(sorted({'numpy', 'hydra', 'paho', 'rich'} & set(sys.modules)))"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60).stdout
    assert "workers=1" in said
    assert all(line in said for line in EXAMPLE)
    assert said.splitlines()[-1] == "[]"


@pytest.mark.check
def test_a_run_that_no_twin_answers_ends_with_code_1_and_its_files(tmp_path: Path) -> None:
    """No broker, or a broker and no twin: the loop goes on, all is written, and it is said."""
    credentials = tmp_path / "machine.yaml"
    credentials.write_text("user: machine\npassword: x\nkey: machine:" + 64 * "a" + "\n")
    credentials.chmod(0o600)
    there = [f"twin.broker=127.0.0.1:{network.free_port()}", "twin.timeout_s=0.5", f"twin.credentials={credentials}"]
    words = ["run", *network.SCENARIO, "twin=remote", *there, "out=run"]
    done = subprocess.run(
        [sys.executable, "-m", "dtbacklash.cli", *words], cwd=tmp_path, capture_output=True, text=True, timeout=300,
        check=False,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "dtb: the twin has answered none of the requests" in done.stderr
    assert "0 of 3 requests answered" in done.stdout
    assert (tmp_path / "run" / "summary.json").exists()
