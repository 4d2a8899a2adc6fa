"""Finished cases in one file."""

import gzip
import json

import proved
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dtbacklash.errors import UserError
from dtbacklash.prove import run
from dtbacklash.prove.rules import Case


@pytest.fixture
def cases():
    found = {**proved.diagnosis(proved.finding(proved.COULOMB)), "settings": {"a": 1}, "checks": [1, 2]}
    seen = proved.oracle(proved.COULOMB)
    return [
        Case("a1", proved.secret("single", proved.COULOMB, seed=30000), found, seen, 2.0, kinds={"gear": "gear"},
             rig="lead_screw", cpu_s=1.5),
        Case("b2", proved.secret("nothing", seed=30001), None, {}, error="its worker died", rig="pendulum"),
    ]  # fmt: skip


def test_what_is_scored_comes_back_and_the_rest_is_left_out(cases, tmp_path):
    run.save_known(cases, tmp_path / run.FILE)
    first, second = run.load_known(tmp_path / run.FILE)
    assert second == cases[1]
    assert first.secret == cases[0].secret
    assert (first.findings, first.verdict, first.oracle) == (cases[0].findings, cases[0].verdict, cases[0].oracle)
    assert not {"settings", "checks"} & set(first.diagnosis)


def test_the_same_cases_are_the_same_bytes(cases, tmp_path):
    for name in ("a", "b"):
        run.save_known(cases, tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize("part", ["concealed_by", "diagnosed_by", "oracle_by"])
def test_cases_of_other_code_are_refused(cases, tmp_path, part):
    run.save_known(cases, tmp_path / run.FILE)
    content = json.loads(gzip.decompress((tmp_path / run.FILE).read_bytes()))
    (tmp_path / run.FILE).write_bytes(gzip.compress(json.dumps({**content, part: "other"}).encode()))
    with pytest.raises(UserError, match=part):
        run.load_known(tmp_path / run.FILE)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.one_of(st.binary(), st.text().map(lambda t: gzip.compress(t.encode("utf-8", "replace")))))
def test_anything_else_is_one_line(tmp_path, content):
    (tmp_path / run.FILE).write_bytes(content)
    with pytest.raises(UserError, match=run.FILE):
        run.load_known(tmp_path / run.FILE)
