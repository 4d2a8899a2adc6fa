"""How the error falls when the step is refined."""

import numpy as np
import pytest
from reference.cases import SAMPLE_TIME_S, problems
from reference.store import stored

from dtbacklash.physics.simulate import simulate

SUBSTEPS = (1, 2, 4, 8, 16)


def errors_of(name: str) -> np.ndarray:
    """The largest error for each number of substeps."""
    problem = problems()[name]
    ((sensor, truth),) = stored(problem).channels.items()
    runs = (simulate(problem.rig, problem.u, SAMPLE_TIME_S, problem.gap, substeps=n).sensors[sensor] for n in SUBSTEPS)
    return np.array([np.abs(run - truth).max() for run in runs])


def test_second_order_with_smooth_forces() -> None:
    error = errors_of("smooth")
    order = np.log2(error[:-1] / error[1:])
    assert error[0] > 1e-8  # far above rounding, or the ratios would mean nothing
    assert np.all(np.abs(order - 2.0) < 0.1), order


def test_second_order_with_smooth_forces_behind_a_backlash() -> None:
    error = errors_of("smooth behind a backlash")
    order = np.log2(error[:-1] / error[1:])
    assert np.all(order > 1.5), order
    assert 1.8 < np.log2(error[0] / error[-1]) / 4.0 < 2.2, error


def test_the_linear_rig_with_backlash_does_not_depend_on_the_substeps() -> None:
    # a contact's place: 15 ns at 30 rad/s through the lead, 1.5e-10 m
    error = errors_of("linear behind a backlash")
    assert np.all(error < 1.5e-10), error


@pytest.mark.parametrize("levels", [6, 10, 14])
def test_a_contact_is_located_to_the_stated_tick(levels: int) -> None:
    """The screw's angle is wrong by at most what the motor turns in a tick."""
    problem = problems()["contact"]
    truth = stored(problem)
    got = simulate(problem.rig, problem.u, SAMPLE_TIME_S, problem.gap, event_levels=levels)
    speed = np.abs(np.diff(truth.channels["theta_m"])).max() / SAMPLE_TIME_S
    tick = SAMPLE_TIME_S / 2**levels
    lead = problem.rig.elements["screw"].values["lead"]
    error = np.abs(got.sensors["q3"] - truth.channels["q3"]).max()
    assert error < 2.0 * speed * tick * lead * truth.events
