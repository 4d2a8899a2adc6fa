"""A designed controller as an FMU for co-simulation: its C file as a slave."""

from __future__ import annotations

from pathlib import Path

from dtbacklash.fmu.description import Model
from dtbacklash.fmu.interface import INPUT, OUTPUT, PARAMETER, Variable
from dtbacklash.fmu.library import read_source, source_of, token_of, write_fmu


def variables(half_gap_rad: float) -> list[Variable]:
    """In the order of the value references of controller.c. half_gap_rad : that it believes in first."""
    return [
        Variable("r", "m", INPUT, "reference of the output"),
        Variable("theta_m", "rad", INPUT, "measured angle of the motor"),
        Variable("q3", "m", INPUT, "measured output"),
        Variable("half_gap", "rad", PARAMETER, "half-gap that the controller believes in", half_gap_rad, tunable=True),
        Variable("u", "V", OUTPUT, "voltage"),
        Variable("held", "1", OUTPUT, "samples in which the last good value stood for one that was not finite"),
    ]


def write_controller(
    source: str, name: str, about: str, half_gap_rad: float, sample_time_s: float, version: int, path: Path, shown: str
) -> None:
    """Write the FMU of a controller's C file.

    Parameters
    ----------
    source : the C file. name : an identifier of C. about : one line. half_gap_rad : that it believes in first.
    version : of FMI, 2 or 3. path : of the new file. shown : the same as the user has written it.

    Raises
    ------
    UserError : see :func:`.library.write_fmu`.
    """
    slave = source + read_source("controller.c")
    model = Model(name, about, token_of(slave), variables(half_gap_rad), sample_time_s)
    write_fmu(model, source_of(slave, model.token, version), {}, version, path, shown)
