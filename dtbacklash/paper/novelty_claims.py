"""Claims about the novelty index: section 4.2, Figure 14."""

import math

import numpy as np
import pandas as pd
from scipy.signal import hilbert, sosfreqz

from dtbacklash.arrays import Floats, Ints
from dtbacklash.paper.backlash_claims import FREQUENCY, frequency_rad_s
from dtbacklash.paper.claim import Claim, between
from dtbacklash.paper.experiments import NOISE_MM, Experiments
from dtbacklash.twin.novelty import NoveltyDesign, novelty_design, novelty_index

#: samples of white noise through the detector: its rms is then known to about half a percent
NOISE_SAMPLES = 2_000_000


def figure_14(x: Experiments) -> list[Claim]:
    run = x.runs["fig14"]
    error = run.estimates["gap_deg"] - run.estimates["true_gap_deg"]
    return [
        between("Fig. 14: number of estimations", "4.2", "three", len(run.estimates), "", 3, 3, "exact"),
        *_margins(x),
        between(
            "Fig. 14: largest error of an estimate",
            "4.2",
            "as in Fig. 13",
            error.abs().max(),
            "deg",
            -math.inf,
            0.15,
            "as for Fig. 13",
        ),
        *_beside_figure_13(x),
    ]


def _margins(x: Experiments) -> list[Claim]:
    """How clearly the index tells the three moves from the seven others."""
    run = x.runs["fig14"]
    peaks = _peaks(run.trace, x.moves["fig14"]["t_s"].to_numpy()) / run.config.twin.novelty_threshold_mm
    event = np.isin(np.arange(peaks.size), _moves_of(run.estimates, x.moves["fig14"]))
    said = "an event where it is larger than 0.1 mm"
    return [
        between(
            "Fig. 14: index at the weakest event over the threshold",
            "4.2",
            said,
            float(peaks[event].min()) if event.any() else math.nan,
            "",
            1.1,
            math.inf,
            "a tenth above, so that three is no accident",
        ),
        between(
            "Fig. 14: largest index at a move without an event over the threshold",
            "4.2",
            said,
            float(peaks[~event].max()) if not event.all() else math.nan,
            "",
            -math.inf,
            0.9,
            "a tenth below, so that three is no accident",
        ),
    ]


def _peaks(trace: pd.DataFrame, starts_s: Floats) -> Floats:
    """The largest index of each move, mm."""
    move = np.searchsorted(starts_s, trace["t_s"].to_numpy() + 1e-9, side="right") - 1
    return trace["novelty_mm"].groupby(move).max().to_numpy()


def _moves_of(estimates: pd.DataFrame, moves: pd.DataFrame) -> Ints:
    """The numbers (from 0) of the moves in which the events lie."""
    found: Ints = np.searchsorted(moves["t_s"].to_numpy(), estimates["t_event_s"].to_numpy(), side="right") - 1
    return found


def _beside_figure_13(x: Experiments) -> list[Claim]:
    q3 = {name: x.runs[name].trace["q3_mm"].to_numpy() for name in ("fig8", "fig13", "fig14")}
    away = float(np.sqrt(np.mean((q3["fig14"] - q3["fig13"]) ** 2)))
    linear = float(np.sqrt(np.mean((q3["fig8"] - q3["fig13"]) ** 2)))
    estimates = x.runs["fig14"].estimates
    wear = float(estimates["true_gap_deg"].diff().max())
    return [
        between(
            "Fig. 14: rms distance of q3 from Fig. 13, over that of Fig. 8",
            "4.2",
            "does not differ much",
            away / linear,
            "",
            -math.inf,
            0.6,
            "nearer to Fig. 13 than to linear IMC",
        ),
        between(
            "Fig. 14: largest overshoot beside Fig. 13's",
            "4.2",
            "does not differ much",
            x.moves["fig14"]["overshoot_pct"].max() - x.moves["fig13"]["overshoot_pct"].max(),
            "points",
            -math.inf,
            2.0,
            "twice the settling band",
            "a move that raises the alarm is itself made with the old gap, and "
            f"between two estimates the gap grows by up to {wear:.0f} deg",
        ),
    ]


def _detector(x: Experiments) -> NoveltyDesign:
    """The lock-in of Fig. 14."""
    config = x.runs["fig14"].config
    return novelty_design(config.twin.novelty_filter, x.design.dominant_frequency_rad_s, config.sample_time_s)


def novelty_filter(x: Experiments) -> list[Claim]:
    """The two edges of the low-pass, each on its own."""
    omega_d, sample_time_s = x.design.dominant_frequency_rad_s, x.runs["fig14"].config.sample_time_s
    omega = np.linspace(0.05, 1.0, 9501) * omega_d
    gain = 20.0 * np.log10(np.abs(sosfreqz(_detector(x).sos, omega * sample_time_s)[1]))
    return [
        between(
            "Novelty filter: attenuation at omega_d",
            "4.2",
            "40 dB",
            float(-gain[-1]),
            "dB",
            39.9,
            math.inf,
            "as it is said, to rounding",
        ),
        between(
            "Novelty filter: cut-off over omega_d",
            "4.2",
            "omega_d/2",
            float(omega[np.flatnonzero(gain < -3.0103)[0]] / omega_d),
            "",
            0.45,
            0.55,
            "one digit",
        ),
    ]


def noise(x: Experiments) -> list[Claim]:
    """White noise through the lock-in, beside the instantaneous amplitude of the noise itself."""
    detector = _detector(x)
    sample_time_s = x.runs["fig14"].config.sample_time_s
    white = np.random.default_rng(0).standard_normal(NOISE_SAMPLES)
    start = detector.initial_state()
    index = novelty_index(white, detector.sos, detector.cos_step, detector.sin_step, start)[NOISE_SAMPLES // 100 :]
    rms, raw_rms = (float(np.sqrt(np.mean(a**2))) for a in (index, np.abs(hilbert(white))))
    gain = np.abs(sosfreqz(detector.sos, 2**18)[1])
    predicted = 2.0 * float(np.sqrt(np.mean(gain**2)))  # two channels, each of power 2, through |H|^2 from 0 to Nyquist
    cut_off_share = x.design.dominant_frequency_rad_s / 2.0 * sample_time_s / np.pi
    ideal_db = -20.0 * math.log10(math.sqrt(2.0 * cut_off_share))
    return [
        between(
            "Lock-in: attenuation of white noise against its instantaneous amplitude",
            "4.2, 5",
            "attenuates measurement noise",
            20.0 * math.log10(raw_rms / rms),
            "dB",
            ideal_db,
            math.inf,
            "what an ideal low-pass with the cut-off omega_d/2 leaves; 2000 s of noise through the detector",
        ),
        between(
            "Lock-in: rms of the index under white noise over what the filter's noise bandwidth gives",
            "4.2",
            "attenuates measurement noise",
            rms / predicted,
            "",
            0.98,
            1.02,
            "four times the scatter of 2000 s",
        ),
        *_noisy_loop(x),
    ]


def _noisy_loop(x: Experiments) -> list[Claim]:
    """The prediction error of a loop with noise on q3, in the rest from 2 s after each move on, hardly any gap."""
    run = x.runs["noise"]
    trace, threshold_mm = run.trace, run.config.twin.novelty_threshold_mm
    since = trace["t_s"].to_numpy() % (run.config.reference.period_s / 2.0)
    rest = (since > 2.0) & (since < 19.0)  # the transform of a finite record errs at its ends
    raw = np.abs(hilbert(trace["eps_mm"].to_numpy()))[rest]
    sensor = f"a sensor with {NOISE_MM:g} mm of noise"
    return [
        between(
            f"Share of the time at rest in which the amplitude of the raw error is above the threshold, {sensor}",
            "4.2",
            "susceptible to any measurement noise",
            100.0 * float(np.mean(raw > threshold_mm)),
            "%",
            1.0,
            math.inf,
            "each is a false alarm: the gap is below 9 deg, and without noise there is none",
        ),
        between(
            f"Largest index of the same run over the threshold, {sensor}",
            "4.2",
            "attenuates measurement noise",
            float(trace["novelty_mm"].max()) / threshold_mm,
            "",
            -math.inf,
            0.5,
            "half the threshold: no alarm, and none near",
        ),
    ]


def tracked_frequency(x: Experiments) -> list[Claim]:
    """Section 4.2's outlook: omega_d itself as an index of the structure."""
    expected = math.sqrt(0.8)
    return [
        between(
            "Frequency of the transient over the nominal omega_d, springs 20 % softer",
            "4.2",
            "tells a change of the structure",
            frequency_rad_s(x.runs["soft"].trace, 180.0) / x.design.dominant_frequency_rad_s,
            "",
            expected - 0.02,
            expected + 0.02,
            f"the root of 0.8, where a gap leaves 1.00 (Figs. 8 and 10); {FREQUENCY}",
        )
    ]
