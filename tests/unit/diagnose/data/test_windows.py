"""What of a long recording the search looks at."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnose import Record, diagnose_records
from dtbacklash.diagnose.data import windows as windows_module
from dtbacklash.diagnose.data.windows import portion
from dtbacklash.diagnose.search.parts import divided
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

from ..conftest import STEP_S, command


@pytest.fixture(scope="module")
def oscillator() -> Rig:
    return nominal_rig("oscillator")


def recorded(rig: Rig, seconds: float, from_s: float = 0.0) -> Record:
    u = command(seconds, 2)
    shown, rng = simulate(rig, u[:-1], STEP_S).sensors, np.random.default_rng(4)
    y = {"x": shown["x"] + rng.normal(0.0, 2e-6, len(u))}
    train = np.arange(len(u)) < 0.6 * len(u)
    return Record(STEP_S, u, y, train, ~train, from_s)


@pytest.fixture
def looking_at(monkeypatch):
    def chosen(samples: int, **more: float) -> None:
        monkeypatch.setattr(windows_module, "SETTINGS", replace(SETTINGS, search_samples_max=samples, **more))

    return chosen


def test_what_is_short_enough_is_looked_at_as_it_is(oscillator):
    records = divided([recorded(oscillator, 5.0)])
    assert portion(oscillator, records) is records


def test_windows_are_cut_out_of_both_parts_and_keep_their_time(oscillator, looking_at):
    records = divided([recorded(oscillator, 40.0), recorded(oscillator, 20.0, from_s=50.0)])
    looking_at(20000, search_window_decays=1.0)
    windows = portion(oscillator, records)
    assert 0.9 * 20000 < sum(r.samples for r in windows) <= 20000
    assert sum(bool(r.train.any()) for r in windows) == sum(bool(r.held.any()) for r in windows) == 4
    for window in windows:
        assert window.train.all() != window.held.all()
        mother = records[int(window.from_s >= 50.0)]
        at = round((window.from_s - mother.from_s) / STEP_S)
        assert np.array_equal(window.u, mother.u[at : at + window.samples])
        assert np.array_equal(window.y["x"], mother.y["x"][at : at + window.samples])
        part = mother.train if window.train.all() else mother.held
        assert part[at : at + window.samples].all()
        assert mother.judge.any()
        assert not mother.judge[at : at + window.samples].any()


def test_windows_are_as_long_as_the_rig_remembers(oscillator, looking_at):
    records = divided([recorded(oscillator, 40.0)])
    looking_at(8000, search_window_decays=20.0)
    few = portion(oscillator, records)
    looking_at(8000, search_window_decays=0.5)
    many = portion(oscillator, records)
    assert len(few) < len(many)


def test_each_of_several_recordings_is_looked_at_in_both_parts(oscillator, looking_at):
    short = recorded(oscillator, 6.0)
    records = divided([recorded(oscillator, 40.0), replace(short, recording=1, own_zero=True)])
    looking_at(20000, search_window_decays=1.0)
    windows = portion(oscillator, records)
    assert sum(r.samples for r in windows) <= 20000
    for part in ("train", "held"):
        assert {r.recording for r in windows if getattr(r, part).any()} == {0, 1}
    assert all(r.own_zero == (r.recording == 1) for r in windows)


@pytest.mark.check
def test_the_search_takes_a_part_and_the_fit_and_the_judgement_all(oscillator, looking_at):
    stiffer = oscillator.with_effect("spring", "cubic_stiffness", {"k3": 2e6})
    record = recorded(stiffer, 40.0)
    looking_at(8000)
    found = diagnose_records(oscillator, [record])
    assert (found.verdict, [f.effect for f in found.findings]) == ("missing_physics", ["cubic_stiffness"])
    assert found.findings[0].parameters["k3"].value == pytest.approx(2e6, rel=0.02)
    assert found.work.judged == pytest.approx(0.4 * SETTINGS.judging_share * record.samples, abs=40)
    assert found.work.fitted == pytest.approx(record.samples - found.work.judged, abs=40)


def test_what_chooses_takes_turns_with_what_is_fitted_to(oscillator):
    record = recorded(oscillator, 30.0)
    (mixed,) = divided([record])
    assert not (mixed.train & mixed.held).any()
    assert mixed.held.sum() == pytest.approx(0.25 * record.samples, abs=5)
    assert (mixed.train | mixed.held).sum() == pytest.approx(0.85 * record.samples, abs=5)
    assert not (mixed.train | mixed.held)[-round(0.15 * record.samples) + 5 :].any()
    assert np.count_nonzero(np.diff(mixed.held.astype(int)) == 1) == SETTINGS.turns_max


def test_another_recording_that_chooses_is_left_in_one_piece(oscillator):
    record = recorded(oscillator, 10.0)
    everything, nothing = np.ones(record.samples, dtype=bool), np.zeros(record.samples, dtype=bool)
    fitted, other = divided([
        replace(record, train=everything, held=nothing), replace(record, train=nothing, held=everything),
    ])  # fmt: skip
    assert fitted.train.all()
    assert np.count_nonzero(np.diff(other.held.astype(int))) == 1


@pytest.mark.nightly
def test_a_limit_that_is_reached_late_is_fitted_to_and_chosen_by(oscillator):
    """The command is large enough for the amplifier only from two thirds of what was the first part on."""
    record = recorded(oscillator, 1.0)
    u = command(30.0, 2) * np.where(np.arange(30001) < 18000, 0.2, 1.0)
    limited = oscillator.with_effect("amplifier", "saturation", {"limit": 3.0})
    x = simulate(limited, u[:-1], STEP_S).sensors["x"] + np.random.default_rng(1).normal(0.0, 2e-6, len(u))
    train = np.arange(len(u)) < 0.6 * len(u)
    found = diagnose_records(oscillator, [replace(record, u=u, y={"x": x}, train=train, held=~train)])
    assert (found.verdict, [f.effect for f in found.findings]) == ("missing_physics", ["saturation"])
