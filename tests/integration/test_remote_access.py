"""Who may say what to the twin over a network, and what becomes of what should not have been said."""

import datetime
import hashlib
import ipaddress
import json
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import network
import numpy as np
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from network import Broker, Served, wait_for

from dtbacklash.remote.belief import described
from dtbacklash.remote.connection import Connection
from dtbacklash.remote.credentials import load_credentials
from dtbacklash.remote.messages import RequestMessage, Ticket
from dtbacklash.remote.protocol import answer_topic, request_topic
from dtbacklash.twin.link.service import Request

pytestmark = pytest.mark.check


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
    """They are counted by what is wrong with them, told so where they are signed, and the next request is answered."""
    before = network.settled_status(broker, lambda s: s["online"])["rejected"]
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
    told = [reason for reason in ("malformed", "wrong version") for _ in hostile[reason]]
    wait_for(lambda: len(talker.heard) == len(told) + 1)
    answers = [json.loads(payload) for _, payload in talker.heard]
    assert sorted(a["reason"].partition(":")[0] for a in answers if a["status"] == "refused") == sorted(told)
    digests = {hashlib.sha256(one).hexdigest() for reason in ("malformed", "wrong version") for one in hostile[reason]}
    assert {a["request"]["sha256"] for a in answers if a["status"] == "refused"} == digests
    settled = network.settled_status(broker, lambda s: s["rejected"].get("replayed", 0) > before.get("replayed", 0))
    after = settled["rejected"]
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
        "twin=remote", f"twin.broker={broker.address}", "twin.machine=press", f"twin.credentials={broker.of('press')}",
    ]  # fmt: skip
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
