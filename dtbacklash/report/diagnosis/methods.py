"""The paragraph of methods of a diagnosis: what was done, with the numbers of this one, and the works it rests on."""

from __future__ import annotations

from dtbacklash.diagnose.result import Diagnosis
from dtbacklash.diagnose.shown import Work
from dtbacklash.report.diagnosis.words import listed
from dtbacklash.report.kit.intervals import interval
from dtbacklash.report.kit.numbers import number

OBSERVER = "D. G. Luenberger, An introduction to observers, IEEE Trans. Autom. Control 16 (1971) 596"
SPECTRUM = (
    "P. D. Welch, The use of fast Fourier transform for the estimation of power spectra, IEEE Trans. Audio "
    "Electroacoust. 15 (1967) 70"
)
SCORE_TEST = "C. R. Rao, Large sample tests of statistical hypotheses, Proc. Camb. Phil. Soc. 44 (1948) 50"
LEAST_SQUARES = (
    "M. A. Branch, T. F. Coleman, Y. Li, A subspace, interior, and conjugate gradient method for large-scale "
    "bound-constrained minimization problems, SIAM J. Sci. Comput. 21 (1999) 1"
)
HELD_OUT = (
    "M. Stone, Cross-validatory choice and assessment of statistical predictions, J. R. Stat. Soc. B 36 (1974) 111"
)
PAIRED = "F. X. Diebold, R. S. Mariano, Comparing predictive accuracy, J. Bus. Econ. Stat. 13 (1995) 253"
SANDWICH = "H. White, Maximum likelihood estimation of misspecified models, Econometrica 50 (1982) 1"
SELECTION = (
    "P. Pudil, J. Novovičová, J. Kittler, Floating search methods in feature selection, Pattern Recognit. "
    "Lett. 15 (1994) 1119"
)
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
    cite = _Cited()
    total = work.fitted + work.judged
    pieces = "cut at the measured angle" if len(work.blocks) > 1 else "in one piece"
    told = [
        f"{_recorded(diagnosis, total, work.sample_time_s)} compared with the rig "
        f"{diagnosis.nominal.config.name}, {pieces}: {_blocks(work)}"
        + (f" {cite(OBSERVER)}." if any(pulled for _, _, pulled in work.blocks) else ".")
    ]
    if work.smooth:
        told.append("The command is a measured signal and was taken to pass smoothly through its samples.")
    told += [
        f"Everything was fitted to {work.fitted} samples, the later ones of which were held out until they had chosen "
        f"the structure, and judged on the other {work.judged} ({number(100 * work.judged / total, 2)} %), by which "
        f"nothing was added; what made the error there larger was taken back {cite(HELD_OUT)}.",
        "The noise floor, what a true model would leave, comes from the recording's own spectrum and from a simulated "
        f"recording {cite(SPECTRUM)}: {_floor(diagnosis, work)}.",
        "The rig's parameters were first recalibrated within their tolerances by bounded least squares "
        f"{cite(LEAST_SQUARES)}.",
        f"Then {work.bank} effects of the catalogue, each at its place, were ranked by how much of the remaining "
        f"residual their signature explains once the parameters' signatures are projected out {cite(SCORE_TEST)}; "
        f"{_fits(work.fits)} by full simulation, jointly with the parameters.",
        f"An effect stays where it lowers the held-out error by a relevant share and significantly in a paired test "
        f"{cite(PAIRED)}; each was tried against its rivals and without it again {cite(SELECTION)}.",
        "It is not believed where one of its parameters stands where the recording does not show it, where the free "
        "simulation gets worse with it, or where its interval holds what does nothing.",
        f"Intervals are 95 %, from the curvature or the scatter of the score, whichever is wider {cite(SANDWICH)}.",
    ]
    if diagnosis.shown.laws:
        told.append(
            "Points beside a law are a sum of hat functions of its state, which one regression fits to what the model "
            f"leaves {cite(LATENT)}."
        )
    return " ".join(told), cite.works


def _recorded(diagnosis: Diagnosis, total: int, sample_time_s: float) -> str:
    """What was compared, with its verb."""
    steps = sorted({one.sample_time_s for one in diagnosis.recordings} or {sample_time_s})
    of = f"{total} samples of {listed([interval(step, None, 's') for step in steps])}"
    if not diagnosis.recordings:
        return f"The recording, {of}, was"
    return f"{len(diagnosis.recordings)} recordings, together {of}, each at its own rate, were"


def _blocks(work: Work) -> str:
    """What is compared, and what drives it."""
    parts = []
    for channels, imposed, pulled in work.blocks:
        by = f"the measured {imposed}" if imposed else "the command"
        slow = f" and pulled slowly towards the measured {pulled}" if pulled else ""
        parts.append(f"{listed(list(channels))} simulated from {by}{slow}")
    return listed(parts)


def _floor(diagnosis: Diagnosis, work: Work) -> str:
    """Of every channel."""
    sensors = diagnosis.nominal.sensors
    return ", ".join(f"{c} {interval(v, None, sensors[c].unit)}" for c, v in work.floor.items())


def _fits(count: int) -> str:
    if count == 0:
        return "none promised enough to be fitted"
    return "the most promising one was fitted" if count == 1 else f"the {count} most promising trials were fitted"
