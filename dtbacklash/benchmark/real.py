"""Recordings of real machines with published values: copied where their licence allows, else to be fetched."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import pandas as pd

from dtbacklash.scoring.truth import Hidden

#: licences that allow a copy
COPYABLE = ("BSD-3-Clause", "CC BY-SA 4.0")
EMPS = (
    Hidden("carriage", "viscous_friction", 203.5, "N s/m"), Hidden("carriage", "coulomb_friction", 20.39, "N"),
    Hidden("carriage", "constant_force", -3.165, "N"),
)  # fmt: skip
#: the authors also publish a friction that differs between the directions
EMPS_ALLOWED = (("carriage", "asymmetric_friction"), ("carriage", "stribeck_friction"))
COGGING, BACKLASH = (Hidden("rotor", "cogging"),), (Hidden("joint", "backlash"),)


@dataclass(frozen=True)
class Real:
    """One recording. source : as ``recording=`` takes it. file : of its mapping; empty: the default."""

    source: str
    file: str
    hidden: tuple[Hidden, ...]
    allowed: tuple[tuple[str, str], ...] = ()

    @property
    def mapping(self) -> str:
        """The name of its mapping."""
        return self.source.partition(":")[0]


#: the sources of the values stand in docs/real-recordings.md
RECORDINGS = (
    Real("emps:first", "", EMPS, EMPS_ALLOWED),
    Real("emps:second", "", EMPS, EMPS_ALLOWED),
    Real("silverbox:train", "", (Hidden("link_1", "cubic_stiffness"),)),
    Real("silverbox:arrow", "", (Hidden("link_1", "cubic_stiffness"),)),
    Real(
        "disk", "", (Hidden("disk", "gravity"), Hidden("disk", "coulomb_friction"), Hidden("amplifier", "delay")),
    ),
    Real("anticogging:off", "", COGGING),
    Real("anticogging:on", "", COGGING),
    Real("brfd", "dataset-2_0.5Hz_30lb_1in.json", BACKLASH),
    Real("brfd", "dataset-2_0.25Hz_30lb_0.5in.json", BACKLASH),
    Real("brfd", "dataset-1_0.5Hz_20lb.json", BACKLASH),
)  # fmt: skip


def about(real: Real) -> dict[str, Any]:
    """Title and licence of a recording, how to cite it, and how to fetch it."""
    from dtbacklash.recording.mapping import load_mapping

    mapping = load_mapping(real.mapping)
    return {
        "machine": mapping.rig, "title": mapping.title, "licence": mapping.licence, "cite": mapping.citation,
        "page": mapping.page, "file": real.file or mapping.file,
        "fetch": f"dtb recordings fetch {real.mapping}", "part": real.source.partition(":")[2],
    }  # fmt: skip


def table(real: Real) -> tuple[pd.DataFrame, dict[str, str]] | None:
    """A recording in SI and the units of its columns; None if its licence allows no copy, or it is not here."""
    from dtbacklash.benchmark.files import nominal
    from dtbacklash.recording import locate, read_recording
    from dtbacklash.recording.mapping import load_mapping

    mapping = load_mapping(real.mapping)
    file = real.file or mapping.file
    if mapping.licence not in COPYABLE or not file:
        return None
    path = locate.find(mapping, file)
    if path is None:
        print(f"dtb: {file} is not here: the case says how to fetch it ({real.mapping})", file=sys.stderr)
        return None
    rig = nominal(str(mapping.rig))
    found = read_recording(real.source, path=str(path), rig=rig)
    return pd.DataFrame({"t": found.t_s, **found.channels}), {"t": "s", **found.units}
