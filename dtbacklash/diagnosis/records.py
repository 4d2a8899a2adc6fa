"""Records: what a diagnosis looks at of its recordings, a stretch without a gap each."""

from dataclasses import dataclass, field, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.resampling import noise_of
from dtbacklash.diagnosis.settings import SETTINGS
from dtbacklash.errors import UserError
from dtbacklash.physics.mjcf import steps_roughly
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.channels import filled
from dtbacklash.recording.mapping import Channel
from dtbacklash.recording.model import Recording
from dtbacklash.recording.refusal import SAMPLES_MIN

#: a shorter stretch beside others shows mostly the state in which it began (samples)
STRETCH_SAMPLES_MIN = 200
#: a recording without a command is looked at in so many pieces, of so many samples at least
PIECES, PIECE_SAMPLES_MIN = 100, 20
#: a channel moves in a piece where its standard deviation there is so many times its noise (ratio)
MOVES = 2.0
#: so much rest is kept: friction holds a machine that a constant load would move on (share of the motion)
RESTS = 0.05
#: taps to each side of the interpolation of a smooth command
REACH = 24

#: of what is fitted to, and of what judges, there are so many samples at least
PART_SAMPLES_MIN = 50

SMOOTH = "The command is a measured signal: it passes smoothly through its samples instead of being held."
AFTER = "What senses acceleration was read just after the command had stepped, not just before."

STRAIGHT = "The command goes straight from each logged value to the next instead of being held."
STEPPED = "The log follows the model's own steps, which move positions half a step early: a simulation made it."
COURSES = (SMOOTH, AFTER, STRAIGHT, STEPPED)
UNLOGGED = "what the command may have done between its logged values, which this log does not hold"

UNCOMMANDED = "Nothing was commanded (u is 0): the state in which it begins is all that moves the machine."

Mask = np.ndarray


@dataclass(frozen=True)
class Record:
    """One recording, or one stretch of it, on its grid.

    u : (N,) command, V. inputs : (N, commands) of a model, in the order of the rig's; None: u alone. y : channel ->
    (N,) measured, SI, NaN where a reading is missing. train, held : (N,) masks of the samples that are fitted to, and
    that are held out. from_s : time of its first sample since the recording began, s. recording, name : number, from 0,
    and name of the recording that it is or belongs to. at_once : (N,) the command that a sensor of acceleration shows;
    None: that which was held until then. columns : channel -> what it was read from. otherwise : (N,) the command as it
    may as well have been between its logged values; None where all of it was logged. as_stepped : whether a simulator's
    own steps made it, as they are. retimed : whether a sensor had a clock of its own, which was set right.
    """

    sample_time_s: float
    u: Floats
    y: dict[str, Floats]
    train: Mask
    held: Mask
    from_s: float = 0.0
    recording: int = 0
    name: str = ""
    at_once: Floats | None = None
    columns: dict[str, Channel] = field(default_factory=dict)
    otherwise: Floats | None = None
    inputs: Floats | None = None
    as_stepped: bool = False
    retimed: bool = False

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.u)

    @property
    def driven(self) -> bool:
        """Whether a command changes."""
        return bool(np.any(np.ptp(self.u if self.inputs is None else self.inputs, axis=0)))


def records_of(
    recording: Recording, rig: Rig, train: bool, held: bool, share: float | None = None, number: int = 0
) -> list[Record]:
    """The stretches of a recording with their masks: all samples for one purpose, or the last ``share`` held out.

    share : None: as in the settings. number : of the recording.
    """
    n = recording.samples
    share = SETTINGS.held_out_share if share is None else share
    cut_at = n - round(share * n) if train and held else n * train
    mask = np.arange(n) < cut_at
    columns = {c: np.ascontiguousarray(v, dtype=float) for c, v in recording.channels.items()}
    measured = {c: v for c, v in columns.items() if c in rig.sensors}
    inputs = np.column_stack([columns[c] for c in rig.config.commands]) if rig.config.commands else None
    return [
        Record(
            recording.sample_time_s, columns["u"][a:b], {c: v[a:b] for c, v in measured.items()}, mask[a:b], ~mask[a:b],
            float(recording.t_s[a] - recording.t_s[0]), number, columns=recording.columns,
            otherwise=None if recording.straight is None or rig.config.model else recording.straight[a:b],
            inputs=None if inputs is None else inputs[a:b],
        )
        for a, b in recording.stretches
    ]  # fmt: skip


def long_enough(records: list[Record]) -> tuple[list[Record], tuple[str, ...]]:
    """The records without the short stretches of recordings that have several, and a note on those that are left out.

    Nothing is left out if no training or no held-out part would remain.
    """
    stretches = [r for r in records if sum(other.recording == r.recording for other in records) > 1]
    short = [r for r in stretches if r.samples < STRETCH_SAMPLES_MIN]
    kept = [r for r in records if not any(r is s for s in short)]
    if not short or not any(r.train.any() for r in kept) or not any(r.held.any() for r in kept):
        return records, ()
    count, lost = len(short), sum(r.samples for r in short)
    return kept, (
        f"{count} of {len(stretches)} stretches ({lost} samples) {'is' if count == 1 else 'are'} left out, being "
        f"shorter than {STRETCH_SAMPLES_MIN} samples: too short beside the state in which a stretch begins.",
    )


def check_parts(records: list[Record], given: tuple[str, object]) -> None:
    """Refuse recordings of which too little is fitted to or judges.

    given : key and value of what the user chose the parts by.

    Raises
    ------
    UserError : with that key.
    """
    counts = {
        "to fit to": sum(int(r.train.sum()) for r in records), "to judge on": sum(int(r.held.sum()) for r in records)
    }  # fmt: skip
    least = min(counts, key=lambda part: counts[part])
    if counts[least] < PART_SAMPLES_MIN:
        raise UserError(*given, f"leaves {counts[least]} samples {least}, and at least {PART_SAMPLES_MIN} are needed")


def while_it_moves(recording: Recording, rig: Rig) -> Recording:
    """A recording up to where its machine comes to rest and nothing is commanded, with a note; else as it is.

    Rest says nothing: a part that rests would be chosen and judged by noise alone. Without a command, the first state
    moves the machine.
    """
    commanded = np.flatnonzero(np.any([recording.channels[c] for c in rig.config.commands or ("u",)], axis=0))
    end = max((_end(filled(v)) for name, v in recording.channels.items() if name in rig.sensors), default=0)
    if len(commanded):
        said, most = [], round((1.0 - SETTINGS.held_out_share) * recording.samples)
        end = max(end, int(commanded[-1]) + 1)
    else:
        said, most = [UNCOMMANDED], recording.samples - 1
    if SAMPLES_MIN <= end <= most:
        said.append(f"What comes after {recording.t_s[end] - recording.t_s[0]:.4g} s is left out: there it rests.")
        recording = recording.section(0, end)
    return replace(recording, notes=[*recording.notes, " ".join(said)]) if said else recording


def _end(values: Floats) -> int:
    """The first sample after the last piece in which a channel moves; 0 where it never does."""
    length = max(PIECE_SAMPLES_MIN, len(values) // PIECES)
    pieces = values[: len(values) // length * length].reshape(-1, length)
    moving = np.flatnonzero(pieces.std(axis=1) > MOVES * noise_of(values)[0])
    if not len(moving):
        return 0
    return min(len(values), round((1.0 + RESTS) * (int(moving[-1]) + 1) * length))


def ways_to_read(records: list[Record], rig: Rig) -> dict[str, list[Record]]:
    """What is said -> the same records with another course of the command between its samples, where it matters."""
    if rig.config.model:
        roughly = rig.config.simulator == "mujoco" and steps_roughly(rig.config)
        return {STEPPED: [replace(r, as_stepped=True) for r in records]} if roughly else {}
    found = {}
    if any(r.otherwise is not None for r in records):
        found[STRAIGHT] = [r if r.otherwise is None else replace(r, u=r.otherwise, otherwise=r.u) for r in records]
    if rig.only("actuator") is None or not any(np.any(r.u) for r in records):
        return found
    found |= {SMOOTH: [replace(r, u=held_equivalent(r.u), at_once=r.u) for r in records]}
    if any(rig.sensors[c].quantity == "acceleration" for r in records for c in r.y if c in rig.sensors):
        found[AFTER] = [replace(r, at_once=r.u) for r in records]
    return found


def held_equivalent(u: Floats) -> Floats:
    """(N,) the command that, when each value is held over its sample, acts as the smooth signal through ``u`` does.

    A measured input passes through its samples; held in the simulation it would come half a sample late, which looks
    like a delay or a wrong damping. So it is taken half a sample ahead, and divided by the spectrum of the hold,
    ``sin(x)/x`` with ``x = omega h/2``: the inverse Fourier transform of ``exp(i x) x/sin(x)``, windowed.
    """
    omega = np.linspace(-np.pi, np.pi, 4097)
    x = 0.5 * omega
    gain = np.divide(x, np.sin(x), out=np.ones_like(x), where=np.abs(x) > 1e-9)
    n = np.arange(-REACH, REACH)
    taps = np.array([np.trapezoid(gain * np.cos(omega * (k + 0.5)), omega) / (2.0 * np.pi) for k in n])
    taps *= np.kaiser(2 * REACH + 1, 8.0)[:-1]
    taps /= taps.sum()
    padded = np.concatenate([np.full(REACH, u[0]), u, np.full(REACH, u[-1])])
    # value k lies between u[k] and u[k + 1]: taps n weigh u[k - n]
    return np.ascontiguousarray(np.convolve(padded, taps, "full")[2 * REACH : 2 * REACH + len(u)])
