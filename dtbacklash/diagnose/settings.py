"""The settings that decide what a diagnosis says: each with its value, its unit, and the reason that it is there.

What is a setting: a number that moves a verdict, a name, an estimate or an interval. What stays a constant beside its
code: pure numerics (substeps, steps of differences, lengths of filters, guards against overflow, how many samples are
looked at), what is only drawn or worded, and numbers of definitions (1.96 for an interval of 95 %).

A module asks :func:`settings` when it needs one; :func:`using` puts others in force. The choice belongs to the process
and not to a thread, so that the threads which share the work of a diagnosis see it too; :mod:`.spread` hands it to
other machines.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from dtbacklash.config.setting import check, declared, setting


# fmt: off
@dataclass(frozen=True)
class DiagnoseSettings:
    """All of them, by stage. Shares and ratios are of what the reason names; floors are the noise floor's.

    Raises
    ------
    UserError : a value out of its bounds.
    """

    # parts of a recording
    held_out_share: float = setting(
        0.4, "end of a recording that is not fitted to where no other recording judges", unit="share", above=0, below=1)
    judging_share: float = setting(
        0.375, "of what is held out, the last, which judges; what chooses comes before", unit="share", above=0,
        below=1)
    turns_max: int = setting(
        4, "so often what chooses takes turns with what is fitted to: what happens seldom shows in both", unit="turns",
        at_least=1)
    turn_stretches: int = setting(
        3, "what chooses at a turn lasts so long at least: what is near what was fitted to flatters", unit="stretches",
        at_least=1)
    stretch_decays_min: float = setting(
        1.0, "a shorter stretch beside others shows mostly the state in which it began", unit="slowest decays", above=0)
    paired_stretches: int = setting(
        12, "losses are compared over so many stretches: each counts once, and what is correlated within it, too",
        unit="stretches", at_least=2)

    # inspection: sensors, sampling, wiring
    clipped_share_max: float = setting(
        0.25, "a channel clipped more often can neither be mended nor left out", unit="share of samples", above=0,
        below=1)
    clipped_decays: float = setting(
        15.0, "after so long a simulation has forgotten a bridge towards which it was pulled",
        unit="time constants of the pull", above=0)
    inspected_share_min: float = setting(
        0.5, "of the samples to fit to and to judge on, this much has to remain", unit="share", above=0, at_most=1)
    spike_samples_max: int = setting(2, "what lasts longer is a motion", unit="samples", at_least=1)
    spike_window_samples: int = setting(
        7, "the median's window: most of it lies beside the longest spike", unit="samples", at_least=3)
    spike_ratio: float = setting(
        8.0, "a spike is so much further off its median than usual and than noise, which outliers of noise are not",
        unit="ratio", above=1)
    spike_usual_share: float = setting(
        0.998, "this quantile is how far samples usually are off their median", unit="share", above=0, below=1)
    spike_counts: float = setting(5.0, "an encoder jitters by fewer counts than a spike has", unit="counts", above=0)
    spike_roughness: float = setting(
        3.0, "a spike is so much further off the cubic through its neighbours than usual; a turning point is not",
        unit="ratio", above=0)
    spikes_share_max: float = setting(
        0.01, "what is more frequent is a signal's own way and no spike", unit="share of samples", above=0, below=1)
    jump_ratio: float = setting(
        3.0, "a signal jumps where its step is so much larger than the rms of its steps", unit="ratio", above=0)
    jump_answer_samples: int = setting(
        20, "so long after a jump of the command a current may answer like a spike", unit="samples", at_least=1)
    held_together_share: float = setting(
        0.01, "a channel that changes more often at two samples in a row is read at every sample",
        unit="share of changes", above=0, below=1)
    held_counts: float = setting(
        3.0, "and one that changes by fewer counts may move slowly over them", unit="counts", above=0)
    held_readings_min: int = setting(
        500, "a channel of fewer readings is left out: some stretches of twenty have to remain to choose by",
        unit="readings", at_least=1)
    hung_samples_min: int = setting(5, "fewer equal readings are no pattern", unit="samples", at_least=2)
    hung_repeats_share: float = setting(
        0.05, "where readings repeat more often than this, a sensor's counts are coarse and it does not hang",
        unit="share of samples", above=0, below=1)
    hung_chance: float = setting(
        1e-3, "how seldom equal readings by chance may be taken for a sensor that hangs", unit="probability", above=0,
        below=1)
    dead_noise_share: float = setting(
        0.8, "a channel of whose variance more is white noise, coherent with nothing, is dead", unit="share", above=0,
        below=1)
    coherence_stretches_min: int = setting(
        16, "with fewer, noise is coherent by chance", unit="stretches", at_least=2)
    coherence_chance: float = setting(
        1e-3, "how seldom noise alone may be taken for a signal", unit="probability", above=0, below=1)
    mode_samples_min: float = setting(
        6.0, "with fewer a measured angle, linear between samples, drives a mode wrongly by more than a tenth",
        unit="samples per period", above=2)
    mode_band_share: float = setting(
        0.7, "from this share of its frequency on, power belongs to a mode: damping widens it", unit="share", above=0,
        at_most=1)
    reversal_share: float = setting(
        0.5, "a sign is wrong above it; of 431 channels that were wired right the largest had 0.34",
        unit="share of effort", above=0, below=1)
    rewiring_share: float = setting(
        0.1, "two rewirings mend alike where their sums of reversals differ by less", unit="share of effort", above=0)

    # the command, and a beginning in motion
    smooth_command_share: float = setting(
        0.7, "a command is read as smooth where that leaves less than this of what holding it leaves: held is the rule",
        unit="share of the mean square", above=0, at_most=1)
    delay_reach_samples: int = setting(
        30, "the longest sensor delay that is tried; as many first samples it may keep from being known",
        unit="samples", at_least=1)
    beginning_decays: float = setting(
        3.0, "the first state is fitted until what it adds has died out to a twentieth", unit="slowest decays", above=0)
    beginning_samples_min: int = setting(
        200, "a first state is fitted to as many samples at least", unit="samples", at_least=10)
    beginning_integrating_ratio: float = setting(
        25.0, "and as long where an integrator runs freely: its first speed counts to the end", unit="1/tempo", above=0)
    beginning_squares: float = setting(
        100.0, "a speed at the first sample is one if without it so much more is left: ten standard deviations",
        unit="variances of the noise", above=0)
    beginning_noise_ratio: float = setting(
        1.1, "a smooth curve pictures a beginning where it leaves so much noise at most", unit="ratio", at_least=1)
    beginning_scatter: float = setting(
        2.0, "and the scatter of what it leaves, of which few samples have much", unit="standard errors", above=0)
    beginning_speed_share: float = setting(
        0.5, "where no curve is fair, a first speed is one from this share of the fastest", unit="share", above=0,
        at_most=1)
    beginning_ratio: float = setting(
        25.0, "a first state explains a beginning of which rest leaves so many times more; missing physics goes on",
        unit="ratio of squares", above=1)
    beginning_hidden_ratio: float = setting(
        10.0, "a hidden body near its resonance moves so much further than its host: its first state's prior",
        unit="ratio", above=0)
    beginning_memory_ratio: float = setting(
        10.0, "a memory's first value lies within so much of what it comes to: its prior", unit="ratio", above=0)

    # comparison
    pull_ratio: float = setting(
        1.5, "bandwidth of the pull towards the measurement: slow against the laws, fast against drift", unit="tempos",
        above=0)
    pull_slow_ratio: float = setting(
        0.05, "bandwidth of the last fit where the pull moves position and speed: prediction lives at low frequencies",
        unit="tempos", above=0)
    pull_agrees_ratio: float = setting(
        3.0, "so many times slower a pull has to agree, where a free run says nothing", unit="ratio", above=1)
    pull_per_sample_max: float = setting(
        0.25, "a faster pull than this share of the sampling would hand the measurement back", unit="rad per sample",
        above=0, at_most=1)
    pull_error_share_max: float = setting(
        0.2, "a simulation further off is pulled faster: laws would be evaluated along a motion that never was",
        unit="share of the motion", above=0)
    integrator_ratio: float = setting(
        0.01, "a slower pole integrates: it does not decay while the machine moves to and fro", unit="tempos", above=0)

    # noise floor
    numerical_error_share: float = setting(
        3e-5, "two integrators of the same equations differ by less: no floor is lower", unit="share of the signal",
        above=0)
    method_error_share: float = setting(
        2e-4, "what linear motion between samples leaves where a sensor is exact", unit="share of the signal", above=0)
    counted_share: float = setting(
        0.5, "a channel of counts repeats its values: it has this many at most", unit="share of samples", above=0,
        at_most=1)
    quieter_ratio: float = setting(
        0.8, "a channel's noise is corrected where a residual shows less than this of it: its estimate scatters",
        unit="ratio", above=0, at_most=1)

    # fit
    tolerances_max: float = setting(
        3.0, "a parameter of the rig further from nominal is physics and no recalibration", unit="tolerances", above=0)
    tolerance_room: float = setting(
        0.3, "a known effect's parameter nearer to its bound has no room left, and is looked for freely",
        unit="tolerances", above=0)
    effect_tolerance: float = setting(
        0.3, "of an effect of the nominal rig whose own is not given: what one knows of a friction, roughly",
        unit="share (an angle: rad)", above=0)
    found_tolerance_min: float = setting(
        1e-3, "what was found is known no better, from one recording to the next", unit="share", above=0)
    found_tolerance_max: float = setting(0.5, "nor worse, or it would not have been named", unit="share", above=0)
    correlated_ratio: float = setting(
        0.5, "a residual far above the floor is correlated so long: it counts once, or it would overrule every prior",
        unit="1/tempo", above=0)
    astray_tolerances: float = setting(
        2.5, "a parameter so far away may have been led astray, by missing physics or a misplaced resonance: the fit "
        "starts anew from nominal",
        unit="tolerances", above=0)

    # standard errors
    error_stretches: int = setting(
        2, "the score's scatter is taken over as many of the stretches that judge: it is correlated for longer",
        unit="stretches", at_least=1)
    error_groups_min: int = setting(
        16, "over at least as many groups, or the scatter is not known itself", unit="groups", at_least=2)

    # bank of signatures
    signature_growth_max: float = setting(
        30.0, "a size is changed by so much at once: laws are not linear in it", unit="ratio", above=1)
    signature_growths: int = setting(3, "a size is brought to that of the residual so often", unit="times", at_least=1)
    signature_size_band: float = setting(
        3.0, "a signature within this of the residual's size is not made again", unit="ratio", above=1)
    signature_shrinks: int = setting(
        6, "a size is made smaller so often where the simulation runs away", unit="times", at_least=1)
    signature_shrink_ratio: float = setting(0.1, "and by so much", unit="ratio", above=0, below=1)
    signature_grown_gain: float = setting(
        1.02, "twice the size is the better start of a fit if it explains so many times as much: from a play that is "
        "far too small no way leads to a wide one", unit="ratio", above=1)
    wave_step_share: float = setting(
        0.5, "wave numbers are this far apart over the travel, so that none slips through", unit="cycles", above=0)
    waves_max: int = setting(
        150, "where the travel tells more apart, so many of the likeliest wave numbers are regressed", unit="count",
        at_least=3)
    wave_every_samples: int = setting(
        5, "every so many samples are enough to choose a wave number", unit="samples", at_least=1)
    delay_step_samples: float = setting(
        0.5, "delays are tried as finely: a fit has a valley each sample", unit="samples", above=0)
    scanned_starts: int = setting(
        2, "so many of the best wave numbers or delays are simulated: the regression may confuse neighbours",
        unit="count", at_least=1)

    # search
    search_samples_max: int = setting(
        40_000, "of a longer recording the search looks at windows with so many samples in all: it makes hundreds of "
        "simulations, and names do not change by more", unit="samples", at_least=1000)
    search_windows: int = setting(
        4, "so many windows of what is fitted to, and of what chooses: what changes with time shows in several",
        unit="windows", at_least=1)
    search_window_decays: float = setting(
        20.0, "a shorter window shows mostly the state in which it began", unit="slowest decays", above=0)
    effects_max: int = setting(4, "one recording does not carry more", unit="effects", at_least=1)
    quick_fits: int = setting(
        5, "the best of the bank that are fitted quickly: signatures are linear and rank roughly", unit="candidates",
        at_least=1)
    full_fits: int = setting(3, "the best of the quick fits that are fitted in full", unit="candidates", at_least=1)
    gain_min: float = setting(
        12.0, "a signature that promises less is chance: the best of fifty seldom reaches it", unit="-2 log-likelihood",
        above=0)
    gain_floor_share: float = setting(
        0.0075, "a signature has to promise as much a sample: less is chance", unit="floors, mean square", above=0)
    gain_weight_ratio: float = setting(
        20.0, "where the residual is not noise, samples count so much more towards that than their weight says",
        unit="ratio", above=0)
    twin_cosine: float = setting(
        0.95, "signatures more alike than this are those of twins, which are fitted beside the best", unit="cosine",
        above=0, below=1)
    twins_max: int = setting(3, "so many of them", unit="candidates", at_least=1)
    runners_up: int = setting(
        2, "of what came next to the effect that was added last, so many are fitted in full beside it: of two large "
        "effects each hides the other", unit="candidates", at_least=1)
    pair_firsts: int = setting(
        2, "where no effect earns its place alone, so many that take away enough are tried in pairs",
        unit="candidates", at_least=0)
    swap_rivals: int = setting(
        2, "rivals that an effect is tried against when another one has joined", unit="candidates", at_least=1)
    final_rivals: int = setting(4, "rivals that it is tried against in the end", unit="candidates", at_least=1)
    close_floors: float = setting(1.1, "a fit that leaves less leaves noise only", unit="floors, rms", at_least=1)
    hopeless_ratio_noise: float = setting(
        1.5, "a quick fit that leaves so much more than the best, which leaves noise, is not finished", unit="ratio",
        at_least=1)
    hopeless_ratio: float = setting(
        4.0, "the same where the best leaves more than noise: others may still overtake it", unit="ratio", at_least=1)

    # what an effect has to earn
    earn_penalty: float = setting(
        15.0, "so much less of the prior's penalty makes up for no gain: parameters come back from four tolerances",
        unit="-2 log-likelihood", above=0)
    nearly_noise_floors: float = setting(
        2.0, "a fit that leaves less in every channel leaves hardly more than noise", unit="floors, mean square",
        at_least=1)
    merit_train_weight: float = setting(
        0.5, "of the fitted part's loss beside the choosing part's in ranking fits: it was fitted to",
        unit="ratio", at_least=0)

    # trial of a name
    bound_share: float = setting(
        0.01, "a parameter so near to a bound stands at it: the data did not choose it", unit="share of the bound",
        above=0)
    free_worse_ratio: float = setting(
        1.2, "a law may make the free simulation worse by so much by chance: it drifts", unit="ratio of mean squares",
        at_least=1)
    repeated_share: float = setting(
        0.5, "a run that noise or another formulation turns elsewhere, by this share of its error, judges no law",
        unit="share of the error", above=0, at_most=1)
    away_errors: float = setting(
        1.96, "an effect's size has to be so far from doing nothing: its 95 % interval excludes it",
        unit="standard errors", above=0)

    # verdict
    noise_floors: float = setting(
        1.2, "a channel of which less is left is noise: the floor is an estimate itself", unit="floors, mean square",
        at_least=1)
    coloured_ratio: float = setting(
        5.0, "a residual that exceeds the threshold of the test for whiteness so many times has a structure",
        unit="ratio", at_least=1)
    coloured_floors: float = setting(
        1.05, "such a residual is more than noise from here on", unit="floors, mean square", above=1)
    noise_part_floors: float = setting(
        2.0, "the same of the part of a recording where it is larger", unit="floors, mean square", at_least=1)
    formulation_deviations: float = setting(
        2.0, "two formulations of a law differ by so much at most",
        unit="standard deviations of the catalogue", above=0)
    depends_errors: float = setting(
        3.5, "an effort over a state beats nothing by so much: the best of some thirty states is looked at",
        unit="standard errors", above=0)
    depends_floors: float = setting(
        0.03, "and by so much in size: less matters to nobody", unit="floors, mean square", above=0)
    located_share: float = setting(
        0.05, "an effort that explains less of what is left does not show where it acts",
        unit="share of what is left", above=0, below=1)
    moved_share: float = setting(0.2, "a parameter that moved by less has not", unit="share of its tolerance", above=0)
    moved_errors: float = setting(
        0.7, "nor one by less than this: it follows another along a direction that cannot be seen",
        unit="standard errors", above=0)
    needed_ratio: float = setting(
        1.03, "recalibration is needed where a channel's held-out mean square is so much larger without it",
        unit="ratio of mean squares", at_least=1)

    # effort of free form, findings, checks, advice
    recovered_knots: int = setting(
        25, "hats over a state: enough for friction's corner, few enough for their noise", unit="hats", at_least=5)
    recovered_tail_share: float = setting(
        0.002, "outermost values, beyond the outermost hats, that a spike would have moved", unit="share", above=0,
        below=0.5)
    recovered_smoothing: float = setting(
        1e-3, "weight of the heights' second differences, so that hats without data follow their neighbours",
        unit="ratio to the data", above=0)
    sharp_stretch_share: float = setting(
        0.03, "a law whose width is below this share of its spring's stretch has become the sharp one",
        unit="share of the stretch", above=0)
    limit_less_share: float = setting(
        0.25, "the law that another one has become may explain so much less of what that one explains", unit="share",
        above=0, at_most=1)
    limit_less_floors: float = setting(
        0.03, "and so much of the floor, which is the floor's own uncertainty", unit="floors, mean square", above=0)
    limit_kept_share: float = setting(
        3e-3, "of a signature that is left beside what the parameters can do, less is the simulation's own error",
        unit="share of the norm", above=0, below=1)
    told_apart_share: float = setting(
        0.01, "an experiment that makes two models differ by less is not advised", unit="share of the signal", above=0)
    white_lags: int = setting(20, "of the test for whiteness, Ljung and Box's usual number", unit="lags", at_least=1)
    white_ratio: float = setting(
        3.0, "a residual may be so much more coloured than a true model's, of which one simulation tells roughly",
        unit="ratio", above=1)
    overfitted_ratio: float = setting(
        1.2, "the held-out mean square may be so much larger than the fitted part's by chance", unit="ratio", above=1)

    def __post_init__(self) -> None:
        check(self)

    def to_json(self) -> dict[str, dict[str, Any]]:
        """Name -> value, unit and reason."""
        return {
            one.key: {"value": getattr(self, one.key), "unit": one.about.unit, "reason": one.about.meaning}
            for one in declared(DiagnoseSettings)
        }
# fmt: on


_current = DiagnoseSettings()


def settings() -> DiagnoseSettings:
    """The settings in force."""
    return _current


@contextmanager
def using(chosen: DiagnoseSettings) -> Iterator[DiagnoseSettings]:
    """Within it, other settings are in force: in the whole process, in which one diagnosis may run at a time."""
    global _current  # noqa: PLW0603  # a context variable would not reach threads that are there already
    before = _current
    _current = chosen
    try:
        yield chosen
    finally:
        _current = before
