"""All efforts of a block grown alike, which no recording of motion can show."""

from dataclasses import replace

import numpy as np
import pytest
from ringing import blade, known, recorded

from dtbacklash.config.compose import compose
from dtbacklash.diagnose import Record
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import all_free, apply, effect_free, nominal_free
from dtbacklash.diagnose.fit.intervals import linear
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.fit.scaling import power, unseen_scalings
from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.rig import build_rig
from dtbacklash.physics.simulate import simulate

FRICTION = ("frame", "ground_friction", {"force": 0.5})


@pytest.mark.parametrize(
    ("unit", "expected"),
    [("N m/A", 0), ("V s/rad", 0), ("ohm", -1), ("kg m^2", 1), ("N s^2/m^2", 1), ("m/N", -1), ("1/W", -1), ("1", 0),
     ("?", None), ("", 0), ("kgf", None), ("m/s/kg", None)],
)  # fmt: skip
def test_with_which_power_of_the_efforts_a_unit_grows(unit, expected):
    assert power(unit) == expected


def test_every_unit_of_the_catalogue_is_known():
    units = {p.unit for effect in CATALOGUE.values() for p in effect.parameters} - {"sensor's unit"}
    assert [unit for unit in units if power(unit) is None] == []


def test_nothing_moves_where_all_efforts_grow_alike():
    rig = known(blade()).with_effect(*FRICTION)
    evidence = Evidence.gather(rig, [recorded(rig, 21, 3000)])
    free = nominal_free(rig) + effect_free(rig, *FRICTION)
    x = np.zeros(len(free))
    (direction,) = unseen_scalings(evidence, rig, free, x)
    here = evidence.residuals(rig)
    there = evidence.residuals(apply(rig, free, x + 0.05 * direction))
    for name, (residual,) in here.items():
        # the size of friction is a logarithm: grown by exp(0.05), the others by 1.05
        assert np.abs(there[name][0] - residual).max() < 0.2
        (one,) = evidence.residuals(apply(rig, free, x + 0.05 * direction * (np.arange(len(free)) == 1)))[name]
        assert np.abs(one - residual).max() > 20.0


def test_beside_dry_friction_only_the_priors_know_how_large_all_efforts_are():
    rig = known(blade())
    evidence = Evidence.gather(rig, [recorded(rig.with_effect(*FRICTION), 22, 4000)])
    base = rig.with_effect(*FRICTION)
    fitted = fit(evidence, base, nominal_free(rig) + effect_free(base, *FRICTION))
    about = linear(evidence, fitted)
    (direction,) = unseen_scalings(evidence, fitted.rig, about.problem.free, about.x)
    changed = about.jacobian @ direction
    priors = int(about.problem.prior.sum())
    assert np.linalg.norm(changed[:-priors]) < 1e-6 * np.linalg.norm(about.jacobian[:-priors])
    assert np.linalg.norm(changed[-priors:]) > 0.1


def test_where_one_of_the_efforts_is_known_exactly_all_are_seen():
    rig = known(blade())
    parameters = rig.config.parameters
    exact = build_rig(replace(rig.config, parameters={**parameters, "m_1": replace(parameters["m_1"], tolerance=0.0)}))
    evidence = Evidence.gather(exact, [recorded(exact, 23, 3000)])
    assert unseen_scalings(evidence, exact, *all_free(evidence, exact)) == []


def test_what_pushes_back_on_the_motor_is_seen_there():
    rig = build_rig(compose("rig=lead_screw", "rig.effects.screw.load_reaction.share=1.0").rig)
    steps = {"theta_m": 1e-3, "i_m": 1e-2, "q3": 1e-6}
    rng = np.random.default_rng(5)
    u = rng.normal(0.0, 2.0, 3000)
    shown = simulate(rig, u[:-1], 1e-3).sensors
    y = {name: shown[name] + rng.normal(0.0, sigma, len(u)) for name, sigma in steps.items()}
    train = np.arange(len(u)) < 1800
    evidence = Evidence.gather(rig, [Record(1e-3, u, y, train, ~train)])
    assert len(evidence.blocks) == 2
    assert unseen_scalings(evidence, rig, *all_free(evidence, rig)) == []
