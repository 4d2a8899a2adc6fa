"""Models compared over stretches at several horizons: leads in standard errors, clipped, whitened."""

import numpy as np
import pytest
from nominal import nominal_rig
from scipy.signal import lfilter

from dtbacklash.diagnosis.engine.fit import FitProblem
from dtbacklash.diagnosis.engine.horizons import (
    CLIPPED,
    FOLLOWS,
    LONG,
    LONGER,
    ORDER,
    SHORT,
    STRETCHES,
    VIEWS,
    Horizons,
    _t,
    _whitening,
)
from dtbacklash.diagnosis.engine.motion import motion_of

from .conftest import command, recorded, segments_of


@pytest.mark.parametrize("torque", [0.0, 0.2])
def test_the_long_horizon_is_as_long_as_the_model_follows(torque):
    """A drive whose load hangs on nothing loses its phase under gravity: it is judged at a shorter horizon."""
    truth, u = nominal_rig("rotary_drive"), command(12.0, 1.0)
    hidden = truth.with_effect("load", "gravity", {"torque": torque, "phase": 0.3}) if torque else truth
    rig = hidden.with_effect("load", "gravity", {"torque": torque, "phase": 0.31}) if torque else truth
    segments = segments_of(truth, u, recorded(hidden, u))
    keys = (("load", "gravity"),) if torque else ()
    sizes, _ = segments.tuned(rig)
    motion = motion_of(segments, rig, segments.gains(rig, sizes))
    model = FitProblem(segments, rig, keys, motion).homotopy_fit(sizes, None, (1.0,))
    found = Horizons(segments, motion, model)
    assert set(found.reference.views) == set(VIEWS)
    assert found.reference.views[LONG].sum() <= FOLLOWS * found.reference.views[SHORT].sum() * (1.0 + 1e-9)
    assert found.shares == LONGER[: len(found.shares)]
    again = found.squares(model)
    assert all(np.allclose(again.views[view], found.reference.views[view], rtol=1e-3) for view in VIEWS)


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
    assert len(f) == ORDER + 1
    white = lfilter(f, [1.0], coloured)[100:]
    assert white.std() == pytest.approx(1.0, rel=0.02)
    assert f[1:3] / f[0] == pytest.approx([-1.6, 0.8], abs=0.04)
    near = [np.corrcoef(white[:-k], white[k:])[0, 1] for k in range(1, 6)]
    assert np.abs(near).max() < 0.03
    assert np.array_equal(_whitening(np.zeros(1000)), np.ones(1))
