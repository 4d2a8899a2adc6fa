"""The score: its figures, intervals, bins, confusion, text and files."""

import json
import math
from dataclasses import replace

import proved
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from proved import BACKLASH, COULOMB, CUBIC, DEAD_ZONE, case, diagnosis, finding, oracle, perfect, secret

from dtbacklash.files import json_able
from dtbacklash.physics.element_kinds import KINDS
from dtbacklash.prove.name_scores import (
    ELSEWHERE,
    EXTRA,
    FAILED,
    FAMILIES,
    NOTHING,
    UNEXPLAINED,
    Reliability,
    case_rows,
    confusion,
    confusion_rows,
    family,
    reliability,
)
from dtbacklash.prove.score import Score, Share, bins, score
from dtbacklash.report.proof.text import markdown, which_seeds
from dtbacklash.scoring.shares import wilson

KEYS = list(proved.VALUES)
EACH = st.one_of(
    st.tuples(st.sampled_from(["nothing", "parameters", "unknown"]), st.just([])),
    st.tuples(st.just("single"), st.lists(st.sampled_from(KEYS), min_size=1, max_size=1)),
    st.tuples(st.just("several"), st.lists(st.sampled_from(KEYS), min_size=2, max_size=3, unique=True)),
)


@settings(max_examples=40, deadline=None)
@given(st.lists(EACH, min_size=1, max_size=12))
def test_a_perfect_diagnosis_scores_perfectly(drawn):
    cases = [perfect(kind, *keys, seed=10_000 + j) for j, (kind, keys) in enumerate(drawn)]
    found = score(cases)
    assert all(f.right == f.of for f in found.figures)
    assert found.failed == 0
    assert sum(c.count for c in found.confusion if c.hidden == c.named) == sum(c.count for c in found.confusion)
    assert all(b.exact == b.within == b.of for b in found.bins)
    assert all(q.median == q.ninety == 1.0 for q in found.quantities if q.name == "ratio" and q.of)
    assert case_rows(cases)["right"].all()
    assert found.bars[0] == found.bars[1] > 0


@settings(max_examples=25, deadline=None)
@given(st.lists(EACH, min_size=1, max_size=8))
def test_failed_diagnoses_count_against_every_share(drawn):
    whole = [perfect(kind, *keys, seed=j) for j, (kind, keys) in enumerate(drawn)]
    cases = [replace(c, diagnosis=None, oracle={**c.oracle, "held_out": {"oracle": 1.0}}) for c in whole]
    found = score(cases)
    by_case = [f for f in found.figures if not f.name.startswith("coverage")]
    assert all(f.right == 0 for f in by_case)
    assert [f.of for f in by_case] == [f.of for f in score(whole).figures if not f.name.startswith("coverage")]
    assert all(math.isinf(q.median) for q in found.quantities if q.name == "ratio" and q.of)


def test_what_is_not_clear_counts_beside_the_bar():
    hidden = case("b", secret("single", BACKLASH), diagnosis(), oracle(BACKLASH, clear=False), 1.0)
    strict = score([perfect("single", COULOMB), hidden]).figure("strict")
    assert (strict.right, strict.of, strict.every_right, strict.every_of) == (1, 1, 1, 2)


@pytest.mark.parametrize(
    ("right", "of", "bar", "met"),
    [
        (9, 10, (0.90, 1), True), (89, 100, (0.90, 1), False), (19, 20, (0.95, 1), True),
        (17, 17, (0.9, 0.99), True), (500, 500, (0.9, 0.99), False), (16, 18, (0.9, 0.99), False),
        (0, 0, (0.9, 1), None), (3, 4, None, None),
    ],
)  # fmt: skip
def test_a_bar_is_met_or_missed(right, of, bar, met):
    assert Share("a", "a", right, of, bar).met is met


def test_the_errors_quantiles_are_by_rank_and_held_against_the_bar():
    cases = [perfect("single", COULOMB, seed=j) for j in range(10)]
    for j, one in enumerate(cases):
        one.oracle["held_out"]["extended"] = 1.0 + 0.05 * j
    ratio = next(q for q in score(cases).quantities if q.name == "ratio")
    assert (ratio.median, ratio.ninety) == (1.25, 1.45)
    assert [ratio.met(v) for v in (1.1, 1.11)] == [True, False]


def test_the_bins_part_by_family_and_size():
    small = case("a", secret("single", CUBIC, size=0.5), diagnosis(), oracle(CUBIC), 1.0)
    other = case("b", secret("single", CUBIC, size=0.6), diagnosis(finding(DEAD_ZONE, CUBIC)), oracle(CUBIC), 1.0)
    found = bins([small, other, perfect("single", CUBIC, size=40.0), perfect("unknown", size=5.0)])
    assert [(b.family, b.low, b.high, b.of, b.exact, b.within, b.intervals, b.hold) for b in found] == [
        ("structure", 0.316, 1.0, 2, 0, 1, 0, 0),
        ("structure", 31.6, 100.0, 1, 1, 1, 1, 1),
        ("unknown", 3.16, 10.0, 1, 1, 1, 0, 0),
    ]


@pytest.mark.parametrize("kind", [*KINDS, "sensor"])
def test_every_kind_has_a_family(kind):
    assert family(kind) in FAMILIES


def test_what_was_hidden_is_sorted_by_the_kind_of_its_place_whatever_its_name():
    kinds = {"shaft": "mass", "gearwheel_mass": "rotor", "sensor_hub": "link"}
    hidden = [("shaft", "ground_friction"), ("gearwheel_mass", "cogging")]
    told = secret("several", size=30.0) | {
        "effects": [{"location": p, "effect": e, "parameters": {}} for p, e in hidden],
        "visibility": {".".join(key): 30.0 for key in hidden},
    }
    found = score([case("a", told, diagnosis(), oracle(*hidden), kinds=kinds)])
    assert [(b.family, b.of) for b in found.bins] == [("drive", 1), ("structure", 1)]
    assert sorted(c.hidden_kind for c in found.confusion) == ["mass ground_friction", "rotor cogging"]


def test_places_of_a_kind_are_one_and_the_right_effect_elsewhere_is_told():
    links = [("link_1", "cubic_stiffness"), ("link_2", "cubic_stiffness")]
    cases = [perfect("single", key) for key in links]
    cases.append(case("a", secret("single", links[0]), diagnosis(finding(links[1])), oracle(links[0])))
    row = "link cubic_stiffness"
    assert score(cases).by_kind() == {(row, row): (2, 2), (row, ELSEWHERE): (1, 0)}


def test_the_bins_of_all_families_add_up():
    found = score(proved.campaign(120))
    effects = [b for b in found.bins if b.family != "unknown"]
    assert sum(b.of for b in found.bins_of()) == sum(b.of for b in effects)
    assert found.bins_of("drive") == [b for b in effects if b.family == "drive"]
    assert all(low <= b.exact / b.of <= high for b in effects for low, high in [wilson(b.exact, b.of)])


def test_the_confusion_pairs_each_thing_once():
    cases = [
        perfect("nothing"),
        case("a", secret("nothing"), diagnosis(finding(COULOMB)), oracle()),
        case("b", secret("single", COULOMB), diagnosis(finding(DEAD_ZONE, COULOMB)), oracle(COULOMB)),
        case("c", secret("several", COULOMB, BACKLASH), diagnosis(finding(BACKLASH)), oracle(COULOMB, BACKLASH)),
        case("d", secret("single", COULOMB), diagnosis(finding(COULOMB), finding(CUBIC)), oracle(COULOMB)),
        case("e", secret("single", COULOMB), None, oracle(COULOMB)),
        case("f", secret("unknown"), diagnosis(finding(CUBIC)), oracle()),
        case("g", secret("single", BACKLASH), diagnosis(verdict="unexplained"), oracle(BACKLASH)),
    ]
    coulomb, backlash, cubic = (" ".join(k) for k in (COULOMB, BACKLASH, CUBIC))
    assert {(c.hidden, c.named): (c.count, c.within) for c in confusion(cases)} == {
        (NOTHING, NOTHING): (1, 0), (NOTHING, coulomb): (1, 0), (coulomb, "amplifier dead_zone"): (1, 1),
        (backlash, backlash): (1, 1), (coulomb, NOTHING): (1, 0), (coulomb, coulomb): (1, 1), (EXTRA, cubic): (1, 0),
        (coulomb, FAILED): (1, 0), (UNEXPLAINED, cubic): (1, 1), (backlash, UNEXPLAINED): (1, 0),
    }  # fmt: skip


def test_every_hidden_thing_stands_in_the_confusion():
    cases = proved.campaign(100)
    found = confusion(cases)
    things = sum(max(len(c.hidden), 1) for c in cases)
    assert sum(c.count for c in found if c.hidden != EXTRA) >= things
    assert len(confusion_rows(score(cases).confusion)) == len(found)
    rows = case_rows(list(reversed(cases)))
    assert list(rows["seed"]) == sorted(rows["seed"])
    assert rows.loc[rows["error"] != "", "right"].tolist() == [False]


def test_the_score_survives_its_file():
    found = score(proved.campaign(150), {"command": "dtb prove n=150"})
    again = Score.from_json(json.loads(json.dumps(json_able(found.to_json()))))
    assert markdown(again) == markdown(found)
    assert again.figures == found.figures
    assert again.bins == found.bins


def test_the_table_says_which_seeds_and_what_repeats_it():
    text = markdown(score(proved.campaign(30), {"command": "dtb prove n=30"}))
    assert "dtb prove n=30" in text
    assert "Scoring seeds 10000 to 10029" in text
    assert "at least 97 %" in text
    assert "Diagnoses that failed, and count as wrong: 1." in text
    assert "development seeds: the tool may have been tuned" in which_seeds(score([perfect("nothing", seed=7)]))
    mixed = [perfect("nothing", seed=9_999), perfect("nothing", seed=10_000)]
    assert "may have been tuned" in which_seeds(score(mixed))
    lost = score([case("a", secret("single", COULOMB), diagnosis(finding(COULOMB)), {"error": "no fit"}, 1.0)])
    assert (lost.oracle_failed, lost.figure("strict").of, lost.figure("strict").every_of) == (1, 0, 1)
    assert "because the oracle itself failed: 1" in markdown(lost)


def test_lifelike_recordings_have_figures_of_their_own():
    partial = {"confidence": "partial"}
    cases = [
        proved.lifelike(perfect("single", COULOMB), finding(COULOMB), finding(proved.COGGING)),
        proved.lifelike(perfect("single", BACKLASH), finding(BACKLASH) | partial, finding(CUBIC)),
        proved.lifelike(perfect("single", CUBIC), finding(DEAD_ZONE) | partial),
        proved.lifelike(perfect("nothing"), finding(proved.COGGING)),
        proved.lifelike(perfect("nothing"), finding(CUBIC)),
        proved.lifelike(perfect("unknown"), verdict="unexplained"),
    ]
    found = score(cases)
    counts = {f.name: (f.right, f.of) for f in found.figures}
    assert counts == {
        "main_named": (2, 3), "main_sure": (1, 2), "nothing_sure": (1, 2), "lifelike_no_false_name": (4, 6),
        "sure_right": (3, 5), "lifelike_coverage": (2, 2),
    }  # fmt: skip
    left = next(q for q in found.quantities if q.name == "left_extended")
    assert (left.median, left.of) == (pytest.approx(0.0025), 3)
    both = score([*cases, perfect("single", COULOMB)])
    assert (both.figure("strict").of, both.figure("main_named").of, both.lifelike) == (1, 3, 6)
    assert Score.from_json(json.loads(json.dumps(json_able(both.to_json())))).reliability == both.reliability
    assert "6 lifelike" in markdown(both)
    assert list(case_rows(cases)["beside"]) == [1] * 6


def test_reliability_counts_the_names_of_each_confidence():
    partial = {"confidence": "partial"}
    cases = [
        case("a", secret("single", COULOMB), diagnosis(finding(COULOMB), finding(BACKLASH) | partial), oracle(COULOMB)),
        case("b", secret("single", CUBIC), diagnosis(finding(DEAD_ZONE), finding(CUBIC) | partial), oracle(CUBIC)),
    ]
    assert reliability(cases) == [
        Reliability("sure", "all", 1, 2), Reliability("sure", "drive", 1, 2), Reliability("partial", "all", 1, 2),
        Reliability("partial", "transmission", 0, 1), Reliability("partial", "structure", 1, 1),
    ]  # fmt: skip
