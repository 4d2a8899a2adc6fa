"""A gain that is off by a factor is found before anything is searched, and what else is missing is none."""

import numpy as np
import pandas as pd
import pytest
from nominal import nominal_rig

import dtbacklash as dtb
from dtbacklash.diagnosis.engine.scale_errors import begin, numbers_suspected
from dtbacklash.diagnosis.engine.selection import StepwiseSelection
from dtbacklash.diagnosis.settings import SETTINGS

from .conftest import STEP_S, command, recorded, segments_of

DRY = ("disk", "coulomb_friction", {"torque": 0.02})
#: rig, what it has and the nominal one lacks, parameters that are off, channel -> what it is multiplied by
MISCOUNTED = {
    "four times the lines": ("two_mass_stage", None, {}, {"x_t": 4.0}),
    "a quarter, and friction": ("two_mass_stage", ("carriage", "coulomb_friction", {"force": 3.0}), {}, {"x_c": 0.25}),
    "a tenth of a speed": ("pendulum", DRY, {}, {"omega": 0.1}),
}
OTHERWISE = {
    "friction": ("pendulum", DRY, {}, {}),
    "an amplifier that clips": ("pendulum", ("amplifier", "saturation", {"limit": 0.15}), {}, {}),
    "a wrong inertia": ("two_mass_stage", None, {"m_t": 10.0}, {}),
    "a wrong stiffness": ("two_mass_stage", None, {"k": 0.25}, {}),
    "a sensor that the rig does better without": ("pendulum", DRY, {}, {"omega": "noise"}),
    "a wrong drive": ("pendulum", DRY, {"K_t": 0.1}, {}),
}


def measured(case):
    name, law, off, factors = case
    rig = true = nominal_rig(name)
    true = true.with_effect(*law) if law else true
    true = true.with_parameters({n: f * rig.config.parameters[n].value for n, f in off.items()})
    u = command(8.0, 0.4 if name == "pendulum" else 1.0)
    noise = np.random.default_rng(3).normal(size=len(u))
    read = recorded(true, u).items()
    return rig, u, {c: noise * y if (by := factors.get(c, 1.0)) == "noise" else by * y for c, y in read}


@pytest.mark.parametrize("case", [*MISCOUNTED, *OTHERWISE])
def test_a_search_begins_with_a_gain_only_where_nothing_else_is_wrong(case):
    rig, u, y = measured({**MISCOUNTED, **OTHERWISE}[case])
    search = StepwiseSelection(segments_of(rig, u, y))
    found = begin(search.quick, SETTINGS)
    if case in OTHERWISE:
        assert found is None
        return
    assert found is not None
    ((channel, factor),) = MISCOUNTED[case][3].items()
    assert found.key == (f"sensor_{channel}", "gain_error")
    assert found.factor == pytest.approx(factor)
    begun = StepwiseSelection(search.segments, begin=found).now
    assert begun.keys == (found.key,)
    assert begun.rig.effect(*found.key)["relative"] == pytest.approx(factor - 1.0, rel=0.02)


@pytest.mark.parametrize(("off", "suspected"), [({}, set()), ({"J": 10.0}, {"J", "K_t"})])
def test_a_number_is_suspected_only_where_it_does_better_than_what_was_found(off, suspected):
    """Friction alone: no typo explains more. A wrong inertia beside it: no friction explains more."""
    rig, u, y = measured(("pendulum", DRY, off, {}))
    search = StepwiseSelection(segments_of(rig, u, y))
    key = DRY[:2]
    model = search.fitted(search.nothing.rig.with_effect(*DRY), search.nothing, (key,), (0.1, 0.1, 1.0), 5)
    sizes = search.segments.of_first(model.noise_levels)
    found = numbers_suspected(search.quick, sizes, model, search.motion, SETTINGS, search.segments.nominal)
    assert {one.key[1] for one in found} == suspected
    assert all(abs(np.log10(one.factor)) == pytest.approx(1.0) for one in found)


def diagnosed(case):
    rig, u, y = measured(case)
    frame = pd.DataFrame({"t": STEP_S * np.arange(len(u)), "u": u, **y})
    return dtb.diagnose(dtb.Recording.from_frame(frame, rig=rig), rig).diagnosis


@pytest.mark.check
def test_a_wrong_number_of_lines_is_one_cause_beside_friction():
    found = diagnosed(MISCOUNTED["a quarter, and friction"])
    named = {(f.location, f.effect): f for f in found.findings}
    assert found.verdict == "missing_physics"
    assert set(named) == {("sensor_x_c", "gain_error"), ("carriage", "coulomb_friction")}
    lines = named["sensor_x_c", "gain_error"]
    assert lines.confidence == "sure"
    assert "reads 1/4 of what is there, as with a wrong number of lines" in lines.sentence
    assert named["carriage", "coulomb_friction"].parameters["force"].value == pytest.approx(3.0, rel=0.02)


@pytest.mark.check
def test_where_a_number_of_the_rig_does_the_same_it_is_said_first_and_no_size_is_sure():
    """Only the ratio of drive, inertia and friction shows: J may be ten times what it says, or K_t a tenth."""
    found = diagnosed(("pendulum", DRY, {"J": 10.0}, {}))
    assert found.verdict == "unexplained"
    assert "`J` fits ten times its value" in found.suspected
    assert "`K_t` fits a tenth of its value" in found.suspected
    assert found.summary.startswith(found.suspected)
    assert not [f for f in found.findings if f.confidence == "sure"]
