"""The golden set: what each recording hides is said; and each number that decides is seen to decide."""

from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import pytest
from golden import GOLDEN, MOVED, Golden, recorded, said
from nominal import nominal_rig

from dtbacklash.diagnosis import diagnose, pipeline
from dtbacklash.diagnosis.engine.selection import StepwiseSelection
from dtbacklash.diagnosis.settings import SETTINGS

pytestmark = pytest.mark.check

#: a change of the signals by so many times their noise shows beside other effects
SEEN = 10.0


@pytest.mark.parametrize("case", GOLDEN, ids=str)
def test_what_is_hidden_is_said(case: Golden, tmp_path: Path):
    secret = case.secret()
    found = diagnose(recorded(secret, nominal_rig(case.rig), tmp_path), nominal_rig(case.rig))
    seen = {name for name, size in secret.visibility.items() if size > SEEN or len(secret.effects) == 1}
    hidden = {(e["location"], e["effect"]) for e in secret.effects}
    clear = {key for key in hidden if ".".join(key) in seen}
    small = {(b["location"], b["effect"]) for b in secret.beside if "effect" in b}
    small |= {(place, name) for b in secret.beside for place, name in b.get("akin", [])}
    sure = {(f.location, f.effect) for f in found.findings if f.confidence == "sure"}
    certain = {(f.location, f.effect) for f in found.findings if f.confidence in ("sure", "one_of")}
    named = {(f.location, f.effect) for f in found.findings}
    alike = {(a.location, a.effect) for f in found.findings for a in f.also_fits}
    assert sure <= hidden | small
    assert clear <= named | alike
    if case.sure and len(hidden) == 1:
        assert hidden <= certain
    if not hidden and case.kind != "unknown":
        assert found.verdict in ("consistent", *(["parameters"] if secret.parameters else []))
    if case.kind == "parameters":
        assert found.recalibrated
    if secret.unknown is not None:
        assert found.verdict == "unexplained"
        assert found.modelled is not None
        assert found.modelled.location == secret.unknown["location"]


def test_all_numbers_but_two_are_seen_to_decide():
    """``min_effect`` has a test of the search; no golden recording is so near that ``tie_ratio`` decides."""
    assert {one.name for one in fields(SETTINGS)} == set(MOVED) | {"min_effect", "tie_ratio"}


@pytest.mark.nightly
@pytest.mark.parametrize("name", list(MOVED))
def test_each_number_that_decides_is_seen_to(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Changed, it changes what is said of a golden recording."""
    case, factor = MOVED[name]
    recording = recorded(case.secret(), nominal_rig(case.rig), tmp_path)

    def of(value: float) -> tuple[object, ...]:
        rules = replace(SETTINGS, **{name: value})
        monkeypatch.setattr(pipeline, "StepwiseSelection", partial(StepwiseSelection, rules=rules))
        return said(diagnose(recording, nominal_rig(case.rig), held_out=rules.held_out_share))

    value = getattr(SETTINGS, name)
    assert of(value) != of(factor * value)
