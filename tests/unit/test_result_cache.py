"""Results kept on disk: the same bits, made anew when anything that decides them differs."""

from dataclasses import dataclass

import numpy as np
import pytest

from dtbacklash import result_cache as keeping
from dtbacklash.control.chain import StructureParameters, dominant_frequency
from dtbacklash.result_cache import kept

CHAIN = StructureParameters((5.2, 5.2), (1e4, 1e4), (36.9, 36.9), 3e-4)


@dataclass(frozen=True)
class Design:
    """Something with an array in it."""

    values: np.ndarray
    size: float


made: list[tuple[float, str]] = []


def design(size: float, kind: str) -> Design:
    made.append((size, kind))
    return Design(np.linspace(0.1, size, 7), size / 3)


@pytest.fixture(autouse=True)
def apart(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made.clear()


def test_it_is_made_once_and_comes_back_to_the_last_bit():
    first, second = kept(design, 0.7, "a"), kept(design, 0.7, "a")
    assert made == [(0.7, "a")]
    assert second.size == first.size
    assert second.values.tobytes() == first.values.tobytes()


def test_other_arguments_and_other_code_make_it_anew(monkeypatch):
    kept(design, 0.7, "a")
    kept(design, np.nextafter(0.7, 1.0), "a")
    kept(design, 0.7, "b")
    monkeypatch.setattr(keeping, "_state", lambda module: ("other code",))
    kept(design, 0.7, "a")
    assert len(made) == 4


def test_a_broken_file_and_a_place_that_cannot_be_written_do_no_harm(tmp_path, monkeypatch):
    kept(design, 0.7, "a")
    (file,) = keeping.folder().iterdir()
    file.write_bytes(b"half of")
    assert kept(design, 0.7, "a").size == pytest.approx(0.7 / 3)
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert kept(design, 0.7, "a").size == pytest.approx(0.7 / 3)
    assert len(made) == 3


def test_an_error_is_no_result():
    with pytest.raises(TypeError):
        kept(design, "wide", "a")
    assert not keeping.folder().exists()


def test_a_real_design():
    assert kept(dominant_frequency, CHAIN) == kept(dominant_frequency, CHAIN) == dominant_frequency(CHAIN)


def test_a_figure_that_is_kept_is_drawn_anew_when_the_look_of_the_house_changes(monkeypatch):
    design_of, drawn_by = keeping._state("dtbacklash.control.design"), keeping._state("dtbacklash.report.run.loop")
    assert len(drawn_by) == len(design_of) + 1  # matplotlib's version
    keeping._state.cache_clear()
    monkeypatch.setattr(keeping.source_hash, "digest", "+".join)
    assert "report" in keeping._state("dtbacklash.report.run.loop")[0]
    assert "report" not in keeping._state("dtbacklash.control.design")[0]
    keeping._state.cache_clear()
