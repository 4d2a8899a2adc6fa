"""Recordings from files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dtbacklash.api.in_python import speaks_python
from dtbacklash.api.rigs import RigLike, load_rig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dtbacklash.recording import Recording


def read_recording(
    source: str | Path,
    rig: RigLike | None = None,
    *,
    path: str | Path | None = None,
    part: str | None = None,
    sample_time_s: float | None = None,
    units: Mapping[str, str] | None = None,
    trust_units: bool = False,
    command: str | None = None,
    rows: Sequence[int] | None = None,
) -> Recording:
    """Read and check a recording: CSV and other text, Parquet, ``.mat``, ``.npz``, also gzipped; or one with a mapping.

    Parameters
    ----------
    source : the path of a file with the columns ``t``, ``u`` and the rig's sensors; or the name of a mapping, as in
        ``dtb recordings``, with ``name:part`` for one of its parts.
    rig : tells which sensors there are and in which units; a rig, a name, a file or a mapping.
    path : the file of a mapping, where it is not in the usual places.
    part : the part of a mapping; None: its part ``train`` if it has one, else all.
    sample_time_s : for a file without a time column, s.
    units : channel -> unit of its column (``{"q3": "mm"}``); overrules mapping, header and rig. Without any of them
        values are in SI. ``assumed_units`` of the result lists the unit of each channel.
    trust_units : a diagnosis skips the check that the sizes of the channels are possible for the rig.
    command : course of ``u`` between two samples: ``held`` or ``band_limited``; ``none``: there was no command, and a
        column ``u`` is not needed. None: as the mapping says, else held.
    rows : first row and the one after the last, counted from 0; None: all.

    Returns
    -------
    The recording in SI on a uniform grid: ``t_s`` (N,), ``channels`` name -> (N,), ``units``, and ``notes`` of
    defects and their treatment.

    Raises
    ------
    UserError : there is no such file, it cannot be read, or it has a defect that cannot be repaired.

    Examples
    --------
    >>> import numpy as np, pandas as pd
    >>> import dtbacklash as dtb
    >>> from tempfile import TemporaryDirectory
    >>> t = 1e-3 * np.arange(500)
    >>> frame = pd.DataFrame({"t": t, "u [mV]": 1e3 * np.cos(9 * t), "theta [deg]": np.cos(7 * t)})
    >>> with TemporaryDirectory() as folder:
    ...     frame.to_csv(f"{folder}/bench.csv", index=False)
    ...     print(dtb.read_recording(f"{folder}/bench.csv", rig="pendulum"))
    bench.csv: 500 samples, 0.001 s apart, from 0 s
      u      -1 to 1 V   read in mV (header)
      theta  -0.01745 to 0.01745 rad   read in deg (header)
      Units: t in s (taken as SI, since nothing is said).
    """
    from dtbacklash.recording import read_recording as read

    known = None if rig is None else load_rig(rig)
    with speaks_python():
        return read(
            source, path=None if path is None else str(path), part=part, rig=known, sample_time_s=sample_time_s,
            units=units, trust_units=trust_units, command=command, rows=rows,
        )  # fmt: skip


def plot_recording(recording: Recording) -> Figure:
    """Draw the channels of a recording as they were read, in a panel each, without pyplot.

    Examples
    --------
    >>> import numpy as np, pandas as pd
    >>> import dtbacklash as dtb
    >>> t = 1e-3 * np.arange(500)
    >>> frame = pd.DataFrame({"t": t, "u": np.sin(9 * t), "x [mm]": np.cos(7 * t)})
    >>> figure = dtb.plot_recording(dtb.Recording.from_frame(frame))
    >>> [ax.get_ylabel() for ax in figure.axes]
    ['u [V]', 'x [mm]']
    """
    from dtbacklash.report.components.channels import channels_figure

    return channels_figure(recording.t_s, dict(recording.channels), recording.units, recording.stretches)
