"""The twin over a network, with a real broker and a real ``dtb twin serve``: same answers, status, metrics, access."""

from __future__ import annotations

from collections.abc import Iterator

import network
import pytest
from network import Broker, Served

from dtbacklash.config.compose import compose


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
