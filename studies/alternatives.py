"""What one would use instead of a diagnosis: PySINDy on the residual and a NARX model, on the same recordings.

Per recording and channel, the error on the held-out last 30 %, in units of the channel's noise floor. No method sees
these 30 %: the diagnosis gets the first 70 % alone, and holds out the last 30 % of those to choose by, as PySINDy does.

- the nominal rig and the diagnosed rig: as predictors (see :mod:`dtbacklash.diagnosis.engine.predictor`) that may
  assume an unknown force of ``STRICT`` of the motion's only, so that they hardly follow what was measured;
- PySINDy, weak form and ensemble: a second-order equation for the residual of the nominal rig, with the terms of
  ``LIBRARY`` along the nominal motion, added to the nominal rig's prediction, simulated freely over the held-out part;
- NARX by sysidentpy (polynomial of degree 2, FROLS): the channel from its input (u, or the measured angle), simulated
  freely over the held-out part, and one step ahead.

The alternatives work on the low-passed signals at ``RATE_HZ``; the truth that they are compared with is not filtered.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.signal import butter, cont2discrete, sosfiltfilt

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis import Record, diagnose_records, records_of
from dtbacklash.diagnosis.engine.predictor import Predictor
from dtbacklash.diagnosis.engine.resampling import readings
from dtbacklash.diagnosis.engine.rig_simulator import Simulated
from dtbacklash.files import write_json, write_text
from dtbacklash.physics.rig import Rig
from dtbacklash.prove.conceal import conceal, nominal_rig
from dtbacklash.prove.seal import RECORDING, key_path, open_seal
from dtbacklash.recording import read_recording
from studies.measure import Row

RATE_HZ, PASS_HZ = 200.0, 40.0
#: the candidate terms of the residual's equation: name -> function of the nominal motion (y, v, standard deviations 1)
LIBRARY: dict[str, Any] = {
    "y": lambda y, v: y,
    "v": lambda y, v: v,
    "sign(v)": lambda y, v: np.tanh(v / 0.02),
    "|v|": lambda y, v: np.abs(v),
    "|v| v": lambda y, v: np.abs(v) * v,
    "y^2": lambda y, v: y**2,
    "y^3": lambda y, v: y**3,
}
#: which term would be the name of which effect; an effect without one cannot be named by this library
NAMES = {
    "coulomb_friction": "sign(v)", "dry_friction": "sign(v)", "ground_friction": "sign(v)",
    "viscous_friction": "v", "asymmetric_friction": "|v|", "quadratic_damping": "|v| v", "cubic_stiffness": "y^3",
    "constant_load": "1", "constant_force": "1", "offset": "1", "gain_error": "y",
}  # fmt: skip
#: of STLSQ, with features of standard deviation 1, 1/s; taken is what predicts the end of the training best
THRESHOLDS = (0.1, 0.5, 2.0, 10.0, 50.0)
MODELS, LAGS = 20, 6
#: unknown force that a rig may assume as it predicts (share of the motion's), and the share of a recording held out
STRICT, HELD_OUT = 1e-3, 0.3
#: noise floors beyond which a simulation has run away
RUNAWAY = 1e6


@dataclass
class Answer:
    """What one method says of one recording: errors per channel, one step ahead where it has one, terms, time."""

    errors: dict[str, float] = field(default_factory=dict)
    one_step: dict[str, float] = field(default_factory=dict)
    named: list[str] = field(default_factory=list)
    seconds: float = 0.0


@dataclass
class Channel:
    """One channel at ``RATE_HZ``: measured, nominal, input, which samples are held out, and the noise floor."""

    name: str
    measured: Floats
    raw: Floats
    nominal: Floats
    input: Floats
    held: np.ndarray
    floor: float
    step_s: float

    def training(self) -> Channel:
        """The training part alone, its last 30 % held out, to choose by."""
        n = int(np.argmax(self.held))
        signals = {k: getattr(self, k)[:n] for k in ("measured", "raw", "nominal", "input")}
        return replace(self, **signals, held=np.arange(n) >= round(0.7 * n))

    def error(self, predicted: Floats) -> float:
        """Rms error over the held-out part, in noise floors."""
        wrong = (self.raw - predicted)[self.held] / self.floor
        rms = float(np.sqrt(np.mean(np.clip(wrong, -RUNAWAY, RUNAWAY) ** 2)))
        return rms if rms < RUNAWAY / 10.0 else float("inf")


def alternative_rows(n: int, seed: int) -> list[Row]:
    """A row a recording and method: ``n`` concealed single effects from ``seed`` on.

    Raises
    ------
    SystemExit : the extra ``compare`` is not installed.
    """
    try:
        import pysindy  # noqa: F401
        import sysidentpy  # noqa: F401
    except ImportError as error:
        raise SystemExit(f"{error.name} is not installed; pip install 'dtbacklash[compare]'") from None
    rows: list[Row] = []
    np.random.seed(seed)  # noqa: NPY002  PySINDy draws its subdomains and bags from numpy's old state
    with TemporaryDirectory() as folder:
        for j in range(seed, seed + n):
            rows += _case_rows(j, Path(folder) / "concealed")
    return rows


def _case_rows(seed: int, folder: Path) -> list[Row]:
    case = conceal(seed, "lead_screw", folder, kind="single", instruments="minimal")
    rig = nominal_rig("lead_screw")
    (record,) = records_of(read_recording(case / RECORDING, rig=rig), rig, True, True, HELD_OUT)
    channels = channels_of(rig, record)
    answers = {"nominal rig": Answer(errors_of(rig, rig, record)), "dtb diagnose": _diagnosed(rig, record)}
    for ensemble in (False, True):
        answers["PySINDy, ensemble" if ensemble else "PySINDy, weak form"] = sindy(channels, ensemble)
    answers["NARX, sysidentpy"] = narx(channels)
    hidden = open_seal(case, key_path(folder)).effects[0]
    return [_row(seed, hidden, method, answer) for method, answer in answers.items()]


def _row(seed: int, hidden: dict[str, Any], method: str, answer: Answer) -> Row:
    what = f"{hidden['location']}.{hidden['effect']}"
    term = NAMES.get(hidden["effect"])
    right = what in answer.named if method.startswith("dtb") else any(t.endswith(f": {term}") for t in answer.named)
    row: Row = {"what": f"{seed} {what}: {method}"}
    for name in ("theta_m", "q3"):
        row[f"{name}_floors"] = answer.errors.get(name, float("nan"))
    for name in ("theta_m", "q3"):
        row[f"{name}_one_step"] = answer.one_step.get(name)
    return row | {"time_s": answer.seconds, "terms": len(answer.named), "hidden_is_among": "yes" if right else "no",
                  "named": _shortened(answer.named)}  # fmt: skip


def _shortened(named: list[str], most: int = 3) -> str:
    more = f" and {len(named) - most} more" if len(named) > most else ""
    return ", ".join(named[:most]) + more


def left(nominal: Rig, rig: Rig, record: Record) -> tuple[dict[str, Floats], dict[str, float]]:
    """Channel -> (N,) what a rig's predictor leaves of it, and channel -> the noise's standard deviation."""
    channels = tuple(c for c in nominal.sensors if c in record.y)
    predictor = Predictor(nominal, Simulated(readings(record.u, record.y, channels, record.sample_time_s, 1, False)))
    sizes = predictor.first_noise_levels()
    sizes[: len(predictor.bodies)] = np.log(STRICT)
    innovations = predictor.run(rig, predictor.gains(rig, sizes)).D
    noise = predictor.readings.noise.tolist()
    return dict(zip(channels, innovations.T, strict=True)), dict(zip(channels, noise, strict=True))


def errors_of(nominal: Rig, rig: Rig, record: Record) -> dict[str, float]:
    """Channel -> rms of what is left of the held-out part, in units of the noise."""
    errors, noise = left(nominal, rig, record)
    return {c: float(np.sqrt(np.mean(e[record.held] ** 2))) / noise[c] for c, e in errors.items()}


def _diagnosed(rig: Rig, record: Record) -> Answer:
    begin = time.perf_counter()
    found = diagnose_records(rig, [_beginning(record)])
    seconds = time.perf_counter() - begin
    named = [f"{f['location']}.{f['effect']}" for f in found.to_json()["findings"]]
    return Answer(errors_of(rig, found.extended, record), {}, named, seconds)


def _beginning(record: Record) -> Record:
    """The part before what is held out, with its last 30 % to choose by."""
    n = int(np.argmax(record.held))
    train = np.arange(n) < round(0.7 * n)
    return Record(record.sample_time_s, record.u[:n], {c: v[:n] for c, v in record.y.items()}, train, ~train)


def channels_of(rig: Rig, record: Record) -> list[Channel]:
    """The channels with the nominal rig's prediction, low-passed and thinned; each is driven by the one before."""
    every = max(1, round(1.0 / RATE_HZ / record.sample_time_s))
    low = butter(4, PASS_HZ, fs=1.0 / record.sample_time_s, output="sos")
    errors, noise = left(rig, rig, record)
    found, driven = [], record.u
    for name, error in errors.items():
        measured = record.y[name]
        smooth, nominal, given = (sosfiltfilt(low, s)[::every] for s in (measured, measured - error, driven))
        found.append(Channel(name, smooth, measured[::every], nominal, given, record.held[::every], noise[name],
                             every * record.sample_time_s))  # fmt: skip
        driven = measured
    return found


def sindy(channels: list[Channel], ensemble: bool) -> Answer:
    """PySINDy on the residual of each channel; the terms are ``channel: term``."""
    answer, begin = Answer(), time.perf_counter()
    for channel in channels:
        inner = channel.training()
        errors = {threshold: _sindy(inner, ensemble, threshold)[0] for threshold in THRESHOLDS}
        best = min(errors, key=lambda threshold: errors[threshold])
        answer.errors[channel.name], coefficients = _sindy(channel, ensemble, best)
        answer.named += [f"{channel.name}: {term}" for term in ("1", *LIBRARY) if coefficients[term] != 0.0]
    answer.seconds = time.perf_counter() - begin
    return answer


def _sindy(channel: Channel, ensemble: bool, threshold: float) -> tuple[float, dict[str, float]]:
    """Held-out error and coefficients."""
    coefficients, scale = _sindy_fit(channel, ensemble, threshold)
    return channel.error(channel.nominal + _sindy_simulate(channel, coefficients, scale)), coefficients


def _features(channel: Channel) -> Floats:
    """(samples, terms) the library along the nominal motion."""
    v = np.gradient(channel.nominal, channel.step_s)
    y, v = channel.nominal / channel.nominal.std(), v / v.std()
    return np.column_stack([term(y, v) for term in LIBRARY.values()])


def _sindy_fit(channel: Channel, ensemble: bool, threshold: float) -> tuple[dict[str, float], tuple[float, float]]:
    """Coefficients of e'' over e, e', 1 and the library, and the scales of e and e'; all of standard deviation 1."""
    import pysindy as ps

    e = channel.measured - channel.nominal
    rate = np.gradient(e, channel.step_s)
    scale = float(e.std()) or 1.0, float(rate.std()) or 1.0
    state = np.column_stack([e / scale[0], rate / scale[1]])
    train = ~channel.held
    t = np.arange(int(train.sum())) * channel.step_s
    linear: Any = ps.PolynomialLibrary(degree=1, include_bias=True)
    least = ps.STLSQ(threshold=threshold, alpha=1e-3)
    if ensemble:
        library, optimizer = linear, ps.EnsembleOptimizer(least, bagging=True, n_models=MODELS)
    else:
        library = ps.WeakPDELibrary(function_library=linear, spatiotemporal_grid=t, K=300, H_xt=[0.15])
        optimizer = least
    model = ps.SINDy(feature_library=library, optimizer=optimizer)
    model.fit(state[train], t=t, u=_features(channel)[train])
    row = np.asarray(model.coefficients())[1]
    return dict(zip(["1", "e", "e'", *LIBRARY], map(float, row), strict=True)), scale


def _sindy_simulate(channel: Channel, c: dict[str, float], scale: tuple[float, float]) -> Floats:
    """The residual over the held-out part, simulated freely from where it begins; zero before."""
    force = c["1"] + _features(channel) @ np.array([c[term] for term in LIBRARY])
    a = np.array([[0.0, scale[1] / scale[0]], [c["e"], c["e'"]]])
    A, B, *_ = cont2discrete((a, np.array([[0.0], [1.0]]), np.eye(2), np.zeros((2, 1))), channel.step_s)
    e = channel.measured - channel.nominal
    rate = np.gradient(e, channel.step_s)
    first = int(np.argmax(channel.held))
    x = np.array([e[first] / scale[0], rate[first] / scale[1]])
    found = np.zeros(len(e))
    for k in range(first, len(e)):
        found[k] = x[0] * scale[0]
        x = np.clip(A @ x + B[:, 0] * force[k], -1e6, 1e6)  # an unstable equation stays a number
    return found


def narx(channels: list[Channel]) -> Answer:
    """A polynomial NARX for each channel from its input; it names nothing."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    answer, begin = Answer(), time.perf_counter()
    for channel in channels:
        x, y = channel.input[:, None] / channel.input.std(), channel.measured[:, None] / channel.measured.std()
        train, first = ~channel.held, int(np.argmax(channel.held))
        model = FROLS(
            order_selection=True, n_info_values=12, ylag=LAGS, xlag=LAGS, info_criteria="bic",
            estimator=LeastSquares(), basis_function=Polynomial(degree=2),
        )  # fmt: skip
        model.fit(X=x[train], y=y[train])
        for steps, where in ((None, answer.errors), (1, answer.one_step)):
            with np.errstate(all="ignore"):
                shown = model.predict(X=x[first:], y=y[first:], steps_ahead=steps)[:, 0] * channel.measured.std()
            predicted = channel.nominal.copy()
            predicted[first:] = np.nan_to_num(shown, nan=np.inf)
            where[channel.name] = channel.error(predicted)
    answer.seconds = time.perf_counter() - begin
    return answer


def alternative_words(rows: list[Row]) -> list[str]:
    """Sentences below the table: per method, the medians and how often what was hidden is among what is named."""
    found = []
    for method in dict.fromkeys(str(r["what"]).split(": ", 1)[1] for r in rows):
        own = [r for r in rows if str(r["what"]).endswith(": " + method)]
        medians = ", ".join(f"{c} {np.median([float(r[f'{c}_floors']) for r in own]):.3g}" for c in ("theta_m", "q3"))
        hits, terms = sum(r["hidden_is_among"] == "yes" for r in own), np.mean([r["terms"] for r in own])
        seconds = np.median([r["time_s"] for r in own])
        found.append(
            f"{method}: median held-out error {medians} noise floors; {seconds:.3g} s; names {terms:.2g} things, "
            f"what was hidden among them in {hits} of {len(own)}."
        )
    return found


BEGIN = "<!-- alternatives: begin, made by python -m studies alternatives --docs docs -->"
END = "<!-- alternatives: end -->"


def docs_block(document: dict[str, Any]) -> str:
    """Return the text between the two lines in the docs: the medians of each method."""
    command = f"python -m studies alternatives --n {document['n']} --seed {document['seed']} --docs docs"
    words = "\n".join(f"- {line}" for line in alternative_words(document["rows"]))
    return "\n".join([BEGIN, "", f"```sh\n{command}\n```", "", words, "", END])


def write_docs(rows: list[Row], n: int, seed: int, folder: Path) -> None:
    """Bring a run into ``proof.md`` of the docs, and its rows beside it."""
    kept = [{k: "inf" if v == float("inf") else v for k, v in row.items()} for row in rows]  # JSON knows no infinity
    document = {"n": n, "seed": seed, "rows": kept}
    page = folder / "proof.md"
    text = page.read_text(encoding="utf-8")
    write_json(folder / "proof" / "alternatives.json", document)
    write_text(page, text.split(BEGIN)[0] + docs_block(document) + text.split(END)[1])
