"""Whatever happens to broker, twin or network, the loop stays under control, the gap in force stays, and it is told.

A real broker; twins that do as the test says, or ``dtb twin serve`` itself.
"""

import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import network
import numpy as np
import pytest
from network import Broker, Proxy, Puppet, Served, wait_for

from dtbacklash.experiment.result import RunResult
from dtbacklash.experiment.run import run_scenario
from dtbacklash.remote.belief import described
from dtbacklash.remote.client import RemoteTwin
from dtbacklash.remote.messages import RequestMessage
from dtbacklash.twin.link.service import Request

pytestmark = pytest.mark.check

# --- the broker


def test_the_broker_is_gone_before_the_start(broker: Broker, tmp_path: Path) -> None:
    config = broker.config(timeout_s=1.0)
    config.twin.broker = f"127.0.0.1:{network.free_port()}"
    began = time.monotonic()
    result = network.run(config)
    assert time.monotonic() - began < 60.0  # three requests of 1 s each, and no more
    assert (result.trace["gap_hat_deg"] == 0.0).all()
    assert len(result.estimates) == 3
    assert result.summary["n_accepted"] == 0
    network.under_control(result)
    network.told(result, tmp_path, f"no broker at {config.twin.broker}")


def test_the_broker_is_gone_in_the_middle_and_comes_back(
    puppet: Callable[..., Puppet], tmp_path_factory: pytest.TempPathFactory, tmp_path: Path
) -> None:
    """The second request is lost with the broker; the third is answered."""
    own = Broker(tmp_path_factory.mktemp("own")).start()

    def play(twin: Puppet, message: RequestMessage) -> None:
        if message.ticket.counter == 2:
            own.stop()
            time.sleep(2.0)
            own.start()
        else:
            twin.reply(message)

    puppet(play, own)
    try:
        result = network.run(own.config(timeout_s=4.0))
    finally:
        own.stop()
    assert list(result.estimates["accepted"]) == [True, False, True]
    applied = float(result.estimates["applied_deg"].iloc[0])
    between = result.trace.query("13.1 < t_s < 32.9")["gap_hat_deg"]
    assert np.allclose(between, applied, rtol=0, atol=1e-9)
    network.under_control(result)
    # the request is sent again when the broker is back: whether the twin hears it then depends on who came back first
    lost = str(result.estimates["reason"].iloc[1])
    assert lost in ("no answer within 4 s", f"no twin listens at {own.address}")
    network.told(result, tmp_path, lost)


def test_a_wrong_password_is_refused_before_the_loop_begins(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DTB_TWIN_PASSWORD", "wrong")
    with pytest.raises(
        ValueError, match=r"twin.credentials=.*press.yaml: the broker at .* refuses them: not authorized"
    ):
        network.run(broker.config())


def test_a_twin_with_a_wrong_password_ends_in_one_line(
    broker: Broker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DTB_TWIN_PASSWORD", "wrong")
    one = Served(broker, folder=tmp_path)
    assert one.process.wait(120) == 2
    assert (
        one.text().splitlines()[-1].endswith("twin.yaml: the broker at " + broker.address + " refuses: not authorized")
    )


def test_what_the_broker_has_kept_from_before_is_no_answer(
    broker: Broker, puppet: Callable[..., Puppet], plain: RunResult
) -> None:
    """Kept messages are taken for the status of a twin alone."""
    twin = puppet()
    first = network.run(broker.config())
    topic, payload, _ = twin.payloads[0]
    twin.connection.publish(topic, payload, twin.key.of_machine("press"), retain=True)
    time.sleep(0.2)
    second = network.run(broker.config())
    twin.connection._client.publish(topic, b"", qos=1, retain=True)
    network.same(plain, first)
    network.same(plain, second)
    assert second.summary["remote"]["dropped"] == {}


# --- the twin


def test_nobody_listens(broker: Broker, tmp_path: Path) -> None:
    result = network.run(broker.config(timeout_s=0.4))
    assert (result.trace["gap_hat_deg"] == 0.0).all()
    network.under_control(result)
    network.told(result, tmp_path, f"no twin listens at {broker.address}")


def test_a_twin_that_comes_later_gets_the_request(
    broker: Broker, puppet: Callable[..., Puppet], plain: RunResult
) -> None:
    timer = threading.Timer(1.0, puppet)
    timer.start()
    result = network.run(broker.config())
    timer.join()
    network.same(plain, result)


def test_the_twin_is_killed_while_it_estimates_and_started_again(
    broker: Broker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its processes end with it; the request is lost; the next ones are answered by the new twin."""
    first = Served(broker, folder=tmp_path).ready()
    workers = network.children(first.process.pid)
    for pid in workers:
        os.kill(pid, signal.SIGSTOP)  # an estimate that does not end
    again: list[Served] = []
    ask, asked = RemoteTwin.ask, []

    def patient(self: RemoteTwin, request: Request) -> None:
        """The first request is given up soon; the second one is asked when the new twin is there."""
        asked.append(request)
        self.settings = replace(self.settings, timeout_s=5.0 if len(asked) == 1 else network.PATIENCE_S)
        if len(asked) == 2:
            killer.join()
        ask(self, request)

    def kill() -> None:
        wait_for(lambda: _busy(broker))
        first.process.send_signal(signal.SIGKILL)
        first.process.wait(10)
        for pid in workers:
            os.kill(pid, signal.SIGCONT)
        again.append(Served(broker, folder=tmp_path))
        again[0].ready()

    monkeypatch.setattr(RemoteTwin, "ask", patient)
    killer = threading.Thread(target=kill)
    killer.start()
    try:
        result = network.run(broker.config())
        assert list(result.estimates["accepted"]) == [False, True, True]
        assert "request 1" not in first.text()
        assert "request 2: accepted" in again[0].text()
        assert workers
        wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))
        network.under_control(result)
        network.told(result, tmp_path / "run", "no answer within 5 s")
    finally:
        for one in (first, *again):
            one.end()


def _busy(broker: Broker) -> bool:
    """Whether a twin says that it is at work."""
    return any(one["online"] and one["busy"] for one in network.status(broker, 0.1).values())


# --- the network


def test_a_slow_network_gives_the_same_run(broker: Broker, puppet: Callable[..., Puppet], plain: RunResult) -> None:
    """20 ms later in each direction and for each 2 kB, at 200 kB/s: only the wall clock sees it."""
    puppet()
    proxy = Proxy(broker, delay_s=0.02, bytes_s=200e3)
    config = broker.config()
    config.twin.broker = proxy.address
    result = network.run(config)
    proxy.close()
    network.same(plain, result)
    assert result.summary["remote"]["delay_s"]["median"] > 0.25


def test_a_lossy_network_costs_no_answer(broker: Broker, puppet: Callable[..., Puppet], plain: RunResult) -> None:
    """Three times the connection is cut in the middle of a request: it is sent again, and answered once."""
    twin = puppet()
    proxy = Proxy(broker, cut_after=12_000, cuts=3)
    config = broker.config(timeout_s=20.0)
    config.twin.broker = proxy.address
    result = network.run(config)
    proxy.close()
    assert proxy.cut == 3
    network.same(plain, result)
    assert {message.ticket.counter for message in twin.requests} == {1, 2, 3}


def test_a_dead_network_is_a_broker_that_is_gone(broker: Broker, puppet: Callable[..., Puppet], tmp_path: Path) -> None:
    """Connected, and then nothing passes any more: nothing waits for longer than it may, the end of the run neither."""
    puppet()
    proxy = Proxy(broker)
    config = broker.config(timeout_s=1.0)
    config.twin.broker = proxy.address
    with RemoteTwin(config.twin, described(config)) as twin:
        twin.warm_up()
        proxy.delay_s = 3600.0
        began = time.monotonic()
        result = run_scenario(config, service=twin)
        result.summary |= {"remote": twin.summary(), "command": None}
    assert time.monotonic() - began < 60.0  # not the hour of the network
    network.under_control(result)
    network.told(result, tmp_path, "no answer within 1 s: is it this machine")
