"""``dtb twin`` from the command line: the three terminals of the docs, one-line errors, the help."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import network
import pandas as pd
import pytest
from network import wait_for

from dtbacklash import cli
from dtbacklash.config.compose import compose
from dtbacklash.config.twin import EXAMPLE


@pytest.mark.usefixtures("interruptible")
@pytest.mark.check
def test_the_three_terminals_of_the_docs_reproduce_figure_13(tmp_path: Path) -> None:
    """``dtb twin broker``, ``dtb twin serve``, ``dtb run``, as they stand in the docs but for the port."""
    network.need_mosquitto()
    text = (Path(__file__).parents[2] / "docs" / "remote.md").read_text(encoding="utf-8")
    assert all(line in text for line in EXAMPLE)
    port = network.free_port()
    added = (
        [f"port={port}"], [f"broker=127.0.0.1:{port}"], [f"twin.broker=127.0.0.1:{port}", "figures=false", "out=run"],
    )  # fmt: skip
    head = [sys.executable, "-m", "dtbacklash.cli"]
    terminals = [[*head, *line.split()[1:], *more] for line, more in zip(EXAMPLE, added, strict=True)]
    running: list[subprocess.Popen[str]] = []
    logs = [tmp_path / f"{name}.log" for name in ("broker", "serve")]
    try:
        for words, log, sign in zip(terminals, logs, ("Mosquitto on", "connected to the broker"), strict=False):
            with log.open("w") as out:
                running.append(subprocess.Popen(words, cwd=tmp_path, stdout=out, stderr=subprocess.STDOUT, text=True))
            wait_for(lambda log=log, sign=sign: sign in log.read_text(), 300)
        subprocess.run(terminals[2], cwd=tmp_path, check=True, timeout=300, capture_output=True)
    finally:
        codes = []
        for one in reversed(running):
            one.send_signal(signal.SIGINT)
            codes.append(one.wait(20))
    assert codes == [0, 0]
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
        (["access", "machines=[a b]"], "machines=a b: letters, digits, - and _"),
        (["access", "machines=[twin]"], "machines=twin: another name"),
        (["access", "machines=[a,a]"], "machines=a,a: names, each once"),
        (["access", "out=."], "out=.: is there"),
        (["broker", "access=."], "access=.: a folder of dtb twin access"),
        (["broke"], "twin=broke: choose one of serve, status, broker, access, describe"),
    ],
)
def test_a_mistake_is_one_line(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    network.need_mosquitto()
    monkeypatch.chdir(tmp_path)
    if "broker=host:port" in words:
        monkeypatch.setenv("DTB_TWIN_KEY", 64 * "a")
    if words[0] == "broker":
        words = [*words, f"port={network.free_port()}"]
    assert cli.main(["twin", *words]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_the_help_says_what_there_is_and_loads_nothing_heavy() -> None:
    code = "from dtbacklash import cli; cli.main(['twin', 'serve', '--help']); cli.main(['twin']); import sys; "
    code += "print(sorted({'numpy', 'hydra', 'paho', 'rich'} & set(sys.modules)))"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60).stdout
    assert "workers=1" in said
    assert all(line in said for line in EXAMPLE)
    assert said.splitlines()[-1] == "[]"


@pytest.mark.skipif(sys.platform != "linux", reason="prctl")
@pytest.mark.check
def test_a_broker_that_is_killed_hard_leaves_no_mosquitto(tmp_path: Path) -> None:
    network.need_mosquitto()
    words = [sys.executable, "-m", "dtbacklash.cli", "twin", "broker", f"port={network.free_port()}"]
    with (tmp_path / "log").open("w") as out:
        ours = subprocess.Popen(words, cwd=tmp_path, stdout=out, stderr=subprocess.STDOUT)
    try:
        wait_for(lambda: "Mosquitto on" in (tmp_path / "log").read_text() and network.children(ours.pid, "mosquitto"))
        (theirs,) = network.children(ours.pid, "mosquitto")
    finally:
        ours.kill()
        ours.wait(10)
    stat = Path(f"/proc/{theirs}/stat")
    wait_for(lambda: not stat.exists() or stat.read_text().rsplit(")", 1)[1].split()[0] == "Z", 10)


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
