"""The quick proof's recordings, and what counts as a drop."""

from dataclasses import replace

import proved
import pytest
import yaml
from proved import COULOMB, diagnosis, perfect

from dtbacklash.config.commands import QUICK
from dtbacklash.prove import quick
from dtbacklash.prove.draw import draw_kind
from dtbacklash.prove.score import score
from dtbacklash.prove.secret import KINDS


def cases():
    kinds = [("nothing", []), ("parameters", []), ("single", [COULOMB]), ("single", [proved.BACKLASH]), ("unknown", [])]
    return [perfect(kind, *keys, seed=j) for j, (kind, keys) in enumerate(kinds)]


@pytest.mark.parametrize("n", QUICK)
def test_the_recordings_are_the_first_of_each_kind_from_a_seed_of_its_own(lead_screw, n):
    chosen = quick.quick_seeds(lead_screw, n)
    assert len(chosen) == n
    kinds = {seed: draw_kind(seed, lead_screw) for seed in range(quick.FROM, chosen[-1] + 1)}
    for kind in KINDS:
        every = [seed for seed, there in kinds.items() if there == kind]
        assert [seed for seed in chosen if kinds[seed] == kind] == every[: quick.QUOTAS[n][kind]]


def test_what_was_reached_is_reached_again():
    found = score(cases())
    before = yaml.safe_load(quick.reached_text("lead_screw", 20, found))["lead_screw 20"]
    assert set(before) == {*quick.HELD, "ratio"}
    assert quick.drops(found, before) == []
    assert quick.drops(found, {}) == []


@pytest.mark.parametrize("lost", range(5))
def test_every_kind_of_loss_is_a_drop(lost):
    before = yaml.safe_load(quick.reached_text("lead_screw", 20, score(cases())))["lead_screw 20"]
    worse = cases()
    worse[lost] = replace(worse[lost], diagnosis=None)
    assert quick.drops(score(worse), before)


def test_larger_errors_wider_misses_and_fewer_clear_cases_are_drops():
    before = yaml.safe_load(quick.reached_text("lead_screw", 20, score(cases())))["lead_screw 20"]
    worse = cases()
    for one in worse:
        one.oracle["held_out"]["extended"] = 1.06
    assert quick.drops(score(worse), before) == ["held-out error over the oracle's: 1.06, reached were 1"]
    missed = cases()
    missed[2] = replace(missed[2], diagnosis=diagnosis(proved.finding(COULOMB, off=0.5)))
    assert quick.drops(score(missed), before) == []  # one may be lost to another processor
    missed[3] = replace(missed[3], diagnosis=diagnosis(proved.finding(proved.BACKLASH, off=0.5)))
    assert quick.drops(score(missed), before) == [
        "95 % intervals of rightly named effects that hold the truth: 0/2, reached were 2/2"
    ]
    unclear = cases()
    for one in unclear[2:4]:
        one.oracle["clear"] = dict.fromkeys(one.oracle["clear"], False)
    assert len(quick.drops(score(unclear), before)) == 3


def test_what_is_on_record_names_known_figures():
    for n in QUICK:
        assert set(quick.reached("lead_screw", n)) == {*quick.HELD, "ratio"}
    assert quick.reached("no such rig", 20) == {}
