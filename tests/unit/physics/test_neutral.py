"""An effect at its neutral value changes nothing, to the last bit; a tiny one changes next to nothing."""

import numpy as np
import pytest
from catalogued import of_each_law_and_kind
from reference import rigs

from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import Response, simulate

SAMPLE_TIME_S, SAMPLES = 1e-3, 800
#: a table has a neutral value for each of its values
LAWS = [key for key in of_each_law_and_kind(CATALOGUE) if not CATALOGUE[key].is_table]
PLACES = {
    "amplifier": "amplifier", "motor_circuit": "motor_circuit", "rotor": "motor_bearing", "gear": "gear",
    "screw": "screw", "link": "link_2", "mass": "mass_2", "sensor": "sensor_theta_m", "carriage": "carriage",
    "coupling": "joint", "brake": "band", "shaft": "shaft", "gearbox": "teeth", "belt": "belt",
    "rack": "rack", "servo": "servo", "linear_servo": "drive", "actuator": "motor",
}  # fmt: skip
RIGS = {
    "carriage": rigs.carriage, "coupling": rigs.damper, "brake": rigs.damper, "shaft": rigs.two_inertias,
    "servo": rigs.served, "linear_servo": rigs.served_carriage, "actuator": rigs.carriage,
    "gearbox": rigs.geared, "belt": rigs.geared, "rack": lambda: rigs.geared("rack"),
}  # fmt: skip


def run(rig: Rig) -> Response:
    gap = np.full(SAMPLES + 1, 0.4) if rig.only("gear") else None
    return simulate(rig, rigs.random_steps(SAMPLES, 25, 5.0), SAMPLE_TIME_S, gap)


def busy_lead_screw() -> Rig:
    """Nonlinear already, so that the forces' code runs with and without the neutral effect."""
    rig = rigs.lead_screw().with_effect("link_1", "cubic_stiffness", {"k3": 1e10})
    return rig.with_effect("mass_3", "ground_friction", {"force": 0.1})


#: on the lead screw, a force beside it or none
CASES = [(*key, busy) for key in of_each_law_and_kind(CATALOGUE) for busy in (False, True)[: 1 + (key[0] not in RIGS)]]


@pytest.mark.parametrize(("kind", "name", "busy"), CASES)
def test_a_neutral_effect_changes_no_bit(kind: str, name: str, busy: bool) -> None:
    effect = CATALOGUE[kind, name]
    rig = RIGS.get(kind, busy_lead_screw if busy else rigs.lead_screw)()
    values = {p.name: p.typical if p.neutral is None else p.neutral for p in effect.parameters}
    before, after = run(rig), run(rig.with_effect(PLACES[kind], name, values))
    for sensor in rig.sensors:
        assert np.array_equal(before.sensors[sensor], after.sensors[sensor]), sensor
    assert np.array_equal(before.states, after.states)
    assert np.array_equal(before.theta_d_rad, after.theta_d_rad)


def near_neutral(neutral: float, typical: float) -> float:
    return 1e6 if np.isinf(neutral) else neutral + 1e-6 * typical


@pytest.mark.parametrize(("kind", "name"), [k for k in LAWS if k[1] not in ("compliance", "absorber")])
def test_an_effect_fades_out_towards_its_neutral_value(kind: str, name: str) -> None:
    """Switched on with a millionth of its typical size: the code of the effect runs, and nearly nothing happens."""
    effect = CATALOGUE[kind, name]
    rig = RIGS.get(kind, rigs.lead_screw)()
    tiny = {p.name: p.typical for p in effect.parameters}
    tiny[effect.size.name] = near_neutral(effect.size.neutral, effect.size.typical)
    plain = run(rig)
    ours = run(rig.with_effect(PLACES[kind], name, tiny))
    for sensor in rig.sensors:
        span = np.ptp(plain.sensors[sensor])
        assert np.abs(plain.sensors[sensor] - ours.sensors[sensor]).max() < 1e-4 * span, sensor
