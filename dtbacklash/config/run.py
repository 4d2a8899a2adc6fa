"""The schema of ``dtb run``: one dataclass per folder of ``conf/``.

Each ``__post_init__`` refuses values that make no sense on their own; :class:`RunConfig` refuses
combinations. All raise :class:`dtbacklash.errors.UserError` with the dotted key that the user would write.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from dtbacklash.config.checks import choice, number
from dtbacklash.config.rig import RigConfig
from dtbacklash.errors import UserError

STRUCTURES = ("imc", "nimc", "open_loop")
TRIGGERS = ("never", "reference_change", "novelty")
PROFILES = ("s_curve", "constant", "ramp", "step", "wear", "csv")
REFERENCES = ("square", "step", "staircase", "multisine", "csv")
OPTIMIZERS = ("bfgs", "lbfgsb", "nelder_mead", "differential_evolution", "dual_annealing")
SAMPLES_MAX = 20_000_000  # a trace of this length needs about 2 GB
RECORDING_SUFFIXES = (".csv", ".parquet")


@dataclass
class ControllerConfig:
    """The controller: its structure, when the twin may reconfigure it, and its design parameters."""

    name: str = "nimc_twin"
    structure: str = "nimc"  # imc | nimc | open_loop (the reference drives the rig's input itself)
    reconfigure: str = "reference_change"  # never | reference_change | novelty
    k_theta_v_per_rad: float = 15.0
    prefilter: str = "reduced"  # reduced: 1/(tau_r s + 1) Gd^-1 ; none: 1
    tau_r_s: float = 1.0 / 6.0
    # what drives the model of the structure. bare: G1 driven by u ; measured: theta_m ; inner_loop: a model of the
    # inner loop driven by theta_ref ; exact (imc): G1 G2 sampled as one
    internal_model: str = "bare"
    gap_hat_deg: float = 0.0  # first estimate of the gap

    def __post_init__(self) -> None:
        choice("controller.structure", self.structure, STRUCTURES)
        choice("controller.reconfigure", self.reconfigure, TRIGGERS)
        choice("controller.prefilter", self.prefilter, ("reduced", "none"))
        choice("controller.internal_model", self.internal_model, ("bare", "measured", "inner_loop", "exact"))
        number("controller.k_theta_v_per_rad", self.k_theta_v_per_rad, above=0, unit="V/rad")
        number("controller.tau_r_s", self.tau_r_s, above=0, unit="s")
        number("controller.gap_hat_deg", self.gap_hat_deg, at_least=0, at_most=360, unit="deg")
        if self.internal_model == "exact" and self.structure == "nimc":
            raise UserError("controller.internal_model", "exact", "only structure=imc has a linear internal model")
        if self.reconfigure != "never" and self.structure != "nimc":
            raise UserError("controller.reconfigure", self.reconfigure, "only structure=nimc has a gap to reconfigure")


@dataclass
class ProfileConfig:
    """The gap over time. What a kind does not use it ignores; see :func:`dtbacklash.signals.gap_profile`."""

    kind: str = "s_curve"
    start_deg: float = 0.0
    end_deg: float = 100.0
    t_start_s: float = 50.0
    t_end_s: float = 150.0
    running_in_share: float = 0.15  # wear: share of the growth in the running-in phase ...
    running_in_span: float = 0.1  # ... and its time constant as a share of the time
    severe_share: float = 0.55  # wear: share of the growth in the severe phase ...
    severe_from: float = 0.6  # ... and the share of the time at which it begins
    path: str | None = None  # csv: columns t_s, gap_deg

    def __post_init__(self) -> None:
        choice("profile.kind", self.kind, PROFILES)
        number("profile.start_deg", self.start_deg, at_least=0, at_most=360, unit="deg")
        number("profile.end_deg", self.end_deg, at_least=0, at_most=360, unit="deg")
        number("profile.t_start_s", self.t_start_s, at_least=0, unit="s")
        number("profile.t_end_s", self.t_end_s, at_least=0, unit="s")
        for name in ("running_in_share", "severe_share"):
            number(f"profile.{name}", getattr(self, name), at_least=0, at_most=1)
        number("profile.running_in_span", self.running_in_span, above=0)
        number("profile.severe_from", self.severe_from, at_least=0, below=1)
        if self.running_in_share + self.severe_share > 1:
            most = 1 - self.running_in_share
            allowed = f"must be at most {most:g}, as running_in_share={self.running_in_share:g}"
            raise UserError("profile.severe_share", self.severe_share, allowed)
        self._check_times()
        if self.kind == "constant" and self.end_deg != self.start_deg:
            raise UserError("profile.end_deg", self.end_deg, "a constant gap is set by profile.start_deg alone")
        if self.kind == "csv":
            _check_input_file("profile.path", self.path, "t_s,gap_deg")

    def _check_times(self) -> None:
        if self.kind in ("s_curve", "ramp", "wear") and not self.t_end_s > self.t_start_s:
            raise UserError("profile.t_end_s", self.t_end_s, f"must be above profile.t_start_s={self.t_start_s:g} s")


@dataclass
class ReferenceConfig:
    """The reference r over time; see :func:`dtbacklash.signals.reference`."""

    kind: str = "square"
    amplitude_mm: float = 1.0  # square: between +A and -A ; step: from 0 to A
    offset_mm: float = 0.0  # added to every kind but csv
    period_s: float = 40.0  # square, multisine
    t_start_s: float = 0.0  # step
    step_mm: float = 0.5  # staircase: size of one step ...
    dwell_s: float = 10.0  # ... the time on it ...
    levels: int = 4  # ... and how many steps up before it goes down again
    f_min_hz: float = 0.1  # multisine: band ...
    f_max_hz: float = 2.0
    rms_mm: float = 0.5  # ... and size
    path: str | None = None  # csv: columns t_s, r_mm
    interpolation: str = "hold"  # csv, between its rows: hold | linear

    def __post_init__(self) -> None:
        choice("reference.kind", self.kind, REFERENCES)
        choice("reference.interpolation", self.interpolation, ("hold", "linear"))
        for name in ("amplitude_mm", "step_mm"):
            number(f"reference.{name}", getattr(self, name), at_least=-1e4, at_most=1e4, unit="mm")
        number("reference.offset_mm", self.offset_mm, at_least=-1e4, at_most=1e4, unit="mm")
        number("reference.rms_mm", self.rms_mm, at_least=0, at_most=1e4, unit="mm")
        number("reference.period_s", self.period_s, above=0, unit="s")
        number("reference.dwell_s", self.dwell_s, above=0, unit="s")
        number("reference.t_start_s", self.t_start_s, at_least=0, unit="s")
        number("reference.levels", self.levels, at_least=1, at_most=1000)
        number("reference.f_min_hz", self.f_min_hz, above=0, unit="Hz")
        number("reference.f_max_hz", self.f_max_hz, above=0, unit="Hz")
        if self.kind == "multisine" and self.f_max_hz < self.f_min_hz:
            allowed = f"must be at least reference.f_min_hz={self.f_min_hz:g} Hz"
            raise UserError("reference.f_max_hz", self.f_max_hz, allowed)
        if self.kind == "csv":
            _check_input_file("reference.path", self.path, "t_s,r_mm")


@dataclass
class TwinConfig:
    """The digital twin: its link, its buffer, its observer and what it accepts."""

    delay_s: float = 4.0  # from a full buffer to the new gap in force
    buffer: int = 1000  # samples of one estimation
    settle: int = 400  # samples at the start of the buffer that do not enter the cost
    observer_pole_rad_s: float = 40.0
    gap_max_deg: float = 180.0  # physical bound of an estimate
    guard: bool = True  # false: trust whatever the optimiser returns, as the paper does
    novelty_threshold_mm: float = 0.1
    novelty_filter: str = "cheby2"

    def __post_init__(self) -> None:
        number("twin.delay_s", self.delay_s, at_least=0, unit="s")
        number("twin.buffer", self.buffer, at_least=10, at_most=SAMPLES_MAX, unit="samples")
        number("twin.settle", self.settle, at_least=0, unit="samples")
        number("twin.observer_pole_rad_s", self.observer_pole_rad_s, above=0, unit="rad/s")
        number("twin.gap_max_deg", self.gap_max_deg, above=0, at_most=360, unit="deg")
        number("twin.novelty_threshold_mm", self.novelty_threshold_mm, above=0, unit="mm")
        choice("twin.novelty_filter", self.novelty_filter, ("cheby2", "ellip"))
        if self.settle >= self.buffer:
            raise UserError("twin.settle", self.settle, f"must be below twin.buffer={self.buffer} samples")


@dataclass
class OptimizerConfig:
    """The search for the gap: a method of scipy.optimize and when it stops."""

    name: str = "bfgs"
    max_evaluations: int = 200
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        choice("optimizer.name", self.name, OPTIMIZERS)
        number("optimizer.max_evaluations", self.max_evaluations, at_least=2, at_most=1_000_000)
        number("optimizer.tolerance", self.tolerance, above=0, below=1)


@dataclass
class SensorsConfig:
    """Per column: noise (standard deviation) and resolution (size of one count); 0 = none."""

    noise: dict[str, float] = field(default_factory=dict)
    resolution: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for kind in ("noise", "resolution"):
            for column, size in getattr(self, kind).items():
                number(f"sensors.{kind}.{column}", size, at_least=0, unit="(0 = none)")


@dataclass
class SolverConfig:
    """Accuracy of the simulation."""

    substeps: int = 0  # per sample; 0 = automatic
    event_levels: int = 16  # a contact is located to sample_time_s / 2**event_levels
    divergence_mm: float = 1000.0  # |q3| beyond this is reported as diverged

    def __post_init__(self) -> None:
        number("solver.substeps", self.substeps, at_least=0, at_most=10_000)
        number("solver.event_levels", self.event_levels, at_least=0, at_most=30)
        number("solver.divergence_mm", self.divergence_mm, above=0, unit="mm")


@dataclass
class RecordingOutConfig:
    """Where to write what the sensors saw, beside the run folder."""

    save: str | None = None

    def __post_init__(self) -> None:
        if self.save is None:
            return
        path = Path(self.save)
        if path.suffix.lower() not in RECORDING_SUFFIXES:
            raise UserError("recording.save", self.save, "must end in " + " or ".join(RECORDING_SUFFIXES))
        if path.is_dir():
            raise UserError("recording.save", self.save, "is a folder; give a file name")
        if not path.absolute().parent.is_dir():
            raise UserError("recording.save", self.save, "must lie in a folder that exists")


@dataclass
class RunConfig:
    """One closed-loop experiment."""

    rig: RigConfig = field(default_factory=RigConfig)
    controller: ControllerConfig = field(default_factory=ControllerConfig)
    profile: ProfileConfig = field(default_factory=ProfileConfig)
    reference: ReferenceConfig = field(default_factory=ReferenceConfig)
    twin: TwinConfig = field(default_factory=TwinConfig)
    optimizer: OptimizerConfig = field(default_factory=OptimizerConfig)
    sensors: SensorsConfig = field(default_factory=SensorsConfig)
    solver: SolverConfig = field(default_factory=SolverConfig)
    recording: RecordingOutConfig = field(default_factory=RecordingOutConfig)
    duration_s: float = 200.0
    sample_time_s: float = 0.001
    seed: int = 0
    figures: bool = True

    def __post_init__(self) -> None:
        number("sample_time_s", self.sample_time_s, above=0, unit="s")
        number("duration_s", self.duration_s, at_least=10 * self.sample_time_s, unit="s (ten samples)")
        number("seed", self.seed, at_least=0, at_most=2**63 - 1)
        self._check_length()
        self._check_twin()
        self._check_rig()
        nyquist_hz = 0.5 / self.sample_time_s
        if self.reference.kind == "multisine":
            number(
                "reference.f_max_hz",
                self.reference.f_max_hz,
                at_most=nyquist_hz,
                unit="Hz (half the sample rate)",
            )

    @property
    def samples(self) -> int:
        """Number of sample intervals N; the trace has N + 1 rows."""
        return round(self.duration_s / self.sample_time_s)

    def _check_length(self) -> None:
        number(
            "duration_s",
            self.duration_s,
            at_most=SAMPLES_MAX * self.sample_time_s,
            unit="s (20 million samples)",
        )
        rest = abs(self.duration_s / self.sample_time_s - self.samples)
        if rest > 1e-6 * max(1.0, self.samples * 1e-6):
            near = self.samples * self.sample_time_s
            raise UserError("duration_s", self.duration_s, f"must be a whole number of samples, e.g. {near:.9g} s")

    def _check_rig(self) -> None:
        kinds = [element["kind"] for element in self.rig.elements.values()]
        if self.controller.structure == "nimc" and self.rig.elements and "gear" not in kinds:
            raise UserError("controller", self.controller.name, f"needs a rig with a gear; {self.rig.name} has none")
        for kind in ("noise", "resolution"):
            for column in getattr(self.sensors, kind):
                if not any(column.startswith(f"{sensor}_") for sensor in self.rig.sensors):
                    allowed = f"a sensor and its unit, e.g. q3_mm; {self.rig.name} has " + ", ".join(self.rig.sensors)
                    raise UserError(f"sensors.{kind}.{column}", getattr(self.sensors, kind)[column], allowed)

    def _check_twin(self) -> None:
        if self.controller.reconfigure != "never" and self.twin.buffer > self.samples:
            allowed = f"must not be longer than the run ({self.samples} samples)"
            raise UserError("twin.buffer", self.twin.buffer, allowed)
        if self.controller.gap_hat_deg > self.twin.gap_max_deg:
            allowed = f"must be at most twin.gap_max_deg={self.twin.gap_max_deg:g} deg"
            raise UserError("controller.gap_hat_deg", self.controller.gap_hat_deg, allowed)


def _check_input_file(key: str, path: str | None, columns: str) -> None:
    if path is None:
        raise UserError(key, "null", f"give a CSV file with the columns {columns}")
    if not Path(path).is_file():
        raise UserError(key, path, "is not a file; give a CSV file with the columns " + columns)
