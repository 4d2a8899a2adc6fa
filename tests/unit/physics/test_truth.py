"""The compiled simulation against the kept solutions of ``tests/reference``, effect by effect."""

import numpy as np
import pytest
from numpy.typing import NDArray
from reference.cases import FORCE_DRIVEN, SAMPLE_TIME_S, gaps, places, problems
from reference.store import stored

from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

Array = NDArray[np.float64]

#: The largest error of q3: 1e-4 mm. The strokes here are 2 to 3 mm, so it is 4e-5 of the stroke.
Q3_M = 1e-7
#: The same at the screw's end: 1e-7 m over the lead.
THETA_RAD = Q3_M / 3.183e-4
#: The current follows the speed within a few samples (k_B/R = 8 mA s/rad): a fourth of a degree per second of error,
#: or a friction that lets go a tick late, is 1 mA for 0.1 ms where currents are 100 mA.
CURRENT_A = 1e-3
#: Rigs without a screw: the same share of the stroke, 4e-5.
SHARE = 4e-5


def bounds(rig: Rig, truth: dict[str, Array]) -> dict[str, float]:
    """The largest error allowed, by sensor."""
    known = {"q3": Q3_M, "q2": Q3_M, "theta_m": THETA_RAD, "i_m": CURRENT_A}
    return {name: known.get(name, SHARE * float(np.ptp(truth[name]))) for name in rig.sensors}


def errors(got: dict[str, Array], truth: dict[str, Array]) -> dict[str, float]:
    return {name: float(np.abs(got[name] - truth[name]).max()) for name in truth}


def too_large(found: dict[str, float], allowed: dict[str, float]) -> dict[str, str]:
    return {n: f"{e:.1e} > {allowed[n]:.1e}" for n, e in found.items() if not e < allowed[n]}


def agrees_and_shows(problem_name: str) -> None:
    """The simulation agrees with the reference, and the rig without the effect does not by far."""
    problem = problems()[problem_name]
    truth, u, gap = stored(problem).channels, problem.u, problem.gap
    allowed = bounds(problem.rig, truth)
    plain = errors(simulate(problem.without, u, SAMPLE_TIME_S, gap).sensors, truth)
    assert any(plain[s] > 10.0 * allowed[s] for s in allowed), f"nothing to see: {plain}"
    found = errors(simulate(problem.rig, u, SAMPLE_TIME_S, gap).sensors, truth)
    assert not too_large(found, allowed), too_large(found, allowed)


# a table is compared with the laws that it stands for, in test_table.py
@pytest.mark.parametrize(("kind", "name", "place"), [p for p in places() if not CATALOGUE[p[:2]].is_table])
def test_every_effect_is_simulated_as_newton_would(kind: str, name: str, place: str) -> None:
    assert place, f"{kind}.{name} has no case in tests/reference/cases.py"
    agrees_and_shows(f"{place} {name}")


@pytest.mark.parametrize(("place", "name"), [one[:2] for one in FORCE_DRIVEN])
def test_effects_of_a_force_driven_oscillator(place: str, name: str) -> None:
    agrees_and_shows(f"oscillator {place} {name}")


@pytest.mark.parametrize("shape", gaps())
def test_the_linear_rig_is_exact_however_the_gap_changes(shape: str) -> None:
    problem = problems()[f"gap {shape}"]
    truth = stored(problem).channels
    got = simulate(problem.rig, problem.u, SAMPLE_TIME_S, problem.gap)
    # what is left is the contact's place: Ts/2^16 = 15 ns at 30 rad/s is 5e-7 rad, 1.5e-10 m
    found = errors(got.sensors | {"theta_d": got.theta_d_rad}, truth)
    assert found["q3"] < 1e-9
    assert found["theta_m"] < 1e-8
    assert found["theta_d"] < 1e-6


def test_effects_together() -> None:
    problem = problems()["together"]
    truth = stored(problem).channels
    found = errors(simulate(problem.rig, problem.u, SAMPLE_TIME_S, problem.gap).sensors, truth)
    assert found["q3"] < Q3_M
    assert found["theta_m"] < THETA_RAD


def test_twenty_seconds_of_the_papers_rig_in_closed_loop() -> None:
    """Voltages up to 146 V that change every millisecond, a gap that grows from 0 to 100 degrees."""
    problem = problems()["twenty seconds"]
    truth = stored(problem)
    got = simulate(problem.rig, problem.u, SAMPLE_TIME_S, problem.gap)
    assert truth.events >= 8
    assert np.ptp(truth.channels["q3"]) > 2e-3
    assert errors(got.sensors, truth.channels)["q3"] < Q3_M
