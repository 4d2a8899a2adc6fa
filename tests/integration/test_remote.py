"""The twin over a network, with a real broker and a real ``dtb twin serve``: same answers, status, metrics, access."""

from __future__ import annotations

import datetime
import ipaddress
import json
import os
import shutil
import signal
import stat
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import network
import numpy as np
import pandas as pd
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from network import Broker, Served, wait_for

from dtbacklash import cli
from dtbacklash.config.compose import compose
from dtbacklash.config.twin import EXAMPLE, StatusConfig
from dtbacklash.errors import UserError
from dtbacklash.experiment.run import run_scenario
from dtbacklash.remote.belief import described
from dtbacklash.remote.connection import Connection
from dtbacklash.remote.credentials import load_credentials
from dtbacklash.remote.messages import RequestMessage, Ticket
from dtbacklash.remote.status import heard
from dtbacklash.remote.topics import answer_topic, request_topic
from dtbacklash.twin.service import Request


@pytest.fixture(scope="module")
def broker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Broker]:
    one = Broker(tmp_path_factory.mktemp("broker")).start()
    yield one
    one.stop()


METRICS = network.free_port()


@pytest.fixture(scope="module")
def served(broker: Broker, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    one = Served(broker, f"metrics_port={METRICS}", folder=tmp_path_factory.mktemp("serve")).ready()
    yield one
    one.end()


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("controller=nimc_novelty", "twin.delay_s=0.5"),
        ("optimizer=differential_evolution", "seed=7", "sensors=encoder"),
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


def _status(broker: Broker) -> dict[str, dict[str, Any]]:
    found, rejected = heard(StatusConfig(broker.address, broker.of("monitor"), wait_s=0.2))
    assert rejected == {}
    return found


def _settled_status(broker: Broker, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The twin's status once something holds in it."""
    found: list[dict] = []

    def there() -> bool:
        one = _status(broker).get("twin")
        found[:] = [one] if one else []
        return bool(one and holds(one))

    wait_for(there, 20)
    return found[0]


def test_the_status_and_the_metrics_say_what_has_happened(broker: Broker, served: Served, capsys: object) -> None:
    """After a run: its machine with three estimates; nothing waits; the port is on this machine only."""
    before = _status(broker).get("twin", {}).get("machines", {}).get("lathe", {}).get("answered", 0)
    network.run(broker.config(machine="lathe"))
    status = _settled_status(broker, lambda s: s["machines"].get("lathe", {}).get("answered", 0) == before + 3)
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
    with urllib.request.urlopen(f"http://127.0.0.1:{METRICS}/metrics", timeout=10) as page:
        metrics = page.read().decode()
    assert f'dtb_twin_answered_total{{machine="lathe"}} {before + 3}.0' in metrics
    assert f"dtb_twin_delay_seconds_count {sum(m['answered'] for m in status['machines'].values())}.0" in metrics


def _request(broker: Broker, machine: str = "press") -> RequestMessage:
    """A request of a run of its own."""
    theta_m = np.sin(0.005 * np.arange(1000.0))
    request = Request(0, 0, theta_m, 2e-4 * theta_m, 0.0, 0)
    run = f"{time.monotonic_ns():032x}"
    return RequestMessage(machine, Ticket(run, 1), 60.0, request, described(broker.config(machine=machine)))


class _Talker:
    """A client with a machine's credentials that sends anything, and keeps what it hears."""

    def __init__(self, broker: Broker, user: str, machine: str, topics: list[str]) -> None:
        credentials = load_credentials(broker.of(user), "credentials")
        self.key = load_credentials(broker.of("twin"), "credentials").needed_key("credentials").of_machine(machine)
        self.heard: list[tuple[str, bytes]] = []
        self.refused: dict[int, str] = {}
        self.connection = Connection(
            broker.address, credentials, topics, lambda t, p, s: self.heard.append((t, p)), "talker",
            published=self.refused.__setitem__,
        )  # fmt: skip
        self.connection.open()
        wait_for(self.connection.connected.is_set)
        time.sleep(0.1)

    def say(self, topic: str, payload: bytes, signed: bool = True) -> str:
        """Publish; what the broker has against it."""
        if signed:
            mid = self.connection.publish(topic, payload, self.key)
        else:
            mid = self.connection._client.publish(topic, payload, qos=1).mid
        wait_for(lambda: mid in self.refused)
        return self.refused[mid]


def test_hostile_requests_do_not_disturb_the_twin(broker: Broker, served: Served) -> None:
    """They are counted by what is wrong with them, and the next request is answered."""
    before = _settled_status(broker, lambda s: s["online"])["rejected"]
    message = _request(broker)
    talker = _Talker(broker, "press", "press", [answer_topic("press")])
    topic, good = request_topic("press"), message.dumped()

    def other(**changes: object) -> bytes:
        return json.dumps(json.loads(good) | changes).encode()

    hostile = {
        "malformed": [
            b"", b"{", other(q3_m=[1.0, float("nan")] * 500), other(q3_m=[1.0] * 999), other(q3_m=["1"] * 1000),
            other(theta_m_rad="AAAA" * 100 + "A==="), other(event=-1), other(present_rad=-0.1), other(belief={}),
            other(machine="lathe"), 100_000 * b'{"a":', other(timeout_s=1e308 * 10),
        ],
        "wrong version": [other(version=2), other(version="1"), other(version=True)],
        "too large": [good[:-1] + b',"more":"' + bytes(4_100_000).replace(b"\0", b"x") + b'"}'],
    }  # fmt: skip
    for payloads in hostile.values():
        for payload in payloads:
            assert talker.say(topic, payload) == ""
    assert talker.say(topic, good, signed=False) == ""
    assert talker.say(topic, good) == ""
    assert talker.say(topic, good) == ""  # once more, as it was
    expected = {reason: len(payloads) for reason, payloads in hostile.items()} | {"wrong signature": 1, "replayed": 1}
    wait_for(lambda: len(talker.heard) == 1)
    after = _settled_status(broker, lambda s: s["rejected"].get("replayed", 0) > before.get("replayed", 0))["rejected"]
    assert {reason: n - before.get(reason, 0) for reason, n in after.items()} == expected
    talker.connection.close()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda b: b["rig"]["parameters"]["m"].update(value=-1.0), "above 0"),
        (lambda b: b["twin"].update(no_such_setting=1), "no such setting here"),
        (lambda b: b["twin"].update(settle="400"), "must be a value like"),
        (lambda b: b["optimizer"].update(name="magic"), "choose one of"),
        (lambda b: b.update(output="theta_x"), "a sensor of the rig"),
        (lambda b: b["rig"]["elements"].clear(), ""),
        (lambda b: b["rig"].update(elements={"a": 5}), "a mapping with at least"),
        (lambda b: b["twin"].update(observer_pole_rad_s=0), "positive"),
    ],
)
def test_a_belief_that_makes_no_sense_is_refused_with_a_reason(
    broker: Broker, served: Served, change: Callable[[dict[str, Any]], None], reason: str
) -> None:
    message = _request(broker)
    belief = json.loads(json.dumps(message.belief))
    change(belief)
    talker = _Talker(broker, "press", "press", [answer_topic("press")])
    fresh = replace(message, belief=belief, ticket=Ticket(f"{time.monotonic_ns():032x}", 1))
    talker.say(request_topic("press"), fresh.dumped())
    wait_for(lambda: talker.heard)
    answer = json.loads(talker.heard[0][1])
    assert answer["status"] == "refused"
    assert reason in answer["reason"]
    talker.connection.close()


def test_beyond_capacity_the_oldest_buffer_of_a_machine_is_dropped_and_it_is_told(
    broker: Broker, served: Served
) -> None:
    """One machine asks twelve times at once, another once: that one waits for its turn only, not for the twelve."""
    message = _request(broker)
    press = _Talker(broker, "press", "press", [answer_topic("press")])
    lathe = _Talker(broker, "lathe", "lathe", [answer_topic("lathe")])
    run = f"{time.monotonic_ns():032x}"
    slow = json.loads(json.dumps(message.belief))
    slow["optimizer"] = {"name": "dual_annealing", "max_evaluations": 20000, "tolerance": 1e-6}
    for counter in range(1, 13):
        one = replace(message, belief=slow, ticket=Ticket(run, counter))
        press.connection.publish(request_topic("press"), one.dumped(), press.key)
    mine = replace(message, machine="lathe", ticket=Ticket(run, 1))
    lathe.connection.publish(request_topic("lathe"), mine.dumped(), lathe.key)
    wait_for(lambda: len(press.heard) == 12 and lathe.heard)
    answers = {json.loads(p)["request"]["counter"]: json.loads(p) for _, p in press.heard}
    dropped = [n for n, one in answers.items() if one.get("reason") == "dropped: the twin is busy"]
    assert len(dropped) >= 8
    assert not set(dropped) & {11, 12}  # the newest ones are kept
    assert json.loads(lathe.heard[0][1])["status"] == "answered"
    for one in (press, lathe):
        one.connection.close()


def test_the_access_rules_hold(broker: Broker, served: Served) -> None:
    """A machine can neither answer nor ask as another nor hear it; the monitor can say nothing."""
    puppet_topic = answer_topic("press")
    talker = _Talker(
        broker, "press", "press", [answer_topic("lathe"), request_topic("lathe"), "dtbacklash/#", "$SYS/#"]
    )
    for topic in (puppet_topic, request_topic("lathe"), answer_topic("lathe"), "dtbacklash/twin/twin/status"):
        assert talker.say(topic, b"x") == "not authorized"
    monitor = _Talker(broker, "monitor", "press", ["dtbacklash/#"])
    for topic in (puppet_topic, request_topic("press"), "dtbacklash/twin/twin/status"):
        assert monitor.say(topic, b"x") == "not authorized"
    network.run(broker.config(machine="lathe"))
    time.sleep(0.3)
    assert {topic for topic, _ in talker.heard} <= {puppet_topic}
    assert {topic.split("/")[1] for topic, _ in monitor.heard} <= {"twin"}
    for one in (talker, monitor):
        one.connection.close()


def test_no_key_and_no_password_is_ever_written(broker: Broker, served: Served, tmp_path: Path) -> None:
    """Neither in the files of a run, nor in what is printed, nor in the twin's log."""
    secrets = [word for file in broker.folder.glob("*.yaml") for word in file.read_text().split() if len(word) > 30]
    assert len(secrets) == 2 * len(list(broker.folder.glob("*.yaml")))
    there = [
        "twin=remote",
        f"twin.broker={broker.address}",
        "twin.machine=press",
        f"twin.credentials={broker.of('press')}",
    ]
    command = [sys.executable, "-m", "dtbacklash.cli", "run", "-v", *there, *network.SCENARIO, "out=run"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=120)
    assert "3 of 3 estimates accepted" in done.stdout
    assert "3 of 3 requests answered" in done.stdout
    texts = [done.stdout, done.stderr, served.text()]
    texts += [file.read_bytes().decode("latin-1") for file in (tmp_path / "run").rglob("*") if file.is_file()]
    for secret in secrets:
        for part in {secret, secret.split(":")[-1]}:
            assert not any(part in text for text in texts)
    for name in ("twin.yaml", "press.yaml", "passwords"):
        assert stat.S_IMODE((broker.folder / name).stat().st_mode) == 0o600


def test_sigterm_ends_the_twin_and_it_says_that_it_is_gone(broker: Broker, tmp_path: Path) -> None:
    one = Served(broker, "name=second", folder=tmp_path).ready()
    wait_for(lambda: _status(broker).get("second", {}).get("online"))
    began = time.monotonic()
    assert one.end() == 0
    assert time.monotonic() - began < 10.0
    assert "twin second: ended" in one.text()
    assert not _status(broker)["second"]["online"]


def test_the_three_terminals_of_the_docs_reproduce_figure_13(tmp_path: Path) -> None:
    """``dtb twin broker``, ``dtb twin serve``, ``dtb run``, as they stand in the docs but for the port."""
    network.need_mosquitto()
    for page in ("README.md", "docs/remote.md"):
        text = (Path(__file__).parents[2] / page).read_text(encoding="utf-8")
        assert all(line in text for line in EXAMPLE)
    port = network.free_port()
    added = (
        [f"port={port}"],
        [f"broker=127.0.0.1:{port}"],
        [f"twin.broker=127.0.0.1:{port}", "figures=false", "out=run"],
    )
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
        "duration_s=40", "twin.indexes=[frequency,structure]",
    )  # fmt: skip
    plain, config = network.run(compose(*words)), compose(*words)
    there = broker.config().twin
    config.twin = replace(
        config.twin, where="remote", broker=there.broker, machine=there.machine, credentials=there.credentials,
        timeout_s=60.0,
    )  # fmt: skip
    assert plain.estimates["found"].iloc[0].startswith("stiffness all links")
    network.same(plain, network.run(config))


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


def _certificates(folder: Path) -> None:
    """A CA, and by it a certificate of the broker at 127.0.0.1 and one of a machine; another CA, that nobody trusts."""
    now, here = datetime.datetime.now(datetime.UTC), x509.IPAddress(ipaddress.ip_address("127.0.0.1"))

    def made(name: str, issuer: tuple[x509.Name, ec.EllipticCurvePrivateKey] | None) -> Any:
        key = ec.generate_private_key(ec.SECP256R1())
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        by, signer = issuer or (subject, key)
        certificate = (
            x509.CertificateBuilder().subject_name(subject).issuer_name(by).public_key(key.public_key())
            .serial_number(x509.random_serial_number()).not_valid_before(now - datetime.timedelta(days=1))
            .not_valid_after(now + datetime.timedelta(days=1))
            .add_extension(x509.BasicConstraints(ca=issuer is None, path_length=None), critical=True)
            .add_extension(x509.SubjectAlternativeName([here]), critical=False)
            .sign(signer, hashes.SHA256())
        )  # fmt: skip
        (folder / f"{name}.pem").write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
        private = (serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
        (folder / f"{name}.key").write_bytes(key.private_bytes(*private))
        return subject, key

    ca = made("ca", None)
    made("other", None)
    made("broker", ca)
    made("press", ca)


def test_certificates_in_place_of_passwords(tmp_path: Path) -> None:
    """The machine shows a certificate of the plant's, and believes the broker's only if it is of the plant's too."""
    _certificates(tmp_path)
    port = network.free_port()
    tls = f"cafile {tmp_path / 'ca.pem'}\ncertfile {tmp_path / 'broker.pem'}\nkeyfile {tmp_path / 'broker.key'}\n"
    more = f"listener {port} 127.0.0.1\n{tls}require_certificate true\nuse_identity_as_username true\n"
    broker = Broker(tmp_path, more=more).start()
    key = load_credentials(broker.of("press"), "credentials").needed_key("credentials").text()
    own = {"key": key, "ca_file": "ca.pem", "cert_file": "press.pem", "cert_key_file": "press.key"}
    for name, changed in (("with", {}), ("untrusting", {"ca_file": "other.pem"})):
        file = tmp_path / f"{name}.yaml"
        file.write_text("".join(f"{k}: {v}\n" for k, v in (own | changed).items()))
        file.chmod(0o600)
    puppet = network.Puppet(broker)
    try:
        config = broker.config(timeout_s=3.0)
        config.twin.broker, config.twin.credentials = f"127.0.0.1:{port}", str(tmp_path / "with.yaml")
        network.same(network.local(), network.run(config))
        config.twin.credentials = str(tmp_path / "untrusting.yaml")
        config.twin.timeout_s = 0.5
        result = network.run(config)
        assert result.estimates["reason"].str.startswith("no broker at").all()
    finally:
        puppet.close()
        broker.stop()


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
