"""Whatever answers come, late, lost, doubled, forged: the loop stays under control, the gap in force stays, it is told.

A real broker; twins that do as the test says.
"""

import json
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import network
import pytest
from network import Broker, Puppet, wait_for

from dtbacklash.config.compose import compose
from dtbacklash.experiment.result import RunResult
from dtbacklash.experiment.run import run_scenario
from dtbacklash.remote.belief import described
from dtbacklash.remote.client import RemoteTwin
from dtbacklash.remote.credentials import Key
from dtbacklash.remote.messages import RequestMessage
from dtbacklash.remote.protocol import answer_topic
from dtbacklash.twin.link.service import Dropped, Reply, Request

pytestmark = pytest.mark.check


@pytest.mark.usefixtures("plain")  # what an estimate needs is loaded, or the second answer were late too
def test_answers_are_late_by_seconds(broker: Broker, puppet: Callable[..., Puppet], tmp_path: Path) -> None:
    """What comes after the machine has stopped waiting is dropped; the others hold."""
    asked_again, sent = threading.Event(), threading.Event()

    def play(twin: Puppet, message: RequestMessage) -> None:
        answer = twin.message(message)
        if message.ticket.counter == 1:
            asked_again.wait(10)
        elif message.ticket.counter == 2:
            asked_again.set()
            sent.wait(10)
        twin.send(message.machine, answer.dumped())
        sent.set()

    puppet(play)
    result = network.run(broker.config(timeout_s=1.5))
    rows = result.estimates[~result.estimates["reason"].str.startswith("dropped")]
    assert list(rows["accepted"]) == [False, True, True]
    assert result.summary["remote"]["dropped"] == {"late": 1}
    network.under_control(result)
    network.told(result, tmp_path, "no answer within 1.5 s", "dropped: late")


def test_an_answer_is_lost(broker: Broker, puppet: Callable[..., Puppet], tmp_path: Path) -> None:
    puppet(lambda twin, message: None if message.ticket.counter == 2 else twin.reply(message))
    result = network.run(broker.config(timeout_s=1.0))
    assert list(result.estimates["accepted"]) == [True, False, True]
    network.under_control(result)
    network.told(result, tmp_path, "no answer within 1 s")


def test_answers_are_doubled(broker: Broker, puppet: Callable[..., Puppet], plain: RunResult, tmp_path: Path) -> None:
    """By the network: the same message twice; by the twin: two answers to a request. The first one counts."""

    def play(twin: Puppet, message: RequestMessage) -> None:
        if message.ticket.counter == 2:
            payload = twin.message(message).dumped()
            twin.send(message.machine, payload)
            twin.send(message.machine, payload)
        else:
            twin.reply(message)
            twin.reply(message)
            time.sleep(0.1)

    puppet(play)
    result = network.run(broker.config())
    network.same(plain, result)
    dropped = result.summary["remote"]["dropped"]
    assert dropped["replayed"] == 1
    assert dropped["doubled"] >= 1  # the run may have ended before the last one came
    network.told(result, tmp_path, "doubled", "replayed")


@dataclass
class _Paced:
    """A service that never waits, in a loop that takes 2 ms for each look: five times as fast as the clock."""

    inner: RemoteTwin

    def warm_up(self) -> None:
        self.inner.warm_up()

    def ask(self, request: Request) -> None:
        self.inner.ask(request)

    def replies(self) -> list[Reply]:
        time.sleep(0.002)
        return self.inner.replies()

    def dropped(self) -> list[Dropped]:
        return self.inner.dropped()


def _paced(broker: Broker, *words: str, timeout_s: float = 10.0) -> RunResult:
    config = broker.config("twin.delay_s=0", *words, timeout_s=timeout_s)
    with RemoteTwin(config.twin, described(config), waits=False) as twin:
        result = run_scenario(config, service=_Paced(twin))
        result.summary |= {"remote": twin.summary(), "command": None}
    return result


def test_the_loop_goes_on_while_an_answer_is_on_its_way(broker: Broker, puppet: Callable[..., Puppet]) -> None:
    """An answer that comes 0.6 s later, in a loop that is faster than the clock: in force seconds after the buffer."""

    def play(twin: Puppet, message: RequestMessage) -> None:
        time.sleep(0.6)
        twin.reply(message)

    puppet(play)
    result = _paced(broker)
    waited = result.estimates["t_applied_s"] - result.estimates["t_event_s"] - 1.0
    assert result.estimates["accepted"].all()
    assert (waited > 1.0).all()
    assert result.trace.query("gap_hat_deg > 0")["t_s"].min() == pytest.approx(result.estimates["t_applied_s"].iloc[0])
    network.under_control(result)


def test_answers_come_out_of_order_and_for_an_old_buffer(
    broker: Broker, puppet: Callable[..., Puppet], tmp_path: Path
) -> None:
    """The answer to the second buffer comes first; that to the first says what was so long ago."""
    held: list[RequestMessage] = []

    def play(twin: Puppet, message: RequestMessage) -> None:
        if message.ticket.counter == 1:
            held.append(message)
            return
        # made beforehand: the run may end while an estimate is made
        old = twin.message(held.pop()).dumped() if held else None
        twin.reply(message)
        if old is not None:
            twin.send(message.machine, old)

    puppet(play)
    result = _paced(broker)
    assert result.estimates["reason"].iloc[0] == "overtaken by the answer to a later buffer"
    assert result.summary["remote"]["dropped"] == {"for an old buffer": 1}
    second, third = result.estimates.query("accepted")["applied_deg"]
    in_force = list(dict.fromkeys(result.trace["gap_hat_deg"].round(9)))
    assert in_force in ([0.0, round(second, 9), round(third, 9)], [0.0, round(second, 9)])
    network.under_control(result)
    network.told(result, tmp_path, "overtaken by the answer to a later buffer", "dropped: for an old buffer")


def _with(payload: bytes, change: Callable[[dict], None]) -> bytes:
    document = json.loads(payload)
    change(document)
    return json.dumps(document).encode()


def _chosen(value: object) -> Callable[[dict], None]:
    """Let every attempt say that it is accepted, with another gap to put in force."""

    def change(document: dict) -> None:
        for attempt in document["attempts"]:
            attempt.update(accepted=True, applied_rad=value, gap_rad=value, fit_gap_rad=value)

    return change


#: what it is -> (the message, from the right one and what the twin has; the reason in the counters)
HOSTILE: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "NaN, as a word": (lambda p: _with(p, _chosen("nan")), "malformed"),
    "NaN, as Python writes it": (lambda p: _with(p, _chosen(float("nan"))), "malformed"),
    "infinite": (lambda p: _with(p, _chosen("inf")), "malformed"),
    "beyond a double": (lambda p: _with(p, _chosen(0.5)).replace(b"0.5", b"1e999"), "malformed"),
    "a whole number beyond a double": (
        lambda p: _with(p, _chosen(7)).replace(b": 7,", b": 1" + 400 * b"0" + b","), "malformed",
    ),
    "negative": (lambda p: _with(p, _chosen(-0.3)), "gap out of bounds"),
    "beyond the machine's bound": (lambda p: _with(p, _chosen(3.2)), "gap out of bounds"),
    "too large for an answer": (lambda p: p[:-1] + b',"more":"' + 600_000 * b"x" + b'"}', "too large"),
    "wrong version": (lambda p: _with(p, lambda d: d.update(version=2)), "wrong version"),
    "no version": (lambda p: _with(p, lambda d: d.pop("version")), "wrong version"),
    "of another kind": (lambda p: _with(p, lambda d: d.update(kind="request")), "malformed"),
    "a field is missing": (lambda p: _with(p, lambda d: d.pop("attempts")), "malformed"),
    "not guarded": (lambda p: _with(p, lambda d: d.update(guarded=False)), "not guarded as asked"),
    "a model that nobody asked for": (
        lambda p: _with(p, lambda d: d.update(belief=described(compose())["rig"])), "no model for this machine",
    ),
    "a model that is none": (lambda p: _with(p, lambda d: d.update(belief={"name": "x"})), "malformed"),
    "no attempts": (lambda p: _with(p, lambda d: d.update(attempts=[])), "malformed"),
    "a text for a gap": (lambda p: _with(p, _chosen("1")), "malformed"),
    "no JSON": (lambda p: b"\xff\xfe gap=1", "malformed"),
    "a list": (lambda p: b"[1]", "malformed"),
    "nested too deeply": (lambda p: 100_000 * b"[", "malformed"),
    "of another run": (lambda p: _with(p, lambda d: d["request"].update(run=32 * "0")), "of another run"),
    "to an unknown request": (lambda p: _with(p, lambda d: d["request"].update(counter=99)), "to an unknown request"),
    "to a request that was changed": (
        lambda p: _with(p, lambda d: d["request"].update(sha256=64 * "0")), "to a request that was changed",
    ),
    "of another machine": (lambda p: _with(p, lambda d: d.update(machine="lathe")), "of another run"),
}  # fmt: skip


def test_hostile_messages_change_nothing(
    broker: Broker, puppet: Callable[..., Puppet], plain: RunResult, tmp_path: Path
) -> None:
    """Each comes, signed with the right key, before the right answer to the first request: the run is as without."""

    def play(twin: Puppet, message: RequestMessage) -> None:
        if message.ticket.counter == 1:
            answer = twin.answer(message)
            for change, _ in HOSTILE.values():
                twin.send(message.machine, change(twin.message(message, answer).dumped()))
        twin.reply(message)

    puppet(play)
    result = network.run(broker.config())
    network.same(plain, result)
    expected: dict[str, int] = {}
    for _, reason in HOSTILE.values():
        expected[reason] = expected.get(reason, 0) + 1
    assert result.summary["remote"]["dropped"] == expected
    rows = (f"dropped {n} times: {reason}" if n > 1 else f"dropped: {reason}" for reason, n in expected.items())
    network.told(result, tmp_path, *rows)


def test_who_has_no_key_or_replays_changes_nothing(
    broker: Broker, puppet: Callable[..., Puppet], plain: RunResult, tmp_path: Path
) -> None:
    """Wrong key, the key of another machine, no signature; and the first answer once more, as it was."""
    first: list[bytes] = []

    def play(twin: Puppet, message: RequestMessage) -> None:
        payload = twin.message(message).dumped()
        wrong = _with(payload, _chosen(1.0))
        topic = answer_topic(message.machine)
        for key in (Key.drawn(), twin.key.of_machine("lathe"), twin.key):
            twin.send(message.machine, wrong, key)
        client = twin.connection._client
        client.publish(topic, wrong, qos=1)  # no signature
        if first:
            twin.send(message.machine, first[0])
        first.append(payload)
        twin.send(message.machine, payload)

    puppet(play)
    result = network.run(broker.config())
    network.same(plain, result)
    assert result.summary["remote"]["dropped"] == {"wrong signature": 12, "replayed": 2}
    network.told(result, tmp_path, "dropped 4 times: wrong signature", "dropped: replayed")


def test_ten_megabytes_end_at_the_broker(broker: Broker, puppet: Callable[..., Puppet], plain: RunResult) -> None:
    """The broker cuts off who sends them; the loop notices nothing."""
    bully = Puppet(broker, lambda twin, message: None)
    cut = threading.Event()

    def play(twin: Puppet, message: RequestMessage) -> None:
        if message.ticket.counter == 1:
            link = bully.connection
            bully.send(message.machine, bytes(10_000_000))
            wait_for(lambda: not link.connected.is_set(), 10)
            cut.set()
            bully.close()
        twin.reply(message)

    puppet(play)
    result = network.run(broker.config())
    assert cut.is_set()
    network.same(plain, result)
    assert result.summary["remote"]["dropped"] == {}


def test_two_twins_answer(broker: Broker, puppet: Callable[..., Puppet], plain: RunResult, tmp_path: Path) -> None:
    """The first valid answer counts, the other is dropped."""

    def play(twin: Puppet, message: RequestMessage) -> None:
        if message.ticket.counter == 3:
            time.sleep(0.5)  # so that the run is still there when the others have come twice
        twin.reply(message)

    puppet(play)
    puppet(play)
    result = network.run(broker.config())
    network.same(plain, result)
    assert result.summary["remote"]["dropped"]["doubled"] in (2, 3)
    network.told(result, tmp_path, "doubled")
