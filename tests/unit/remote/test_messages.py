"""Messages keep their bits, and what is none is refused."""

import json
import math
from contextlib import suppress
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtbacklash.config.compose import compose
from dtbacklash.config.run import TwinConfig
from dtbacklash.control.belief import beliefs_of, settled
from dtbacklash.experiment import estimation
from dtbacklash.remote import belief, messages
from dtbacklash.remote.messages import AnswerMessage, RequestMessage, Ticket, check_bounds, claimed_ticket
from dtbacklash.remote.protocol import LIMITS, Rejected, parsed, schema
from dtbacklash.twin.gap.estimate import Estimate
from dtbacklash.twin.gap.guard import Attempt, Verdict
from dtbacklash.twin.link.service import Answer, Request

BELIEF = belief.described(compose())
FINITE = st.floats(allow_nan=False, allow_infinity=False)
ANY = st.floats()
RUN = "0123456789abcdef" * 2
DIGEST = 2 * RUN


def _request(theta_m: list[float], q3: list[float], present_rad: float = 0.25) -> RequestMessage:
    request = Request(2000, 1000, np.array(theta_m), np.array(q3), present_rad, 3)
    return RequestMessage("press", Ticket(RUN, 7), 2.5, request, BELIEF)


def _answer(numbers: list[float], accepted: bool = True, guarded: bool = True) -> AnswerMessage:
    estimate = Estimate(*numbers[:7], 17, True, "fine", 0.125)
    attempt = Attempt(estimate, Verdict(accepted, "better"), numbers[6] if math.isfinite(numbers[6]) else math.nan)
    return AnswerMessage(
        "press", Ticket(RUN, 3), Ticket(RUN, 7), DIGEST, Answer((attempt,), guarded, 0.5)
    )  # fmt: skip


@given(st.lists(FINITE, min_size=10, max_size=40), st.floats(0.0, 6.28))
def test_a_request_keeps_its_bits(samples: list[float], present_rad: float) -> None:
    sent = _request(samples, samples[::-1], present_rad)
    got = RequestMessage.parsed(sent.dumped())
    assert got.request.theta_m.tobytes() == sent.request.theta_m.tobytes()
    assert got.request.q3.tobytes() == sent.request.q3.tobytes()
    assert replace(got.request, theta_m=0, q3=0) == replace(sent.request, theta_m=0, q3=0)  # type: ignore[arg-type]
    assert (got.machine, got.ticket, got.timeout_s, got.belief) == ("press", sent.ticket, 2.5, BELIEF)
    assert got.sha256 == messages.digest(sent.dumped())


@given(st.lists(FINITE, min_size=10, max_size=40))
def test_samples_may_be_plain_numbers(samples: list[float]) -> None:
    document = json.loads(_request(samples, samples).dumped()) | {"theta_m_rad": samples}
    got = RequestMessage.parsed(json.dumps(document).encode())
    assert got.request.theta_m.tobytes() == got.request.q3.tobytes()


@given(st.lists(ANY, min_size=7, max_size=7), st.booleans())
def test_an_answer_keeps_its_bits(numbers: list[float], accepted: bool) -> None:
    sent = _answer(numbers, accepted)
    got = AnswerMessage.parsed(sent.dumped())
    assert got.answer is not None
    assert repr(got.answer) == repr(sent.answer)  # NaN is not equal to itself
    assert (got.machine, got.ticket, got.to, got.sha256) == ("press", sent.ticket, sent.to, DIGEST)


def test_the_gap_for_the_controller_is_a_number_or_null() -> None:
    for gap, said in ((0.5, 0.5), (math.nan, None), (math.inf, None)):
        sent = _answer([gap] * 7)
        assert json.loads(sent.dumped())["attempts"][0]["applied_rad"] == said
        got = AnswerMessage.parsed(sent.dumped()).answer
        assert got is not None
        assert got.attempts[0].applied_rad == gap or math.isnan(got.attempts[0].applied_rad)


def test_a_refusal_says_why() -> None:
    refusal = AnswerMessage("press", Ticket(RUN, 3), Ticket(RUN, 7), DIGEST, None, 1000 * "x")
    assert AnswerMessage.parsed(refusal.dumped()) == replace(refusal, reason=500 * "x")


def test_fields_that_are_not_known_yet_are_ignored() -> None:
    for message in (_request([0.0] * 10, [0.0] * 10), _answer([0.1] * 7)):
        document = json.loads(message.dumped()) | {"later": {"x": [1, 2]}}
        assert repr(type(message).parsed(json.dumps(document).encode())).count("later") == 0


@pytest.mark.parametrize("gap", [-0.1, -1e-300, 3.2, math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("guarded", [True, False])
def test_a_gap_out_of_bounds_is_refused(gap: float, guarded: bool) -> None:
    """The gap that would be put in force; where the guard has not judged that is the fitted one."""
    numbers = [0.1, 0.1 if guarded else gap, 0.0, 1e-9, 0.01, 0.0, gap if guarded else math.nan]
    answer = _answer(numbers, guarded=guarded).answer
    assert answer is not None
    with pytest.raises(Rejected, match="gap out of bounds"):
        check_bounds(answer, 180.0)
    rejected = _answer(numbers, accepted=False, guarded=guarded).answer
    assert rejected is not None
    check_bounds(rejected, 180.0)  # into the table only


def test_a_gap_at_the_bounds_is_taken() -> None:
    for gap in (0.0, -0.0, math.radians(180.0), math.radians(123.4)):
        answer = _answer([gap, gap, 0.0, 1e-9, 0.01, 0.0, gap]).answer
        assert answer is not None
        check_bounds(answer, math.degrees(gap) if gap > 0.0 else 180.0)


def test_a_buffer_of_the_longest_kind_fits_into_a_message() -> None:
    most = messages.samples_that_fit(BELIEF)
    assert most > 100_000
    ones = np.full(most, 1.0 / 3.0)
    message = RequestMessage(
        "p" * 64, Ticket(RUN, 2**53 - 1), 86400.0, Request(2**53 - 1, 0, ones, ones, 1 / 3, 0), BELIEF
    )
    assert 0.99 * LIMITS["request"] < len(message.dumped()) <= LIMITS["request"]


@pytest.mark.parametrize("kind", ["request", "answer", "status"])
def test_a_schema_refers_to_nothing_outside_itself(kind: str) -> None:
    def references(node: object) -> list[str]:
        if isinstance(node, dict):
            own = [node["$ref"]] if "$ref" in node else []
            return own + [one for value in node.values() for one in references(value)]
        return [one for value in node for one in references(value)] if isinstance(node, list) else []

    assert all(one.startswith("#/definitions/") for one in references(schema(kind)))
    assert "$id" not in schema(kind)


def test_the_same_belief_makes_the_same_twin() -> None:
    """What goes with a request and what a run makes of its configuration answer alike, effects and all."""
    words = ("model=lead_screw", "model.effects.link_1.dry_friction.force=0.3", "model.parameters.k.value=9123.456789",
             "optimizer.max_evaluations=20")  # fmt: skip
    config = compose(*words)
    beliefs = beliefs_of(config)
    here = estimation.answering(settled(config, beliefs), beliefs.twin)
    there = belief.twin_of(json.loads(json.dumps(belief.described(config))))
    assert there.settings.method == here.settings.method == "simulate"
    assert there.model.structure == here.model.structure
    theta_m = 30.0 * np.sin(0.004 * np.arange(600.0)) ** 2
    request = Request(0, 0, theta_m, here.model.pitch_m_per_rad * theta_m, 0.1, 0)
    one, two = here.answer(request).chosen.estimate, there.answer(request).chosen.estimate
    assert replace(one, wall_s=0.0) == replace(two, wall_s=0.0)


def test_what_is_the_machines_affair_does_not_travel() -> None:
    assert set(belief.OF_THE_MACHINE) <= {one.name for one in fields(TwinConfig)}
    assert not set(BELIEF["twin"]) & set(belief.OF_THE_MACHINE)
    assert {"buffer", "settle", "observer_pole_rad_s", "gap_max_deg", "guard", "method"} <= set(BELIEF["twin"])


@pytest.mark.parametrize("payload", [b"", b"null", b"[]", b'"x"', b"\x00", b"{" * 10**5, b'{"version":1}', b"1" * 5000])
def test_anything_else_is_refused(payload: bytes) -> None:
    for kind in ("request", "answer", "status"):
        with pytest.raises(Rejected, match=r"malformed|wrong version"):
            parsed(payload, kind)


@given(st.binary(max_size=300))
def test_noise_is_refused(payload: bytes) -> None:
    with pytest.raises(Rejected):
        AnswerMessage.parsed(payload)


@given(st.data())
def test_a_message_with_a_changed_byte_is_refused_or_read(data: st.DataObject) -> None:
    """Nothing but Refused ever comes out of reading a message."""
    payload = bytearray(_answer([0.1] * 7).dumped())
    payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    with suppress(Rejected):
        AnswerMessage.parsed(bytes(payload))


def test_a_request_of_a_wrong_form_is_known_by_what_can_be_read_of_it() -> None:
    run, unknown = RUN, Ticket(32 * "0", 1)
    for said in ({}, {"kind": "?"}, {"more": [1.0]}):
        assert claimed_ticket(json.dumps({"run": run, "counter": 7} | said).encode()) == Ticket(run, 7)
    for payload in (b"", b"{", b"[]", b"7", b"\xff", 100_000 * b'{"a":'):
        assert claimed_ticket(payload) == unknown
    for run_said, counter in ((run, 0), (run, 2**53), (run, True), (run, 1.5), (run, None), ("RUN", 1), (5, 1)):
        assert claimed_ticket(json.dumps({"run": run_said, "counter": counter}).encode()) == unknown
