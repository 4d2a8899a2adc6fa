"""Springs that remember: followed however far a step moves them."""

import numpy as np
import pytest
import ringing

from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.kernel.dispatch import CODES
from dtbacklash.physics.kernel.memory import remembered
from dtbacklash.physics.simulate import simulate

BOUC_WEN = CODES["link", "hysteresis"]
REACH = 1e-3


def come_to(z: float, change: float) -> float:
    """Bouc and Wen's variable after a stretch that only grows or only shrinks, in closed form."""
    up = 1.0 if change > 0.0 else -1.0
    z, far = up * z, abs(change) / REACH
    free = min(far, max(-z, 0.0))
    z += free
    return up * (1.0 - (1.0 - z) * np.exp(-(far - free)) if far > free else z)


@pytest.mark.parametrize("z", [-1.0, -0.3, 0.0, 0.6, 1.0])
@pytest.mark.parametrize("change", [1e-9, -4e-5, 3e-4, -2e-3, 7e-3, -0.5, 40.0])
def test_a_memory_follows_the_stretch_however_far_it_goes_in_a_step(z, change):
    parameters = np.array([[2.0, REACH]])
    assert remembered(BOUC_WEN, parameters, 0, z, 0.1, change, 1e-3) == pytest.approx(come_to(z, change), abs=5e-3)
    assert remembered(BOUC_WEN, parameters, 0, z, 0.1, 0.0, 1e-3) == z


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


def test_the_hysteretic_spring_takes_energy_and_gives_none():
    rig = ringing.known(ringing.blade())
    u = np.zeros(4000)
    u[:20] = 1.0
    held = {"force": 0.05, "displacement": 1e-6}
    swings = {
        name: simulate(machine, u, 1e-3).sensors["x_1"]
        for name, machine in (("plain", rig), ("hysteretic", rig.with_effect("foot", "hysteresis", held)))
    }
    late = slice(500, None)
    assert np.ptp(swings["hysteretic"][late]) < np.ptp(swings["plain"][late])
    assert np.ptp(swings["hysteretic"][2000:]) <= np.ptp(swings["hysteretic"][late])


def test_every_spring_with_a_memory_says_how_far_it_reaches():
    for kind in ("link", "shaft", "coupling"):
        effect = CATALOGUE[kind, "hysteresis"]
        assert effect.slot.named() == {"reach": "displacement"}
