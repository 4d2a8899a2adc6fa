"""What a recording is once it has been read and checked."""

from __future__ import annotations

from collections.abc import Mapping as Dict
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from dtbacklash import units as table_of_units
from dtbacklash.arrays import Floats
from dtbacklash.errors import UserError
from dtbacklash.recording.clean import clean
from dtbacklash.recording.command import HELD, stepped
from dtbacklash.recording.mapping import Channel
from dtbacklash.recording.pick import pick
from dtbacklash.recording.prepare import cut, detrended, resampled
from dtbacklash.recording.refusal import SAMPLES_MIN, Refused
from dtbacklash.recording.tables import frame_table

if TYPE_CHECKING:
    import pandas as pd

    from dtbacklash.physics.rig import Rig

__all__ = ["Recording", "Refused", "refined", "split"]


@dataclass(frozen=True)
class Recording:
    """A recording on a uniform time grid, in SI units; where it has gaps, in several stretches of one.

    Attributes
    ----------
    name : name of the mapping, of the file, or as given.
    source : the file that was read; None for a recording that came from Python.
    sample_time_s : time between two samples, s.
    t_s : (N,) time of each sample as recorded (it need not start at 0, and jumps from stretch to stretch), s.
    channels : name -> (N,) values in SI units, NaN where a sensor that is read more seldom was not.
    units : name -> SI unit.
    assumed_units : name (and ``t``) -> the unit in which it was read and who says so: ``m (assumed)``,
        ``mm (declared by the rig)``, ``mm (header)``, ``mm (mapping)``, ``mm (given)``.
    notes : one sentence for each thing that was found and how it was handled.
    citation, licence : of a published recording, else empty.
    rig : the rig that it was recorded on, where the mapping says so.
    splits : the parts that the mapping names, as half-open ranges of rows of the file.
    part : which of them this is, or empty for the whole file.
    command : what ``u`` does between two samples: ``held``, ``band_limited``, or ``none`` (see :mod:`.command`).
    stretches : half-open ranges of samples without a gap, in their order; they hold all N. One if nothing is given.
    trust_units : whether a diagnosis takes the units as they are (:mod:`.wrong_units`).
    columns : name -> the column that it was read from, and how.
    straight : (N,) the command if it goes straight from one logged value to the next, V, where it was logged more
        seldom than the sensors; else None. ``channels["u"]`` is the command if each value is held.
    """

    name: str
    source: Path | None
    sample_time_s: float
    t_s: Floats
    channels: dict[str, Floats]
    units: dict[str, str]
    notes: list[str] = field(default_factory=list)
    citation: str = ""
    licence: str = ""
    rig: str | None = None
    splits: dict[str, tuple[int, int]] = field(default_factory=dict)
    part: str = ""
    command: str = HELD
    assumed_units: dict[str, str] = field(default_factory=dict)
    stretches: tuple[tuple[int, int], ...] = ()
    trust_units: bool = False
    columns: dict[str, Channel] = field(default_factory=dict)
    straight: Floats | None = None

    def __post_init__(self) -> None:
        if not self.stretches:
            object.__setattr__(self, "stretches", ((0, len(self.t_s)),))

    @classmethod
    def from_frame(
        cls,
        frame: pd.DataFrame,
        *,
        units: Dict[str, str] | None = None,
        rig: Rig | None = None,
        name: str = "frame",
        sample_time_s: float | None = None,
        command: str = HELD,
        trust_units: bool = False,
    ) -> Recording:
        """Make a recording from a DataFrame, by the rules of a file.

        Parameters
        ----------
        frame : a row a sample; columns ``u`` and the sensors, also as ``q3 [mm]`` or ``q3_mm``; the time in a column
            ``t`` or in the index (s, or times of pandas).
        units : channel -> unit of its column, before all that header and rig say. Without any: SI.
        rig : tells which sensors there are, in which units they are recorded, and what signals to expect.
        name : for messages and reports. sample_time_s : of a frame without times. command : see :mod:`.command`.
        trust_units : a diagnosis does not ask whether the channels' sizes are what the rig can do.

        Raises
        ------
        UserError : with the key ``recording``: what is wrong with the frame.

        Examples
        --------
        >>> import numpy as np, pandas as pd
        >>> t = 1e-3 * np.arange(500)
        >>> frame = pd.DataFrame({"t": t, "u": np.sin(9 * t), "x [mm]": np.cos(7 * t)})
        >>> recording = Recording.from_frame(frame, units={"u": "V"})
        >>> recording.sample_time_s, recording.units
        (0.001, {'u': 'V', 'x': 'm'})
        """
        try:
            table = frame_table(frame)
            picked = pick(table, rig, units or {})
            found = clean(picked, rig, table.notes, command, sample_time_s)
        except Refused as refusal:
            raise UserError("recording", name, str(refusal)) from refusal
        return cls(name, None, command=command, trust_units=trust_units, **found)

    def to_frame(self) -> pd.DataFrame:
        """The recording as a DataFrame, a row a sample, with its units (SI) in its columns: ``t_s, u_v, q3_m``.

        ``Recording.from_frame`` and, once written to a file, ``read_recording`` give the same recording again.
        """
        import pandas as pd

        def column(name: str, unit: str) -> str:
            return f"{name}_{table_of_units.suffix(unit)}" if unit else name

        columns = {column(name, self.units[name]): values for name, values in self.channels.items()}
        return pd.DataFrame({"t_s": self.t_s, **columns})

    def __str__(self) -> str:
        """What it holds in a few lines: its clock, each channel's range in SI and what it was read in, the notes."""
        part = f", part {self.part}" if self.part else ""
        clock = f"{self.samples} samples, {self.sample_time_s:.6g} s apart, from {self.t_s[0]:.6g} s"
        width = max(map(len, self.channels), default=0)
        lines = [f"{self.name}{part}: {clock}"]
        for name, values in self.channels.items():
            said = self.assumed_units.get(name, "")
            read = f"   read in {said}" if said else ""
            lines.append(f"  {name:<{width}}  {values.min():.4g} to {values.max():.4g} {self.units[name]}{read}")
        return "\n".join([*lines, *(f"  {note}" for note in self.notes)])

    def __repr__(self) -> str:
        return f"<Recording: {self.name}, {self.samples} samples, {', '.join(self.channels)}>"

    def _repr_html_(self) -> str:
        """A row a channel, for a notebook."""
        import pandas as pd

        rows = {
            name: (values.min(), values.max(), self.units[name], self.assumed_units.get(name, ""))
            for name, values in self.channels.items()
        }
        table = pd.DataFrame.from_dict(rows, orient="index", columns=["lowest", "highest", "unit", "read in"])
        return str(table.rename_axis(columns=repr(self)[1:-1]).to_html())

    @property
    def samples(self) -> int:
        """Number of samples N."""
        return len(self.t_s)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample, without the gaps, s."""
        return self.sample_time_s * (self.samples - len(self.stretches))

    def cut(self, from_s: float | None = None, to_s: float | None = None) -> Recording:
        """What lies from ``from_s`` to ``to_s`` of its clock, s; None: its beginning, its end.

        Raises
        ------
        UserError : fewer than 100 samples lie there.

        Examples
        --------
        >>> import numpy as np, pandas as pd
        >>> t = 1e-3 * np.arange(2000)
        >>> recording = Recording.from_frame(pd.DataFrame({"t": t, "u": np.sin(9 * t), "x [mm]": 3.0 + np.cos(7 * t)}))
        >>> part = recording.cut(0.5, 1.5).detrend("x").resample(0.002)
        >>> part.samples, part.sample_time_s, bool(abs(part.channels["x"].mean()) < 0.01)
        (501, 0.002, True)
        """
        return cut(self, from_s, to_s)

    def detrend(self, *channels: str, trend: str = "constant") -> Recording:
        """Channels without their means, or with ``trend="linear"`` without their lines; without names: all sensors'.

        Raises
        ------
        UserError : no such channel, or no such trend.
        """
        names = channels or [name for name in self.channels if name not in ("r", "u")]
        return detrended(self, dict.fromkeys(names, trend))

    def resample(self, sample_time_s: float) -> Recording:
        """The recording at a slower rate, low-passed first. sample_time_s : a whole multiple of its own.

        Raises
        ------
        UserError : it is none, or too few samples are left.
        """
        return resampled(self, sample_time_s)

    def section(self, start: int, stop: int) -> Recording:
        """The samples ``start`` to ``stop - 1``."""
        channels = {name: values[start:stop] for name, values in self.channels.items()}
        ends = [(max(a, start) - start, min(b, stop) - start) for a, b in self.stretches]
        stretches = tuple((a, b) for a, b in ends if a < b)
        straight = None if self.straight is None else self.straight[start:stop]
        return replace(self, t_s=self.t_s[start:stop], channels=channels, stretches=stretches, straight=straight)


def refined(recording: Recording, parts: int = 4) -> tuple[Floats, int]:
    """Return the command in steps that may be held, and how many of them make a sample: :func:`.command.stepped`.

    Raises
    ------
    UserError : the recording has a gap, so that it cannot be simulated through; take :meth:`Recording.section` of a
        stretch.
    """
    if len(recording.stretches) > 1:
        raise UserError("recording", recording.name, f"has {len(recording.stretches)} stretches; take one of them")
    return stepped(recording.channels["u"], recording.command, parts)


def split(recording: Recording, share: float = 0.3) -> tuple[Recording, Recording]:
    """Hold out the last ``share`` of a recording.

    Returns
    -------
    The part to fit and the part to judge on.

    Raises
    ------
    UserError : the share is not between 0 and 1, or leaves a part with fewer than 100 samples.
    """
    if not 0.0 < share < 1.0:
        raise UserError("held_out", share, "must be above 0 and below 1")
    cut = recording.samples - round(share * recording.samples)
    if min(cut, recording.samples - cut) < SAMPLES_MIN:
        allowed = f"leaves a part with fewer than {SAMPLES_MIN} of the {recording.samples} samples"
        raise UserError("held_out", share, f"{allowed}; give a longer recording")
    return recording.section(0, cut), recording.section(cut, recording.samples)
