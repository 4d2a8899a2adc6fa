"""What differs between recordings is freed in each; what does not is not, and a wrong parameter stands for no law."""

import re
from importlib.resources import files

import numpy as np
import pytest

import dtbacklash as dtb
from dtbacklash.diagnosis.engine.per_recording import RecordingValue, stands
from dtbacklash.diagnosis.engine.recording_effects import joined

MOTION = ("rig=two_mass_stage", "controller=open_loop", "reference=multisine", "reference.f_min_hz=0.5",
          "reference.f_max_hz=8", "duration_s=6")  # fmt: skip
#: of a channel, as a share of its standard deviation
NOISE = 5e-4


def recorded(seed: int, force: float, mass: float = 2.5, more: tuple[str, ...] = ()):
    """A run of the stage with dry friction at its carriage, and a table of this mass."""
    truth = [f"rig.effects.carriage.coulomb_friction.force={force}", f"rig.parameters.m_t.value={mass}"]
    motion = [m for m in MOTION if m.split("=")[0] not in {n.split("=")[0] for n in more}]
    frame = dtb.run(*motion, f"seed={seed}", *truth, *more).recording.to_frame()
    frame = frame[[c for c in frame if c[:2] in ("t_", "u_", "x_")]].copy()
    rng = np.random.default_rng(seed)
    for c in (c for c in frame if c.startswith("x_")):
        frame[c] += rng.normal(0.0, NOISE * frame[c].std(), len(frame))
    return frame


@pytest.mark.check
def test_a_friction_that_differs_is_found_with_its_size_in_each():
    found = dtb.diagnose([recorded(10, 2.0), recorded(11, 6.0)], "two_mass_stage", trust_units=True)
    (finding,) = found.diagnosis.findings
    assert (finding.location, finding.effect, finding.confidence) == ("carriage", "coulomb_friction", "sure")
    sizes = [one.causes["carriage.coulomb_friction.force"] for one in found.diagnosis.recordings]
    assert [one.value for one in sizes] == pytest.approx([2.0, 6.0], rel=0.02)
    assert [one.said for one in sizes] == ["seen", "seen"]
    said = r"is (2|1\.99|2\.01) N in frame \(1\), (6|5\.99|6\.01) N in frame \(2\): it depends on what differs"
    assert re.search(said, found.summary)
    assert found.rig.effects["carriage"]["coulomb_friction"]["force"] == pytest.approx(6.0, rel=0.02)
    row = found.diagnosis.to_json()["recordings"][0]["causes"]["carriage.coulomb_friction.force"]
    assert row["ci95"][0] < 2.0 < row["ci95"][1]


@pytest.mark.nightly
def test_a_mass_that_differs_is_found_beside_a_friction_that_does_not():
    found = dtb.diagnose([recorded(10, 4.0), recorded(11, 4.0, 3.0)], "two_mass_stage", trust_units=True)
    assert [f.effect for f in found.diagnosis.findings] == ["coulomb_friction"]
    causes = found.diagnosis.recordings[1].causes
    assert causes["carriage.coulomb_friction.force"].value == pytest.approx(4.0, rel=0.02)
    assert causes["m_t"].value == pytest.approx(3.0, rel=0.05)


@pytest.mark.check
def test_a_friction_that_one_alone_has_is_found_and_said_to_be_seen_there_only():
    found = dtb.diagnose([recorded(10, 0.0), recorded(11, 4.0)], "two_mass_stage", trust_units=True)
    (finding,) = found.diagnosis.findings
    assert (finding.location, finding.effect, finding.confidence) == ("carriage", "coulomb_friction", "sure")
    assert finding.parameters["force"].value == pytest.approx(4.0, rel=0.01)
    assert re.search("friction of 4(.0[0-4])? N acts at the carriage", finding.sentence)
    assert finding.sentence.endswith("It is seen in frame (2) only.")
    causes = [one.causes["carriage.coulomb_friction.force"] for one in found.diagnosis.recordings]
    assert [one.said for one in causes] == ["not seen", "seen"]
    assert causes[1].value == pytest.approx(4.0, rel=0.02)


@pytest.mark.check
def test_a_ripple_is_found_where_each_recording_begins_at_another_zero(tmp_path):
    """Beside a friction, and half a period apart: with one phase for both the ripple would add up to nothing."""
    description = (files("dtbacklash.conf.rig") / "two_mass_stage.yaml").read_text()
    rig = tmp_path / "relative.yaml"
    rig.write_text(description.replace(", absolute: true", ""))
    frames = []
    for seed, phase in ((10, 0.5), (11, 0.5 - np.pi)):
        ripple = {"force": 0.2, "wave_number": 600.0, "phase": phase}
        more = [f"rig.effects.carriage.cogging.{name}={value}" for name, value in ripple.items()]
        frames.append(recorded(seed, 4.0, more=("duration_s=4", *more)))
    found = dtb.diagnose(frames, str(rig), trust_units=True, search="quick")
    assert {(f.location, f.effect) for f in found.diagnosis.findings} == {
        ("carriage", "coulomb_friction"), ("carriage", "cogging")}  # fmt: skip
    values = found.rig.effects["carriage"]["cogging"]
    assert values["force"] == pytest.approx(0.2, rel=0.02)
    assert values["wave_number"] == pytest.approx(600.0, rel=1e-3)


SPRING = ("rig=oscillator", "controller=open_loop", "reference=multisine", "reference.f_min_hz=1",
          "reference.f_max_hz=12", "duration_s=4")  # fmt: skip


def sprung(seed: int, mass: float, friction: float):
    """A run of the oscillator with a quadratic damping that its rig lacks."""
    more = (f"rig.parameters.m.value={mass}", "rig.effects.spring.quadratic_damping.c2=20",
            f"rig.effects.mass.ground_friction.force={friction}")  # fmt: skip
    frame = dtb.run(*SPRING, f"seed={seed}", *more).recording.to_frame()
    frame = frame[["t_s", "u_v", *(c for c in frame if c.startswith("x"))]].copy()
    frame.iloc[:, 2] += np.random.default_rng(seed).normal(0.0, NOISE * frame.iloc[:, 2].std(), len(frame))
    return frame


@pytest.mark.check
@pytest.mark.parametrize(("title", "after"), [("m", (1.26, 0.5)), ("mass.ground_friction.force", (1.2, 1.5))])
def test_what_changed_is_said_beside_what_the_rig_lacks_in_both(title, after):
    pair = [sprung(20, 1.2, 0.5), sprung(21, *after)]
    found = dtb.diagnose(pair, "oscillator", compare="change", trust_units=True)
    (change,) = found.diagnosis.changes
    # of a mass on a spring to the ground both rub alike
    also = () if title == "m" else ("spring.dry_friction.force",)
    assert (change.title, change.confidence, change.also_fits) == (title, "one_of" if also else "sure", also)
    ends = (1.2, 1.26) if title == "m" else (0.5, 1.5)
    assert (change.before.value, change.after.value) == pytest.approx(ends, rel=0.03)
    assert found.summary.startswith(f"`{title}` changed from ")
    assert [one["title"] for one in found.to_json()["changes"]] == [title]


@pytest.mark.check
def test_nothing_is_said_to_have_changed_where_nothing_did():
    pair = [sprung(20, 1.2, 0.5), sprung(21, 1.2, 0.5)]
    found = dtb.diagnose(pair, "oscillator", compare="change", trust_units=True)
    assert found.diagnosis.changes == ()
    assert "nothing is seen to have changed" in found.summary


@pytest.mark.parametrize(("compare", "count"), [("change", 1), ("change", 3), ("wear", 2)])
def test_two_recordings_are_compared_for_what_changed(compare, count):
    frame = sprung(20, 1.2, 0.5)
    frames = [frame.assign(u_v=frame["u_v"] + 1e-6 * k) for k in range(count)]
    with pytest.raises(dtb.UserError, match=f"compare={compare}: .*of two recordings"):
        dtb.diagnose(frames, "oscillator", compare=compare, trust_units=True)


def test_a_name_stands_if_all_that_can_show_it_do_and_agree():
    a, b = RecordingValue(0, 4.0, 0.1, True, True), RecordingValue(1, 4.2, 0.1, True, True)
    blind, missing = RecordingValue(2, 9.0, 8.0, False, False), RecordingValue(2, 0.1, 0.1, True, False)
    assert stands([a, b], 3.0)
    assert stands([a, b, blind], 3.0)
    assert not stands([a, b, missing], 3.0)
    assert not stands([a, RecordingValue(1, 5.0, 0.1, True, True)], 3.0)
    assert stands(
        [RecordingValue(0, 0.0, 0.1, True, False, own=True), RecordingValue(1, 5.0, 0.1, True, True, own=True)], 3.0
    )


def test_what_one_recording_alone_has_stays_an_effect_where_it_is_shared_again():
    title = "carriage.coulomb_friction.force"
    rig = dtb.load_rig("two_mass_stage").with_effect("carriage", "coulomb_friction", {"force": 5.0})
    rig = rig.owning({(0, title): 0.0, (1, title): 5.0, (2, title): 0.0})
    shared = joined(rig, title, (0, 1, 2))
    assert shared.effects["carriage"]["coulomb_friction"]["force"] == 5.0
    assert not any(shared.own)
