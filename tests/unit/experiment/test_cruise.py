"""The loop that is written out for the sizes at hand gives the bits of the general one."""

from __future__ import annotations

import pytest

from dtbacklash.config.compose import compose
from dtbacklash.errors import Diverged
from dtbacklash.experiment import run
from dtbacklash.experiment.cruise import form_of

SHORT = ("duration_s=6", "reference.period_s=2", "profile=constant", "profile.start_deg=20", "profile.end_deg=20")


def _traces(monkeypatch: pytest.MonkeyPatch, long: int, *overrides: str) -> tuple[run.RunResult, int]:
    """A run, and in how many forms its loop was written out."""
    forms = []
    monkeypatch.setattr(run, "LONG", long)
    monkeypatch.setattr(run, "form_of", lambda *given: forms.append(form_of(*given)) or forms[-1])
    return run.run_scenario(compose(*overrides)), sum(form is not None for form in forms)


@pytest.mark.parametrize(
    "overrides",
    [
        pytest.param(("controller=nimc_fixed", *SHORT), id="nimc"),
        pytest.param(("controller=imc", "twin.novelty_filter=cheby2", *SHORT), id="imc"),
        pytest.param(("controller=nimc_fixed", *SHORT, "sensors=encoder"), id="encoder"),
        pytest.param(("controller=nimc_novelty", "duration_s=60"), id="alarms"),
    ],
)  # fmt: skip
def test_the_same_bits(monkeypatch: pytest.MonkeyPatch, overrides: tuple[str, ...]) -> None:
    general, none = _traces(monkeypatch, 10**9, *overrides)
    written, one = _traces(monkeypatch, 0, *overrides)
    assert (none, one) == (0, 1)
    assert general.trace.equals(written.trace)
    columns = ["t_event_s", "gap_deg", "accepted"]
    assert general.estimates[columns].equals(written.estimates[columns])


def test_the_same_end_of_a_loop_that_diverges(monkeypatch: pytest.MonkeyPatch) -> None:
    said = []
    for long in (10**9, 0):
        with pytest.raises(Diverged) as refused:
            _traces(monkeypatch, long, "controller=nimc_fixed", *SHORT, "solver.divergence_mm=1")
        said.append(str(refused.value))
    assert said[0] == said[1]


@pytest.mark.parametrize(
    "overrides",
    [
        pytest.param(("controller=nimc_fixed", "controller.internal_model=measured"), id="another internal model"),
        pytest.param(("controller=open_loop",), id="open loop"),
        pytest.param(
            ("controller=nimc_fixed", "rig.effects.motor_bearing.coulomb_friction.torque=0.02"), id="friction"
        ),
    ],
)
def test_what_is_not_written_is_left_to_the_general_loop(
    monkeypatch: pytest.MonkeyPatch, overrides: tuple[str, ...]
) -> None:
    assert _traces(monkeypatch, 0, *overrides, "duration_s=0.01")[1] == 0
