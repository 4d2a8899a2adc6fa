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
    judge = object.__new__(Judge)
    judge.model = SimpleNamespace(rig=nominal_rig(rig))
    assert judge._contains(tuple(tuple(one.split(".")) for one in laws), tuple(law.split("."))) == held


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
