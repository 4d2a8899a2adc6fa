"""The schema of ``dtb run``: one dataclass per folder of ``conf/``.

Each ``__post_init__`` refuses values that make no sense on their own; :class:`RunConfig` refuses
combinations. All raise :class:`dtbacklash.errors.UserError` with the dotted key that the user would write.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dtbacklash.config import choices as c
from dtbacklash.config.changes import check_changes
from dtbacklash.config.rig import RigConfig
from dtbacklash.config.setting import INPUT, OUTPUT, check, number, setting
from dtbacklash.errors import UserError

SAMPLES_MAX = 20_000_000  # a trace of this length needs about 2 GB
BANK_MAX = 10_000  # the bank builds a dense matrix of n/10 x n: 80 MB
RECORDING_SUFFIXES = (".csv", ".parquet")
SEED_MAX = 2**63 - 1


@dataclass
class ControllerConfig:
    """The controller: its structure, when the twin may reconfigure it, and its design parameters."""

    name: str = setting("nimc_twin", "name in results; the option's file sets it")
    structure: str = setting(
        "nimc",
        "linear IMC, IMC with a model of the backlash, a PID, an LQG, one with an offset state, an MPC, a law "
        "from a file, or the reference as the rig's input",
        choices=c.STRUCTURES,
    )
    reconfigure: str = setting(
        "reference_change", "when the twin is asked: never, at a reference change, when the novelty index rises",
        choices=c.TRIGGERS,
    )  # fmt: skip
    k_theta_v_per_rad: float = setting(15.0, "gain of the motor's inner loop", above=0)
    prefilter: str = setting(
        "reduced", "`reduced`: 1/(tau_r s + 1) times the inverse of the dominant mode; `none`: 1", choices=c.PREFILTERS
    )
    tau_r_s: float = setting(1.0 / 6.0, "time constant of the reference model", above=0)
    internal_model: str = setting(
        "auto", "what drives the model of the structure: u, theta_m, a model of the inner loop (`inverse`: with an "
        "inverse of the backlash); `exact` (imc): G1 G2 sampled as one; `auto`: inverse where the reference is held or "
        "the estimate is fixed, else inner_loop; see theory.md", choices=c.INTERNAL_MODELS,
    )  # fmt: skip
    crossing: str = setting(
        "hold", "with `inverse`, what a jump of the reference does while the motor crosses the gap", choices=c.CROSSINGS
    )
    crossing_v: float = setting(12.0, "`hold`: steady voltage that crosses the gap, at most", above=0, unit="V")
    limit_v: float | None = setting(
        None, "at which the controller limits its voltage, and its model the model's; null: that of the model's "
        "amplifier, else none", above=0, unit="V",
    )  # fmt: skip
    robust: float | None = setting(
        1.0, "offset: most that the small-gain bound under the rig's tolerances may be; null: as fast as the noise "
        "allows", above=0,
    )  # fmt: skip
    file: str | None = setting(
        None, "state_space: YAML file with the matrices A, B, C, D, E of the law; see controller.md", path=INPUT
    )
    design_from: str = setting("model", "what it is designed for", choices=c.BELIEFS)
    compensate: list[str] = setting(
        lambda: list(c.COMPENSATED), "effects of the model's motor that the voltage compensates; never Coulomb "
        "friction", choices=c.COMPENSATED, shown=f"[{','.join(c.COMPENSATED)}]",
    )  # fmt: skip
    gap_hat_deg: float | None = setting(
        None, "first estimate of the gap; null: that of the model, else 0", at_least=0, at_most=360
    )

    def __post_init__(self) -> None:
        check(self, "controller.")
        if self.internal_model == "exact" and self.structure == "nimc":
            raise UserError("controller.internal_model", "exact", "only structure=imc has a linear internal model")
        if self.reconfigure != "never" and self.structure != "nimc":
            raise UserError("controller.reconfigure", self.reconfigure, "only structure=nimc has a gap to reconfigure")


@dataclass
class ProfileConfig:
    """The gap over time. What a kind does not use it ignores; see :func:`dtbacklash.experiment.signals.gap_profile`."""

    kind: str = setting("s_curve", "how the gap develops", choices=c.PROFILES)
    start_deg: float = setting(0.0, "gap (half-width) at the start", at_least=0, at_most=360)
    end_deg: float = setting(100.0, "gap at the end; with `constant` it follows start_deg", at_least=0, at_most=360)
    t_start_s: float = setting(25.0, "growth begins (`step`: the jump)", at_least=0)
    t_end_s: float = setting(175.0, "growth ends", at_least=0)
    running_in_share: float = setting(0.15, "wear: share of the growth in the running-in phase", at_least=0, at_most=1)
    running_in_span: float = setting(0.1, "wear: time constant of the running-in, as a share of the time", above=0)
    severe_share: float = setting(0.55, "wear: share of the growth in the severe phase", at_least=0, at_most=1)
    severe_from: float = setting(
        0.6, "wear: where the severe phase begins, as a share of the time", at_least=0, below=1
    )
    path: str | None = setting(None, "csv: file with the columns t_s, gap_deg; linear between its rows", path=INPUT)

    def __post_init__(self) -> None:
        check(self, "profile.")
        if self.running_in_share + self.severe_share > 1:
            most = 1 - self.running_in_share
            allowed = f"must be at most {most:g}, as running_in_share={self.running_in_share:g}"
            raise UserError("profile.severe_share", self.severe_share, allowed)
        grows = self.kind in ("s_curve", "ramp", "wear")
        if grows and not self.t_end_s > self.t_start_s:
            raise UserError("profile.t_end_s", self.t_end_s, f"must be above profile.t_start_s={self.t_start_s:g} s")
        if self.kind == "constant" and self.end_deg != self.start_deg:
            raise UserError("profile.end_deg", self.end_deg, "a constant gap is set by profile.start_deg alone")
        if self.kind == "csv":
            _check_input_file("profile.path", self.path, "t_s,gap_deg")


@dataclass
class ReferenceConfig:
    """The reference r over time; see :func:`dtbacklash.experiment.signals.reference`."""

    kind: str = setting("square", "form of the reference", choices=c.REFERENCES)
    amplitude_mm: float = setting(
        1.0, "square, trajectory: + and - this in turn; step: from 0 to this; in open loop write `amplitude_v`",
        at_least=-1e4,
        at_most=1e4,
    )  # fmt: skip
    offset_mm: float = setting(
        0.0, "added to every kind but csv; in open loop write `offset_v`", at_least=-1e4, at_most=1e4
    )
    period_s: float = setting(40.0, "square, trajectory and multisine: period", above=0)
    t_start_s: float = setting(0.0, "step: when", at_least=0)
    move_s: float = setting(1.0, "trajectory: time of a move", above=0)
    step_mm: float = setting(0.5, "staircase: size of a step; in open loop write `step_v`", at_least=-1e4, at_most=1e4)
    dwell_s: float = setting(10.0, "staircase: time on a step", above=0)
    levels: int = setting(4, "staircase: steps up before it goes down again", at_least=1, at_most=1000)
    f_min_hz: float = setting(0.1, "multisine: lowest frequency", above=0)
    f_max_hz: float = setting(2.0, "multisine: highest frequency, at most half the sample rate", above=0)
    rms_mm: float = setting(0.5, "multisine: root mean square; in open loop write `rms_v`", at_least=0, at_most=1e4)
    path: str | None = setting(None, "csv, trajectory: file with the columns t_s, r_mm", path=INPUT)
    interpolation: str = setting("hold", "csv: between its rows", choices=c.INTERPOLATIONS)

    def __post_init__(self) -> None:
        check(self, "reference.")
        if self.kind == "multisine" and self.f_max_hz < self.f_min_hz:
            allowed = f"must be at least reference.f_min_hz={self.f_min_hz:g} Hz"
            raise UserError("reference.f_max_hz", self.f_max_hz, allowed)
        if self.kind == "csv" or (self.kind == "trajectory" and self.path is not None):
            _check_input_file("reference.path", self.path, "t_s,r_mm")
        if self.kind == "trajectory" and 2.0 * self.move_s > self.period_s:
            allowed = f"must be at most half of reference.period_s={self.period_s:g} s"
            raise UserError("reference.move_s", self.move_s, allowed)


@dataclass
class TwinConfig:
    """The digital twin: its link, its buffer, its observer and what it accepts."""

    delay_s: float = setting(4.0, "from the full buffer to the new gap in force", at_least=0)
    buffer: int = setting(1000, "samples of one estimation", unit="samples", at_least=10, at_most=SAMPLES_MAX)
    settle: int = setting(
        400, "samples at its start that do not enter the cost; below twin.buffer", unit="samples", at_least=0
    )
    observer_pole_rad_s: float = setting(40.0, "all poles of the observer lie at minus this", above=0)
    gap_max_deg: float = setting(180.0, "physical bound of an estimate", above=0, at_most=360)
    guard: bool = setting(True, "false: whatever the optimizer returns goes to the controller, as in the paper")
    method: str = setting(
        "auto", "how an estimate explains a buffer: through the structure's linear observer, or by simulating it with "
        "its effects; `auto`: simulate where the model holds effects behind the gear", choices=c.TWIN_METHODS,
    )  # fmt: skip
    on_alarm: str = setting("estimate", "what the twin does when it is asked; see bank.md", choices=c.ON_ALARM)
    bank_buffer: int = setting(
        1500, "samples of one diagnosis by the bank", unit="samples", at_least=500, at_most=BANK_MAX
    )
    bank_rest: int = setting(100, "samples of it before the change of the reference", unit="samples", at_least=0)
    growth_s: float | None = setting(
        None, "for how long after its buffer the gap in force goes on growing as an answer saw it grow; 0: it stays as "
        "estimated, as in the paper; null: 20 where the reference is held, else 0", at_least=0, unit="s",
    )  # fmt: skip
    shading: float | None = setting(
        None, "standard errors by which an estimate is put in force too small; null: 0.5 where the reference is held, "
        "which a gap too large harms no more than one too small, else 1", at_least=0, at_most=10,
    )  # fmt: skip
    estimate_from: str = setting("model", "what the twin takes for the structure", choices=c.BELIEFS)
    novelty_threshold_mm: float = setting(0.1, "novelty index at which the twin is asked", above=0)
    novelty_filter: str = setting("ellip", "low-pass of the index: elliptic or Chebyshev II", choices=c.NOVELTY_FILTERS)
    indexes: list[str] = setting(
        list, "further novelty indexes, each a column of the trace and an alarm of its own", choices=c.INDEXES,
        shown="[]",
    )  # fmt: skip
    frequency_threshold: float = setting(
        0.08, "alarm: the mode's frequency is off by this share of the believed one", above=0, below=1
    )
    frequency_amplitude_mm: float = setting(
        0.02, "amplitude of the mode below which its frequency says nothing", above=0
    )
    motor_threshold_n_m: float = setting(
        0.005, "alarm: torque that the motor's model does not explain, rms", unit="N m", above=0
    )
    structure_threshold_mm: float = setting(0.02, "alarm: output error behind the gap in force, rms", above=0)
    index_hysteresis: float = setting(
        0.7, "share of its threshold below which an index may raise its next alarm", above=0, at_most=1
    )
    where: str = setting("local", "in this process, or at an MQTT broker (dtb twin serve)", choices=c.TWIN_PLACES)
    broker: str = setting("127.0.0.1:1883", "remote: where the MQTT broker is, host:port")
    machine: str = setting("machine", "remote: name of this machine, in the topics and for its key")
    timeout_s: float = setting(
        10.0, "remote: how long a request waits for its answer, wall clock; then the gap in force stays",
        above=0, at_most=86400,
    )  # fmt: skip
    credentials: str | None = setting(
        None, "remote: file of mode 600 with user, password and key; null: from the environment", path=INPUT
    )

    def __post_init__(self) -> None:
        check(self, "twin.")
        for key, limit in (("settle", "buffer"), ("bank_rest", "bank_buffer")):
            value, below = getattr(self, key), getattr(self, limit)
            if value >= below:
                raise UserError(f"twin.{key}", value, f"must be below twin.{limit}={below} samples")


@dataclass
class OptimizerConfig:
    """The search for the gap: its method and when it stops."""

    name: str = setting("bfgs", "method: BFGS of the core, or one of scipy.optimize", choices=c.OPTIMIZERS)
    max_evaluations: int = setting(200, "evaluations of the cost, at most", at_least=2, at_most=1_000_000)
    tolerance: float = setting(1e-6, "tolerance at which the method stops, as scipy defines it", above=0, below=1)

    def __post_init__(self) -> None:
        check(self, "optimizer.")


@dataclass
class SensorsConfig:
    """Per column: noise (standard deviation) and resolution (size of one count); 0 = none."""

    noise: dict[str, float] = setting(dict, "column of the trace -> standard deviation, e.g. sensors.noise.q3_mm=0.001")
    resolution: dict[str, float] = setting(
        dict, "column of the trace -> size of a count, e.g. sensors.resolution.theta_m_rad=0.0015"
    )

    def __post_init__(self) -> None:
        for kind in ("noise", "resolution"):
            for column, size in getattr(self, kind).items():
                number(f"sensors.{kind}.{column}", size, at_least=0, unit="(0 = none)")


@dataclass
class SolverConfig:
    """Accuracy of the simulation."""

    substeps: int = setting(0, "steps a sample; 0: 1 where that is exact, else 8", at_least=0, at_most=10_000)
    event_levels: int = setting(16, "a contact is located to sample_time_s / substeps / 2^this", at_least=0, at_most=30)
    divergence_mm: float = setting(1000.0, "a loop whose q3 goes beyond this has diverged", above=0)

    def __post_init__(self) -> None:
        check(self, "solver.")


@dataclass
class RecordingOutConfig:
    """Where to write what the sensors saw, beside the run folder."""

    save: str | None = setting(
        None, "file to which what the sensors saw is also written: .csv or .parquet", path=OUTPUT
    )

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
    model: RigConfig | None = setting(
        None, "what controller and twin believe of the rig; null: its own parameters, without effects"
    )
    controller: ControllerConfig = field(default_factory=ControllerConfig)
    profile: ProfileConfig = field(default_factory=ProfileConfig)
    reference: ReferenceConfig = field(default_factory=ReferenceConfig)
    twin: TwinConfig = field(default_factory=TwinConfig)
    optimizer: OptimizerConfig = field(default_factory=OptimizerConfig)
    sensors: SensorsConfig = field(default_factory=SensorsConfig)
    solver: SolverConfig = field(default_factory=SolverConfig)
    recording: RecordingOutConfig = field(default_factory=RecordingOutConfig)
    duration_s: float = setting(200.0, "length of the run, a whole number of samples", above=0)
    sample_time_s: float = setting(0.001, "sample time of the controller and of the trace", above=0)
    seed: int = setting(0, "seed of noise, random references and random optimizers", at_least=0, at_most=SEED_MAX)
    changes: list[Any] = setting(
        list, "later changes of the machine, each {at_s: s, parameters: {name: value}, effects: {element: {effect: "
        "{parameter: value}}}}, SI; the gap grows by profile.*", shown="[]",
    )  # fmt: skip
    task: str = setting(
        "run", "one run; or record in the loop, diagnose, and run with what was found (experiment=close_the_loop)",
        choices=c.TASKS,
    )  # fmt: skip
    pace: str = setting(
        "free", "as fast as it goes, or every sample at its instant of the wall clock, with the twin in a process of "
        "its own; the deadlines that were missed are then in summary.json (`pace`)", choices=c.PACES,
    )  # fmt: skip
    uncertainty: str | None = setting(
        None, "FOLDER of the diagnosis that found the rig: draw the 95 % band of what its parameters may be off by",
        path=INPUT,
    )  # fmt: skip
    figures: bool = setting(True, "false: no figures, also not in report.html")

    def __post_init__(self) -> None:
        number("sample_time_s", self.sample_time_s, above=0, unit="s")
        number("duration_s", self.duration_s, at_least=10 * self.sample_time_s, unit="s (ten samples)")
        check(self)
        self._check_length()
        self._check_twin()
        self._check_task()
        check_changes(self.changes, self.duration_s, self.sample_time_s)
        self._check_model()
        self._check_rig()
        if self.reference.kind == "multisine":
            nyquist_hz = 0.5 / self.sample_time_s
            number("reference.f_max_hz", self.reference.f_max_hz, at_most=nyquist_hz, unit="Hz (half the sample rate)")

    @property
    def samples(self) -> int:
        """Number of sample intervals N; the trace has N + 1 rows."""
        return round(self.duration_s / self.sample_time_s)

    def _check_length(self) -> None:
        longest_s = SAMPLES_MAX * self.sample_time_s
        number("duration_s", self.duration_s, at_most=longest_s, unit="s (20 million samples)")
        rest = abs(self.duration_s / self.sample_time_s - self.samples)
        if rest > 1e-6 * max(1.0, self.samples * 1e-6):
            near = self.samples * self.sample_time_s
            raise UserError("duration_s", self.duration_s, f"must be a whole number of samples, e.g. {near:.9g} s")

    def _check_rig(self) -> None:
        sensors = tuple(f"{sensor}_" for sensor in self.rig.sensors)
        for kind in ("noise", "resolution"):
            for column, size in getattr(self.sensors, kind).items():
                if not column.startswith(sensors):
                    allowed = f"a sensor and its unit; {self.rig.name} has {', '.join(self.rig.sensors)}"
                    allowed += " (sensors=encoder is the lead screw's; sensors=ideal fits each rig)"
                    raise UserError(f"sensors.{kind}.{column}", size, allowed)

    def _check_model(self) -> None:
        if self.model is not None and self.controller.structure == "open_loop":
            raise UserError("model", self.model.name, "open loop uses no model; leave it out")

    def _check_task(self) -> None:
        if self.task == "run":
            return
        if self.twin.where == "remote":
            allowed = "closing the loop makes several runs, with a twin of its own"
            raise UserError("twin.where", self.twin.where, allowed)
        if self.controller.reconfigure == "never":
            raise UserError("controller", self.controller.name, "closing the loop needs one that the twin reconfigures")
        if self.uncertainty is not None:
            raise UserError("uncertainty", self.uncertainty, "closing the loop makes several runs")
        if self.pace != "free":
            raise UserError("pace", self.pace, "closing the loop makes several runs; give dtb run one of them")
        if self.recording.save is not None:
            raise UserError("recording.save", self.recording.save, "closing the loop makes several runs")
        beliefs = {"controller.design_from": self.controller.design_from, "twin.estimate_from": self.twin.estimate_from}
        for key, source in beliefs.items():
            if source != "model":
                raise UserError(key, source, "closing the loop runs with each belief in turn; leave it out")

    def _check_twin(self) -> None:
        if self.controller.reconfigure != "never":
            name = "bank_buffer" if self.twin.on_alarm == "bank" else "buffer"
            length = getattr(self.twin, name)
            if length > self.samples:
                raise UserError(f"twin.{name}", length, f"must not be longer than the run ({self.samples} samples)")
            least = self.twin.bank_rest + self.twin.settle
            if self.twin.on_alarm == "bank" and length <= least:
                allowed = f"must be above twin.bank_rest + twin.settle = {least} samples"
                raise UserError("twin.bank_buffer", length, allowed)
        if (self.controller.gap_hat_deg or 0.0) > self.twin.gap_max_deg:
            allowed = f"must be at most twin.gap_max_deg={self.twin.gap_max_deg:g} deg"
            raise UserError("controller.gap_hat_deg", self.controller.gap_hat_deg, allowed)


def _check_input_file(key: str, path: str | None, columns: str) -> None:
    if path is None:
        raise UserError(key, "null", f"give a CSV file with the columns {columns}")
    if not Path(path).is_file():
        raise UserError(key, path, "is not a file; give a CSV file with the columns " + columns)
