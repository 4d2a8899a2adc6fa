"""``dtb diagnose`` in Python: what physics a recording has and a rig lacks, and where."""

from __future__ import annotations

import io
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from dtbacklash.api.durations import timed
from dtbacklash.api.in_python import speaks_python
from dtbacklash.api.progress import ShowProgress, cores_of, shown
from dtbacklash.api.rigs import RigLike, load_rig
from dtbacklash.errors import UserError
from dtbacklash.recording import Recording
from dtbacklash.recording.several import Source

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dtbacklash.diagnosis.findings import Alternative
    from dtbacklash.diagnosis.per_recording_parameters import Given, Own
    from dtbacklash.diagnosis.preliminary import Depth
    from dtbacklash.diagnosis.result import Diagnosis
    from dtbacklash.physics.rig import Rig

DEFAULT_RIG = "lead_screw"


@dataclass(frozen=True, repr=False)
class Found:
    """Result of :func:`diagnose`. ``print(found)`` shows verdict, findings, and the fit before and after.

    Attributes
    ----------
    diagnosis : the result, typed; the properties below are views of it.
    """

    diagnosis: Diagnosis

    @property
    def verdict(self) -> str:
        """The verdict: ``consistent``, ``parameters``, ``missing_physics`` or ``unexplained``."""
        return self.diagnosis.verdict

    @property
    def summary(self) -> str:
        """The result in two or three sentences."""
        return self.diagnosis.summary

    @property
    def stopped(self) -> str:
        """The stage at which the diagnosis was interrupted; empty if it was completed."""
        return self.diagnosis.stopped

    @cached_property
    def findings(self) -> pd.DataFrame:
        """The effects that the rig lacks: a row for each parameter of each effect.

        Columns ``location, effect, confidence, parameter, value, unit, low, high, also_fits, sentence``: ``confidence``
        is ``sure``, ``one_of`` (this effect or one of ``also_fits``) or ``partial``; ``low`` and ``high`` are the ends
        of the 95 % interval, in ``unit`` (SI); ``also_fits`` is a tuple of (location, effect) that this recording
        cannot distinguish from it. The size of an effect is its first parameter.
        """
        columns = ["location", "effect", "confidence", "parameter", "value", "unit", "low", "high", "also_fits",
                   "sentence"]  # fmt: skip
        rows = []
        for finding in self.diagnosis.findings:
            also = _pairs(finding.also_fits)
            for name, p in finding.parameters.items():
                size = (name, p.value, p.unit, *p.ci95)
                rows.append((finding.location, finding.effect, finding.confidence, *size, also, finding.sentence))
        return pd.DataFrame(rows, columns=columns)

    @cached_property
    def recalibrated(self) -> pd.DataFrame:
        """Parameters of the rig that had to move: a row for each.

        Columns ``nominal, value, unit, low, high`` (95 % interval, SI), and ``also_fits``: a tuple of (location,
        effect) that this recording cannot distinguish from the parameter.
        """
        columns = ["nominal", "value", "unit", "low", "high", "also_fits"]
        rows = {
            name: (p.nominal, p.value, p.unit, *p.ci95, _pairs(p.also_fits))
            for name, p in self.diagnosis.recalibrated.items()
        }
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns)

    @cached_property
    def fit(self) -> pd.DataFrame:
        """Errors of the models: rows ``nominal, recalibrated, extended, noise_floor``, columns ``train, held_out``.

        Normalised rms over the channels (rms error over standard deviation, 1). The noise floor is the error of a true
        model. There is a row ``modelled`` if the remaining force is modelled by a table or a formula.
        """
        fit = self.diagnosis.fit
        parts = {"train": fit.train, "held_out": fit.held_out}
        table = pd.DataFrame(
            {part: {**asdict(errors), "noise_floor": fit.noise_floor} for part, errors in parts.items()}, dtype=float
        )
        return table if self.diagnosis.modelled else table.drop("modelled")

    @cached_property
    def recordings(self) -> pd.DataFrame:
        """Use and errors of each of several recordings: a row for each; empty for one.

        Columns ``name, samples, sample_time_s, fitted, judged, nominal, recalibrated, extended``: numbers of
        fitted and of held-out samples, and the normalised rms errors of the models on the held-out ones (1).
        """
        columns = ["name", "samples", "sample_time_s", "fitted", "judged", "nominal", "recalibrated", "extended"]
        rows = []
        for one in self.diagnosis.recordings:
            errors = asdict(one.held_out) if one.held_out else {}
            rows.append({**{name: getattr(one, name) for name in columns[:5]}, **errors})
        return pd.DataFrame(rows, columns=columns)

    @cached_property
    def calibration(self) -> pd.DataFrame:
        """All fitted parameters with the correlations of their errors: a row for each.

        Columns ``nominal, value, unit, low, high`` (95 % interval, SI), then a column for each parameter with its
        correlation, -1 to 1. ``attrs["blind"]`` lists the directions along which the recording is blind, in sentences.
        """
        found = self.diagnosis.calibration
        if found is None:
            return pd.DataFrame(columns=["nominal", "value", "unit", "low", "high"])
        rows = {
            name: {"nominal": p.nominal, "value": p.value, "unit": p.unit, "low": p.ci95[0], "high": p.ci95[1],
                   **found.correlation[name]}
            for name, p in found.parameters.items()
        }  # fmt: skip
        table = pd.DataFrame.from_dict(rows, orient="index")
        table.attrs["blind"] = [one.sentence for one in found.blind]
        return table

    def fit_report(self) -> str:
        """Return the fitted parameters as text: value, standard error, nominal value; correlations from 0.1 on.

        A parameter that is fixed (``fixed: true``), or tied to another one, has no row.
        """
        from dtbacklash.report.components import tables
        from dtbacklash.report.diagnosis.text import fit_report

        found, text = self.diagnosis.calibration, io.StringIO()
        if found is None or not found.parameters:
            return "No parameter was fitted."
        tables.show(*fit_report(found), file=text)
        return text.getvalue().rstrip("\n")

    @cached_property
    def candidates(self) -> pd.DataFrame:
        """Effects that were tried, best first: ``location, effect, score, held_out, verdict``."""
        columns = ["location", "effect", "score", "held_out", "verdict"]
        return pd.DataFrame([asdict(c) for c in self.diagnosis.candidates], columns=columns)

    @cached_property
    def checks(self) -> pd.DataFrame:
        """Tests of the result: ``check, statistic, operator, threshold, passed, comment, source``."""
        columns = ["check", "statistic", "operator", "threshold", "passed", "comment", "source"]
        return pd.DataFrame([asdict(c) for c in self.diagnosis.checks], columns=columns)

    @property
    def rig(self) -> Rig:
        """The extended rig: recalibrated, with the missing effects, and with a modelled force if there is one.

        ``dtb.run(rig=found.rig)`` takes it.
        """
        return self.diagnosis.rig

    @property
    def next_experiment(self) -> str:
        """The next recording or measurement that is recommended; empty if none."""
        return self.diagnosis.next_experiment

    def to_json(self) -> dict[str, Any]:
        """Return the content of ``diagnosis.json``."""
        return dict(self.diagnosis.to_json())

    def plot(self, what: str = "rig") -> Figure:
        """Draw one of the report's figures, without pyplot.

        Parameters
        ----------
        what : ``rig``, the rig with the evidence at each element; a channel (``q3``), measured and simulated before and
            after; ``residual q3``, its residual with autocorrelation and spectrum; a finding's
            location (``motor_bearing``), the recovered force and the law over its state; ``profile J``, the profile
            likelihood of a fitted parameter (``profile disk.coulomb_friction.torque`` of a finding's), computed now.

        Raises
        ------
        UserError : there is no such figure.
        """
        from dtbacklash.report.diagnosis.figures import curve_figure, law_figure
        from dtbacklash.report.diagnosis.page import rig_figure
        from dtbacklash.report.diagnosis.residual import profile_figure, residual_figure
        from dtbacklash.report.diagnosis.words import better_model

        if what == "rig":
            return rig_figure(self.diagnosis)
        shown = self.diagnosis.shown
        curves = {curve.name: curve for curve in shown.curves}
        laws = {law.location: law for law in reversed(shown.laws)}
        if what in curves:
            return curve_figure(curves[what], better_model(self.diagnosis))
        if what in laws:
            return law_figure(laws[what])
        left = {f"residual {name}": curve for name, curve in curves.items()}
        if what in left:
            return residual_figure(left[what])
        profiles = self.diagnosis.profiles
        fitted = {f"profile {name}": name for name in profiles.units} if profiles else {}
        if profiles and what in fitted:
            known, unit = self.diagnosis.nominal.config.parameters.get(fitted[what]), profiles.units[fitted[what]]
            return profile_figure(profiles(fitted[what]), unit, known.value if known else None)
        raise UserError("plot", what, "choose one of " + ", ".join(["rig", *curves, *left, *laws, *fitted]))

    def save(self, folder: str | Path) -> Path:
        """Write the files of ``dtb diagnose``, complete or not at all; an earlier diagnosis there is replaced.

        Files: ``diagnosis.json, rig.yaml, figures/*.png, report.html``.

        Returns
        -------
        The folder.

        Raises
        ------
        UserError : the folder holds something else, or cannot be written.
        """
        from dtbacklash.files import DIAGNOSIS_ENTRIES, run_folder
        from dtbacklash.report.diagnosis import page

        target = Path(folder).expanduser()
        with run_folder(target, key="folder", mark="diagnosis.json", known=DIAGNOSIS_ENTRIES) as scratch:
            page.write(self.diagnosis, scratch)
        return target

    def __str__(self) -> str:
        from dtbacklash.report.components import tables
        from dtbacklash.report.diagnosis.text import lines

        text = io.StringIO()
        tables.show(*lines(self.diagnosis), file=text)
        return text.getvalue().rstrip("\n")

    def _repr_html_(self) -> str:
        """The causes and the figure of the report's first screen, for a notebook."""
        from dtbacklash.report.diagnosis.page import first_look

        return first_look(self.diagnosis)

    def __repr__(self) -> str:
        named = [f"{finding.effect} at {finding.location}" for finding in self.diagnosis.findings]
        return f"<Found: {', '.join([self.verdict, *named])}>"


def diagnose(
    recording: Source | Sequence[Source],
    rig: RigLike | None = None,
    validation: Source | Sequence[Source] | int | None = None,
    *,
    held_out: float | None = None,
    enough: Mapping[str, str | float] | None = None,
    search: Depth = "full",
    own: Own | None = None,
    given: Given | None = None,
    hold_out: str | int | None = None,
    compare: str | None = None,
    jobs: int | None = None,
    progress: ShowProgress = False,
    trust_units: bool = False,
) -> Found:
    """Compare a recording with the simulation of a rig, and name the physics that the rig lacks.

    Parameters
    ----------
    recording : a recording, a DataFrame, or what :func:`read_recording` reads; or several together: a list of them, or
        a pattern (``"data/*.csv"``). Several share the rig's physics and parameters. Each has its own first state and
        noise levels; lengths, sample times and channels may differ.
    rig : the nominal rig; default: that of the (first) recording's mapping, else ``lead_screw``.
    validation : the recording to judge on; without it the last share ``held_out`` of each recording judges. The number
        (from 1), the name or the file of one of several recordings holds that one out.
    held_out : share that nothing is fitted to and nothing is chosen by, above 0 and below 1; None: as the settings say.
    enough : channel -> accepted error, as ``0.05 mm`` or as a share of its motion (``2 %``).
    search : ``full`` looks for everything; ``quick`` names large effects, without alternatives; ``none`` names nothing:
        the rig is calibrated as it is, with intervals, correlations and blind directions (:attr:`Found.calibration`).
    own : of several recordings, the parameters and effects that are free in each (``["carriage.mass"]``), or in one
        (``{"b": ["carriage.mass"]}``). given : values that are known to differ, ``{"b": {"carriage.mass": "3.2 kg"}}``.
    hold_out : which of several recordings judges: ``turns``, each in turn (default from three on); ``ends``, the last
        share of each; or the name or number (from 1) of one.
    compare : ``change``: find what changed from the first of two recordings to the second, whatever else the rig lacks
        (``found.to_json()["changes"]``).
    jobs : threads that share the work; None: one for each core.
    progress : True shows a bar; a function is called with the share of the stages done, 0 to 1, and the present stage.
    trust_units : skip the check that the sizes of the channels are possible for the rig.

    In a notebook or at a prompt an interruption (Ctrl-C) returns the result so far, marked as stopped
    (:attr:`Found.stopped`), once the rig is recalibrated; a second one ends it.

    Raises
    ------
    KeyboardInterrupt : the diagnosis was interrupted in a script, or before the rig was recalibrated.
    UserError : a channel looks to be in a wrong unit; no channel of the rig was recorded, or a recording has none; an
        integrating part not measured, too little is left to fit to or to judge on; the validation repeats the
        recording, or, of one recording, lacks one of its channels or has another sample time.

    Examples
    --------
    A recording made by simulation, rounded as by an encoder, and the rig that it was made with:

    >>> import dtbacklash as dtb
    >>> rig = dtb.load_rig("pendulum")
    >>> result = dtb.run("controller=open_loop", "reference=multisine", "duration_s=4", rig=rig)
    >>> frame = result.recording.to_frame()[["t_s", "u_v", "theta_rad"]]
    >>> dtb.diagnose(frame.round({"theta_rad": 4}), rig, search="none").verdict
    'consistent'
    """
    from dtbacklash.config.choices import SEARCHES
    from dtbacklash.diagnosis import diagnose as diagnosed
    from dtbacklash.recording import read_together

    with speaks_python():
        nominal = load_rig(rig if rig is not None else _usual_rig(recording))
        fitted, judged = read_together(recording, validation, rig=nominal, trust_units=trust_units)
        if held_out is not None and not (isinstance(held_out, (int, float)) and 0.0 < held_out < 1.0):
            raise UserError("held_out", held_out, "must be above 0 and below 1")
        if search not in SEARCHES:
            raise UserError("search", search, f"choose one of {', '.join(SEARCHES)}")
        cores = cores_of(jobs)
        if enough is not None and not isinstance(enough, Mapping):
            raise UserError("enough", enough, "must be a mapping, channel: what is good enough, like 0.05 mm or 2 %")
        with shown(progress, "diagnosing") as tell, ExitStack() as until_done:
            told = until_done.enter_context(timed(tell, nominal, fitted, search, cores)) if tell else None
            said = None if told is None else lambda text, share: told(share, text)
            found = diagnosed(
                fitted, nominal, judged, held_out, said, cores, enough=enough, depth=search, keep=hasattr(sys, "ps1"),
                own=own, given=given, hold_out=hold_out, compare=compare,
            )  # fmt: skip
    return Found(found)


def _usual_rig(recording: Source | Sequence[Source]) -> str:
    """The rig that the (first) recording's mapping names, if it has one."""
    from dtbacklash.recording import mapping_of, sources_of

    if isinstance(recording, Recording):
        return recording.rig or DEFAULT_RIG
    if isinstance(recording, pd.DataFrame) or not isinstance(recording, (str, Path, Sequence)):
        return DEFAULT_RIG
    if not isinstance(recording, (str, Path)):
        return _usual_rig(recording[0]) if len(recording) else DEFAULT_RIG
    mapping = mapping_of(sources_of(str(recording))[0])
    return (mapping.rig if mapping else None) or DEFAULT_RIG


def _pairs(others: tuple[Alternative, ...]) -> tuple[tuple[str, str], ...]:
    return tuple((a.location, a.effect) for a in others)
