"""Each rule on made-up answers and diagnoses, once where it holds and once for each way in which it can fail."""

from dataclasses import replace

import proved
import pytest
from proved import BACKLASH, COGGING, COULOMB, CUBIC, DEAD_ZONE, diagnosis, finding, oracle, perfect, secret

from dtbacklash.prove import rules
from dtbacklash.prove.rules import Case

ELSEWHERE = ("link_2", "cubic_stiffness")


def case(kind, hidden, *findings, **more):
    seen = oracle(*hidden)
    return Case("a", secret(kind, *hidden), diagnosis(*findings, **more), seen, 1.0)


@pytest.mark.parametrize(
    ("hidden", "found", "strict", "within"),
    [
        ([COULOMB], [finding(COULOMB)], True, True),
        ([COULOMB], [], False, False),
        ([COULOMB], [finding(DEAD_ZONE)], False, False),
        ([COULOMB], [finding(DEAD_ZONE, COULOMB)], False, True),
        ([COULOMB], [finding(COULOMB), finding(BACKLASH)], False, False),
        ([CUBIC], [finding(ELSEWHERE)], False, False),
        ([COULOMB, BACKLASH], [finding(BACKLASH), finding(COULOMB)], True, True),
        ([COULOMB, BACKLASH], [finding(BACKLASH)], False, False),
        ([COULOMB, BACKLASH], [finding(BACKLASH), finding(DEAD_ZONE, COULOMB)], False, True),
        # one finding may not stand for two effects, and its own name comes before what it may also be
        ([COULOMB, BACKLASH], [finding(DEAD_ZONE, COULOMB, BACKLASH)], False, False),
        ([COULOMB, DEAD_ZONE], [finding(DEAD_ZONE, COULOMB), finding(COULOMB, DEAD_ZONE)], True, True),
        ([COULOMB, DEAD_ZONE], [finding(DEAD_ZONE, COULOMB), finding(BACKLASH, DEAD_ZONE)], False, True),
    ],
)
def test_strict_and_within_the_stated_ambiguity(hidden, found, strict, within):
    judged = case("several" if len(hidden) > 1 else "single", hidden, *found)
    assert (rules.strict(judged), rules.within_ambiguity(judged)) == (strict, within)


@pytest.mark.parametrize(
    ("found", "unnamed", "right"),
    [
        (diagnosis(verdict="unexplained"), True, True),
        (diagnosis(finding(CUBIC) | {"confidence": "partial"}, verdict="unexplained"), True, True),
        (diagnosis(finding(CUBIC) | {"confidence": "sure"}, verdict="unexplained"), False, False),  # that is a name
        (diagnosis(finding(CUBIC)), False, False),  # the right place, but a law of the catalogue
        (diagnosis(finding(CUBIC) | {"confidence": "partial"}), True, True),  # no name to rely on, whatever the verdict
        (diagnosis(finding(COULOMB)), False, False),
        (diagnosis(), True, False),  # given no name, but not admitted either
        (None, False, False),
    ],
)
def test_unknown_physics_is_not_given_a_name(found, unnamed, right):
    judged = Case("a", secret("unknown"), found, oracle())
    assert (rules.unknown_unnamed(judged), rules.right(judged)) == (unnamed, right)


def test_unknown_physics_is_judged_where_its_true_law_beats_the_catalogue():
    beaten, same = (Case("a", secret("unknown"), diagnosis(), oracle(clear=clear)) for clear in (True, False))
    assert rules.beaten(beaten)
    assert not rules.beaten(same)
    assert rules.beaten(replace(same, diagnosis=None))


@pytest.mark.parametrize(
    ("kind", "hidden", "found", "without"),
    [
        ("single", [COULOMB], [finding(COULOMB)], True),
        ("single", [COULOMB], [], True),
        ("single", [COULOMB], [finding(DEAD_ZONE, COULOMB)], True),
        ("single", [COULOMB], [finding(COULOMB), finding(BACKLASH)], False),
        ("single", [COULOMB], [finding(COULOMB), finding(DEAD_ZONE, COULOMB)], False),
        ("single", [CUBIC], [finding(ELSEWHERE)], False),
        ("nothing", [], [finding(COULOMB)], False),
        ("unknown", [], [finding(CUBIC)], False),
    ],
)
def test_a_false_name_is_one_that_pairs_with_nothing_hidden(kind, hidden, found, without):
    assert rules.no_false_name(case(kind, hidden, *found)) == without
    unsure = [one | {"confidence": "partial"} for one in found]
    assert rules.no_false_name(case(kind, hidden, *unsure, verdict="unexplained"))
    assert rules.no_false_name(case(kind, hidden, *unsure))
    assert rules.no_false_name(case(kind, hidden, *found, verdict="unexplained")) == without


@pytest.mark.parametrize(("found", "relied_on"), [
    ([finding(DEAD_ZONE, COULOMB) | {"confidence": "one_of"}], True),
    ([finding(DEAD_ZONE, BACKLASH) | {"confidence": "one_of"}], False),
    ([finding(COULOMB), finding(DEAD_ZONE, COULOMB) | {"confidence": "one_of"}], False),  # one hidden, two names
])  # fmt: skip
def test_one_of_several_is_right_if_the_truth_is_in_it(found, relied_on):
    judged = case("single", [COULOMB], *found)
    assert rules.no_false_name(judged) == relied_on
    assert rules.right_names(judged) == (set(range(len(found))) if relied_on else {0} & judged.matching.exact)
    assert rules.said_with_certainty(judged) == (relied_on or len(found) > 1)
    assert not rules.said_with_certainty(case("single", [COULOMB], *found, verdict="unexplained"))


def test_a_table_among_several_is_physics_that_the_catalogue_lacks():
    place = secret("unknown")["unknown"]["location"]
    for table, right in (((place, "speed_table"), True), (("gear", "speed_table"), False), (COULOMB, False)):
        judged = Case("a", secret("unknown"), diagnosis(finding(CUBIC, table) | {"confidence": "one_of"}), oracle())
        assert rules.no_false_name(judged) is right
        assert rules.unknown_unnamed(judged)  # it is no sure name


def test_a_table_is_what_the_catalogue_lacks_at_its_place():
    place = secret("unknown")["unknown"]["location"]
    told = [finding(CUBIC) | {"location": where, "effect": "speed_table"} for where in (place, "gear", "mass_3")]
    small = {"machine": "lifelike", "beside": [{"location": "mass_3", "name": "creep"}]}
    judged = Case("a", secret("unknown") | small, diagnosis(*told), oracle())
    assert rules.right_names(judged) == {0, 2}
    assert judged.matching.false == {1}


@pytest.mark.parametrize(
    ("found", "right"),
    [
        (diagnosis(), True),
        (diagnosis(k=(9300.0, 9000.0, 9600.0)), True),
        (diagnosis(finding(COULOMB)), False),
        (diagnosis(verdict="unexplained"), False),
        (None, False),
    ],
)
@pytest.mark.parametrize("kind", ["nothing", "parameters"])
def test_no_physics(kind, found, right):
    judged = Case("a", secret(kind), found, oracle())
    assert rules.no_physics(judged) is right
    assert rules.right(judged) is right


@pytest.mark.parametrize(
    ("found", "right"),
    [
        (diagnosis(verdict="unexplained"), True),
        (diagnosis(verdict="unexplained", located="gear"), True),
        (diagnosis(finding(CUBIC)), True),
        (diagnosis(finding(CUBIC), finding(ELSEWHERE)), False),
        (diagnosis(finding(ELSEWHERE), located="link_1"), False),
        (diagnosis(finding(ELSEWHERE)), False),
        (diagnosis(), False),
        (diagnosis(k=(1.0, 0.9, 1.1)), False),
        (None, False),
    ],
)
def test_unknown_physics_is_admitted_or_located(found, right):
    assert rules.unknown_admitted(Case("a", secret("unknown"), found, oracle())) is right


def test_a_failed_diagnosis_is_never_right():
    for kind, hidden in (("nothing", []), ("parameters", []), ("single", [COULOMB]), ("unknown", [])):
        judged = Case("a", secret(kind, *hidden), None, oracle(*hidden, extended=None), None, "died")
        assert not rules.right(judged)
        assert not rules.within_ambiguity(judged)
        assert rules.error_ratio(judged) == float("inf")
        assert judged.verdict == "failed"
        assert not rules.no_false_name(judged)


def test_clear_means_that_the_oracle_sees_every_effect():
    seen = case("several", [COULOMB, BACKLASH])
    assert rules.clear(seen)
    seen.oracle["clear"]["gear.backlash"] = False
    assert not rules.clear(seen)
    assert not rules.clear(replace(seen, oracle={"error": "it failed"}))
    assert rules.clear(Case("a", secret("nothing"), diagnosis(), {}))


@pytest.mark.parametrize(("size", "clear"), [(2.9, False), (3.0, True)])
def test_unknown_physics_is_clear_by_its_size(size, clear):
    assert rules.clear(Case("a", secret("unknown", size=size), diagnosis(), {})) is clear


def test_intervals_count_only_of_what_was_named_exactly():
    judged = case("several", [COULOMB, COGGING], finding(DEAD_ZONE, COULOMB), finding(COGGING, off=0.02, width=0.01))
    assert rules.effect_intervals(judged) == [False, False, False]
    judged = case("several", [COULOMB, COGGING], finding(COULOMB), finding(COGGING))
    assert rules.effect_intervals(judged) == [True] * 4


def test_recalibrated_parameters_count_where_the_structure_is_right():
    off, held = (10000.0, 9900.0, 10100.0), (9310.0, 9290.0, 9330.0)
    judged = Case("a", secret("parameters"), diagnosis(k=held, m=(1.01e4, 1.0e4, 1.02e4)), oracle())
    assert rules.nominal_intervals(judged) == [True, True]  # m is at its nominal value, 1e4 in this made-up rig
    assert rules.nominal_intervals(replace(judged, diagnosis=diagnosis(k=off))) == [False]
    assert rules.nominal_intervals(replace(judged, diagnosis=diagnosis(finding(COULOMB), k=held))) == []
    assert rules.nominal_intervals(Case("a", secret("unknown"), diagnosis(k=held), oracle())) == []


@pytest.mark.parametrize(
    ("found", "count"),
    [((9310.0, 9290.0, 9330.0), 1), ((9400.0, 9390.0, 9410.0), 0), (None, 0)],
)
def test_the_right_parameter_is_recalibrated(found, count):
    judged = perfect("parameters")
    judged = replace(judged, diagnosis=diagnosis(k=found) if found else diagnosis())
    assert rules.right_parameters(judged) == [bool(count)]
    unclear = replace(judged, oracle={"clear_parameters": {"k": False}})
    assert rules.right_parameters(unclear) == []


def test_a_finding_without_an_effect_names_nothing():
    somewhere = {**finding(COULOMB), "effect": None}
    judged = case("single", [COULOMB], somewhere, verdict="unexplained")
    assert judged.named == []
    assert not rules.no_physics(replace(judged, secret=proved.secret("nothing")))


def test_a_parameter_that_takes_an_effects_place_and_says_so_is_within_the_ambiguity():
    said = diagnosis(k=(9310.0, 9290.0, 9330.0))
    judged = replace(case("single", [COULOMB]), diagnosis=said)
    assert not rules.within_ambiguity(judged)
    said["recalibrated"]["k"]["also_fits"] = [{"location": COULOMB[0], "effect": COULOMB[1]}]
    assert rules.within_ambiguity(judged)
    assert not rules.strict(judged)
    assert not rules.within_ambiguity(replace(judged, diagnosis={**said, "findings": [finding(DEAD_ZONE)]}))
    assert not rules.within_ambiguity(replace(judged, secret=secret("several", COULOMB, COGGING)))


def lifelike(kind, hidden, *findings, beside=(COGGING,), akin=()):
    """A case with small things of the catalogue, and one outside of it."""
    small = [{"location": p, "effect": e, "parameters": {}, "visibility": 5.0} for p, e in beside]
    small.append({"location": "mass_3", "name": "creep", "visibility": 5.0, "akin": [list(key) for key in akin]})
    told = secret(kind, *hidden) | {"machine": "lifelike", "beside": small, "beside_visibility": 7.0}
    return replace(case(kind, hidden, *findings), secret=told)


PARTIAL, ONE_OF = {"confidence": "partial"}, {"confidence": "one_of"}
HELD = ("mass_3", "ground_friction")


@pytest.mark.parametrize(
    ("found", "named", "surely", "without_false"),
    [
        ([finding(COULOMB)], True, True, True),
        ([finding(COULOMB), finding(COGGING)], True, True, True),  # a small thing is right, too
        ([finding(COULOMB) | PARTIAL, finding(COGGING)], True, False, True),
        ([finding(DEAD_ZONE, COULOMB)], True, True, True),
        ([finding(COGGING)], False, False, True),
        ([finding(COULOMB), finding(CUBIC)], True, True, False),
        ([finding(COULOMB), finding(CUBIC) | PARTIAL], True, True, True),
        ([finding(COULOMB), finding(COULOMB) | {"location": HELD[0], "effect": HELD[1]}], True, True, True),
        ([finding(DEAD_ZONE, COULOMB) | ONE_OF], True, True, True),
        ([finding(DEAD_ZONE, CUBIC) | ONE_OF], False, False, False),
        ([finding(DEAD_ZONE, COGGING) | ONE_OF], False, False, True),
        ([], False, False, True),
    ],
)
def test_beside_small_things_the_main_one_is_named(found, named, surely, without_false):
    judged = lifelike("single", [COULOMB], *found, akin=[HELD])
    assert (rules.main_named(judged), rules.main_sure(judged)) == (named, surely)
    assert rules.no_false_name(judged) is without_false
    assert rules.right(judged) is (named and without_false)
    assert not rules.main_named(replace(judged, diagnosis=None))


def test_the_right_names_are_those_that_are_there():
    judged = lifelike("single", [COULOMB], finding(CUBIC), finding(COGGING), finding(COULOMB), finding(BACKLASH))
    assert rules.right_names(judged) == {1, 2}
    assert rules.right_names(lifelike("nothing", [], finding(COGGING))) == {0}
    assert rules.right_names(case("single", [COULOMB], finding(COGGING))) == set()


def test_what_is_explained_is_a_share_of_the_recalibrated_mean_square():
    judged = lifelike("single", [COULOMB], finding(COULOMB))
    judged.oracle["held_out"] = {"recalibrated": 20.0, "extended": 4.0, "oracle": 2.0}
    assert rules.explained(judged, "extended") == pytest.approx(0.96)
    assert rules.explained(judged, "oracle") == pytest.approx(0.99)
    judged.oracle["held_out"]["extended"] = None
    assert rules.explained(judged, "extended") == 0.0
