"""The settings that decide what a diagnosis says: each with its value, its unit, and the reason that it is there.

What is a setting: a number that several modules share, or that decides what a report says. All others are constants
beside their code, each with its meaning; the bars of the one comparison are in :mod:`.fit.comparison`. None is changed
while a program runs: halved and doubled, none changed a verdict or a name.
"""

from dataclasses import dataclass
from typing import Any

from dtbacklash.config.setting import declared, setting


# fmt: off
@dataclass(frozen=True)
class DiagnoseSettings:
    """All of them, by stage. Shares and ratios are of what the reason names; floors are the noise floor's."""

    # parts of a recording
    held_out_share: float = setting(
        0.4, "end of a recording that is not fitted to where no other recording judges", unit="share")
    judging_share: float = setting(
        0.375, "of what is held out, the last, which judges; what chooses comes before", unit="share")
    turns_max: int = setting(
        4, "so often what chooses takes turns with what is fitted to: what happens seldom shows in both", unit="turns")
    paired_stretches: int = setting(
        12, "losses are compared over so many stretches: each counts once, and what is correlated within it, too",
        unit="stretches")

    # inspection: sensors, sampling, wiring
    spike_samples_max: int = setting(2, "what lasts longer is a motion", unit="samples")
    spike_ratio: float = setting(
        8.0, "a spike is so much further off its median than usual and than noise, which outliers of noise are not",
        unit="ratio")
    spike_usual_share: float = setting(
        0.998, "this quantile is how far samples usually are off their median", unit="share")
    dead_noise_share: float = setting(
        0.8, "a channel of whose variance more is white noise, coherent with nothing, is dead", unit="share")
    mode_samples_min: float = setting(
        6.0, "with fewer a measured angle, linear between samples, drives a mode wrongly by more than a tenth",
        unit="samples per period")
    reversal_share: float = setting(
        0.5, "a sign is wrong above it; of 431 channels that were wired right the largest had 0.34",
        unit="share of effort")

    # the command, and a beginning in motion
    delay_reach_samples: int = setting(
        30, "the longest sensor delay that is tried; as many first samples it may keep from being known",
        unit="samples")
    beginning_samples_min: int = setting(
        200, "a first state is fitted to as many samples at least", unit="samples")
    beginning_squares: float = setting(
        100.0, "a speed at the first sample is one if without it so much more is left: ten standard deviations",
        unit="variances of the noise")

    # comparison
    pull_ratio: float = setting(
        1.5, "bandwidth of the pull towards the measurement: slow against the laws, fast against drift", unit="tempos")
    pull_per_sample_max: float = setting(
        0.25, "a faster pull than this share of the sampling would hand the measurement back", unit="rad per sample")
    integrator_ratio: float = setting(
        0.01, "a slower pole integrates: it does not decay while the machine moves to and fro", unit="tempos")

    # noise floor
    numerical_error_share: float = setting(
        3e-5, "two integrators of the same equations differ by less: no floor is lower", unit="share of the signal")
    counted_share: float = setting(
        0.5, "a channel of counts repeats its values: it has this many at most", unit="share of samples")

    # fit
    tolerances_max: float = setting(
        3.0, "a parameter of the rig further from nominal is physics and no recalibration", unit="tolerances")
    astray_tolerances: float = setting(
        2.5, "a parameter so far away may have been led astray, by missing physics or a misplaced resonance: the fit "
        "starts anew from nominal",
        unit="tolerances")

    # bank of signatures
    scanned_starts: int = setting(
        2, "so many of the best wave numbers or delays are simulated: the regression may confuse neighbours",
        unit="count")

    # search
    search_samples_max: int = setting(
        40_000, "of a longer recording the search looks at windows with so many samples in all: it makes hundreds of "
        "simulations, and names do not change by more", unit="samples")
    search_window_decays: float = setting(
        20.0, "a shorter window shows mostly the state in which it began", unit="slowest decays")
    quick_fits: int = setting(
        5, "the best of the bank that are fitted quickly: signatures are linear and rank roughly", unit="candidates")
    gain_min: float = setting(
        12.0, "a signature that promises less is chance: the best of fifty seldom reaches it", unit="-2 log-likelihood")
    close_floors: float = setting(1.1, "a fit that leaves less leaves noise only", unit="floors, rms")
    hopeless_ratio: float = setting(
        4.0, "the same where the best leaves more than noise: others may still overtake it", unit="ratio")

    # what an effect has to earn
    nearly_noise_floors: float = setting(
        2.0, "a fit that leaves less in every channel leaves hardly more than noise", unit="floors, mean square")

    # trial of a name
    bound_share: float = setting(
        0.01, "a parameter so near to a bound stands at it: the data did not choose it", unit="share of the bound")
    away_errors: float = setting(
        1.96, "an effect's size has to be so far from doing nothing: its 95 % interval excludes it",
        unit="standard errors")

    # verdict
    noise_floors: float = setting(
        1.2, "a channel of which less is left is noise: the floor is an estimate itself", unit="floors, mean square")
    formulation_deviations: float = setting(
        2.0, "two formulations of a law differ by so much at most",
        unit="standard deviations of the catalogue")
    depends_errors: float = setting(
        3.5, "an effort over a state beats nothing by so much: the best of some thirty states is looked at",
        unit="standard errors")
    depends_floors: float = setting(
        0.03, "and by so much in size: less matters to nobody", unit="floors, mean square")
    needed_ratio: float = setting(
        1.03, "recalibration is needed where a channel's held-out mean square is so much larger without it",
        unit="ratio of mean squares")

    # effort of free form, findings, checks, advice
    recovered_smoothing: float = setting(
        1e-3, "weight of the heights' second differences, so that hats without data follow their neighbours",
        unit="ratio to the data")
    white_lags: int = setting(20, "of the test for whiteness, Ljung and Box's usual number", unit="lags")

    def to_json(self) -> dict[str, dict[str, Any]]:
        """Name -> value, unit and reason."""
        return {
            one.key: {"value": getattr(self, one.key), "unit": one.about.unit, "reason": one.about.meaning}
            for one in declared(DiagnoseSettings)
        }
# fmt: on


SETTINGS = DiagnoseSettings()
