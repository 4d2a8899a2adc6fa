"""The paragraph of methods of a diagnosis: what was done, with the numbers of this one, and the works it rests on."""

from __future__ import annotations

from dtbacklash.diagnosis.labels import listed
from dtbacklash.diagnosis.result import Diagnosis
from dtbacklash.diagnosis.settings import SETTINGS
from dtbacklash.report.components.intervals import interval
from dtbacklash.report.components.numbers import number

UNKNOWN_FORCE = (
    "N. R. Kristensen, H. Madsen, S. B. Jørgensen, A method for systematic improvement of stochastic grey-box models, "
    "Automatica 40 (2004) 225"
)
LIKELIHOOD = "L. Ljung, System Identification: Theory for the User, 2nd ed., Prentice Hall (1999)"
SCORE_TEST = "C. R. Rao, Large sample tests of statistical hypotheses, Proc. Camb. Phil. Soc. 44 (1948) 50"
LEAST_SQUARES = (
    "D. W. Marquardt, An algorithm for least-squares estimation of nonlinear parameters, J. Soc. Ind. Appl. Math. 11 "
    "(1963) 431"
)
PENALTY = "G. Schwarz, Estimating the dimension of a model, Ann. Statist. 6 (1978) 461"
HELD_OUT = (
    "M. Stone, Cross-validatory choice and assessment of statistical predictions, J. R. Stat. Soc. B 36 (1974) 111"
)
SANDWICH = "H. White, Maximum likelihood estimation of misspecified models, Econometrica 50 (1982) 1"
LATENT = (
    "T. J. Rogers, T. Friis, A latent restoring force approach to nonlinear system identification, Mech. Syst. "
    "Signal Process. 180 (2022) 109426"
)


class _Cited:
    """Works in the order in which they are first cited."""

    def __init__(self) -> None:
        self.works: list[str] = []

    def __call__(self, work: str) -> str:
        if work not in self.works:
            self.works.append(work)
        return f"[{self.works.index(work) + 1}]"


def methods(diagnosis: Diagnosis) -> tuple[str, list[str]]:
    """The paragraph, and the works that it cites by number; empty where the diagnosis does not say what it did."""
    work = diagnosis.work
    if work is None:
        return "", []
    rate = f", a reading being the mean of {work.every} samples" if work.every > 1 else ""
    floor = listed([f"{interval(v, None, diagnosis.nominal.sensors[c].unit)} of {c}" for c, v in work.floor.items()])
    cite = _Cited()
    total = work.fitted + work.judged
    told = [
        f"{_recorded(diagnosis, total, work.sample_time_s)} compared with the rig {diagnosis.nominal.config.name} by a "
        "predictor: the rig is simulated under the command and corrected, at each reading, by what was measured, with "
        f"a white force of unknown size at each body {cite(UNKNOWN_FORCE)}{rate}."
    ]
    if work.smooth:
        told.append("The command is a measured signal and was taken to pass smoothly through its samples.")
    told += [
        f"Everything was fitted to {work.fitted} samples and judged on the other {work.judged} "
        f"({number(100 * work.judged / total, 2)} %), which chose nothing {cite(HELD_OUT)}.",
        "The sizes of the unknown forces and of the sensors' noise are those that make the predictor's errors "
        f"likeliest {cite(LIKELIHOOD)}; were the rig true, it would leave an rms error of {floor}.",
        "The rig's parameters were recalibrated, each held by its tolerance; what the rig then lacks shows as unknown "
        "force.",
        f"{work.columns} effects of the catalogue, each at its place, were ranked by how much of the predictor's "
        f"errors their columns explain, beside the columns of the parameters {cite(SCORE_TEST)}; {_fits(work.fits)}, "
        f"jointly with the parameters, by Gauss and Newton's method on the predictor {cite(LEAST_SQUARES)}.",
        "One number compares all models: minus twice the log likelihood, with the logarithm of the number of readings "
        f"for each parameter that was added {cite(PENALTY)}.",
        "A name is sure if, in three views of the errors (of one step, over long horizons and whitened), it leads each "
        f"rival that was fitted in its place, and the rig without it, by {number(SETTINGS.min_t)} standard errors of "
        "that lead over stretches of the recording, and if little unknown force is left.",
        "Intervals are 95 %, from the curvature of the likelihood and the scatter of its slope over stretches of the "
        f"recording {cite(SANDWICH)}.",
    ]
    if diagnosis.shown.laws:
        told.append(
            "Points beside a law are a sum of hat functions of its state, held back where the recording says little, "
            f"which one regression fits to the predictor's errors without that law {cite(LATENT)}."
        )
    return " ".join(told), cite.works


def _recorded(diagnosis: Diagnosis, total: int, sample_time_s: float) -> str:
    """What was compared, with its verb."""
    steps = sorted({one.sample_time_s for one in diagnosis.recordings} or {sample_time_s})
    of = f"{total} samples of {listed([interval(step, None, 's') for step in steps])}"
    if not diagnosis.recordings:
        return f"The recording, {of}, was"
    return f"{len(diagnosis.recordings)} recordings, together {of}, each at its own rate, were"


def _fits(count: int) -> str:
    if count == 0:
        return "none promised enough to be fitted in full"
    return "the most promising one was fitted in full" if count == 1 else f"the best {count} were fitted in full"
