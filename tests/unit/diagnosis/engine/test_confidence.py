"""What a name rests on: rivals in its place, in three views."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis.engine.confidence import ConfidenceTest, JudgedModel, Rival, _certainty, confidence_set
from dtbacklash.diagnosis.engine.horizons import VIEWS
from dtbacklash.diagnosis.engine.parameters import Key
from dtbacklash.diagnosis.engine.selection import StepwiseSelection

from .conftest import command, recorded, segments_of

COULOMB, GAIN = ("disk", "coulomb_friction"), ("sensor_omega", "gain_error")


@cache
def judged(key: Key, **values: float) -> tuple[StepwiseSelection, JudgedModel]:
    """The end of a search on a short recording of a pendulum with one effect."""
    rig, u = nominal_rig("pendulum"), command(6.0, 0.4)
    search = StepwiseSelection(segments_of(rig, u, recorded(rig.with_effect(*key, values), u)))
    search.run()
    return search, ConfidenceTest(search).judged()


def test_a_name_that_leads_every_rival_is_sure():
    search, found = judged(COULOMB, torque=0.02)
    assert found.model is search.now
    assert found.model.keys == (COULOMB,)
    assert found.certainty == {COULOMB: "sure"}
    rivals = found.rivals[COULOMB]
    assert rivals[0].keys == ()  # nothing in its place
    for rival in rivals:
        assert set(rival.t) == set(VIEWS)
        assert rival.beaten
        assert rival.least == min(rival.t.values()) > search.rules.min_t
        assert rival.lead > 1000.0
        assert rival.agree > 0.9
        assert rival.ratio > 10.0
    # the name explains all, and no table adds to it; without it one over speed comes nearest
    assert found.explains[COULOMB] == pytest.approx(rivals[0].lead)
    assert found.adds[COULOMB] < 0.01
    assert found.tables[COULOMB][0].keys == (("disk", "speed_table"),)
    assert all(p.gain < 0.01 * found.explains[COULOMB] for p in found.rest)


def test_a_gain_that_another_sensors_gain_explains_as_well_is_one_of_the_two():
    """Of a speed beside a position: which of the two is wrong, nothing tells but the priors, by next to nothing."""
    _, found = judged(GAIN, relative=0.05)
    assert found.model.keys == (GAIN,)
    alone, other = found.rivals[GAIN]
    assert alone.keys == ()
    assert alone.beaten
    assert other.keys == (("sensor_theta", "gain_error"),)
    assert abs(other.lead) < 20.0
    assert other.ratio == pytest.approx(1.0, abs=0.01)
    assert not other.beaten
    assert found.certainty == {GAIN: "one_of"}


@pytest.mark.parametrize(("rig", "laws", "law", "held"), [
    *(("pendulum", (f"disk.{table}",), "disk.coulomb_friction", True)
      for table in ("speed_table", "position_table", "position_damping_table", "stribeck_friction")),
    ("pendulum", ("disk.coulomb_friction",), "disk.stribeck_friction", False),
    ("pendulum", ("disk.viscous_friction",), "disk.coulomb_friction", False),
    ("pendulum", ("disk.gravity",), "disk.coulomb_friction", False),
    ("pendulum", ("disk.cogging",), "disk.asymmetric_friction", False),  # of the position, and of the speed
    ("pendulum", ("disk.stribeck_friction", "disk.speed_table"), "disk.coulomb_friction", False),
    ("oscillator", ("spring.hysteresis",), "spring.dry_friction", True),  # which it becomes
    ("oscillator", ("spring.dry_friction",), "spring.hysteresis", False),
    *(("rotary_drive", (f"load.{table}",), f"{place}.coulomb_friction", place == "load")
      for table in ("speed_table", "stribeck_friction") for place in ("load", "motor_rotor")),
    ("rotary_drive", (), "load.coulomb_friction", False),
])  # fmt: skip
def test_a_law_is_held_by_tables_of_its_place_and_by_what_has_it_as_a_special_case(rig, laws, law, held):
    judge = object.__new__(ConfidenceTest)
    judge.model = SimpleNamespace(rig=nominal_rig(rig))
    assert judge._contains(tuple(tuple(one.split(".")) for one in laws), tuple(law.split("."))) == held


def test_what_leads_all_but_laws_that_fit_alike_is_one_of_these():
    def rival(beaten: bool, *keys: Key, ahead: bool = False) -> Rival:
        return Rival(keys, None, 0.0, dict.fromkeys(VIEWS, 1.0), 1.0, 1.0, False, beaten, ahead)

    bare, other, away = rival(True), ("disk", "viscous_friction"), ("sensor_theta", "delay")
    assert _certainty(COULOMB, [bare, rival(True, other), rival(True, away)], False) == "sure"
    assert _certainty(COULOMB, [bare, rival(True, other)], True) == "one_of"
    assert _certainty(COULOMB, [bare, rival(False, other), rival(True, away)], False) == "one_of"
    assert _certainty(COULOMB, [bare, rival(False, away)], False) == "one_of"
    assert _certainty(COULOMB, [bare, rival(False, other, ahead=True)], False) == "one_of"
    assert _certainty(COULOMB, [bare, rival(False, away, ahead=True)], False) == "partial"  # neither is right
    assert _certainty(COULOMB, [bare, rival(False, other, away)], False) == "partial"
    assert _certainty(COULOMB, [rival(False), rival(True, other)], False) == "partial"
    pair = rival(False, other, away)  # what one of the two does alone
    assert confidence_set([bare, rival(False, away), pair]) == [rival(False, away)]
    assert _certainty(COULOMB, [bare, rival(False, away), pair], False) == "one_of"


def test_a_name_that_loses_to_the_rig_without_it_leaves():
    """A delay that fits shrink to nothing explains nothing at a long horizon, and leaves; friction stays."""
    search, found = judged(COULOMB, torque=0.02)
    idle = ("sensor_theta", "delay")
    rig = found.model.rig.with_effect(*idle, {"time": 2e-3})
    before = search.now
    search.now = replace(found.model, rig=rig, keys=(*found.model.keys, idle), counts=found.model.counts + 1.0)
    again = ConfidenceTest(search).judged()
    assert again.model.keys == (COULOMB,)
    assert search.now is again.model
    assert again.model.rig.effects["disk"]["coulomb_friction"]["torque"] == pytest.approx(0.02, rel=0.02)
    search.now = before


def test_a_rejected_name_is_no_simpler_law():
    """Else it leaves, comes back as what another law becomes, and leaves for ever."""
    search, found = judged(COULOMB, torque=0.02)
    before, stribeck = search.now, ("disk", "stribeck_friction")
    rig = found.model.rig.with_effect(*COULOMB, None).with_effect(*stribeck, {"torque": 0.02, "speed": 1e-3})
    search.now = search.fitted(rig, found.model, (stribeck,))
    assert search._simpler(stribeck).keys == (COULOMB,)
    search.rejected.add(COULOMB)
    assert search._simpler(stribeck) is None
    search.now = before
    search.rejected.clear()
