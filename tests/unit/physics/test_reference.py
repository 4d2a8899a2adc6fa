"""The reference itself: converged, right where there is a closed form, and still what is kept of it."""

from dataclasses import replace

import numpy as np
import pytest
from reference import rigs, solve
from reference.cases import HOLD, SAMPLE_TIME_S, growing_gap, problems
from reference.store import quantum, solved, stored


def test_what_is_kept_of_another_rig_or_command_is_refused() -> None:
    problem = problems()["contact"]
    stored(problem)
    softer = replace(problem, rig=problem.rig.with_parameters({"k": 9000.0}))
    for other in (softer, replace(problem, u=1.01 * problem.u), replace(problem, gap=1.01 * problem.gap)):
        with pytest.raises(AssertionError, match="'contact' is missing or old: `make references`"):
            stored(other)


@pytest.mark.nightly
@pytest.mark.parametrize("name", problems())
def test_what_is_kept_is_what_the_reference_says(name: str) -> None:
    """Up to 64 units of the last digit that is kept, on any machine: 2e-7 of a channel's range, or less."""
    problem = problems()[name]
    kept, now = stored(problem), solved(problem)
    assert kept.events == now.events
    assert kept.channels.keys() == now.channels.keys()
    for channel, values in now.channels.items():
        assert np.abs(values - kept.channels[channel]).max() <= 64.0 * quantum(problem, values), channel


@pytest.mark.nightly
def test_the_reference_has_converged() -> None:
    """Two tolerances, a hundredfold apart, agree a thousand times better than what is asked of the simulation."""
    rig = rigs.lead_screw().with_effect("motor_bearing", "coulomb_friction", {"torque": 0.02})
    rig = rig.with_effect("link_1", "dry_friction", {"force": 0.2})
    u, gap = rigs.random_steps(1000, HOLD, 4.0), growing_gap()[:1001]
    coarse = solve(rig, u, SAMPLE_TIME_S, gap).sensors["q3"]
    fine = solve(rig, u, SAMPLE_TIME_S, gap, rtol=1e-12, atol=1e-13).sensors["q3"]
    assert np.abs(coarse - fine).max() < 1e-10  # m


def test_the_reference_against_a_closed_form() -> None:
    """A mass on a spring under a constant force: q = F/k (1 - e^{-zwt}(cos wd t + ...))."""
    rig = rigs.oscillator(damping=0.0).with_effect("mass_2", "ground_friction", {"force": 1e5})
    n, k, m, force = 1000, 4000.0, 1.0, 10.0  # both springs act on mass_1: mass_2 is held
    truth = solve(rig, np.full(n, force), SAMPLE_TIME_S)
    exact = force / k * (1.0 - np.cos(np.sqrt(k / m) * truth.t_s))
    assert np.abs(truth.sensors["q1"] - exact).max() < 1e-11
