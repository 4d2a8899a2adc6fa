"""What a name rests on: rivals in its place, in three views."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from nominal import nominal_rig
from scipy.signal import lfilter

from dtbacklash.diagnose.engine import judge as judging
from dtbacklash.diagnose.engine.free import Key
from dtbacklash.diagnose.engine.judge import CLIPPED, STRETCHES, VIEWS, Judge, Judged, _t, _whitening
from dtbacklash.diagnose.engine.search import Search

from .conftest import bench_of, command, recorded

COULOMB, GAIN = ("disk", "coulomb_friction"), ("sensor_omega", "gain_error")


@cache
def judged(key: Key, **values: float) -> tuple[Search, Judged]:
    """The end of a search on a short recording of a pendulum with one effect."""
    rig, u = nominal_rig("pendulum"), command(6.0, 0.4)
    search = Search(bench_of(rig, u, recorded(rig.with_effect(*key, values), u)))
    search.run()
    return search, Judge(search).judged()


def test_a_name_that_leads_every_rival_is_sure():
    search, found = judged(COULOMB, torque=0.02)
    assert found.model is search.now
    assert found.model.keys == (COULOMB,)
    assert found.sure == {COULOMB}
    rivals = found.rivals[COULOMB]
    assert rivals[0].keys == ()  # nothing in its place
    for rival in rivals:
        assert set(rival.t) == set(VIEWS)
        assert rival.beaten
        assert rival.least == min(rival.t.values()) > search.rules.lead
        assert rival.lead > 1000.0
        assert rival.agree > 0.9
        assert rival.ratio > 10.0
    # the name explains all, and no table adds to it; without it one over speed comes nearest
    assert found.explains[COULOMB] == pytest.approx(rivals[0].lead)
    assert found.adds[COULOMB] < 0.01
    assert found.tables[COULOMB][0].keys == (("disk", "speed_table"),)
    assert all(p.gain < 0.01 * found.explains[COULOMB] for p in found.rest)


def test_a_gain_that_another_sensors_gain_explains_as_well_is_not_sure():
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
    assert not found.sure


def contains(rig: str, place: str, *names: str) -> bool:
    """Whether the first law counts as one that holds the second."""
    judge = object.__new__(Judge)
    judge.model = SimpleNamespace(rig=nominal_rig(rig))
    return judge._contains(tuple((place, name) for name in names[:-1]), (place, names[-1]))


def test_a_law_is_held_by_tables_of_its_place_and_by_what_has_it_as_a_special_case():
    for table in ("speed_table", "position_table", "position_damping_table"):
        assert contains("pendulum", "disk", table, "coulomb_friction")
    assert contains("pendulum", "disk", "stribeck_friction", "coulomb_friction")
    assert not contains("pendulum", "disk", "coulomb_friction", "stribeck_friction")
    assert not contains("pendulum", "disk", "viscous_friction", "coulomb_friction")
    assert not contains("pendulum", "disk", "gravity", "coulomb_friction")
    assert contains("oscillator", "spring", "hysteresis", "dry_friction")  # which it becomes
    assert not contains("oscillator", "spring", "dry_friction", "hysteresis")


def test_two_laws_or_one_at_another_place_hold_none():
    assert not contains("pendulum", "disk", "stribeck_friction", "speed_table", "coulomb_friction")
    judge = object.__new__(Judge)
    judge.model = SimpleNamespace(rig=nominal_rig("rotary_drive"))
    for table in ("speed_table", "stribeck_friction"):
        assert not judge._contains((("load", table),), ("motor_rotor", "coulomb_friction"))
        assert judge._contains((("load", table),), ("load", "coulomb_friction"))
    assert not judge._contains((), ("load", "coulomb_friction"))


def test_a_law_of_the_position_holds_none_of_the_speed():
    assert not contains("pendulum", "disk", "cogging", "asymmetric_friction")


def test_differences_are_counted_in_standard_errors():
    d = np.random.default_rng(1).normal(5.0, 1.0, STRETCHES)
    assert _t(d) == pytest.approx(d.mean() / (d.std(ddof=1) / np.sqrt(STRETCHES)))
    assert _t(-d) == pytest.approx(-_t(d))
    assert abs(_t(d - d.mean())) < 0.5
    assert _t(100.0 * d) == pytest.approx(_t(d))


def test_one_stretch_does_not_decide():
    """Large differences count as so many times their median."""
    d = np.ones(STRETCHES) + 0.1 * np.arange(STRETCHES)
    wild = d.copy()
    wild[-1] = 1e6
    clipped = wild.copy()
    clipped[-1] = CLIPPED * np.median(wild)
    plain = wild.mean() / (wild.std(ddof=1) / np.sqrt(STRETCHES))
    assert _t(wild) == pytest.approx(clipped.mean() / (clipped.std(ddof=1) / np.sqrt(STRETCHES)))
    assert _t(wild) > 3.0 * plain
    # one that leads alone does not lead: the others' median is not above 0
    alone = -0.01 * np.ones(STRETCHES)
    alone[0] = 1e6
    assert _t(alone) < 1.5
    # what loses by far in one stretch is not helped
    lost = d.copy()
    lost[0] = -1e3
    assert _t(lost) == pytest.approx(lost.mean() / (lost.std(ddof=1) / np.sqrt(STRETCHES)))
    assert np.isfinite(_t(np.ones(STRETCHES)))
    assert _t(np.zeros(STRETCHES)) == 0.0


def test_a_signal_is_whitened_by_its_own_filter():
    e = np.random.default_rng(2).normal(size=20000)
    coloured = 3.0 * lfilter([1.0], [1.0, -1.6, 0.8], e)
    f = _whitening(coloured)
    assert len(f) == judging.ORDER + 1
    white = lfilter(f, [1.0], coloured)[100:]
    assert white.std() == pytest.approx(1.0, rel=0.02)
    assert f[1:3] / f[0] == pytest.approx([-1.6, 0.8], abs=0.04)
    near = [np.corrcoef(white[:-k], white[k:])[0, 1] for k in range(1, 6)]
    assert np.abs(near).max() < 0.03
    assert np.array_equal(_whitening(np.zeros(1000)), np.ones(1))
