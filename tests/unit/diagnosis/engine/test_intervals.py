"""Standard errors of a model's values: white and coloured innovations, and directions that only the priors know."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis.engine.fit import FitProblem, FittedModel
from dtbacklash.diagnosis.engine.intervals import (
    PROFILE_POINTS,
    PROFILE_REACH,
    STRETCHES,
    Values,
    covariance_of,
    inverse,
    polished,
    profiles,
    stretches,
    values,
)
from dtbacklash.diagnosis.engine.motion import Motion, motion_of
from dtbacklash.diagnosis.engine.parameters import apply, nominal_free
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import build_rig

from .conftest import command, recorded, segments_of

DAMPED = ("mass", "viscous_friction")
COEFFICIENT = 1.5


def fitted(segments: Segments, rig, keys) -> tuple[Motion, FittedModel, Values]:
    """The motion of a rig on segments, its fit there with priors as they are given, and its values."""
    sizes, _ = segments.tuned(rig)
    motion = motion_of(segments, rig, segments.gains(rig, sizes))
    found = FitProblem(segments, rig, keys, motion, 1.0).homotopy_fit(sizes, None, (1.0, 1.0), 6)
    assert found is not None
    return motion, *polished(segments, motion, found)


@pytest.fixture(scope="module")
def repeated() -> list[tuple[FittedModel, Values, dict]]:
    """Fits of a damped oscillator whose parameters and noise are drawn anew each time, and the truth of each."""
    nominal, runs = nominal_rig("oscillator"), []
    free, rng, u = nominal_free(nominal), np.random.default_rng(7), command(4.0, 1.0)
    damped = nominal.with_effect(*DAMPED, {"coefficient": COEFFICIENT})
    for seed in range(16):
        truth = apply(damped, free, rng.standard_normal(len(free)))
        segments = segments_of(nominal, u, recorded(truth, u, 1e-2, seed))
        _, model, found = fitted(segments, damped, [DAMPED])
        runs.append((model, found, truth))
    return runs


def test_errors_cover_what_is_drawn(repeated):
    """All parameters of a linear case, over draws of the truth from its priors and of the noise."""
    apart = []
    for model, found, truth in repeated:
        for f in found.free:
            was = truth.effects[f.place][f.effect][f.name] if f.effect else truth.config.parameters[f.name].value
            now = (
                model.rig.effects[f.place][f.effect][f.name] if f.effect else model.rig.config.parameters[f.name].value
            )
            apart.append((now - was) / found.errors[f.place, f.effect, f.name])
    apart = np.array(apart).reshape(len(repeated), -1)
    assert (np.abs(apart) < 1.96).mean() > 0.9
    assert np.all(np.sqrt((apart**2).mean(axis=0)) > 0.4)  # nor are they much too wide


def test_errors_are_never_narrower_than_the_curvature_and_the_laws_formulation(repeated):
    model, found, _ = repeated[0]
    curved = np.diag(inverse(found.jacobian))
    assert np.all(np.diag(found.covariance) >= curved * (1.0 - 1e-9))
    j = next(j for j, f in enumerate(found.free) if f.key == DAMPED)
    slope = found.free[j].per_x(found.x[j])
    law = slope * find(model.rig.kind_at("mass"), DAMPED[1], "mass").formulation_error
    assert found.errors[(*DAMPED, "coefficient")] == pytest.approx(
        np.hypot(slope * np.sqrt(found.covariance[j, j]), law)
    )


def test_masses_and_springs_that_grow_alike_are_known_by_the_priors_only():
    """With a gain that is known within its tolerance only, all may grow alike; the columns' errors do not cancel."""
    rig = nominal_rig("oscillator")
    gain = replace(rig.config.parameters["gain"], tolerance=0.05)
    rig = build_rig(replace(rig.config, parameters={**rig.config.parameters, "gain": gain}))
    u = command(4.0, 1.0)
    _, _, found = fitted(segments_of(rig, u, recorded(rig, u, 1e-4)), rig, [])
    known = rig.config.parameters
    relative = {n: found.errors["", "", n] / known[n].value for n in ("gain", "m", "k", "c")}
    expected = 1.0 / np.sqrt(sum(known[n].tolerance ** -2 for n in relative))
    for name, error in relative.items():
        assert error == pytest.approx(expected, rel=0.15), name


def test_a_polished_model_is_at_its_optimum():
    rig, u = nominal_rig("oscillator"), command(4.0, 1.0)
    segments = segments_of(rig, u, recorded(rig.with_effect(*DAMPED, {"coefficient": COEFFICIENT}), u))
    sizes, _ = segments.tuned(rig)
    motion = motion_of(segments, rig, segments.gains(rig, sizes))
    start = FitProblem(segments, rig.with_effect(*DAMPED, {"coefficient": 1.0}), [DAMPED], motion, 1.0).homotopy_fit(
        sizes, None, (1.0, 1.0), 2
    )
    model, found = polished(segments, motion, start)
    assert model.score < start.score
    step = inverse(found.jacobian) @ (found.jacobian.T @ found.rows)
    assert np.all(np.abs(step) < 0.1 * np.sqrt(np.diag(found.covariance)))


def test_a_profile_of_a_linear_case_is_the_parabola_of_its_error():
    """All others are fitted anew: held where they are, the likelihood would fall off much faster."""
    rig, u = nominal_rig("oscillator"), command(4.0, 1.0)
    segments = segments_of(rig, u, recorded(rig.with_effect(*DAMPED, {"coefficient": COEFFICIENT}), u))
    motion, model, found = fitted(segments, rig.with_effect(*DAMPED, {"coefficient": 1.0}), [DAMPED])
    likelihood = profiles(segments, motion, model, found, lambda title, recording: title)
    assert likelihood.units == {"m": "kg", "k": "N/m", "c": "N s/m", "mass.viscous_friction.coefficient": "N s/m"}
    for title in ("m", "c"):  # the friction can stand for the latter: its prior alone holds it
        seen = likelihood(title)
        assert seen.values.shape == seen.rises.shape == (2 * PROFILE_POINTS + 1,)
        j = next(k for k, f in enumerate(found.free) if f.title == title)
        curvature = np.linalg.inv(found.jacobian.T @ found.jacobian)[j, j]
        reach = PROFILE_REACH * np.sqrt(found.covariance[j, j] / curvature)
        parabola = np.linspace(-reach, reach, len(seen.values)) ** 2
        # the fit ends within a few hundredths of an error beside the least: both sides together
        assert 0.5 * (seen.rises + seen.rises[::-1]) == pytest.approx(parabola, rel=0.1, abs=0.1), title
        assert (found.jacobian[:, j] ** 2).sum() * curvature > 1.5  # how much steeper the others held would make it
    skew = likelihood("mass.viscous_friction.coefficient").rises
    assert (
        skew[-1] > 3.0 * skew[0] > 9.0
    )  # c takes up all of a small friction; for a large one it would have to be below 0
    with pytest.raises(UserError, match="choose one of m, "):
        likelihood("mass.coulomb_friction.force")
    stiff = replace(found, free=tuple(replace(f, high=f.value(0.0)) if f.name == "m" else f for f in found.free))
    half = replace(likelihood, found=stiff)("m")  # nothing beyond the end of its range
    assert len(half.values) < 2 * PROFILE_POINTS + 1
    unseen = replace(found, covariance=0.0 * found.covariance)
    with pytest.raises(UserError, match="that the recording shows"):
        replace(likelihood, found=unseen)("m")


@pytest.mark.parametrize(("k3", "wider"), [(0.0, (1.0, 1.1)), (2e5, (1.3, 3.0))])
def test_what_a_model_lacks_widens_its_errors(k3, wider):
    """A spring that stiffens pulls the mass alike in every stretch; at a longer horizon it pulls more."""
    nominal, u = nominal_rig("oscillator"), command(4.0, 1.0)
    damped = nominal.with_effect(*DAMPED, {"coefficient": COEFFICIENT})
    segments = segments_of(
        nominal, u, recorded(damped.with_effect("spring", "cubic_stiffness", {"k3": k3}), u, 1e-2, 0)
    )
    motion, model, found = fitted(segments, damped, [DAMPED])
    ratio = found.errors["", "", "m"] / values(segments, motion, model).errors["", "", "m"]
    assert wider[0] <= ratio < wider[1]


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_the_sandwich_covers_under_coloured_innovations(memory):
    """A regression on slow sines whose noise remembers: the curvature alone would be four times too narrow."""
    rng, n, p = np.random.default_rng(2), 4800, 3
    t = np.arange(n) / n
    J = np.vstack([np.sin(2.0 * np.pi * (np.arange(1, p + 1) * t[:, None] + 0.1)), 1e-3 * np.eye(p)])
    parts = [slice(a, a + n // STRETCHES) for a in range(0, n, n // STRETCHES)]
    inside = []
    for _ in range(150):
        e = rng.standard_normal(n)
        for k in range(1, n):
            e[k] += memory * e[k - 1]
        rows = np.concatenate([e, np.zeros(p)])
        off = inverse(J) @ J.T @ rows
        covariance = covariance_of(J, rows - J @ off, parts)
        assert np.all(np.diag(covariance) >= np.diag(inverse(J)) * (1.0 - 1e-9))
        assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
        inside += (np.abs(off) < 1.96 * np.sqrt(np.diag(covariance))).tolist()
    assert np.mean(inside) > 0.9


def test_no_stretch_reaches_into_another_recording():
    readings = [SimpleNamespace(readings=SimpleNamespace(y=np.zeros((n, 2)))) for n in (1000, 130, 3000)]
    parts = stretches(SimpleNamespace(predictors=readings))
    assert abs(len(parts) - STRETCHES) <= 2
    assert [p.start for p in parts[1:]] == [p.stop for p in parts[:-1]]
    assert (parts[0].start, parts[-1].stop) == (0, 8260)
    assert {2000, 2260} <= {p.stop for p in parts}
    assert all(p.start % 2 == 0 for p in parts)
