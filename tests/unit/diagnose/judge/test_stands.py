"""What a name rests on, on recordings with a known answer."""

from dataclasses import replace

import machines as m
import numpy as np
import pytest
from ringing import blade, known, recorded

from dtbacklash.diagnose import Record
from dtbacklash.diagnose.data.candidates import Candidate
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import Lead
from dtbacklash.diagnose.fit.free import Key
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.judge.law_points import law_shown
from dtbacklash.diagnose.judge.stands import FORM, Rival, _is_the_same_law, rivals_of, stands
from dtbacklash.diagnose.named import Alternative, Stands
from dtbacklash.diagnose.propose.locate import Score
from dtbacklash.diagnose.say.findings import finding, without
from dtbacklash.diagnose.search.leave_out import refit_with
from dtbacklash.diagnose.search.model import Asked, Log, Model, Named, Trial
from dtbacklash.diagnose.shown import LawShown
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig

DRY, STRIBECK = ("carriage", "coulomb_friction"), ("carriage", "stribeck_friction")
VISCOUS, ZONE = ("carriage", "viscous_friction"), ("amplifier", "dead_zone")
NONE, NOT_BEATEN = np.zeros(0), Lead(1.0, 0.0, 0.0, False, False)


def model_of(rig: Rig, record: Record, key: Key, values: dict, tried: dict[Key, dict] | None = None) -> Model:
    """A finished search that named one effect; tried : what was fitted in its place, and from where."""
    evidence = Evidence.gather(rig, [record])
    nominal = fit(evidence, rig, [])
    ended = refit_with(evidence, nominal, [(key, values)])
    trials = []
    for other, start in (tried or {}).items():
        there = refit_with(evidence, nominal, [(other, start)])
        trials.append(Trial(other, None, there, evidence.rms(there.residuals)))
    return Model(evidence, nominal, ended, (Named(key, tuple(trials)),))


def bank_with(model: Model, key: Key, values: dict) -> Log:
    """The log of a search whose bank had one entry."""
    entry = find(model.evidence.nominal.kind_at(key[0]), key[1], key[0])
    score = Score(Candidate(key[0], entry), values, 100.0, NONE, 1.0, 1.0, values)
    return Log(banks=[Asked(model.evidence, [score], NONE)])


def judged(model: Model, log: Log) -> tuple[list[Key], Stands, LawShown | None]:
    (key,) = model.keys
    law = law_shown(model.evidence, model.fitted, key, without(model)[key])
    rivals = rivals_of(model, log, key, law)
    return [r.key for r in rivals], stands(model, log, key, law, rivals), law


@pytest.fixture(scope="module")
def dry(carriage) -> Model:
    """A carriage with dry friction; a plain integration of another kind recorded it."""
    u = m.multisine(m.times(6.0), 1.0, 5.0, 3)
    x, _, _ = m.record(m.Machine((95.0,), gain=35.0, coulomb=15.0), u, 1e-6, 3)
    train = np.arange(len(u)) < 0.6 * len(u)
    record = Record(m.STEP_S, u, {"x": np.ascontiguousarray(x[:, 0])}, train, ~train)
    tried = {VISCOUS: {"coefficient": 50.0}, ZONE: {"half_width": 0.3}}
    return model_of(carriage, record, DRY, {"force": 12.0}, tried)


def test_a_true_name_is_sure(dry):
    rivals, grounds, law = judged(dry, Log())
    assert set(rivals) == {VISCOUS, ZONE}
    assert grounds.sure
    assert grounds.where.against == Alternative(*ZONE)
    assert grounds.law.against == Alternative(*VISCOUS)
    assert grounds.law.share == law.share > FORM
    assert grounds.size.ratio > 10.0
    assert grounds.size.against is None


@pytest.mark.parametrize(("key", "values", "same"), [
    (STRIBECK, {"force": 15.0, "speed": 10.0}, True), (STRIBECK, {"force": 15.0, "speed": 0.01}, False),
    (STRIBECK, {"force": 9.0, "speed": 10.0}, False), (VISCOUS, {"coefficient": 50.0}, False),
])  # fmt: skip
def test_a_law_with_more_parameters_that_has_become_the_named_one_is_no_rival(dry, carriage, key, values, same):
    law = law_shown(dry.evidence, dry.fitted, DRY, without(dry)[DRY])
    beside = replace(dry.fitted, rig=carriage.with_effect(*key, values))
    assert _is_the_same_law(dry, DRY, Rival(key, beside, NOT_BEATEN), law) == same
    assert not _is_the_same_law(dry, DRY, Rival(key, beside, NOT_BEATEN), None)


def test_one_that_is_not_needed_has_no_size(dry):
    _, grounds, _ = judged(replace(dry, nominal=dry.fitted, named=(Named(DRY),)), Log())
    assert not grounds.size.stands
    assert grounds.where.stands, "nothing was tried elsewhere"
    assert not grounds.sure


@pytest.mark.parametrize(("share", "formed"), [(0.95, True), (0.79, False), (float("nan"), True)])
def test_a_law_has_the_form_of_the_free_effort(dry, share, formed):
    law = LawShown(*DRY, "", "", "", "", share=share)
    assert stands(dry, Log(), DRY, law, []).law.stands == formed
    assert stands(dry, Log(), DRY, None, []).law.stands


@pytest.mark.parametrize(("stiffness", "told"), [(2.4e4, True), (2.4e6, False)], ids=["yields", "rigid"])
def test_a_neighbour_that_moves_as_one_with_it_is_tried_and_said(stiffness, told):
    here, beside, values = ("frame", "viscous_friction"), ("tip", "viscous_friction"), {"coefficient": 10.0}
    rig = known(blade(k_2=stiffness))
    model = model_of(rig, recorded(rig.with_effect(*here, values), 31, 4000), here, values)
    log = bank_with(model, beside, values)
    rivals, grounds, law = judged(model, log)
    assert rivals == [beside]
    assert (grounds.where.stands, grounds.where.against) == (told, Alternative(*beside))
    assert (grounds.law.stands, grounds.size.stands) == (True, True)
    said = finding(model, here, {}, without(model)[here], rivals_of(model, log, here, law), grounds)
    assert said.also_fits == (() if told else (Alternative(*beside),))
    assert said.confidence == ("sure" if told else "partial")
    assert ("leaves open where it acts" in said.sentence) != told
