"""What is measured on the digital twin and on the novelty index: sections 4 to 4.2, Figures 13 and 14."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import hilbert, sosfreqz

from dtbacklash.arrays import Floats
from dtbacklash.paper.experiments import Experiments
from dtbacklash.twin.gap.novelty import NoveltyDesign, novelty_design, novelty_index
from dtbacklash.twin.gap.observer import filtered, twin_model

#: samples of white noise through the detector: its rms is then known to about half a percent
NOISE_SAMPLES = 2_000_000


def observer_settling_s(x: Experiments) -> float:
    """Settling time of the twin's observer, 1 % band, in the median of the states that it starts from."""
    sizes = [np.abs(error) for error in _observer_errors_mm(x)]
    sample_time_s = x.runs["fig13"].config.sample_time_s
    return float(np.median([sample_time_s * float(np.flatnonzero(s > 0.01 * s.max())[-1] + 1) for s in sizes]))


def observer_error_left(x: Experiments) -> float:
    """The largest error of the observer from sample k_s on, over its largest of all."""
    settle = x.runs["fig13"].config.twin.settle
    return max(float(s[settle:].max() / s.max()) for s in map(np.abs, _observer_errors_mm(x)))


def _observer_errors_mm(x: Experiments) -> list[Floats]:
    """Output errors of the twin's observer from 40 instants of Fig. 4 on, theta_d exact: each (buffer,)."""
    run = x.runs["fig4"]
    twin = x.runs["fig13"].config.twin
    model = twin_model(x.structure, twin.observer_pole_rad_s, run.config.sample_time_s, twin.settle)
    q3, theta_d = x.q3_mm("fig4"), run.trace["theta_d_rad"].to_numpy()
    parts = [slice(first, first + twin.buffer) for first in range(200, 1200, 25)]
    return [filtered(q3[at], model.from_q3) + 1e3 * filtered(theta_d[at], model.from_theta_d) for at in parts]


def times_faster_than_real_time(x: Experiments) -> float:
    """The time that the twin simulates over the time that an estimate takes.

    Another process can only slow an estimate down: it is the fastest of three runs, each by its median estimate.
    """
    config = x.runs["fig13"].config
    took_s = min(float(x.runs[name].estimates["wall_s"].median()) for name in ("fig13", "no_delay", "unguarded"))
    return config.twin.buffer * config.sample_time_s / took_s


def estimations(x: Experiments, run: str) -> int:
    return len(x.runs[run].estimates)


def mean_estimate_error_deg(x: Experiments, run: str) -> float:
    return abs((x.runs[run].estimates["gap_deg"] - x.runs[run].estimates["true_gap_deg"]).mean())


def largest_estimate_error_deg(x: Experiments, runs: Sequence[str]) -> float:
    tables = [x.runs[name].estimates for name in runs]
    return max(float((table["gap_deg"] - table["true_gap_deg"]).abs().max()) for table in tables)


def largest_wear_deg(x: Experiments) -> float:
    """By how much the gap grows at most between two estimates of Fig. 14."""
    return float(x.runs["fig14"].estimates["true_gap_deg"].diff().max())


def weakest_event_over_threshold(x: Experiments) -> float:
    peaks, event = _peaks_of_index(x)
    return float(peaks[event].min()) if event.any() else math.nan


def strongest_quiet_move_over_threshold(x: Experiments) -> float:
    peaks, event = _peaks_of_index(x)
    return float(peaks[~event].max()) if not event.all() else math.nan


def _peaks_of_index(x: Experiments) -> tuple[Floats, NDArray[np.bool_]]:
    """The largest index of each move of Fig. 14 over the threshold, and whether it is an event: each (moves,)."""
    run = x.runs["fig14"]
    starts_s = x.runs["fig14"].moves["t_s"].to_numpy()
    move = np.searchsorted(starts_s, run.trace["t_s"].to_numpy() + 1e-9, side="right") - 1
    peaks = run.trace["novelty_mm"].groupby(move).max().to_numpy() / run.config.twin.novelty_threshold_mm
    events = np.searchsorted(starts_s, run.estimates["t_event_s"].to_numpy(), side="right") - 1
    return peaks, np.isin(np.arange(peaks.size), events)


def _detector(x: Experiments) -> NoveltyDesign:
    """The lock-in of Fig. 14."""
    config = x.runs["fig14"].config
    return novelty_design(config.twin.novelty_filter, x.design.dominant_frequency_rad_s, config.sample_time_s)


def filter_attenuation_db(x: Experiments) -> float:
    """Attenuation of the low-pass at omega_d."""
    return float(-_filter_gain_db(x)[1][-1])


def filter_cut_off_over_omega_d(x: Experiments) -> float:
    share, gain_db = _filter_gain_db(x)
    return float(share[np.flatnonzero(gain_db < -3.0103)[0]])


def _filter_gain_db(x: Experiments) -> tuple[Floats, Floats]:
    """Frequencies over omega_d, the last of them 1, and the gain of the low-pass there, dB."""
    share = np.linspace(0.05, 1.0, 9501)
    omega = share * x.design.dominant_frequency_rad_s * x.runs["fig14"].config.sample_time_s
    return share, 20.0 * np.log10(np.abs(sosfreqz(_detector(x).sos, omega)[1]))


def noise_attenuation_db(x: Experiments) -> float:
    """Rms of the instantaneous amplitude of white noise over that of the index under it."""
    raw = float(np.sqrt(np.mean(np.abs(hilbert(_white_noise())) ** 2)))
    return 20.0 * math.log10(raw / _rms_of_index_under_noise(x))


def ideal_noise_attenuation_db(x: Experiments) -> float:
    """The same behind an ideal low-pass whose cut-off is omega_d/2."""
    cut_off_share = x.design.dominant_frequency_rad_s / 2.0 * x.runs["fig14"].config.sample_time_s / np.pi
    return -20.0 * math.log10(math.sqrt(2.0 * cut_off_share))


def noise_over_prediction(x: Experiments) -> float:
    """Rms of the index under white noise over what the filter's noise bandwidth gives."""
    gain = np.abs(sosfreqz(_detector(x).sos, 2**18)[1])
    predicted = 2.0 * float(np.sqrt(np.mean(gain**2)))  # two channels, each of power 2, through |H|^2 from 0 to Nyquist
    return _rms_of_index_under_noise(x) / predicted


def _white_noise() -> Floats:
    return np.random.default_rng(0).standard_normal(NOISE_SAMPLES)


def _rms_of_index_under_noise(x: Experiments) -> float:
    detector = _detector(x)
    start = detector.initial_state()
    index = novelty_index(_white_noise(), detector.sos, detector.cos_step, detector.sin_step, start)
    return float(np.sqrt(np.mean(index[NOISE_SAMPLES // 100 :] ** 2)))


def raw_error_above_threshold_pct(x: Experiments) -> float:
    """Share of the time at rest in which the amplitude of the prediction error of the noisy run is above the threshold.

    Rest is from 2 s after each move on; the transform of a finite record errs at its ends.
    """
    run = x.runs["noise"]
    since = run.trace["t_s"].to_numpy() % (run.config.reference.period_s / 2.0)
    raw = np.abs(hilbert(run.trace["eps_mm"].to_numpy()))[(since > 2.0) & (since < 19.0)]
    return 100.0 * float(np.mean(raw > run.config.twin.novelty_threshold_mm))


def index_under_noise_over_threshold(x: Experiments) -> float:
    """Largest index of the noisy run over the threshold."""
    run = x.runs["noise"]
    return float(run.trace["novelty_mm"].max()) / run.config.twin.novelty_threshold_mm
