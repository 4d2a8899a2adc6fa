"""The lock-in amplitude (19)-(21): what it passes, what it suppresses."""

import numpy as np
import pytest
from scipy.signal import sosfreqz

from dtbacklash.errors import UserError
from dtbacklash.twin.gap.novelty import NoveltyDesign, novelty_design, novelty_index

OMEGA_D, TS = 27.06868, 1e-3
T = np.arange(20_000) * TS
SETTLED = slice(6_000, None)


def index(design: NoveltyDesign, errors: np.ndarray) -> np.ndarray:
    return novelty_index(errors, design.sos, design.cos_step, design.sin_step, design.initial_state())


@pytest.fixture(params=["cheby2", "ellip"])
def lock_in(request: pytest.FixtureRequest) -> NoveltyDesign:
    return novelty_design(request.param, OMEGA_D, TS)


@pytest.mark.parametrize("phase", [0.0, 1.0, 2.5])
def test_a_sine_at_the_mode_gives_its_amplitude(lock_in: NoveltyDesign, phase: float) -> None:
    amplitude = index(lock_in, 0.37 * np.sin(OMEGA_D * T + phase))[SETTLED]
    assert amplitude == pytest.approx(0.37, rel=0.012)  # the image at 2 omega_d is 40 dB down
    assert np.mean(amplitude) == pytest.approx(0.37, rel=1e-3)


@pytest.mark.parametrize(("name", "cut_off"), [("ellip", 0.500), ("cheby2", 0.332)])
def test_filter_is_third_order_with_its_edges(name: str, cut_off: float) -> None:
    design = novelty_design(name, OMEGA_D, TS)
    omega = np.linspace(0.0, 1.0, 10_001) * OMEGA_D
    gain = np.abs(sosfreqz(design.sos, omega * TS)[1])
    assert np.sum(design.sos[:, 3:] != 0) - design.sos.shape[0] == 3  # poles: coefficients but for the leading 1
    assert gain[0] == pytest.approx(1.0, abs=1e-9)
    assert omega[np.flatnonzero(gain < 10 ** (-3.0103 / 20))[0]] == pytest.approx(cut_off * OMEGA_D, abs=1e-3 * OMEGA_D)
    above = np.abs(sosfreqz(design.sos, np.geomspace(OMEGA_D * TS, np.pi, 2000))[1])
    assert np.all(above <= 0.01 * (1 + 1e-6))


def test_the_papers_filter_has_both_edges_at_once() -> None:
    """Section 4.2: third order, cut-off omega_d/2, 40 dB at omega_d."""
    design = novelty_design("ellip", OMEGA_D, TS)
    half, mode = 20.0 * np.log10(np.abs(sosfreqz(design.sos, np.array([0.5, 1.0]) * OMEGA_D * TS)[1]))
    assert half == pytest.approx(-3.0, abs=1e-6)
    assert mode == pytest.approx(-40.94, abs=0.01)


def test_matches_the_definition_with_cosine_and_sine(lock_in: NoveltyDesign) -> None:
    from scipy.signal import sosfilt

    errors = np.random.default_rng(5).standard_normal(T.size)
    real = sosfilt(lock_in.sos, 2 * errors * np.cos(OMEGA_D * T))
    imag = sosfilt(lock_in.sos, 2 * errors * np.sin(OMEGA_D * T))
    assert index(lock_in, errors) == pytest.approx(np.hypot(real, imag), rel=1e-6, abs=1e-9)


def test_oscillator_neither_grows_nor_drifts_in_a_long_run(lock_in: NoveltyDesign) -> None:
    state, n = lock_in.initial_state(), 2_000_000
    novelty_index(np.zeros(n), lock_in.sos, lock_in.cos_step, lock_in.sin_step, state)
    assert np.hypot(state[0], state[1]) == pytest.approx(1.0, abs=1e-12)
    phase = np.angle(np.exp(1j * (OMEGA_D * n * TS - np.arctan2(state[1], state[0]))))
    assert abs(phase) < 1e-6


def test_step_by_step_is_the_whole_record(lock_in: NoveltyDesign) -> None:
    errors = np.sin(25.0 * T[:500])
    state = lock_in.initial_state()
    steps = [novelty_index(e[None], lock_in.sos, lock_in.cos_step, lock_in.sin_step, state)[0] for e in errors]
    assert steps == list(index(lock_in, errors))


def test_wrong_choices_are_named() -> None:
    with pytest.raises(UserError, match="novelty_filter=fir"):
        novelty_design("fir", OMEGA_D, TS)
    with pytest.raises(UserError, match=r"sample_time_s=0\.2"):
        novelty_design("cheby2", OMEGA_D, 0.2)
