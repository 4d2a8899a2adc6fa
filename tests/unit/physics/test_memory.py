"""Springs that remember: followed however far a step moves them."""

import numpy as np
import pytest
import ringing
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from dtbacklash.physics.effects.spring import bouc_wen_after
from dtbacklash.physics.simulate import simulate

REACH = 1e-3


def rate(z: float, up: float) -> float:
    """Bouc and Wen's equation over the stretch, for one that grows (1) or shrinks (-1)."""
    return (1.0 - 0.5 * up * z - 0.5 * abs(z)) / REACH


@pytest.mark.parametrize("z", [-1.0, -0.3, 0.0, 0.6, 1.0])
@pytest.mark.parametrize("change", [1e-9, -4e-5, 3e-4, -2e-3, 7e-3, -0.02])
def test_a_memory_follows_its_equation_over_the_stretch(z, change):
    solved = solve_ivp(
        lambda s, z: [rate(z[0], np.sign(change))], (0.0, change), [z], rtol=1e-10, atol=1e-12, max_step=REACH / 20
    )
    assert bouc_wen_after(z, change, REACH) == pytest.approx(solved.y[0, -1], abs=1e-7)


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.0, 1.0))
def test_two_parts_of_a_stretch_to_one_side_are_one(z, change, share):
    first = bouc_wen_after(z, share * change, REACH)
    assert bouc_wen_after(first, (1.0 - share) * change, REACH) == pytest.approx(
        bouc_wen_after(z, change, REACH), abs=1e-12
    )
    assert abs(first) <= 1.0


def test_a_memory_that_goes_nowhere_or_far():
    assert bouc_wen_after(0.3, 0.0, REACH) == 0.3
    assert bouc_wen_after(0.3, 40.0, REACH) == 1.0
    assert bouc_wen_after(0.3, -40.0, REACH) == -1.0


@pytest.mark.parametrize(("force", "displacement"), [(0.2, 2e-6), (2.0, 2e-6), (2.0, 2e-7)])
def test_few_steps_tell_what_many_tell(force, displacement):
    """Explicit forces would run away: it is far stiffer than the blade before it yields."""
    record = ringing.recorded(ringing.blade(), 41, 2000)
    effect = {"force": force, "displacement": displacement}
    rig = ringing.known(ringing.blade()).with_effect("foot", "hysteresis", effect)
    seen = {n: simulate(rig, record.u[:-1], record.sample_time_s, substeps=n).sensors for n in (2, 8, 512)}
    for name, finely in seen[512].items():
        errors = [float(np.std(seen[n][name] - finely) / np.std(finely)) for n in (2, 8)]
        assert errors[0] < 2e-2
        assert errors[1] < 0.3 * errors[0]
