"""What a proposal raises costs that proposal; and a law becomes another one where its kind takes that."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig
from reference.cases import SAMPLE_TIME_S, problems

from dtbacklash.diagnosis.engine import attempts as guarded
from dtbacklash.diagnosis.engine.attempts import attempt, attempts
from dtbacklash.diagnosis.engine.confidence import ConfidenceTest
from dtbacklash.diagnosis.engine.fit import FitProblem
from dtbacklash.diagnosis.engine.hypotheses import Hypothesis
from dtbacklash.diagnosis.engine.predictor import Predictor
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.diagnosis.engine.selection import StepwiseSelection
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import CATALOGUE, simpler
from dtbacklash.physics.effects.declare import Effect, Role

from .conftest import command, predictor_of, recorded, segments_of

COULOMB = "disk", "coulomb_friction"
BECOME = sorted(key for key, effect in CATALOGUE.items() if effect.becomes)
#: the reference's rigs with an effect that may become a simpler one, by kind of element
WITH = {
    key: name for name in problems() for key in BECOME if name.endswith(f" {key[1]}") and len(name.split()) == 2
    and problems()[name].without and problems()[name].without.kind_at(name.split()[0]) == key[0]
}  # fmt: skip


@pytest.mark.parametrize("key", sorted(CATALOGUE), ids=".".join)
def test_a_simpler_law_is_one_of_the_kind(key):
    effect, law = CATALOGUE[key], simpler(CATALOGUE[key])
    if law is None:
        assert effect.becomes is None or (effect.kind, effect.becomes[1]) not in CATALOGUE
        return
    assert law is CATALOGUE[effect.kind, effect.becomes[1]]
    assert effect.becomes[0] in {p.name for p in effect.parameters}
    # its size is what the size of the other one is
    assert (law.size.role, law.size.unit) == (Role.SIZE, effect.size.unit)
    assert law.size.low <= effect.size.typical <= law.size.high


def test_laws_that_become_others_are_tried_at_kinds_with_and_without_these():
    assert {CATALOGUE[key].kind for key in WITH if simpler(CATALOGUE[key])} >= {"link", "shaft", "rotor", "carriage"}
    assert {CATALOGUE[key].kind for key in WITH if not simpler(CATALOGUE[key])} >= {"coupling", "gearbox", "belt"}


@pytest.mark.parametrize("key", sorted(WITH), ids=".".join)
def test_every_law_is_simplified_at_every_kind(key, caplog):
    caplog.set_level(logging.DEBUG, logger=guarded.__name__)
    problem = problems()[WITH[key]]
    place, name = WITH[key].split()
    u = problem.u[:600]
    y = recorded(problem.rig, u, step_s=SAMPLE_TIME_S)
    search = StepwiseSelection(Segments(problem.without, (predictor_of(problem.without, u, y, step_s=SAMPLE_TIME_S),)))
    search.now = replace(search.nothing, rig=problem.rig, keys=((place, name),))
    search.rules = replace(search.rules, tie_ratio=1e9)  # any simpler law that can be fitted does as well
    caplog.clear()
    search.simplify()
    assert not caplog.records
    law = simpler(CATALOGUE[key])
    tried = {effect for keys in search.tried for _, effect in keys}
    assert tried == ({law.name} if law else set())


ERRORS = (
    UserError("x", 1, "no"),
    np.linalg.LinAlgError("singular"),
    KeyError("damping"),
    ZeroDivisionError(),
    IndexError(),
)


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_an_error_is_no_value_and_only_what_is_news_is_logged(error, caplog):
    def fails(item: int) -> int:
        if item == 1:
            raise error
        return item

    assert attempt(fails, 1) is None
    assert attempts(fails, [0, 1, 2]) == [0, 2]
    assert bool(caplog.records) == (not isinstance(error, UserError | np.linalg.LinAlgError))


def test_an_interrupt_is_no_error():
    def interrupted() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        attempt(interrupted)


def _name(key: str):
    """Whether a rig has an effect of a name at the disk."""
    return lambda rig: rig.effect("disk", key) is not None


FRICTIONS = ("coulomb_friction", "stribeck_friction", "viscous_friction", "quadratic_drag")
#: where a proposal breaks: its starts, how it is put in, its fits, its passes, its sizes; each of another name
BREAKS = {
    "start_values": (Effect, lambda effect, *_: effect.name == "gravity"),
    "put": (Hypothesis, lambda hypothesis, *_: hypothesis.effect.name not in FRICTIONS),
    "__init__": (FitProblem, lambda problem, segments, rig, *_: _name("stribeck_friction")(rig)),
    "run": (Predictor, lambda predictor, rig, *_: _name("viscous_friction")(rig)),
    "tuned": (Predictor, lambda predictor, rig, *_: _name("quadratic_drag")(rig)),
}  # fmt: skip


def test_a_proposal_that_breaks_costs_itself_alone(monkeypatch, caplog):
    raised = set()

    def broken(owner: type, method: str, when) -> None:
        was = getattr(owner, method)

        def breaks(self, *rest, **named):
            if when(self, *rest):
                raised.add(method)
                raise KeyError(method)
            return was(self, *rest, **named)

        monkeypatch.setattr(owner, method, breaks)

    rig, u = nominal_rig("pendulum"), command(5.0, 0.4)
    search = StepwiseSelection(segments_of(rig, u, recorded(rig.with_effect(*COULOMB, {"torque": 0.02}), u)))
    for method, (owner, when) in BREAKS.items():
        broken(owner, method, when)
    model = search.run()
    found = ConfidenceTest(search).judged()
    assert raised == set(BREAKS)
    for method in BREAKS:
        assert any(method in record.getMessage() for record in caplog.records)
    assert model.keys == (COULOMB,)
    assert model.rig.effect(*COULOMB)["torque"] == pytest.approx(0.02, rel=0.01)
    assert found.certainty == {COULOMB: "sure"}
